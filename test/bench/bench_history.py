"""How long questions to a history take, and what a minute of all robots costs the recorder.

The alternative is polars on the same rows as one Parquet file.
"""

from __future__ import annotations

import shutil
import sqlite3
import statistics
import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parent.parent))

from histories import DAY, HOUR, MINUTE, START, Robot
from robot_energy_history.api import history, history_jobs
from robot_energy_history.database import JOB_SUMS, open_reader
from robot_energy_history.readings import COLUMNS
from robot_energy_history.rollup import Rolled, curve_id
from robot_energy_history.store import HistoryStore
from robot_energy_history.tariffs import Tariff, add_tariffs
from robot_energy_report.page.history_view import HistoryView, savings_answer

IMPORT = "predicted_import_microjoule"
REPEATS = 5
IMPORT_COLUMN = COLUMNS.index(IMPORT)
QUARTER = 15 * MINUTE
YEAR = 365
SUMS = len(JOB_SUMS)
TARIFF = Tariff.model_validate(
    {
        "begin": "2025-01-01", "timezone": "Europe/Berlin", "price_per_kwh": 0.31,
        "time_of_use": [{"begin": "22:00", "end": "06:30", "price_per_kwh": 0.17}],
        "shifts": ["06:00", "14:00", "22:00"],
    },
    strict=False,
)  # fmt: skip


def fill(folder: Path, robots: int, days: int) -> None:
    """Record quarter hours of robots over days."""
    store = HistoryStore(folder, keep_days=1.0)
    store.open()
    each = [Robot(number) for number in range(robots)]
    for place in range(days * 96):
        for number, robot in enumerate(each):
            robot.advance(QUARTER)
            store.add(f"r{number:03d}", [robot.read(robot.now)])
        if place % 48 == 47:
            assert store.write(robot.now), store.trouble
    store.close()


