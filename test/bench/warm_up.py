"""A robot that warms up: friction that follows its gears beside friction that follows its motors.

    python test/bench/warm_up.py [--plants 10] [--first 300]

Drawn plants of the virtual rig (simulated), identified from three short recordings and one warm-up;
another program of an hour from cold, one with a rest of half an hour, and one that starts with
gears 8 K warmer than their motors. Errors of energy over the whole run and over five minutes, and
of the friction power of each joint.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np
from rich.console import Console

sys.path.insert(0, str(Path(__file__).parent.parent))

from robot_energy.report.printing import table
from robot_energy_papers.gear_study import WarmRun, gear_study

CONSOLE = Console(width=120)


def row_of(run: WarmRun) -> list[str]:
    """Return the cells of one run."""
    low, high = 100.0 * np.array([run.windows.min(), run.windows.max()])
    friction = 100.0 * run.friction
    return [
        run.plant, run.run, run.model, f"{100.0 * run.error:+.1f}", f"{low:+.1f} to {high:+.1f}",
        f"{np.median(friction):.1f}", f"{friction.max():.1f}",
    ]  # fmt: skip


def main() -> int:
    """Print a row for each run and the medians of each kind."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plants", type=int, default=10, help="drawn plants, of three robots")
    parser.add_argument("--first", type=int, default=300, help="seed of the first plant")
    args = parser.parse_args()
    warnings.simplefilter("ignore", RuntimeWarning)  # of fits that find nothing
    runs: list[WarmRun] = []
    with tempfile.TemporaryDirectory() as folder:
        for run in gear_study(Path(folder), range(args.first, args.first + args.plants)):
            print(*row_of(run), sep=" | ", flush=True)
            runs.append(run)
    kinds = dict.fromkeys((run.run, run.model) for run in runs)
    rows: list[list[str]] = []
    for kind in kinds:
        own = [run for run in runs if (run.run, run.model) == kind]
        errors = 100.0 * np.abs([run.error for run in own])
        windows = 100.0 * np.abs(np.concatenate([run.windows for run in own]))
        friction = 100.0 * np.concatenate([run.friction for run in own])
        cells = (np.median(errors), errors.max(), np.median(windows), np.median(friction))
        rows.append([*kind, *(f"{value:.1f}" for value in cells)])
    heads = ("run", "friction follows", "energy, median", "worst", "5 min, median", "friction RMS")
    table(CONSOLE, "virtual rig, drawn plants (simulated): size of the errors [%]", heads, rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
