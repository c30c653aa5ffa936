"""Replay of a 10-minute bag in one process and in two, compared with the loop of a user."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import time
from pathlib import Path

from recording import record
from rich.table import Table

HERE = Path(__file__).parent
RATE = 500


def measure(script: str, *arguments: str, function: str = "main") -> dict[str, float]:
    """Run a script in its own process; wall time after imports, peak memory, its figures."""
    code = (
        "import json, re, sys, time\n"
        f"sys.path.insert(0, {str(HERE)!r})\n"
        f"import {script}, robot_energy.bag.cdr.types as types; types.typestore()\n"
        f"begin = time.perf_counter(); out = {script}.{function}(*{list(arguments)!r}) or {{}}\n"
        "wall = time.perf_counter() - begin\n"
        "status = open('/proc/self/status').read()\n"
        "peak = int(re.search(r'VmHWM:\\s+(\\d+)', status)[1]) / 1024\n"
        "print(json.dumps({'wall': wall, 'peak_mb': peak, **out}))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    lines = done.stdout.strip().splitlines()
    return json.loads(lines[-1])


def median(runs: list[dict[str, float]]) -> dict[str, float]:
    """Median of each figure."""
    return {key: statistics.median(run[key] for run in runs) for key in runs[0]}


def run(folder: Path, quick: bool) -> tuple[Table, dict[str, object], dict[str, bool]]:
    """Measure replay and the alternative on both kinds of bag."""
    seconds = 60 if quick else 600
    messages = seconds * RATE
    table = Table(title=f"replay of {seconds} s, {RATE} Hz, 6 joints")
    for column in (
        "bag",
        "program",
        "wall s",
        "us/message",
        "x real time",
        "ratio",
        "peak MB",
        "reading",
        "dynamics",
        "rest",
    ):
        table.add_column(column, justify="left" if column in ("bag", "program") else "right")
    figures: dict[str, object] = {"seconds": seconds, "messages": messages}
    goals: dict[str, bool] = {}
    for compression in ("zstd", "none"):
        bag = str(record(folder / f"{seconds}s_{compression}", seconds, compression))
        short = str(record(folder / f"{seconds // 5}s_{compression}", seconds // 5, compression))
        runs: dict[str, list[dict[str, float]]] = {"ours": [], "ahead": [], "naive": []}
        for turn in range(1 if quick else 5):  # interleaved, so that noise meets both alike
            runs["ours"].append(measure("ours", bag, "kr16"))
            runs["ahead"].append(measure("ours", bag, "kr16", "2", function="ahead"))
            if turn % 2 == 0:
                runs["naive"].append(measure("naive", bag, "kr16"))
        ours, ahead, naive = (median(runs[name]) for name in ("ours", "ahead", "naive"))
        if ahead["energy"] != ours["energy"]:
            raise RuntimeError("two processes count other energies than one")
        brief = measure("ours", short, "kr16")
        ratio, speed = naive["wall"] / ours["wall"], seconds / ours["wall"]
        of_two = naive["wall"] / ahead["wall"]
        programs = {
            "robot-energy replay": ours,
            "the same, --processes 2": ahead,
            "AnyReader + pin.rnea": naive,
        }
        for name, result in programs.items():
            shares = [
                f"{result[key]:.0%}" if key in result else ""
                for key in ("reading", "dynamics", "rest")
            ]
            table.add_row(
                compression,
                name,
                f"{result['wall']:.2f}",
                f"{result['wall'] / messages * 1e6:.2f}",
                f"{seconds / result['wall']:.0f}",
                f"{naive['wall'] / result['wall']:.1f}",
                f"{result['peak_mb']:.0f}",
                *shares,
            )
        figures[compression] = {
            "replay": ours,
            "two_processes": ahead,
            "ratio_of_two": of_two,
            "naive": naive,
            "ratio": ratio,
            "recorded_seconds_per_second": speed,
            "peak_mb_of_a_fifth": brief["peak_mb"],
        }
        goals[f"{compression}: at least 15 times faster than the loop: {ratio:.1f}"] = ratio >= 15
        goals[f"{compression}: two processes at least 20 times: {of_two:.1f}"] = of_two >= 20
        goals[f"{compression}: at least 400 recorded s per s: {speed:.0f}"] = speed >= 400
        goals[f"{compression}: peak below 300 MB: {ours['peak_mb']:.0f}"] = ours["peak_mb"] < 300
        growth = ours["peak_mb"] - brief["peak_mb"]
        goals[
            f"{compression}: memory independent of length: {growth:+.0f} MB for 5 times the bag"
        ] = growth < 10
    return table, figures, goals


if __name__ == "__main__":
    begin = time.perf_counter()
    print(run(Path("build/bench"), quick=True)[1], time.perf_counter() - begin)
