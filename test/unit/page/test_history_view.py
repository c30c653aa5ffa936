"""What the page shows of a history is what robots used, and a dash where nothing is known."""

import csv
import io
import json
import math
from datetime import date, datetime
from itertools import pairwise
from zoneinfo import ZoneInfo

import pytest

from histories import DAY, HOUR, MINUTE, SECOND, START, Robot
from refusals import refused
from robot_energy.foundation.errors import HistoryError
from robot_energy_history.database import JOB_COLUMNS
from robot_energy_history.store import HistoryStore
from robot_energy_history.tariffs import Tariff, add_tariffs
from robot_energy_report.page.history_figures import KINDS, MAX_SERIES, period_at, span_of
from robot_energy_report.page.history_view import HistoryView

BERLIN = ZoneInfo("Europe/Berlin")
IMPORT = "predicted_import_microjoule"
NOW = START + 40 * DAY


def record(folder, robots, tariffs=()):
    """Write minutes of robots by name; each is a list of (hours worked, watts), rests are None."""
    store = HistoryStore(folder)
    store.open()
    end = START
    for name, course in robots.items():
        robot = Robot(1)
        for hours, watt in course:
            if watt is None:  # switched off
                robot.step_clock(round(hours * HOUR))
                robot.reset()
                continue
            for _ in range(math.ceil(hours)):
                readings = [robot.minute(watt) for _ in range(round(60 * min(hours, 1)))]
                store.add(name, readings)
                assert store.write(robot.now), store.trouble
        end = max(end, robot.now)
    if tariffs:
        add_tariffs(folder, tariffs, end)
    store.close()
    return HistoryView(folder)


def ask(view, now=NOW, **asked):
    given = {k: [v] if isinstance(v, str) else v for k, v in asked.items()}
    answer = view.answer(view.wish(given, now), now)
    json.dumps(answer, allow_nan=False)
    return answer


@pytest.fixture(scope="module")
def view(tmp_path_factory):
    night = {"begin": "22:00", "end": "06:00", "price_per_kwh": 0.1}
    tariff = Tariff(begin=date(2026, 1, 1), price_per_kwh=0.3, time_of_use=[night])
    return record(
        tmp_path_factory.mktemp("page") / "history",
        {"a": [(26, 1000), (2, None), (8, 2000)], "b": [(30, 500)]},
        [tariff],
    )


def total(series):
    return sum(value for one in series for value in one["values"] if value is not None)


def test_a_day_is_what_was_used_at_the_price_of_its_hours(view):
    answer = ask(view, period="day", at="2026-01-01")
    assert answer["total"]["energy"] == pytest.approx(24 * 1500 * 3600)
    assert answer["total"]["cost"] == pytest.approx(1.5 * (16 * 0.3 + 8 * 0.1))
    assert [one["label"] for one in answer["parts"]] == [f"{hour:02d}" for hour in range(24)]
    assert answer["parts"][3]["cost"] == pytest.approx(1.5 * 0.1)
    assert {one["name"]: one["values"][5] for one in answer["series"]} == {
        "a": 3.6e6, "b": 1.8e6,
    }  # fmt: skip
    assert total(answer["series"]) == pytest.approx(answer["total"]["energy"])
    assert not answer["running"]
    assert answer["rests"] == [  # the robots of this test never rest
        {"name": "at night", "energy": 0.0, "cost": 0.0},
        {"name": "at the weekend, nights included", "energy": 0.0, "cost": 0.0},
    ]


def test_what_is_not_recorded_is_none_and_never_zero(view):
    answer = ask(view, period="day", at="2026-01-02", robot="a")
    values = answer["series"][0]["values"]
    assert values[2] is None
    assert values[3] is None
    assert values[1] == 3.6e6
    assert values[5] == 7.2e6
    assert values[12:] == [None] * 12
    assert answer["parts"][2]["observed"] == 0.0
    assert answer["parts"][5]["observed"] == 1.0
    nothing = ask(view, period="month", at="2025-03-01")
    assert nothing["total"] is None
    assert nothing["series"] == []
    assert ask(view, period="day", at="2026-01-01", robot="b")["total"].get("co2") is None


def test_parts_phases_and_joints_add_up(view):
    parts = ask(view, period="day", at="2026-01-01", by="part", robot="a")
    assert [one["name"] for one in parts["series"]] == [
        "friction", "drives", "motion", "brake", "cabinet", "capacitor",
    ]  # fmt: skip
    joints = ask(view, period="day", at="2026-01-01", by="joint", robot="a")
    assert {one["name"] for one in joints["series"]} == {"shoulder", "elbow"}
    of_joints = [one for one in parts["series"] if one["name"] in ("friction", "drives", "motion")]
    assert total(joints["series"]) == pytest.approx(total(of_joints))
    assert joints["parts"][0]["observed"] == 1.0
    phases = ask(view, period="day", at="2026-01-01", by="phase")
    assert total(phases["series"]) == pytest.approx(phases["total"]["energy"])


