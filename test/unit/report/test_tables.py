from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

from logbook import wheel_bag
from robot_energy.bag_replay import replay
from robot_energy.report.document import Document
from robot_energy.report.formats import EnergyFormat, energy_text, percent, watt_hour
from robot_energy.report.printing import print_document
from robot_energy.report.replay import replay_document
from robot_energy.results.replay import ReplayReport, replay_report
from robots import one_wheel


def printed(report: ReplayReport) -> list[str]:
    stream, page = io.StringIO(), Document()
    replay_document(report, page)
    print_document(page, Console(file=stream, width=100, highlight=False))
    return stream.getvalue().splitlines()


def test_the_headline_comes_first_and_nothing_is_wider_than_the_page(tmp_path: Path) -> None:
    report = replay_report(replay(wheel_bag(tmp_path), one_wheel()))
    lines = printed(report)
    assert lines[0].startswith("predicted 680 J, measured 800 J at the grid: -15.0 %")
    assert max(len(line) for line in lines[4:]) <= 100
    assert not any("\x1b" in line for line in lines)


def test_the_printed_parts_sum_to_the_printed_total(tmp_path: Path) -> None:
    lines = printed(replay_report(replay(wheel_bag(tmp_path), one_wheel())))
    start = next(i for i, line in enumerate(lines) if line.startswith("Where the energy went"))
    end = next(i for i, line in enumerate(lines) if line.startswith(" from the grid"))
    rows = [line.split("  ") for line in lines[start + 4 : end + 1] if " Wh " in line]
    values = [float([cell for cell in row if cell.strip()][1]) for row in rows]
    assert values[-1] == pytest.approx(680.0)
    assert sum(values[:-1]) == pytest.approx(values[-1])


def test_without_a_meter_there_is_no_comparison_and_no_zero(tmp_path: Path) -> None:
    lines = printed(replay_report(replay(wheel_bag(tmp_path, power=None), one_wheel())))
    assert "nothing measured (no meter)" in lines[0]
    assert not any("Predicted and measured" in line for line in lines)


def test_two_replays_stand_side_by_side(tmp_path: Path) -> None:
    result = replay(wheel_bag(tmp_path), one_wheel())
    lines = printed(
        replay_report(result, compared_with=replay_report(result, "friction fixed at 20 degC"))
    )
    assert any(line.startswith(" predicted, measured temperatures") for line in lines)
    assert sum("friction fixed at 20 degC" in line for line in lines) >= 2


@pytest.mark.parametrize(
    ("joule", "text"),
    [(0.0, "0 J"), (12.345, "12.35 J"), (12345.0, "12.35 kJ"), (-2.5e6, "-2.5 MJ")],
)
def test_energies_in_words(joule: float, text: str) -> None:
    assert energy_text(joule) == text


def test_one_unit_and_precision_for_a_whole_report() -> None:
    scale = EnergyFormat(12_345.0)
    assert (scale.unit, scale.joule(12_345.0), scale.joule(-4.0)) == ("kJ", "12.35", "0.00")
    assert scale.joule(None) == watt_hour(None) == "-"
    assert watt_hour(3600.0) == "1.000 Wh"
    assert EnergyFormat(0.0).joule(0.0) == "0.000"


def test_a_ratio_is_never_minus_zero() -> None:
    assert (percent(-1e-5), percent(-1e-5, sign=True), percent(None)) == ("0.0 %", "+0.0 %", "-")
    assert (percent(-0.021, sign=True), percent(0.5, sign=True)) == ("-2.1 %", "+50.0 %")
