"""A robot that warms up: friction that follows its gears next to friction that follows its motors.

    python test/bench/warm_up.py [--plants 10] [--first 300] [--models all] [--without EFFECT ...]

Drawn plants of the virtual rig (simulated), identified from three short recordings and one warm-up
(``all``: drives, constants and a fan of the cabinet from the warm-up, too); another program of an
hour from cold, one with a rest of half an hour, and one that starts with gears 8 K warmer than
their motors. Errors of energy over the whole run and over five minutes, and
of the friction power of each joint; the error of each five minutes that begin ten minutes after the
wrong start or later, and its step over the rest.
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

from warm_robots import MODELS, REST, SPAN, WARM_UP, WarmRun, gear_study

from robot_energy_report.printing import table
from robot_energy_rig import RigConfig

CONSOLE = Console(width=120)


def row_of(run: WarmRun) -> list[str]:
    """Return the cells of one run."""
    low, high = 100.0 * np.array([run.windows.min(), run.windows.max()])
    friction = 100.0 * run.friction
    return [
        run.plant, run.run, run.model, f"{100.0 * run.error:+.1f}", f"{low:+.1f} to {high:+.1f}",
        f"{np.median(friction):.1f}", f"{friction.max():.1f}",
    ]  # fmt: skip


def _settled(runs: list[WarmRun]) -> str:
    """Errors once ten minutes are over, and steps over the rest."""
    before = round(WARM_UP / 2 / SPAN)
    after = before + round(REST / SPAN)
    lines: list[str] = []
    for name in dict.fromkeys(run.model for run in runs):
        for kind, what in (
            ("gears 8 K above motors", "ten minutes after the wrong start"),
            ("hour with a rest", "step over the rest"),
        ):
            own = [100.0 * run.windows for run in runs if (run.run, run.model) == (kind, name)]
            if own:
                late = what.startswith("ten")
                off = [
                    np.abs(one[2:]).max() if late else abs(one[after] - one[before - 1])
                    for one in own
                ]
                worst = f"{np.median(off):.1f} % in the median, {max(off):.1f} % at most"
                lines.append(f"{what}, friction follows {name}: {worst} ({len(off)} plants)")
    return "\n".join(lines)


def main() -> int:
    """Print a row for each run and the medians of each kind."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plants", type=int, default=10, help="drawn plants, of three robots")
    parser.add_argument("--first", type=int, default=300, help="seed of the first plant")
    parser.add_argument("--models", nargs="+", default=MODELS, choices=MODELS)
    parser.add_argument("--without", nargs="*", default=[], help="effects of the rig to leave out")
    args = parser.parse_args()
    config = RigConfig.hard().without(*args.without)
    warnings.simplefilter("ignore", RuntimeWarning)  # of fits that find nothing
    runs: list[WarmRun] = []
    with tempfile.TemporaryDirectory() as folder:
        plants = range(args.first, args.first + args.plants)
        for run in gear_study(Path(folder), plants, config, args.models):
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
    CONSOLE.print(_settled(runs))
    heads = ("run", "friction follows", "energy, median", "worst", "5 min, median", "friction RMS")
    table(CONSOLE, "virtual rig, drawn plants (simulated): size of the errors [%]", heads, rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
