"""Hours, days and curves add up to the quarter hours that they were made from, also later."""

import random
import sqlite3
from contextlib import closing
from datetime import datetime
from zoneinfo import ZoneInfo

import pytest

from histories import DAY, HOUR, MINUTE, SECOND, START, Robot
from robot_energy_history import queries
from robot_energy_history.api import history, history_jobs
from robot_energy_history.check import check, repair
from robot_energy_history.database import JOB_COLUMNS, open_reader
from robot_energy_history.queries import pieces
from robot_energy_history.readings import COLUMNS, JOINT_COLUMNS
from robot_energy_history.rollup import Rolled
from robot_energy_history.store import HistoryStore

IMPORT = "predicted_import_microjoule"
USED = COLUMNS.index(IMPORT)
QUARTER = 15 * MINUTE
ZONES = ("UTC", "Europe/Berlin", "Asia/Kolkata", "America/St_Johns")


def record(folder, days, **options):
    """Quarter hours of a robot, written every half day; the robot, and its readings."""
    store, robot, readings = HistoryStore(folder, **options), Robot(), []
    store.open()
    for place in range(days * 96):
        robot.advance(QUARTER)
        readings.append(robot.read(robot.now))
        store.add("a", readings[-1:])
        if place % 48 == 47:
            assert store.write(robot.now), store.trouble
    return store, robot, readings


