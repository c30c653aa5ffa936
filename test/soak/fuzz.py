"""Fuzzing guided by coverage of everything that reads what others wrote."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from figure import Figure

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "fuzz"))

from targets import TARGETS

SECONDS = (120, 5)  # for each, whole and quick
MINUTES = tuple(len(TARGETS) * (seconds + 5) / 60 for seconds in SECONDS)
FOUND = ("crash-*", "timeout-*", "oom-*", "leak-*")


def run(folder: str, quick: bool) -> list[Figure]:
    """Try every target for the same time, one after the other."""
    return [_try(name, Path(folder) / name, SECONDS[quick]) for name in TARGETS]


def _try(name: str, folder: Path, seconds: int) -> Figure:
    scratch = folder / "scratch"
    scratch.mkdir(parents=True)
    path = os.pathsep.join([str(HERE.parent), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "PYTHONPATH": path, "TMPDIR": str(scratch)}
    done = subprocess.run(
        [sys.executable, str(HERE.parent / "fuzz" / "harness.py"), name, str(folder), str(seconds)],
        env=environment,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
        timeout=seconds * 2 + 120,
    )
    (folder / "log.txt").write_text(done.stdout + done.stderr)
    shutil.rmtree(scratch, ignore_errors=True)
    found = [path.name for pattern in FOUND for path in folder.glob(pattern)]
    runs = re.findall(r"number_of_executed_units: (\d+)", done.stderr)
    covered = re.findall(r"cov: (\d+)", done.stderr)
    value = f"{runs[-1] if runs else '?'} inputs, {covered[-1] if covered else '?'} edges"
    good = done.returncode == 0 and not found and bool(runs)
    if not good:
        value += f"; {', '.join(found) or 'ended early'}, see {folder / 'log.txt'}"
    return Figure(f"{name}, {seconds} s", value, "no failure", good)
