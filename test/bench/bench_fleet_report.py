"""How long a report takes on ten thousand bags: reading the dataset, and the report.

``python test/bench/bench_fleet_report.py [BAGS]`` generates a week of four robots and writes its
rows again, as other robots and other weeks, until there are so many.
"""

import argparse
import sys
import time
from pathlib import Path

import polars as pl

sys.path.insert(0, str(Path(__file__).parent.parent))

from fleets import fleet, written
from robot_energy.foundation.files.temporary_folder import TemporaryFolder
from robot_energy_fleet.dataset import read_tables
from robot_energy_fleet.report import fleet_report
from robot_energy_fleet.tables import FleetTables

ROBOTS, WEEKS = 4, 5
WEEK_NS = 7 * 86_400_000_000_000
STAMPS = ("start_ns", "end_ns", "hour_ns")


def again(tables, copy):
    """The same rows of other robots and another week."""
    shift = copy % WEEKS * WEEK_NS
    frames = {}
    for name, frame in vars(tables).items():
        moved = [pl.col(one) + shift for one in STAMPS if one in frame.columns]
        if name == "joints":
            moved.append(pl.col("wear_stamp_ns").list.eval(pl.element() + shift))
        if name == "runs":  # a bag of a robot counts once
            moved.append(pl.col("bag") + f"-week{copy % WEEKS}")
        other = pl.col("robot") + f"-{copy // WEEKS:03d}"
        frames[name] = frame.with_columns(*moved, key=pl.col("key") + f"c{copy}", robot=other)
    return FleetTables(**frames)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bags", nargs="?", type=int, default=10_000, help="default: ten thousand")
    wanted = parser.parse_args().bags
    week = fleet(ROBOTS, faults=False)
    copies = [again(week, copy) for copy in range(-(-wanted // len(week.runs)))]
    tables = FleetTables(*map(pl.concat, zip(*(vars(one).values() for one in copies), strict=True)))
    with TemporaryFolder() as place:
        folder = Path(written(place.path / "dataset", tables))
        size = sum(path.stat().st_size for path in folder.rglob("*.parquet"))
        begun, used = time.perf_counter(), time.process_time()
        read = read_tables(folder)
        between = time.perf_counter()
        report = fleet_report(read, "dataset")
        end = time.perf_counter()
        used = time.process_time() - used
    assert report.bags == len(tables.runs), f"{report.bags} of {len(tables.runs)} bags were counted"
    hours = sum(one.observed_time for one in report.robots) / 3600.0
    print(
        f"{report.bags} bags of {len(report.robots)} robots, {size / 1e6:.0f} MB "
        f"({size / hours / 1e6:.2f} MB a recorded hour): read {between - begun:.1f} s, report "
        f"{end - between:.1f} s, together {end - begun:.1f} s ({used:.1f} s of processor time)"
    )


if __name__ == "__main__":
    main()
