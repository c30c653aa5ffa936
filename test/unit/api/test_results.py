"""Results of the public functions are those of the commands."""

import inspect
import json
import pickle
from argparse import ArgumentTypeError
from pathlib import Path

import numpy as np
import pytest

import robot_energy as re
from robot_energy.certainty.priors import SPREAD
from robot_energy.replay.api import fixed_friction
from robot_energy_cli.main import main
from robot_energy_cli.replay_arguments import degc

ROOT = Path(__file__).resolve().parents[3]
BAG = str(ROOT / "bags/kr16_cold")
PROGRAM = str(ROOT / "src/examples/programs/kr16_pick_and_place.yaml")


@pytest.fixture(scope="module")
def replayed():
    return re.replay(BAG, model="kr16")


def command_json(tmp_path, *words):
    path = tmp_path / "figures.json"
    assert main([*words, "--json", str(path)]) == 0
    return {key: value for key, value in json.loads(path.read_text()).items() if key != "generator"}


def test_replay_gives_the_json_of_the_command(replayed, tmp_path, capsys):
    assert replayed.to_dict() == command_json(tmp_path, "replay", BAG, "--model", "kr16")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("stamp_source", "recieve"), ("power_period", -1.0), ("power_period", 0.0),
        ("power_period", float("nan")), ("derivative_window", 0.0), ("max_gap", -0.1),
        ("processes", 0), ("processes", 2.5), ("reorder_window", 1.0),
    ],
)  # fmt: skip
def test_options_that_make_no_sense_are_refused(name, value):
    with pytest.raises(re.ParameterError, match=f"'{name}' of replay is"):
        re.replay(BAG, "kr16", **{name: value})


def test_errors_end_once_and_quote_keys_as_they_are():
    assert str(re.ParameterError("a", "b.", "look at it.")) == "a; expected b. Look at it."
    assert str(re.ParameterError("no x; did you mean y?", "", "k_z: {}")).endswith("y? k_z: {}.")


def test_fields_hold_the_figures_of_the_summary(replayed):
    figures = replayed.to_dict()
    assert replayed.energy.__dict__ == figures["energy"]
    assert [joint.__dict__ for joint in replayed.joints] == figures["joints"]
    assert replayed.comparison.__dict__ == figures["comparison"]
    assert {name: phase.__dict__ for name, phase in replayed.phases.items()} == figures["phases"]
    assert list(replayed.notes) == figures["notes"]


def test_the_power_integrates_to_the_energy(replayed):
    power = replayed.power
    total = re.physics.trapezoid_energy(power.time, power["predicted_grid_power"])
    assert total == pytest.approx(replayed.energy.grid_import, rel=1e-6)
    friction = re.physics.trapezoid_energy(power.time, power["joint_friction_power"])
    assert friction == pytest.approx([j.friction_energy for j in replayed.joints], rel=1e-6)


def test_every_row_balances(replayed):
    power = replayed.power
    parts = ("rigid_power", "friction_power", "loss_dc", "loss_grid")
    total = sum(power[name] for name in (*parts, "brake_power"))
    assert total == pytest.approx(power["predicted_grid_power"], rel=1e-9)
    assert set(power.units) == {*power.columns, *power.joint_columns}


def test_what_is_not_modelled_is_not_zero(replayed):
    """kr16 has neither drive losses nor a capacitor."""
    power, energy = replayed.power, replayed.energy
    for name in ("drive_loss", "capacitor_power", "joint_drive_loss"):
        assert np.isnan(power[name]).all(), name
    assert (energy.drive_loss, energy.capacitor) == (None, None)
    assert [joint.drive_loss_energy for joint in replayed.joints] == [None] * 6
    assert energy.balanced
    head, *rows = power.to_csv().splitlines()
    place = [name.startswith("drive_loss") for name in head.split(",")].index(True)
    assert {row.split(",")[place] for row in rows} <= {"", "nan"}


