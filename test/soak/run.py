"""Runs that take long: prints one table of figures and goals, writes build/soak.json.

Usage: ``make soak`` or ``python test/soak/run.py [NAME ...] [--quick]``. The exit code is 1
if a goal was missed. A run is a module of this folder (see `figure.LongRun`) listed in RUNS.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import sys
import time
import traceback
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


import flips
import flood
import history
import kills
import load
import meters
import month
import network
import page_day
import sanitizers
import service_kills
import service_load
import urdfs
import wear
from figure import Figure, LongRun
from rich.console import Console
from rich.table import Table

import fuzz

RUNS: dict[str, LongRun] = {
    "month": month,
    "history": history,
    "kills": kills,
    "service_kills": service_kills,
    "load": load,
    "service_load": service_load,
    "fuzz": fuzz,
    "flips": flips,
    "flood": flood,
    "network": network,
    "sanitizers": sanitizers,
    "meters": meters,
    "page_day": page_day,
    "urdfs": urdfs,
    "wear": wear,
}
BUILD = Path(__file__).resolve().parents[2] / "build"


def main() -> int:
    """Run what was named, or all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", choices=[[], *RUNS], help="which; all by default")
    parser.add_argument("--quick", action="store_true", help="short, for trying the script only")
    arguments = parser.parse_args()
    names = list(dict.fromkeys(arguments.names or RUNS))
    console = Console(width=120)
    minutes = sum(RUNS[name].MINUTES[arguments.quick] for name in names)
    console.print(f"{', '.join(names)}: about {minutes:.0f} minutes", highlight=False)
    table = Table("run", "figure", "value", "goal", "reached", title="long runs")
    results: dict[str, object] = {}
    missed = 0
    for name in names:
        folder = BUILD / "soak" / name
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        begin = time.monotonic()
        try:
            figures = RUNS[name].run(str(folder), arguments.quick)
        except Exception:  # one run that fails must not hide the others
            console.print(traceback.format_exc(), markup=False, highlight=False)
            figures = [Figure("ended by itself", "no, see above", "yes", False)]
        lasted = time.monotonic() - begin
        figures.append(Figure("duration [min]", round(lasted / 60, 1)))
        for index, figure in enumerate(figures):
            reached = "" if not figure.goal else "yes" if figure.reached else "NO"
            table.add_row(
                name if index == 0 else "", figure.what, _shown(figure.value), figure.goal, reached
            )
        table.add_section()
        missed += sum(not figure.reached for figure in figures)
        results[name] = {
            "quick": arguments.quick,
            "figures": [figure._asdict() for figure in figures],
        }
    console.print(table, markup=False, highlight=False)
    target = BUILD / "soak.json"
    known: dict[str, object] = json.loads(target.read_text()) if target.exists() else {}
    machine = {"cores": os.cpu_count(), "python": platform.python_version()}
    target.write_text(json.dumps({**known, "machine": machine, **results}, indent=1) + "\n")
    console.print(
        f"figures in {target.relative_to(BUILD.parent)}; {missed} goals missed", highlight=False
    )
    return 1 if missed else 0


def _shown(value: float | int | str) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    sys.exit(main())