def fill_year(folder: Path, robots: int) -> None:
    """Put a year of rolled-up days of robots into a history, as its writer leaves them."""
    store = HistoryStore(folder)
    store.open()
    store.close()
    draw, count = np.random.default_rng(1), 6 + len(COLUMNS)
    with closing(sqlite3.connect(folder / "history.sqlite", isolation_level=None)) as connection:
        connection.execute("PRAGMA synchronous = OFF")
        connection.execute("BEGIN")
        for robot in range(1, robots + 1):
            connection.execute("INSERT INTO robot VALUES (?, ?)", (robot, f"r{robot:03d}"))
            hours = draw.integers(0, 10**12, (YEAR * 24, len(COLUMNS)))
            for length, values in ((HOUR, hours), (DAY, hours.reshape(YEAR, 24, -1).sum(1))):
                rows = (
                    (START + place * length, robot, robot, START + (place + 1) * length, 0, 1, *own)
                    for place, own in enumerate(values.tolist())
                )
                connection.executemany(
                    f"INSERT INTO slot{length // MINUTE} VALUES ({', '.join('?' * count)})", rows
                )
            for length, jobs in ((HOUR, 8), (DAY, 8 * 24)):
                rows = (
                    (robot, START + place * length, f"part {name}", jobs, *[jobs * 10**9] * SUMS)
                    for place in range(YEAR * DAY // length)
                    for name in ((place % 3,) if length == HOUR else range(3))
                )
                connection.executemany(
                    f"INSERT INTO job{length // MINUTE} VALUES ({', '.join('?' * (4 + SUMS))})",
                    rows,
                )
            quarters = hours[:, IMPORT_COLUMN].repeat(4).reshape(YEAR, 96) // 4
            curves = np.stack([quarters, quarters // 3], axis=2)
            connection.executemany(
                "INSERT INTO curve VALUES (?, ?)",
                (
                    (curve_id(robot, START + day * DAY), own.tobytes())
                    for day, own in enumerate(curves)
                ),
            )
        Rolled(START + YEAR * DAY).write(connection)
        connection.execute("COMMIT")
    add_tariffs(folder, [TARIFF], 0)


def median(work: Callable[[], Any], clock: Callable[[], float] = time.perf_counter) -> float:
    """Median time of a piece of work. [s]"""
    found = []
    for _ in range(REPEATS):
        begin = clock()
        work()
        found.append(clock() - begin)
    return statistics.median(found)


def minute_of(folder: Path, robots: int) -> tuple[float, float]:
    """Wall and processor time of one minute of robots, in one transaction. [s]"""
    store, each = HistoryStore(folder), [Robot(number) for number in range(robots)]
    store.open()
    wall, used = [], []
    for _ in range(30):
        for number, robot in enumerate(each):
            store.add(f"r{number:03d}", [robot.minute()])
        begin, began = time.perf_counter(), time.process_time()
        assert store.write(each[0].now), store.trouble
        wall.append(time.perf_counter() - begin)
        used.append(time.process_time() - began)
    store.close()
    return statistics.median(wall), statistics.median(used)


def run(folder: Path, quick: bool) -> tuple[Table, dict[str, Any], dict[str, bool]]:
    """Fill a history and ask it."""
    folder = folder / "history"
    shutil.rmtree(folder, ignore_errors=True)
    robots, days = (5, 31) if quick else (100, 31)
    fill(folder / "asked", robots, days)
    with_parquet = folder / "slots.parquet"
    connection = open_reader(folder / "asked")
    rows = connection.execute(f"SELECT robot, start, {', '.join(COLUMNS)} FROM slot15").fetchall()
    connection.close()
    pl.DataFrame(rows, schema=["robot", "start", *COLUMNS], orient="row").write_parquet(
        with_parquet
    )
    month = START, START + days * DAY
    local = pl.from_epoch("start", "ns").dt.convert_time_zone("Europe/Berlin").dt.date()

    def by_day() -> Any:
        return (
            pl.scan_parquet(with_parquet)
            .group_by(local.alias("day"), "robot").agg(pl.col(IMPORT).sum()).collect()
        )  # fmt: skip

    def of_polars(robot: int) -> Any:
        first = pl.scan_parquet(with_parquet).filter(pl.col("robot") == robot)
        return first.filter(pl.col("start") < START + DAY).collect()

    def ours(start: int, stop: int, names: tuple[str, ...] = ()) -> Any:
        return history(folder / "asked", start, stop, "day", names, "Europe/Berlin")

    figures = {
        "a day of one robot": (
            median(lambda: ours(START, START + DAY, ("r000",))),
            median(lambda: of_polars(1)),
        ),
        f"a month by day, {robots} robots": (median(lambda: ours(*month)), median(by_day)),
    }
    fill_year(folder / "year", robots)

    def of_year(days: int, resolution: Any, names: tuple[str, ...] = ()) -> float:
        asked = (START, START + days * DAY, resolution, names, "Europe/Berlin")
        return median(lambda: history(folder / "year", *asked), time.process_time)

    priced = {
        f"a priced month by day, {robots} robots": (of_year(31, "day"), 0.5),
        f"a priced year by month, {robots} robots": (of_year(YEAR, "month"), 0.5),
        "a priced year by day, one robot": (of_year(YEAR, "day", ("r001",)), 0.5),
        "a priced day by hour, one robot": (of_year(1, "hour", ("r001",)), 0.05),
    }
    page, noon = HistoryView(folder / "year"), START + (YEAR - 1) * DAY + 12 * HOUR

    def of_page(period: str, names: tuple[str, ...] = (), by: str = "robot") -> float:
        wish = page.wish({"period": [period], "robot": names, "by": [by]}, noon)
        return median(lambda: page.answer(wish, noon), time.process_time)

    def of_savings(names: tuple[str, ...] = ()) -> float:
        asked = {"period": ["month"], "robot": names, "driver": ["parts"],
                 "baseline_start": ["2026-10-01"], "baseline_stop": ["2026-12-01"]}  # fmt: skip
        wish = page.wish(asked, noon)
        answer = lambda: savings_answer(folder / "year", wish, asked, noon)  # noqa: E731
        return median(answer, time.process_time)

    priced |= {
        "page: a day of one robot": (of_page("day", ("r001",)), 0.05),
        f"page: a month of {robots} robots": (of_page("month"), 0.5),
        f"page: a year of {robots} robots": (of_page("year"), 0.5),
        f"page: a year of {robots} robots by job": (of_page("year", by="job"), 0.5),
        "page: savings of one robot over three months": (of_savings(("r001",)), 0.5),
    }
    table_of_jobs = (folder / "year", START, START + YEAR * DAY)
    by_job = lambda: history_jobs(*table_of_jobs, "month", (), "Europe/Berlin")  # noqa: E731
    priced |= {
        f"a year of jobs by month, {robots} robots": (median(by_job, time.process_time), 0.5),
    }
    wall, used = minute_of(folder / "minute", robots)
    table = Table("question", "history", "polars on one Parquet file", title="history")
    for name, (own, other) in figures.items():
        table.add_row(name, f"{1e3 * own:.0f} ms", f"{1e3 * other:.0f} ms")
    for name, (own, _) in priced.items():
        table.add_row(f"{name}, processor time", f"{1e3 * own:.0f} ms", "-")
    share = used / 60.0
    table.add_row(f"a minute of {robots} robots, synced", f"{1e3 * wall:.0f} ms", "-")
    table.add_row("share of a core for writing", f"{100 * share:.2f} %", "-")
    size = (folder / "asked/history.sqlite").stat().st_size
    table.add_row("size of a month with joints", f"{size / 1e6:.0f} MB",
                  f"{with_parquet.stat().st_size / 1e6:.0f} MB (without joints)")  # fmt: skip
    result = {name: own for name, (own, _) in figures.items()} | {"minute": wall, "share": share}
    result |= {name: own for name, (own, _) in priced.items()}
    goals = {
        "a day of one robot in 50 ms": figures["a day of one robot"][0] <= 0.05,
        "writing takes at most 5 % of a core": share <= 0.05,
    }
    goals |= {f"{name} in {limit:g} s": own <= limit for name, (own, limit) in priced.items()}
    return table, result, goals
