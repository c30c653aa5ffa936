"""The compiled kernels under the address and the undefined-behaviour sanitizer.

They are built into the folder of the run; their tests, valid and refused calls, run with them.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import sysconfig
from pathlib import Path

from figure import Figure

MINUTES = (2.0, 1.0)
ROOT = Path(__file__).resolve().parents[2]
KERNELS = ROOT / "src/robot_energy/physics/kernels"
NAME = "robot_energy.physics.kernels._compiled"
FLAGS = (
    "-shared", "-fPIC", "-O1", "-g", "-DPy_LIMITED_API=0x030b0000", "-ffp-contract=off",
    "-fno-math-errno", "-Wno-psabi", "-fsanitize=address,undefined",
    "-fno-sanitize-recover=undefined",
)  # fmt: skip
# A plugin of pytest, by which the tests find these kernels before those of the library.
PLUGIN = f"""
import importlib.util, sys
from importlib.machinery import ExtensionFileLoader
loader = ExtensionFileLoader("{NAME}", "%s")
module = importlib.util.module_from_spec(importlib.util.spec_from_loader("{NAME}", loader))
loader.exec_module(module)
sys.modules["{NAME}"] = module
"""


def run(folder: str, quick: bool) -> list[Figure]:
    """Build the kernels and run their tests; a failure is one that a sanitizer saw, or a test."""
    what, goal = "tests of the kernels under sanitizers", "no failure"
    library = Path(folder) / "_compiled.abi3.so"
    include = sysconfig.get_paths()["include"]
    sources = sorted(map(str, KERNELS.glob("*.c")))
    compiler = os.environ.get("CC", "cc")
    command = [compiler, *FLAGS, f"-I{include}", *sources, "-o", str(library), "-lm"]
    try:
        built = subprocess.run(command, capture_output=True, text=True, check=False)
        asan = _said(compiler, "-print-file-name=libasan.so")
    except OSError as error:
        return [Figure(what, f"skipped: no compiler ({error})")]
    (Path(folder) / "build.txt").write_text(built.stderr)
    if built.returncode or not Path(asan).is_file():
        return [Figure(what, f"skipped: {compiler} has no sanitizers, see {folder}/build.txt")]
    (Path(folder) / "sanitized.py").write_text(PLUGIN % library)
    words = ["pytest", "-p", "sanitized", "-c", "test/pytest.ini", "test/unit/kernels", "-q", "-s"]
    done = subprocess.run(
        [sys.executable, "-m", *words, *(["-k", "refused or slopes"] if quick else [])],
        cwd=ROOT,
        env={
            **os.environ,
            # with the C++ library, whose exceptions it looks for when it is loaded
            "LD_PRELOAD": f"{asan} {_said(compiler, '-print-file-name=libstdc++.so.6')}",
            "ASAN_OPTIONS": "detect_leaks=0",  # the interpreter keeps memory to its end
            "PYTHONPATH": os.pathsep.join([folder, os.environ.get("PYTHONPATH", "")]),
        },
        capture_output=True,
        text=True,
        check=False,
    )
    (Path(folder) / "log.txt").write_text(done.stdout + done.stderr)
    passed = re.findall(r"(\d+) passed", done.stdout)
    value = f"{passed[-1] if passed else 'none'} passed"
    if done.returncode:
        value += f"; failed, see {folder}/log.txt"
    return [Figure(what, value, goal, not done.returncode and bool(passed))]


def _said(*command: str) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
