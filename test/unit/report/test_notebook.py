"""Results and models in a notebook: figures on axes, HTML, short representations, errors."""

import inspect
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from pkgutil import iter_modules, resolve_name

import matplotlib as mpl
import numpy as np
import pytest

import robot_energy as re
import robot_energy.results as energy_results
import robot_energy_fleet.results as fleet_results
import robot_energy_identify.results as identify_results
import robot_energy_plan.results as plan_results
from robot_energy.foundation.errors import ColumnError, MissingExtraError
from robot_energy.results.base import Result
from robot_energy_report.document import DOCUMENTS

mpl.use("Agg")
BAGS = Path(__file__).resolve().parents[3] / "bags"
PROGRAM = BAGS.parent / "src/examples/programs/kr16_pick_and_place.yaml"


@pytest.fixture(scope="module")
def result():
    return re.replay(BAGS / "kr16_cold", "kr16", end=3.0)


@pytest.fixture(scope="module")
def predicted():
    return re.predict(PROGRAM, "kr16", 20.0)


def test_power_is_drawn_as_the_meter_shows_it(result):
    lines = {line.get_label(): line for line in result.plot().lines}
    assert list(lines) == ["measured", "predicted, as the meter shows it"]
    known = np.isfinite(result.power["measured_power"])
    known &= np.isfinite(result.power["predicted_power_at_meter"])
    drawn = lines["predicted, as the meter shows it"].get_ydata()
    assert np.array_equal(drawn, result.power["predicted_power_at_meter"][known])


def test_without_a_meter_the_power_from_the_grid_is_drawn(predicted):
    (line,) = predicted.plot("power").lines
    expected = predicted.power["predicted_grid_power"]
    assert np.array_equal(line.get_ydata(), expected[np.isfinite(expected)])


def test_drawn_energies_end_at_those_of_the_registers(result, predicted):
    measured, at_meter = (line.get_ydata()[-1] for line in result.plot("energy").lines)
    compared = result.comparison
    assert measured * 1e3 == pytest.approx(compared.measured_energy, rel=0.03)
    assert at_meter * 1e3 == pytest.approx(compared.predicted_energy_at_meter, rel=0.03)
    (line,) = predicted.plot("energy").lines
    assert line.get_ydata()[-1] * 1e3 == pytest.approx(predicted.energy.net, rel=0.01)


def test_parts_and_joints_sum_to_the_energy(result):
    axes = result.plot("parts")
    total = sum(bar.get_width() for bar in axes.patches)
    scale = {"kJ": 1e3, "J": 1.0, "MJ": 1e6}[axes.get_xlabel()[8:-1]]
    assert total * scale == pytest.approx(result.energy.net, rel=1e-6)
    joints = result.plot("joints")
    assert len(joints.patches) == 2 * len(result.joints)  # drive losses are not modelled
    assert sum(bar.get_height() for bar in joints.patches) * scale == pytest.approx(
        result.energy.rigid + result.energy.friction, rel=1e-6
    )


def test_friction_of_a_model_follows_its_law():
    model = re.load_model("kr16")
    axes = model.plot("friction")
    law = model.joints[0].friction.viscous
    degc, viscous = axes.lines[0].get_data()
    inside = (degc > law.fitted_degc[0]) & (degc < law.fitted_degc[1])
    expected = law.a.value + law.b.value * np.exp(-degc[inside] / law.c.value)
    assert np.allclose(viscous[inside], 1e3 * expected)
    assert len(axes.collections) == len(model.joints)  # a band of each


def test_axes_are_used_and_returned(result):
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    assert result.plot("temperatures", axes) is axes
    assert len(axes.lines) == len(result.joints)


def test_what_cannot_be_drawn_is_named(result):
    with pytest.raises(re.ReportError, match="'powr'; expected power, energy, parts, joints"):
        result.plot("powr")
    with pytest.raises(re.ReportError, match="JointEnergy has no figure"):
        result.joints[0].plot()


def test_without_matplotlib_its_extra_is_named(result, monkeypatch):
    monkeypatch.setattr(
        "robot_energy.foundation.extras.find_spec",
        lambda name: None if name == "matplotlib" else find_spec(name),
    )
    with pytest.raises(MissingExtraError, match=r"\./src\[report\]"):
        result.plot()


def test_html_says_what_the_terminal_says(result, predicted):
    html = result._repr_html_()
    assert "against" not in html.partition("</p>")[0]
    assert f"{result.comparison.predicted_minus_measured_relative:+.1%}"[1:-1] in html
    assert "<table>" in html
    assert "<script" not in html
    assert 'class="tile' not in html  # which only the styles of a page set apart
    assert "As a table" not in html
    assert result.report._repr_html_() == html
    assert "<table>" in predicted._repr_html_()
    assert "joint_a6" in re.load_model("kr16")._repr_html_()
    assert f"{len(result.power)} rows" in result.power._repr_html_()


def test_a_part_without_a_document_shows_its_fields(result):
    assert "joint_a1" in result.joints[0]._repr_html_()


def test_every_document_takes_a_report_and_a_page():
    for package in (energy_results, identify_results, plan_results, fleet_results):
        for module in iter_modules(package.__path__, f"{package.__name__}."):
            import_module(module.name)
    documents = {place: resolve_name(place) for place in DOCUMENTS.values()}
    names = {kind.NAME for kind in every_result() if kind.NAME}
    assert names - DOCUMENTS.keys() == {"check", "fleet_run"}
    assert names >= DOCUMENTS.keys()
    for place, document in documents.items():
        first, second, *more = inspect.signature(document).parameters.values()
        assert (first.name, second.annotation) == ("report", "Document")
        assert all(other.default is not inspect.Parameter.empty for other in more), place


def every_result(kind=Result):
    for each in kind.__subclasses__():
        yield each
        yield from every_result(each)


def test_representations_fit_on_a_line_or_two(result, predicted):
    for shown in (result, result.report, predicted, predicted.report, re.load_model("kr16")):
        assert len(repr(shown)) < 260
    assert "against the meter" in repr(result)


def test_a_wrong_column_names_the_one_that_was_meant(result):
    with pytest.raises(ColumnError, match="expected 'friction_power'"):
        result.power["friction"]
    with pytest.raises(KeyError):
        result.power["nothing like it"]


def test_help_lists_the_options_of_a_replay():
    for verb in (re.replay, re.evaluate, re.advise):
        named = inspect.signature(verb).parameters
        assert {"start", "effort", "processes"} <= named.keys()
        assert "options" not in named


def test_dir_shows_public_names_alone():
    assert set(dir(re)) == {*re.__all__, "__version__"}
