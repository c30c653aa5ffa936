from __future__ import annotations

import io
import re
from pathlib import Path

import pytest
from rich.console import Console

from logbook import wheel_bag
from robot_energy.replay.bag_replay import replay
from robot_energy.results.replay import ReplayReport, replay_report
from robot_energy_report.document import Document
from robot_energy_report.formats import (
    EnergyFormat,
    energy_text,
    percent,
    summing,
    typeset,
    uncertain,
    watt_hours,
)
from robot_energy_report.printing import print_document
from robot_energy_report.replay import replay_document
from robots import one_wheel


def printed(report: ReplayReport) -> list[str]:
    stream, page = io.StringIO(), Document()
    replay_document(report, page)
    print_document(page, Console(file=stream, width=100, highlight=False))
    return stream.getvalue().splitlines()


def test_the_headline_comes_first_and_nothing_is_wider_than_the_page(tmp_path: Path) -> None:
    report = replay_report(replay(wheel_bag(tmp_path), one_wheel()))
    lines = printed(report)
    assert lines[0].startswith("The model reads 15.0 % low; its energy is known within ")
    assert "(90 % band); measure next: " in lines[0]
    assert lines[1].startswith("predicted 680 J, measured 800 J at the grid: -15.0 %")
    assert max(len(line) for line in lines[4:]) <= 100
    assert not any("\x1b" in line for line in lines)


def test_the_printed_parts_sum_to_the_printed_total(tmp_path: Path) -> None:
    lines = printed(replay_report(replay(wheel_bag(tmp_path), one_wheel())))
    start = next(i for i, line in enumerate(lines) if line.startswith("Where the energy went"))
    end = next(i for i, line in enumerate(lines) if line.startswith(" from the grid"))
    rows = [line.split("  ") for line in lines[start + 4 : end + 1] if " % " in line]
    values = [float([cell for cell in row if cell.strip()][1]) for row in rows]
    assert values[-1] == pytest.approx(680.0)
    assert sum(values[:-1]) == pytest.approx(values[-1])


def test_meter_readings_are_counted_by_band_before_calibration_too(tmp_path: Path) -> None:
    (line,) = [
        line
        for line in printed(replay_report(replay(wheel_bag(tmp_path), one_wheel())))
        if "meter readings lay" in line
    ]
    words = r" *[\d.]+ % of \d+ meter readings lay in the 90 % band of power; "
    assert re.fullmatch(words + r"before calibration [\d.]+ % did", line)


def test_without_a_meter_there_is_no_comparison_and_no_zero(tmp_path: Path) -> None:
    lines = printed(replay_report(replay(wheel_bag(tmp_path, power=None), one_wheel())))
    assert lines[0].startswith("Nothing was measured: this is a prediction alone")
    assert "nothing measured (no meter)" in lines[1]
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


def test_a_meter_counts_in_watt_hours() -> None:
    # 250 W for a minute are 15 kJ
    assert (watt_hours(15e3), watt_hours(-15e3), watt_hours(5.4e6)) == (
        "4.167 Wh",
        "-4.167 Wh",
        "1.5 kWh",
    )


def test_one_unit_and_precision_for_a_whole_report() -> None:
    scale = EnergyFormat(12_345.0)
    assert (scale.unit, scale.joule(12_345.0), scale.joule(-4.0)) == ("kJ", "12.35", "0.00")
    assert scale.joule(None) == scale.text(None) == "-"
    assert scale.text(3600.0) == "3.60 kJ"
    assert EnergyFormat(0.0).joule(0.0) == "0.000"


def test_a_ratio_is_never_minus_zero() -> None:
    assert (percent(-1e-5), percent(-1e-5, sign=True), percent(None)) == ("0.0 %", "+0.0 %", "-")
    assert (percent(-0.021, sign=True), percent(0.5, sign=True)) == ("-2.1 %", "+50.0 %")


@pytest.mark.parametrize("digits", [0, 1, 2, 3])
def test_parts_as_shown_sum_to_the_whole_as_shown(digits: int) -> None:
    values = [-0.1949, 16.2749, 5.3949, 8.9949, 5.5749, 0.0049]  # rounded alone: 0.02 less
    texts = summing(values, digits)
    assert sum(map(float, texts)) == pytest.approx(round(sum(values), digits))
    for value, text in zip(values, texts, strict=True):
        assert abs(float(text) - value) < 10.0**-digits
    assert summing([1.25, 1.25], 1, "2.6") == ["1.3", "1.3"]


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (29.41, 31.2, "29 +- 31"),
        (323.7, 321.0, "320 +- 320"),
        (0.00742, 0.0071, "0.0074 +- 0.0071"),
        (0.5, 0.0996, "0.50 +- 0.10"),
        (-0.004, 0.2, "0.00 +- 0.20"),
        (1.2e-5, 3.04e-6, "(1.20 +- 0.30)e-05"),
        (12.34, 0.0, "12.3"),
        (12.34, float("nan"), "12.3"),
    ],
)
def test_a_standard_deviation_has_two_digits_and_the_value_ends_there(
    value: float, std: float, text: str
) -> None:
    assert uncertain(value, std) == text


@pytest.mark.parametrize(
    ("text", "true"),
    [
        ("-0.5 degC", "\u22120.5 \u00b0C"),
        ("29 +- 30 N m s/rad", "29 \u00b1 30 N\u00b7m\u00b7s/rad"),
        ("[1e-3 N m s/rad]", "[10\u207b\u00b3 N\u00b7m\u00b7s/rad]"),
        ("3.2e-05 kg m^2", "3.2\u00b710\u207b\u2075 kg\u00b7m\u00b2"),
        ("(1.2 +- 0.3)e-05", "(1.2 \u00b1 0.3)\u00b710\u207b\u2075"),
        ("W/(N m)^2", "W/(N\u00b7m)\u00b2"),
        ("[W s2/rad2]", "[W s\u00b2/rad\u00b2]"),
        ("predicted\n- measured", "predicted\n\u2212 measured"),
        ("8 uJ", "8 \u00b5J"),
        ("-", "\u2013"),
        *((name, name) for name in (
            "2001-09-09 01:46:40", "run-5/x.mcap", "/motor_degC", "identify-all", "2c5f0b20342e",
            "joint_1-2", "ISO 9001-2", "a-1",
        )),
    ],
)  # fmt: skip
def test_true_signs_and_units(text: str, true: str) -> None:
    assert typeset(text) == true
    assert typeset(true) == true


def test_a_terminal_has_true_signs_where_its_encoding_can_and_a_pipe_is_ascii() -> None:
    page = Document()
    page.paragraph("-0.5 degC")
    page.table("", ("", "[N m]"), [("a", "-1.0")])
    said: dict[tuple[bool, str], bytes] = {}
    for terminal in (True, False):
        for encoding in ("utf-8", "latin-1", "ascii"):
            raw = io.BytesIO()
            stream = io.TextIOWrapper(raw, encoding, "backslashreplace")
            print_document(page, Console(file=stream, width=80, force_terminal=terminal,
                                         color_system=None))  # fmt: skip
            stream.flush()
            said[terminal, encoding] = raw.getvalue()
    assert "\u22120.5 \u00b0C" in said[True, "utf-8"].decode()
    assert "N\u00b7m" in said[True, "utf-8"].decode()
    for key in ((True, "latin-1"), (True, "ascii"), (False, "utf-8"), (False, "ascii")):
        assert b"-0.5 degC" in said[key]
        assert b"[N m]" in said[key]