def by_hand(readings, resolution, zone):
    """Energy of each part of the time, from the readings alone."""
    found, before = {}, 0
    for reading in readings:
        local = datetime.fromtimestamp((reading.stamp_ns - 1) // SECOND, ZoneInfo(zone))
        key = {
            "hour": f"{local:%F %H}", "day": f"{local:%F}", "month": f"{local:%Y-%m}",
            "week": f"{local:%G %V}",
        }[resolution]  # fmt: skip
        found[key] = found.get(key, 0) + reading.values[USED] - before
        before = reading.values[USED]
    return list(found.values())


def rows_of(folder, table):
    with closing(open_reader(folder)) as connection:
        return connection.execute(f"SELECT count(*) FROM {table}").fetchone()[0]


def test_each_resolution_is_the_sum_of_quarter_hours_in_every_zone(tmp_path):
    store, _, readings = record(tmp_path, 35)
    store.close()
    assert rows_of(tmp_path, "slot1440") == 34  # all but the day that has just ended
    assert check(tmp_path) == []
    for zone in ZONES:
        for resolution in ("hour", "day", "week", "month"):
            found = history(tmp_path, START, START + 35 * DAY, resolution, timezone=zone)
            assert found[IMPORT].tolist() == by_hand(readings, resolution, zone), (zone, resolution)
        joints = history(
            tmp_path, START - DAY, START + 36 * DAY, "month", timezone=zone, by_joint=True
        )
        for name, counted in readings[-1].joints.items():
            own = joints["joint"] == name
            friction = joints["friction_microjoule"][own]
            assert friction.sum() == counted[JOINT_COLUMNS.index("friction_microjoule")]


@pytest.mark.parametrize("by", [-3 * DAY, -HOUR])
def test_what_comes_late_is_added_to_all_that_is_rolled_up(tmp_path, by):
    store, robot, _ = record(tmp_path, 5)
    robot.step_clock(by)
    robot.advance(10 * MINUTE, 700)
    store.add("a", [robot.read()])
    assert store.write(START + 6 * DAY, newest=True)
    robot.advance(60 * DAY)
    store.add("a", [robot.read()])  # a span that no slot holds is in none of these
    assert store.write(robot.now, newest=True)
    store.close()
    assert check(tmp_path) == []
    days = history(tmp_path, START, START + 5 * DAY)
    assert days[IMPORT].sum() + days.not_resolved[IMPORT].sum() == robot.values[IMPORT]


def test_quarter_hours_are_dropped_when_asked_and_hours_stay(tmp_path):
    store, robot, readings = record(tmp_path, 20, keep_quarters=5.0)
    for _ in range(3):
        store.write(robot.now)
    store.close()
    assert rows_of(tmp_path, "slot15") == 96 * 5
    assert check(tmp_path) == []
    for zone in ("UTC", "Europe/Berlin"):
        found = history(tmp_path, START, START + 20 * DAY, "day", timezone=zone)
        assert found[IMPORT].tolist() == by_hand(readings, "day", zone)
        assert len(found.not_resolved) == 0
    # Where days begin within an hour, that hour is known, its halves are not.
    found = history(tmp_path, START, START + 20 * DAY, "day", timezone="Asia/Kolkata")
    halves = found.not_resolved
    assert {int(stamp) % DAY // HOUR for stamp in halves.stamp_ns} == {18}
    assert found[IMPORT].sum() + halves[IMPORT].sum() == robot.values[IMPORT]
    assert repair(tmp_path, robot.now) == []
    # The clock is set back to days whose quarter hours are gone.
    store = HistoryStore(tmp_path, keep_quarters=5.0)
    store.open()
    robot.step_clock(-18 * DAY)
    robot.advance(10 * MINUTE, 100)
    store.add("a", [robot.read()])
    assert store.write(START + 20 * DAY, newest=True)
    store.close()
    assert check(tmp_path) == []
    found = history(tmp_path, START, START + 20 * DAY, "all")
    assert found[IMPORT].tolist() == [robot.values[IMPORT]]


@pytest.mark.parametrize(
    ("statement", "said"),
    [("UPDATE slot60 SET brake_microjoule = 3 WHERE start % 86400000000000 = 0", "slot60"),
     ("DELETE FROM slot1440", "slot1440"), ("DELETE FROM curve", "curve"),
     ("DELETE FROM joint60 WHERE joint = 'elbow'", "joint60")],
)  # fmt: skip
def test_a_level_that_does_not_add_up_is_found_and_made_again(tmp_path, statement, said):
    store, _, readings = record(tmp_path, 3)
    store._connection.execute(statement)
    store.close()
    assert said in check(tmp_path)[0]
    repair(tmp_path, START)
    assert check(tmp_path) == []
    found = history(tmp_path, START, START + 3 * DAY)
    assert found[IMPORT].tolist() == by_hand(readings, "day", "UTC")


def test_days_of_years_are_rolled_up_some_at_once(tmp_path):
    store, robot, readings = record(tmp_path, 20)
    with closing(sqlite3.connect(tmp_path / "history.sqlite")) as other:
        other.execute("DELETE FROM meta WHERE name = 'rolled_until'")
        for table in ("slot60", "slot1440", "joint60", "joint1440", "curve"):
            other.execute(f"DELETE FROM {table}")
        other.commit()
    for days in (7, 14, 20, 20):
        assert store.write(robot.now + DAY)
        assert rows_of(tmp_path, "slot1440") == days
        found = history(tmp_path, START, START + 20 * DAY)
        assert found[IMPORT].tolist() == by_hand(readings, "day", "UTC")
    store.close()
    with closing(open_reader(tmp_path)) as connection:
        assert Rolled.of(connection).until_ns == START + 20 * DAY


JOB = dict.fromkeys(JOB_COLUMNS, 0)


def drawn_jobs(draw, count, days):
    """Jobs of three names that end within days, some at midnight."""
    for number in range(count):
        stop = START + draw.choice((draw.randrange(1, days * DAY), draw.randrange(1, days) * DAY))
        yield JOB | {"id": number, "start": stop - MINUTE, "stop": stop,
                     "name": f"part {number % 3}", IMPORT: draw.randrange(10**12)}  # fmt: skip


def jobs_by_hand(jobs, zone):
    """Parts and energy of each local day and name, from the jobs alone."""
    found = {}
    for job in jobs:
        local = datetime.fromtimestamp((job["stop"] - 1) // SECOND, ZoneInfo(zone))
        key = (f"{local:%F}", job["name"])
        parts, used = found.get(key, (0, 0))
        found[key] = (parts + 1, used + job[IMPORT])
    return found


def jobs_of(folder, zone):
    found = history_jobs(folder, START - DAY, START + 12 * DAY, "day", timezone=zone)
    days = (datetime.fromtimestamp(one // SECOND, ZoneInfo(zone)) for one in found.stamp_ns)
    keys = zip((f"{day:%F}" for day in days), found["job"].tolist(), strict=True)
    sums = zip(found["parts"].tolist(), found[IMPORT].tolist(), strict=True)
    return dict(zip(keys, sums, strict=True))


def test_jobs_rolled_up_by_name_are_those_that_ended_in_every_zone(tmp_path):
    draw, jobs = random.Random(2), {}
    store, robot, _ = record(tmp_path, 5)
    for late in (False, True):  # in days that are not rolled up, and in days that are
        for job in drawn_jobs(draw, 300, 10):
            number = job["id"] + 1000 * late
            if late and number % 3 == 0:  # it comes again, with another end
                number -= 1000
                job["start"] = jobs[number]["start"]
            jobs[number] = job | {"id": number}
            store.add_jobs("a", [jobs[number]])
        for _ in range(2):  # days without energy hold jobs as well
            assert store.write(START + 9 * DAY), store.trouble
        assert check(tmp_path) == []
        for zone in ZONES:
            assert jobs_of(tmp_path, zone) == jobs_by_hand(jobs.values(), zone), (late, zone)
    assert rows_of(tmp_path, "job1440") == 8 * 3
    store._connection.execute("UPDATE job60 SET jobs = jobs + 1 WHERE name = 'part 1'")
    store.close()
    assert "job60" in check(tmp_path)[0]
    repair(tmp_path, robot.now)
    assert check(tmp_path) == []
    assert jobs_of(tmp_path, "UTC") == jobs_by_hand(jobs.values(), "UTC")


def test_a_reader_sees_one_state_whatever_is_written_meanwhile(tmp_path, monkeypatch):
    """One transaction adds to a quarter hour and to a day, between the questions for these."""
    store, robot, _ = record(tmp_path, 5)
    before = robot.values[IMPORT]

    class Meanwhile(str):
        def format(self, **given):
            if robot.values[IMPORT] == before:
                for step in (0, -3 * DAY):
                    robot.step_clock(step)
                    robot.advance(QUARTER)
                    store.add("a", [robot.read(robot.now)])
                assert store.write(START + 5 * DAY, newest=True), store.trouble
            return super().format(**given)

    quarters, *others = queries._REGULAR
    monkeypatch.setattr(queries, "_REGULAR", (quarters, *map(Meanwhile, others)))
    asked = (tmp_path, START, START + 6 * DAY, "all")
    assert history(*asked)[IMPORT].tolist() == [before]
    assert history(*asked)[IMPORT].tolist() == [robot.values[IMPORT]]
    assert robot.values[IMPORT] > before
    store.close()


def test_pieces_cover_a_time_once():
    draw = random.Random(1)
    for _ in range(300):
        start = draw.randrange(0, 40 * DAY, QUARTER)
        stop = start + draw.randrange(QUARTER, 40 * DAY, QUARTER)
        until = draw.randrange(0, 80 * DAY, DAY)
        found = list(pieces(start, stop, until))
        assert [start, *(end for *_, end in found)] == [*(begin for _, begin, _ in found), stop]
        assert all(
            begin % length == end % length == 0 and (length == QUARTER or end <= until)
            for length, begin, end in found
        )
