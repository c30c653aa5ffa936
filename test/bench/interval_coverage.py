"""How often the 95 % intervals of identified figures hold the truth, on plants of the rig.

    python test/bench/interval_coverage.py [--hard] [--quick] [--more]

Every repetition draws a plant, its sensors and their constant errors, and motions; half of them
have the power of each drive as well as the meter. `robot_energy_studies.interval_coverage` says
what is drawn. 60 repetitions take about a quarter of an hour on a free core.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from rich.console import Console

from robot_energy.certainty.deviation import Z95
from robot_energy_report.printing import table
from robot_energy_studies.interval_coverage import DrawnPlant, Judged, coverages, repetitions

GOAL = (0.90, 0.98)


def disjoint(fewer: Sequence[Judged], more: Sequence[Judged]) -> tuple[int, tuple[str, ...]]:
    """Return how many figures two identifications share, and whose intervals do not meet."""
    known = {(entry.group, entry.name): entry for entry in fewer if entry.std > 0.0}
    pairs = [
        (known[key], entry)
        for entry in more
        if (key := (entry.group, entry.name)) in known and entry.std > 0.0
    ]
    apart = [
        f"{one.group} {one.name}"
        for one, other in pairs
        if abs(one.value - other.value) > Z95 * (one.std + other.std)
    ]
    return len(pairs), tuple(apart)


def more(robots: list[str], seeds: range, hard: bool, show: Callable[[str, int], None]) -> int:
    """Print the intervals that do not meet those from fewer recordings; exit code 1 if any."""
    figures = apart = 0
    for seed in seeds:
        robot = robots[seed % len(robots)]
        show(robot, seed)
        with TemporaryDirectory() as folder:
            plant = DrawnPlant.of(robot, seed, hard)
            bags = plant.recorded(Path(folder))
            found = [plant.identified(bags[:count]) for count in range(2, len(bags) + 1)]
        for count, (fewer, wider) in enumerate(pairwise(found), 2):
            shared, names = disjoint(fewer, wider)
            figures, apart = figures + shared, apart + len(names)
            for name in names:
                print(f"{robot} {seed}: from {count} recordings and one more: {name}")
    print(f"{apart} of {figures} intervals do not meet those from one recording less")
    return int(apart > 0 and not hard)


def main() -> int:
    """Print the coverage of each group; exit code 1 if one within the form misses the goal."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", nargs="+", default=["kr16", "irb4600", "ur5e"])
    parser.add_argument("--repetitions", type=int, default=60)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--hard", action="store_true", help="effects without a term in the model")
    parser.add_argument("--quick", action="store_true", help="three repetitions, no goals")
    parser.add_argument(
        "--more",
        action="store_true",
        help="count intervals that one more recording makes disjoint",
    )
    parser.add_argument("--json", type=Path, help="write the figures")
    args = parser.parse_args()
    count = 3 if args.quick else args.repetitions
    begin = time.process_time()
    seeds = range(args.first_seed, args.first_seed + count)

    def show(robot: str, seed: int) -> None:
        print(f"{seed - args.first_seed + 1}/{count} {robot}", file=sys.stderr, flush=True)

    if args.more:
        return more(args.robots, seeds, args.hard, show)
    found = repetitions(args.robots, seeds, args.hard, show)
    rows = coverages(found)
    kind = "every effect of the rig" if args.hard else "within the form of the model"
    page = Console(width=110)
    table(
        page,
        f"95 % intervals that hold the truth, {count} repetitions, {kind}",
        ("group", "figures", "repetitions", "hold the truth", "half width", "RMS deviations"),
        [
            (row.group, str(row.figures), str(row.repetitions), f"{100 * row.share:.1f} %",
             f"{100 * row.half_width:.1f} %", f"{row.deviations:.2f}")
            for row in rows
        ],
    )  # fmt: skip
    page.print(f"{(time.process_time() - begin) / count:.1f} s of CPU for one", highlight=False)
    if args.json:
        args.json.write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n")
    if args.hard or args.quick:
        return 0
    missed = [row.group for row in rows if not GOAL[0] <= row.share <= GOAL[1]]
    page.print(f"goal 90 to 98 %, missed: {', '.join(missed) or 'none'}", highlight=False)
    return int(bool(missed))


if __name__ == "__main__":
    raise SystemExit(main())
