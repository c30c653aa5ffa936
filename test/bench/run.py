"""Runs every benchmark, prints tables and writes the figures to build/bench.json.

Every figure stands next to a named alternative measured in the same run; medians.
Usage: ``make bench``, or some: ``python test/bench/run.py replay live page [--quick]``.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import bench_history
import bench_identify
import bench_layouts
import bench_length
import bench_live
import bench_page
import bench_pipeline
import bench_replay
from rich.console import Console

BENCHES = {
    "layouts": bench_layouts,
    "pipeline": bench_pipeline,
    "replay": bench_replay,
    "live": bench_live,
    "page": bench_page,
    "identify": bench_identify,
    "history": bench_history,
    "length": bench_length,
}
BUILD = Path(__file__).resolve().parents[2] / "build"


def main() -> int:
    """Run the benchmarks that were named, or all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", choices=[[], *BENCHES], help="which; all by default")
    parser.add_argument("--quick", action="store_true", help="short, for trying the script only")
    arguments = parser.parse_args()
    console = Console(width=110)
    figures: dict[str, object] = {
        "machine": {"cores": os.cpu_count(), "python": platform.python_version()}
    }
    target = BUILD / "bench.json"
    missed: list[str] = []
    if not arguments.names and not arguments.quick:
        console.print("all benchmarks: about half an hour on two cores that do nothing else")
    for name in arguments.names or list(BENCHES):
        table, result, goals = BENCHES[name].run(BUILD / "bench", arguments.quick)
        console.print(table)
        figures[name] = result
        for goal, met in goals.items():
            console.print(f"  {'met   ' if met else 'MISSED'} {goal}", highlight=False)
            if not met:
                missed.append(goal)
    BUILD.mkdir(exist_ok=True)
    if target.exists():
        figures = {**json.loads(target.read_text()), **figures}
    target.write_text(json.dumps(figures, indent=1) + "\n")
    console.print(f"figures in {target.relative_to(BUILD.parent)}")
    met = "; on a busy machine goals are missed for no other reason" if missed else ""
    console.print(f"goals missed: {'; '.join(missed) or 'none'}{met}", highlight=False)
    return 0


if __name__ == "__main__":
    sys.exit(main())
