"""Sums of a history are the registers to the microjoule, over courses of trouble."""

from contextlib import closing
from datetime import datetime
from zoneinfo import ZoneInfo

import pytest

from histories import DAY, HOUR, SECOND, Course, run_course
from robot_energy_history.api import history
from robot_energy_history.check import check
from robot_energy_history.database import open_reader

IMPORT = "predicted_import_microjoule"


@pytest.mark.parametrize(("seed", "month"), [(0, (2026, 3, 27)), (1, (2026, 10, 23))])
def test_sums_are_the_registers_through_all_trouble(tmp_path, seed, month):
    start = int(datetime(*month, tzinfo=ZoneInfo("Europe/Berlin")).timestamp()) * SECOND
    course = Course(days=4, kills=25, resets=6, steps=10, changes=5, lates=40, off_days=0.7)
    done, robot = run_course(tmp_path, course, seed, start)
    assert check(tmp_path) == []
    with closing(open_reader(tmp_path)) as connection:
        (whole,) = connection.execute(f"SELECT sum({IMPORT}) FROM slot15").fetchone()
    assert whole == done + robot.values[IMPORT]
    every = history(tmp_path, start - 10 * DAY, start + 20 * DAY, "all")
    assert every[IMPORT].sum() == whole
    days = history(tmp_path, start - 10 * DAY, start + 20 * DAY, "day", timezone="Europe/Berlin")
    assert days[IMPORT].sum() + days.not_resolved[IMPORT].sum() == whole
    lengths = {
        (int(b) - int(a)) // HOUR for a, b in zip(days.stamp_ns, days["stop_ns"], strict=True)
    }
    assert lengths - {24} == {23 if month[1] == 3 else 25}