def test_zoom_leads_from_a_year_to_a_minute_and_keeps_the_energy(view):
    asked, seen = {"period": "year", "at": "2026-01-01"}, []
    while asked:
        answer = ask(view, robot="b", **asked)
        seen.append(answer["period"]["resolution"])
        whole = total(answer["series"])
        assert whole == pytest.approx(answer["total"]["energy"]), asked
        place = next(i for i, v in enumerate(answer["series"][0]["values"]) if v is not None)
        asked, energy = answer["parts"][place]["zoom"], answer["series"][0]["values"][place]
        if asked:
            assert ask(view, robot="b", **asked)["total"]["energy"] == pytest.approx(energy)
    assert seen == ["month", "day", "hour", "minute"]


def test_shifts_add_up_to_the_day(tmp_path):
    tariff = Tariff(begin=date(2026, 1, 1), price_per_kwh=0.5, shifts=["06:00", "14:00", "22:00"])
    view = record(tmp_path / "history", {"a": [(24, 1000)], "b": [(8, 500)]}, [tariff])
    wish = view.wish({"period": ["day"], "at": ["2026-01-01"]}, NOW)
    found = view.shifts(wish)
    assert found["currency"] == "EUR"
    used = {row["shift"]: (row["energy"] / 3.6e6, row["cost"]) for row in found["rows"]}
    assert used == {"06:00": (9.0, 4.5), "14:00": (8.0, 4.0), "22:00": (11.0, 5.5)}
    none = record(tmp_path / "none", {"a": [(1, 1000)]})
    assert none.shifts(none.wish({}, NOW)) == {"currency": "", "rows": []}


