"""A year of one robot through two recorders: kills, resets, clocks that are set, a week without.

Readings come every minute. The robot counts in whole numbers, so what the history must hold is
known to the microjoule, and nothing of it shares a sum with what it checks.
"""

from __future__ import annotations

import sys
import time
from contextlib import closing
from pathlib import Path

from figure import Figure, resident_kib

sys.path.append(str(Path(__file__).resolve().parent.parent))
from histories import DAY, MINUTE, START, Course, run_course
from robot_energy_history.api import history
from robot_energy_history.check import check
from robot_energy_history.database import open_reader

MINUTES = (12.0, 0.5)
IMPORT = "predicted_import_microjoule"
YEAR = Course(days=365, kills=1000, resets=200, steps=200, changes=100, lates=2000, off_days=7.0)
WEEK = Course(days=7, kills=20, resets=4, steps=4, changes=2, lates=40, off_days=0.5)


def run(folder: str, quick: bool) -> list[Figure]:
    """Simulate a year, or a week."""
    course = WEEK if quick else YEAR
    before, begin = resident_kib(), time.process_time()
    done, robot = run_course(Path(folder), course, seed=1, start=START)
    used = time.process_time() - begin
    grown = resident_kib() - before
    expected = done + robot.values[IMPORT]
    with closing(open_reader(folder)) as connection:
        (whole,) = connection.execute(f"SELECT sum({IMPORT}) FROM slot15").fetchone()
        (events,) = connection.execute("SELECT count(*) FROM event").fetchone()
    span = START - 30 * DAY, START + 400 * DAY
    days = history(folder, *span, "day", timezone="Europe/Berlin")
    months = history(folder, *span, "month", timezone="Europe/Berlin")
    by_days = int(days[IMPORT].sum()) + int(days.not_resolved[IMPORT].sum())
    by_months = int(months[IMPORT].sum()) + int(months.not_resolved[IMPORT].sum())
    minutes = course.days * DAY // MINUTE
    size = (Path(folder) / "history.sqlite").stat().st_size
    return [
        Figure("energy of all registers, kWh", expected / 3.6e12),
        Figure("history less registers, uJ", whole - expected, "0", whole == expected),
        Figure("days less history, uJ", by_days - whole, "0", by_days == whole),
        Figure("months less history, uJ", by_months - whole, "0", by_months == whole),
        Figure("epochs whose sums differ", len(check(folder)), "0", not check(folder)),
        Figure("events", events),
        Figure("size, MB", round(size / 1e6, 1)),
        Figure("processor time of a minute, ms", round(1e3 * used / minutes, 3)),
        Figure("memory grown, KiB", grown, "at most 32768", grown <= 32768),
    ]