def test_measured_power_is_that_of_the_meter(replayed):
    power, known = replayed.power, np.isfinite(replayed.power["measured_power"])
    assert known.mean() > 0.99
    mean = power["measured_power"][known].mean()
    assert mean == pytest.approx(replayed.comparison.measured_mean_power, rel=1e-3)
    residual = power["predicted_power_at_meter"] - power["measured_power"]
    assert np.array_equal(power["residual_power"], residual, equal_nan=True)


def test_power_over_periods_holds_the_same_energy(replayed):
    means = re.replay(BAG, "kr16", power_period=0.1)
    assert means.energy == replayed.energy
    assert len(means.power) == pytest.approx(len(replayed.power) / 25, abs=2)


def test_a_fixed_temperature_is_that_of_the_command(tmp_path, capsys):
    words = ("replay", BAG, "--model", "kr16", "--fixed-friction", "40")
    result = re.replay(BAG, "kr16", temperature=40.0)
    assert result.to_dict() == command_json(tmp_path, *words)
    fallback = re.replay(BAG, "kr16", temperature="fallback", temperatures="none")
    assert fallback.to_dict()["topics"]["temperatures"] == []


def test_friction_fixed_outside_its_fitted_range_says_so_and_is_less_sure():
    model = re.load_model("kr16")  # fitted from 20 to 80 degC
    (inside, said), (beyond, noted) = (fixed_friction(model, at) for at in (20.0, 0.0))
    assert said == "friction fixed at 20 degC"
    assert noted == "friction fixed at 0 degC, outside the fitted temperatures"
    for joint, other, law in zip(inside.joints, beyond.joints, model.joints, strict=True):
        figure, held = joint.friction.viscous.viscous, other.friction.viscous.viscous
        assert figure.tag == law.friction.viscous.a.tag
        assert held.value == figure.value
        assert figure.std == pytest.approx(SPREAD["viscous"] * figure.value)
        assert held.std > 1.5 * figure.std


@pytest.mark.parametrize("wrong", [-300.0, 251.0, float("nan"), float("inf")])
def test_friction_is_fixed_where_the_command_allows_it(wrong):
    with pytest.raises(re.ParameterError, match=r"expected -60 to 250 degC, or 'fallback'"):
        re.replay(BAG, "kr16", temperature=wrong)
    with pytest.raises(ArgumentTypeError, match="-60 to 250"):
        degc(str(wrong))


def test_replays_can_be_pickled(replayed):
    found = replayed
    copy = pickle.loads(pickle.dumps(found))
    assert copy.to_dict() == found.to_dict()


def test_predictions_can_be_pickled():
    found = re.predict(PROGRAM, "kr16", 20.0)
    copy = pickle.loads(pickle.dumps(found))
    assert copy.to_dict() == found.to_dict()
    for name, column in found.power.columns.items():
        np.testing.assert_array_equal(copy.power[name], column)


def test_predict_gives_the_json_of_the_command(tmp_path, capsys):
    words = ("predict", PROGRAM, "--model", "kr16", "--temperature", "30")
    result = re.predict(PROGRAM, "kr16", 30.0)
    runs = command_json(tmp_path, *words)
    assert [json.loads(json.dumps(result.to_dict()))] == runs["runs"]
    power = result.power["predicted_grid_power"]
    known = np.isfinite(power)  # the first row is one sample: no time, so no mean
    assert not known[0]
    assert known[1:].all()
    total = re.physics.trapezoid_energy(result.power.time[known], power[known])
    assert total == pytest.approx(result.energy.grid_import, rel=0.02)


def test_a_wrong_option_is_refused():
    with pytest.raises(re.ParameterError):
        re.replay(BAG, "kr16", effort="torque")
    with pytest.raises(re.ModelFileError):
        re.replay(BAG, "no_such_model")


