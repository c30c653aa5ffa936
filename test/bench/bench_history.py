"""How long questions to a history take, and what a minute of all robots costs the recorder.

The alternative is polars on the same rows as one Parquet file.
"""

from __future__ import annotations

import shutil
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import polars as pl
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parent.parent))

from histories import DAY, MINUTE, START, Robot
from robot_energy.history.api import history
from robot_energy.history.files import open_reader
from robot_energy.history.readings import COLUMNS
from robot_energy.history.store import HistoryStore

IMPORT = "predicted_import_microjoule"
REPEATS = 5
QUARTER = 15 * MINUTE


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


def median(work: Callable[[], Any]) -> float:
    """Median time of a piece of work. [s]"""
    found = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        work()
        found.append(time.perf_counter() - begin)
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
    wall, used = minute_of(folder / "minute", robots)
    table = Table("question", "history", "polars on one Parquet file", title="history")
    for name, (own, other) in figures.items():
        table.add_row(name, f"{1e3 * own:.0f} ms", f"{1e3 * other:.0f} ms")
    share = used / 60.0
    table.add_row(f"a minute of {robots} robots, synced", f"{1e3 * wall:.0f} ms", "-")
    table.add_row("share of a core for writing", f"{100 * share:.2f} %", "-")
    size = (folder / "asked/history.sqlite").stat().st_size
    table.add_row("size of a month with joints", f"{size / 1e6:.0f} MB",
                  f"{with_parquet.stat().st_size / 1e6:.0f} MB (without joints)")  # fmt: skip
    result = {name: own for name, (own, _) in figures.items()} | {"minute": wall, "share": share}
    goals = {
        "a day of one robot in 50 ms": figures["a day of one robot"][0] <= 0.05,
        "writing takes at most 5 % of a core": share <= 0.05,
    }
    return table, result, goals