def test_jobs_and_events_are_shown(tmp_path):
    view = record(tmp_path / "history", {"a": [(1, 1000)]})
    store = HistoryStore(view.folder)
    store.open()
    own = dict.fromkeys(JOB_COLUMNS, 0)
    for day, watt in enumerate((100, 200, 300)):
        start = START + (day // 2) * DAY + day * MINUTE
        job = {"id": day, "start": start, "stop": start + MINUTE, "name": "part 7",
               "observed_ns": MINUTE, "predicted_import_microjoule": watt * 60 * 10**6}  # fmt: skip
        store.add_jobs("a", [{**own, **job}])
    assert store.write(START + DAY), store.trouble
    store.close()
    answer = ask(view, period="day", at="2026-01-02")
    assert answer["jobs"] == [
        {"robot": "a", "name": "part 7", "count": 1, "time": 60.0, "energy": 18_000.0,
         "mean": 18_000.0, "before": 9_000.0}
    ]  # fmt: skip
    assert total(ask(view, period="day", at="2026-01-01", by="job")["series"]) == 18_000.0
    table = view.csv(view.wish({"by": ["job"], "at": ["2026-01-02"]}, NOW))
    (row,) = csv.DictReader(io.StringIO(table))
    assert (row["job"], row["parts"], row[IMPORT]) == ("part 7", "1", "18000000000")
    assert ask(view, period="day", at="2026-01-01")["events"] == [
        {"at": "2026-01-01 00:00", "robot": "a", "kind": "first",
         "text": "recorded from here on, with model m1"}
    ]  # fmt: skip


def test_minutes_that_are_not_kept_are_shown_as_quarters(tmp_path):
    view = record(tmp_path / "history", {"a": [(1, 1000)]})
    store = HistoryStore(view.folder, keep_days=1.0)
    store.open()
    assert store.write(START + 3 * DAY)
    store.close()
    answer = ask(view, period="hour", at="2026-01-01T00:00")
    assert answer["period"]["resolution"] == "quarter"
    assert answer["series"][0]["values"] == [9e5] * 4


def test_a_day_that_is_not_over_is_compared_up_to_the_same_time(view):
    now = START + DAY + 6 * HOUR + 7 * MINUTE
    answer = ask(view, now, period="day", robot="b")
    assert answer["running"] == "2026-01-02T06:00+00:00"
    assert answer["same"]["energy"] == answer["earlier"]["energy"] == 6 * 500 * 3600
    assert answer["fair"]
    assert answer["robots"][0]["before"] == 6 * 500 * 3600
    gap = ask(view, now, period="day", robot="a")  # two of six hours were not observed
    assert not gap["fair"]
    assert not gap["robots"][0]["fair"]


def test_many_robots_are_summed_up(tmp_path):
    count = MAX_SERIES + 3
    robots = {f"cell/r{n}": [(0.25, 100 * (n + 1))] for n in range(count)}
    view = record(tmp_path / "history", robots)
    answer = ask(view, period="day", at="2026-01-01")
    assert len(answer["series"]) == MAX_SERIES + 1
    assert answer["series"][-1]["name"] == "3 others"
    assert answer["series"][0]["name"] == f"cell/r{count - 1}"
    assert total(answer["series"]) == pytest.approx(answer["total"]["energy"])
    assert len(answer["robots"]) == count
    cells = ask(view, period="day", at="2026-01-01", by="cell")["series"]
    assert [one["name"] for one in cells] == ["cell"]
    assert total(cells) == pytest.approx(answer["total"]["energy"])


def test_the_table_holds_what_is_shown(view):
    wish = view.wish({"period": ["day"], "at": ["2026-01-02"], "robot": ["a"]}, NOW)
    rows = list(csv.DictReader(io.StringIO(view.csv(wish))))
    used = {row["begin"]: int(row["predicted_import_microjoule"]) for row in rows}
    assert used["2026-01-02T05:00+00:00"] == 7_200_000_000_000
    assert "2026-01-02T02:00+00:00" not in used


def test_minutes_and_spans_are_the_total_and_in_the_table(tmp_path):
    store, robot = HistoryStore(tmp_path), Robot()
    store.open()
    for off in (0, 3, 20):  # within a quarter hour, and over one
        robot.advance(off * MINUTE, 6000)
        store.add("a", [robot.minute(6000) for _ in range(5)])
    assert store.write(robot.now), store.trouble
    store.close()
    view = HistoryView(tmp_path)
    asked = {"period": "hour", "at": "2026-01-01"}
    answer = ask(view, **asked)
    whole = 38 * 60 * 6000
    assert answer["total"]["energy"] == whole
    assert answer["span_count"] == 2
    assert answer["span_energy"] == (4 + 21) * 60 * 6000
    assert total(answer["series"]) + answer["span_energy"] == whole
    table = view.csv(view.wish({name: [value] for name, value in asked.items()}, NOW))
    rows = list(csv.DictReader(io.StringIO(table)))
    assert sum(int(row[IMPORT]) for row in rows) == whole * 10**6
    spans = [(row["begin"][11:16], row["end"][11:16]) for row in rows if row["resolved"] == "0"]
    assert spans == [("00:05", "00:09"), ("00:13", "00:34")]


def test_a_name_is_no_formula_in_the_table(tmp_path):
    view = record(tmp_path / "history", {"=cmd|' /C calc'!A0": [(0.25, 100)]})
    wish = view.wish({"period": ["day"], "at": ["2026-01-01"]}, NOW)
    (row,) = csv.DictReader(io.StringIO(view.csv(wish)))
    assert row["robot"] == "'=cmd|' /C calc'!A0"


@pytest.mark.parametrize(
    "asked",
    [
        {"period": ["decade"]}, {"at": ["yesterday"]}, {"timezone": ["Mars/Base"]},
        {"by": ["colour"]}, {"robot": ["nobody"]}, {"period": ["span"]}, {"at": ["9999-12-31"]},
        {"period": ["span"], "start": ["2026-02-01"], "stop": ["2026-01-01"]},
        {"period": ["span"], "start": ["1971-01-01"], "stop": ["2189-01-01"]},
    ],
)  # fmt: skip
def test_what_there_is_not_is_refused(view, asked):
    with refused(HistoryError):
        view.answer(view.wish(asked, NOW), NOW)


def test_without_a_history_it_is_said(tmp_path):
    view = HistoryView(tmp_path / "none")
    with refused(HistoryError, "there is no history"):
        ask(view)


@pytest.mark.parametrize("kind", KINDS)
def test_periods_follow_one_another_without_a_gap(kind):
    stamp = berlin(2026, 3, 28, 12)
    period = period_at(kind, stamp, BERLIN)
    for _ in range(5):
        later = period.moved(1)
        assert later.start_ns == period.stop_ns
        assert later.moved(-1) == period
        assert period.bounds[0] == period.start_ns
        assert period.bounds[-1] == period.stop_ns
        assert all(a < b for a, b in pairwise(period.bounds))
        period = later


def berlin(*local):
    return int(datetime(*local, tzinfo=BERLIN).timestamp()) * SECOND


def test_a_short_day_is_compared_up_to_the_same_hour():
    day = period_at("day", berlin(2026, 3, 29, 12), BERLIN)
    assert day.stop_ns - day.start_ns == 23 * HOUR
    until = berlin(2026, 3, 29, 6)
    before = berlin(2026, 3, 28, 6)
    assert day.same_part(until) == before
    month = period_at("month", berlin(2026, 3, 5), BERLIN)
    late = berlin(2026, 3, 31, 12)
    assert month.same_part(late) == month.start_ns  # February is shorter: all of it


def test_a_span_has_whole_parts():
    span = span_of(START + 7 * MINUTE, START + 5 * DAY + 1, BERLIN)
    assert span.resolution == "day"
    assert span.bounds[0] == span.start_ns
    assert math.isclose((span.stop_ns - span.start_ns) / DAY, 6)
    assert span.moved(-1).stop_ns == span.start_ns
