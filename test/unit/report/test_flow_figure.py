"""The first picture of a page: the pieces of the energy, whose figures sum to the whole."""

from contextlib import contextmanager
from io import BytesIO

import pytest

from logbook import wheel_bag, wheel_model
from pages import read
from places import ROOT
from robot_energy.bag_replay import replay
from robot_energy.cli import main
from robot_energy.model import load
from robot_energy.report import flow_figure
from robot_energy.report.canvas import canvas
from robot_energy.report.flow_figure import energy_flow
from robot_energy.results.replay import replay_report


@pytest.fixture
def figures(monkeypatch):
    """Every figure that is drawn meanwhile."""
    found = []

    @contextmanager
    def kept(*args):
        with canvas(*args) as figure:
            found.append(figure)
            yield figure

    monkeypatch.setattr(flow_figure, "canvas", kept)
    return found


@pytest.mark.parametrize("name", ["kr16_cold", "kr16_warm"])
def test_the_figures_on_the_rows_sum_to_the_first(name, figures):
    report = replay_report(replay(ROOT / "bags" / name, load("kr16")))
    energy_flow(report, BytesIO())
    (axes,) = figures[0].axes
    labels = [text.get_text() for text in axes.get_yticklabels()]
    values = [float(text.get_text().replace("\u2212", "-").split()[0]) for text in axes.texts]
    assert labels[0] == "from the grid"
    assert labels[1:7] == [joint.name for joint in report.joints]
    assert len(values) == len(labels) == 10
    assert sum(values[1:]) == pytest.approx(values[0], abs=1e-9)
    assert values[0] == pytest.approx(report.energy.net / 1e3, abs=5e-3)
    for joint, value in zip(report.joints, values[1:], strict=False):
        assert value == pytest.approx(joint.drive_input_energy / 1e3, abs=1e-2)
    assert values[9] == pytest.approx(report.energy.brake / 1e3, abs=1e-2)
    bars = [bar for bar in axes.patches if bar.get_width()]
    ends = [bar.get_x() + bar.get_width() for bar in bars if round(bar.get_y() + 0.31) == 9]
    assert ends == [pytest.approx(report.energy.net / 1e3)]  # the last piece ends with the whole


def test_replay_writes_a_page_that_holds_all_and_says_so(tmp_path, capsys):
    page, out = tmp_path / "page.html", tmp_path / "out"
    words = ["replay", wheel_bag(tmp_path), "--model", wheel_model(tmp_path), "--compare",
             "--report", page, "--out", out, "--json", tmp_path / "r.json"]  # fmt: skip
    assert main([str(word) for word in words]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[-3:] == [
        f"wrote {out}: bag",
        f"wrote {tmp_path / 'r.json'}: all figures as JSON",
        f"wrote {page}: report",
    ]
    text = page.read_text()
    read(text)  # whole, and nothing is loaded from elsewhere
    first = text.index("<figure>")
    assert text.count("<h2", 0, first) == 1
    assert "Where the energy from the grid went" in text[first : text.index("</figure>")]
    assert text.count("<figure>") >= 4
