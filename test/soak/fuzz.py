"""Fuzzing guided by coverage of everything that reads what others wrote; its time and memory."""

from __future__ import annotations

import json
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

SECONDS = (600, 5)  # for each, whole and quick
INPUTS = (500, 10)  # of the plain code, likewise
MAX_SECONDS, MAX_MEGABYTES = 5.0, 512.0  # of processor time for one input; of the process
MINUTES = tuple(len(TARGETS) * (seconds + 30) / 60 for seconds in SECONDS)
FOUND = ("crash-*", "timeout-*", "oom-*", "leak-*")


def run(folder: str, quick: bool) -> list[Figure]:
    """Try every target for the same time, one after the other; then measure each."""
    places = {name: Path(folder) / name for name in TARGETS}
    tried = [_try(name, place, SECONDS[quick]) for name, place in places.items()]
    return [*tried, *(_measure(name, place, INPUTS[quick]) for name, place in places.items())]


def _script(folder: Path, script: str, *arguments: str, wait: float) -> subprocess.CompletedProcess:
    """Run a script of the targets with a scratch folder of its own."""
    scratch = folder / "scratch"
    scratch.mkdir(parents=True)
    path = os.pathsep.join([str(HERE.parent), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [sys.executable, str(HERE.parent / "fuzz" / script), *arguments],
        env={**os.environ, "PYTHONPATH": path, "TMPDIR": str(scratch)},
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
        timeout=wait,
    )
    shutil.rmtree(scratch, ignore_errors=True)
    return done


def _measure(name: str, folder: Path, inputs: int) -> Figure:
    """Slowest input and peak of memory, without what atheris adds."""
    done = _script(folder, "bounds.py", name, str(inputs), wait=600 + inputs * MAX_SECONDS)
    what = f"{name}, {inputs} damaged samples"
    goal = f"below {MAX_SECONDS:g} s each, {MAX_MEGABYTES:g} MB"
    if done.returncode:
        (folder / "bounds.txt").write_text(done.stdout + done.stderr)
        return Figure(what, f"failed, see {folder / 'bounds.txt'}", goal, False)
    found = json.loads(done.stdout.splitlines()[-1])
    good = found["slowest"] < MAX_SECONDS and found["peak"] < MAX_MEGABYTES
    value = f"slowest {found['slowest']:.2f} s, {found['peak']:.0f} MB"
    return Figure(what, value if good else f"{value}; {found['input']}", goal, good)


def _try(name: str, folder: Path, seconds: int) -> Figure:
    done = _script(folder, "harness.py", name, str(folder), str(seconds), wait=seconds * 2 + 120)
    (folder / "log.txt").write_text(done.stdout + done.stderr)
    found = [path.name for pattern in FOUND for path in folder.glob(pattern)]
    runs = re.findall(r"number_of_executed_units: (\d+)", done.stderr)
    covered = re.findall(r"cov: (\d+)", done.stderr)
    value = f"{runs[-1] if runs else '?'} inputs, {covered[-1] if covered else '?'} edges"
    good = done.returncode == 0 and not found and bool(runs)
    if not good:
        value += f"; {', '.join(found) or 'ended early'}, see {folder / 'log.txt'}"
    return Figure(f"{name}, {seconds} s", value, "no failure", good)