def test_identify_cabinet_gives_the_json_and_the_model_of_the_command(tmp_path, capsys):
    result = re.identify_cabinet([BAG], "kr16")
    words = ("identify", "cabinet", BAG, "--model", "kr16")
    found = command_json(tmp_path, *words, "--out", str(tmp_path / "command.yaml"))
    assert json.loads(json.dumps(result.to_dict())) == found
    result.save(tmp_path / "api.yaml")
    assert (tmp_path / "api.yaml").read_bytes() == (tmp_path / "command.yaml").read_bytes()


def test_identify_needs_the_meaning_of_the_effort():
    with pytest.raises(re.ModelFileError):
        re.identify_friction(BAG, "kr16")


def test_identify_dynamics_gives_a_model(tmp_path):
    result = re.identify_dynamics(BAG, "kr16", "motor_torque")
    assert result.to_dict()
    result.save(tmp_path / "model.yaml")
    assert re.load_model(tmp_path / "model.yaml").joint_names == result.model.joint_names


def test_export_writes_the_table(tmp_path, capsys):
    target = tmp_path / "power.csv"
    words = ["export", BAG, "--model", "kr16", "--power-period", "0.5", "--out", str(target)]
    assert main(words) == 0
    assert main(words) == 0  # its own file is replaced
    assert target.read_text() == re.replay(BAG, "kr16", power_period=0.5).power.to_csv()


def test_export_refuses_what_is_not_its_own(tmp_path, capsys):
    target = tmp_path / "power.csv"
    target.write_text("somebody else's")
    assert main(["export", BAG, "--model", "kr16", "--out", str(target)]) == 2
    assert target.read_text() == "somebody else's"
    assert main(["export", BAG, "--model", "kr16", "--out", str(tmp_path / "power.txt")]) == 2


def test_export_writes_parquet(tmp_path, capsys):
    polars = pytest.importorskip("polars")
    target = tmp_path / "power.parquet"
    words = ["export", BAG, "--model", "kr16", "--power-period", "0.5", "--out", str(target)]
    assert main(words) == 0
    assert main(words) == 0  # its own file is replaced
    assert polars.read_parquet(target).height == 72


@pytest.mark.parametrize(
    ("verb", "option", "expected"),
    [
        (re.replay, "temprature", "replay has no option 'temprature'; expected 'temperature'?"),
        (re.replay, "xyz", "replay has no option 'xyz'; expected one of .*start"),
        (re.evaluate, "efort", "evaluate has no option 'efort'; expected 'effort'?"),
        (re.fleet_run, "efort", "fleet_run has no option 'efort'; expected 'effort'?"),
        (re.fleet_run, "overwrite", "fleet_run has no option 'overwrite'"),
    ],
)
def test_an_option_that_does_not_exist_is_refused(verb, option, expected, tmp_path):
    for kind in (TypeError, re.RobotEnergyError):
        with pytest.raises(kind, match=expected.replace("?", r"\?")):
            verb(BAG, "kr16", **{option: 1.0})


def test_signatures_list_every_option():
    for name in re.__all__:
        thing = getattr(re, name)
        if inspect.isfunction(thing):
            kinds = [parameter.kind for parameter in inspect.signature(thing).parameters.values()]
            assert inspect.Parameter.VAR_KEYWORD not in kinds, name


def test_a_word_is_no_number(replayed):
    for call in (lambda: re.replay(BAG, "kr16", temperature="hot"),
                 lambda: re.replay(BAG, "kr16", start="hot"),
                 lambda: re.predict(PROGRAM, "kr16", "hot"),
                 lambda: re.optimize(PROGRAM, "kr16", "hot"),
                 lambda: replayed.power[b"hot"]):  # fmt: skip
        with pytest.raises(re.RobotEnergyError, match="hot"):
            call()


def test_a_misspelt_verb_is_named_as_python_names_an_attribute():
    with pytest.raises(AttributeError) as error:
        _ = re.replya
    assert (error.value.name, error.value.obj) == ("replya", re)
