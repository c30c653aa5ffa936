"""Bags and live registers in one history: a minute counts once, whoever recorded it."""

import pytest

from histories import DAY, HOUR, MINUTE, START, Robot
from refusals import refused
from robot_energy.foundation.errors import HistoryError
from robot_energy_history.api import history, history_events, history_jobs
from robot_energy_history.bags import BagReadings
from robot_energy_history.check import check
from robot_energy_history.database import JOB_COLUMNS
from robot_energy_history.store import HistoryStore

IMPORT = "predicted_import_microjoule"
JOB = dict.fromkeys(JOB_COLUMNS, 0) | {"name": "weld", IMPORT: 7}


@pytest.fixture
def store(tmp_path):
    store = HistoryStore(tmp_path)
    store.open()
    yield store
    store.close()


def bag(start, minutes, name="ab12-0-0", watt=100, jobs=()):
    """A bag of so many minutes, read at each."""
    robot = Robot(now=start, start=start)
    readings = tuple(robot.minute(watt) for _ in range(minutes))
    return BagReadings("a", name, readings, tuple(jobs)), robot.values[IMPORT]


def live(store, start, minutes, off=0):
    """Live registers of so many minutes, the recorder being off in the first of them."""
    robot = Robot(now=start, start=start)
    store.add("a", [robot.minute(300) for _ in range(minutes)][off:])
    assert store.write(robot.now), store.trouble
    return robot


def minutes(store):
    found = history(store.folder, START - DAY, START + 9 * DAY, "minute")
    return dict(zip(((found.stamp_ns - START) // MINUTE).tolist(), found[IMPORT].tolist(),
                    strict=True))  # fmt: skip


def whole(store):
    assert check(store.folder) == []
    return int(history(store.folder, START - DAY, START + 9 * DAY, "all")[IMPORT].sum())


def test_bags_fill_what_nobody_has_recorded(store):
    job = JOB | {"id": 0, "start": START + HOUR, "stop": START + HOUR + 5 * MINUTE}
    first, used = bag(START + HOUR, 20, jobs=[job])
    assert store.add_bag(first) == 0
    assert minutes(store) == dict.fromkeys(range(60, 80), 6 * 10**9)
    later = live(store, START + 3 * HOUR, 10)
    second, more = bag(START + 2 * HOUR, 10, "cd34-0-0")
    assert store.add_bag(second) == 0
    assert whole(store) == used + more + later.values[IMPORT]
    assert store.has_bag("ab12-0-0")
    assert not store.has_bag("ab12-0-1")
    jobs = history_jobs(store.folder, START, START + DAY)
    assert (jobs["job"].tolist(), jobs["parts"].tolist()) == (["weld"], [1])


def test_what_live_registers_count_goes_before_a_bag(store):
    """The bag begins 10 minutes before the live registers and ends 10 minutes after them."""
    robot = live(store, START + HOUR, 20)
    jobs = [JOB | {"id": place, "start": START, "stop": START + minute * MINUTE}
            for place, minute in enumerate((55, 65, 85))]  # fmt: skip
    long, _ = bag(START + 50 * MINUTE, 40, jobs=jobs)
    assert store.add_bag(long) == 20 * MINUTE
    expected = dict.fromkeys(range(50, 90), 6 * 10**9) | dict.fromkeys(range(60, 80), 18 * 10**9)
    assert minutes(store) == expected
    assert whole(store) == robot.values[IMPORT] + 20 * 6 * 10**9
    assert "overlap" in history_events(store.folder, START, START + DAY)["kind"].tolist()
    assert history_jobs(store.folder, START, START + DAY)["parts"].tolist() == [2]


def test_a_bag_gives_way_to_live_registers_that_come_later(store):
    """The recorder begins late: its first reading counts the time of the bag as well."""
    early, _ = bag(START + 10 * MINUTE, 20)
    other, kept = bag(START - HOUR, 20, "cd34-0-0")
    store.add_bag(early)
    store.add_bag(other)
    robot = live(store, START, 60, off=50)
    assert whole(store) == robot.values[IMPORT] + kept
    events = history_events(store.folder, START - DAY, START + DAY)
    assert any("was also recorded live" in text for text in events["text"].tolist())


@pytest.mark.parametrize("rolled", [False, True])
def test_a_bag_that_is_replayed_again_takes_its_own_place(store, rolled):
    job = JOB | {"id": 0, "start": START + HOUR, "stop": START + HOUR + 5 * MINUTE}
    two = [job, job | {"id": 1, "stop": job["stop"] + MINUTE}]
    store.add_bag(bag(START + HOUR, 20, jobs=two)[0])
    assert store.write(START + (3 * DAY if rolled else HOUR))
    again, used = bag(START + HOUR, 15, "ab12-0-1", watt=150, jobs=[job])
    for _ in range(2):
        assert store.add_bag(again) == 0
        assert whole(store) == used
    assert minutes(store) == dict.fromkeys(range(60, 75), 9 * 10**9)
    assert store.has_bag("ab12-0-1")
    assert not store.has_bag("ab12-0-0")
    assert history_jobs(store.folder, START, START + DAY)["parts"].tolist() == [1]


def test_a_bag_of_quarter_hours_that_are_gone_stays(tmp_path):
    store = HistoryStore(tmp_path, keep_quarters=2.0)
    store.open()
    _, used = bag(START + HOUR, 20)
    store.add_bag(bag(START + HOUR, 20)[0])
    for _ in range(3):
        store.write(START + 9 * DAY)
    with refused(HistoryError, found="quarter hours", remedy="keep_quarters"):
        store.add_bag(bag(START + HOUR, 20, "ab12-0-1")[0])
    assert whole(store) == used
    store.close()
