"""The report of a month says what was used, against the month before, and what is not known."""

import re
from datetime import UTC, date, datetime
from pathlib import Path

import pytest

import robot_energy_report
from histories import DAY, HOUR, Robot
from pages import read
from refusals import refused
from robot_energy.foundation.errors import HistoryError
from robot_energy_cli import main
from robot_energy_history.store import HistoryStore
from robot_energy_history.tariffs import Tariff, add_tariffs
from robot_energy_report.canvas import PART_COLOURS
from robot_energy_report.history_month import MEANINGS, month_document
from robot_energy_report.html import page_html
from robot_energy_report.page.energy_flow import PARTS
from robot_energy_report.page.saved_page import TERMS

STATIC = Path(robot_energy_report.__file__).parent / "page/static"
EVIL = "<script>alert(1)</script>"
NOW = int(datetime(2026, 4, 10, tzinfo=UTC).timestamp()) * 10**9


def stamp(month):
    return int(datetime(2026, month, 1, tzinfo=UTC).timestamp()) * 10**9


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """February and March: two hours on each of the first days, in March with 10 % more power."""
    folder = tmp_path_factory.mktemp("month") / "history"
    store = HistoryStore(folder)
    store.open()
    for name in ("left", EVIL):
        for month, watt in ((2, 1000), (3, 1100)):
            for day in range(3):
                begin = stamp(month) + day * DAY
                robot = Robot(now=begin, start=begin)
                store.add(name, [robot.minute(watt) for _ in range(60)])
                assert store.write(robot.now), store.trouble
                robot.values["hold_microjoule"] += 3600 * 10**8
                robot.values["standby_microjoule"] += 3600 * 10**8
                robot.advance(HOUR, watt)
                store.add(name, [robot.read(robot.now)])
                assert store.write(robot.now, newest=True), store.trouble
    store.close()
    add_tariffs(folder, [Tariff(begin=date(2026, 1, 1), price_per_kwh=0.5)], NOW)
    return folder


def text_of(document):
    page = page_html(document)
    read(page)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", page))


def test_the_verdict_comes_first_and_is_the_sum_of_the_month(folder):
    text = text_of(month_document(folder, "2026-03", NOW))
    assert "13.20 kWh from the grid, 6.60 EUR: +10.0 % against February 2026" in text
    assert text.index("Verdict") < text.index("+10.0 %") < text.index("in motion")
    for word in ("standby", "observed", "at rest", "peak"):
        assert word in text
    first = text_of(month_document(folder, "2026-02", NOW))
    assert "12.00 kWh from the grid, 6.00 EUR: nothing was recorded in January 2026" in first


def test_parts_have_one_name_in_report_and_page():
    script = (STATIC / "history.js").read_text()
    on_page = dict(re.findall(r'(\w+): "([^"]+)"', re.search("const PARTS = .*", script)[0]))
    assert on_page == PARTS
    assert PARTS.keys() == MEANINGS.keys()
    assert PARTS.keys() == PART_COLOURS.keys()  # no two look alike
    assert {"constant losses", "lifting, accelerating"} <= {*on_page.values()} & {*TERMS}


def test_a_part_of_0_is_a_dash_that_is_explained(folder):
    text = text_of(month_document(folder, "2026-03", NOW))
    assert f"{PARTS['brake']} \u2013 \u2013 {MEANINGS['brake']}" in text
    assert re.search(rf"{PARTS['drives']} [\d.]+ [\d.]+ %", text)
    assert "A dash: the part is 0, or no model has it." in text


def test_names_are_text(folder):
    page = page_html(month_document(folder, "2026-03", NOW))
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page


def test_one_robot_and_another_time_zone(folder):
    text = text_of(month_document(folder, "2026-03", NOW, "America/New_York", ["left"]))
    # The first two hours of March in UTC are February in New York.
    assert "4.40 kWh from the grid" in text
    assert "not compared with February 2026" in text  # which has six hours there, March four
    assert "1 robot" in text


def test_what_there_is_not_is_refused(folder, tmp_path):
    for month in ("2026-13", "March", "2026-3", "../..", "2026-03-01"):
        with refused(HistoryError, "the month"):
            month_document(folder, month, NOW)
    with refused(HistoryError, "nothing was recorded in June 2026"):
        month_document(folder, "2026-06", NOW)
    with refused(HistoryError, "no robot"):
        month_document(folder, "2026-03", NOW, robots=["nobody"])
    with refused(HistoryError, "there is no history"):
        month_document(tmp_path, "2026-03", NOW)


def test_without_a_month_it_is_the_last_that_is_over(folder):
    assert "in March 2026" in month_document(folder, "", NOW).title
    late = int(datetime(2026, 4, 1, 0, 30, tzinfo=UTC).timestamp()) * 10**9
    assert "in March 2026" in month_document(folder, "", late).title


def test_the_command_writes_one_page_and_replaces_only_its_own(folder, tmp_path, capsys):
    path = tmp_path / "march.html"
    words = ["history", "report", str(folder), "--month", "2026-03", "--out", str(path)]
    for _ in range(2):
        assert main(words) == 0
    read(path.read_text(encoding="utf-8"))
    path.write_text("<!DOCTYPE html> of someone")
    assert main(words) == 2
    assert path.read_text() == "<!DOCTYPE html> of someone"
    assert "was not written by robot-energy" in capsys.readouterr().err
