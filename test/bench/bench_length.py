"""What each command costs per recorded second: two lengths of the virtual rig at 500 Hz.

Each command runs in a process of its own; the slope is processor time over recorded time, without
the start of the interpreter. Memory is the peak of the process, children included.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from recording import motion
from rich.table import Table

LENGTHS, QUICK = (600, 3600), (60, 120)  # s
RATE = 500
ONE_HOUR = 3600.0  # s
EFFORT = ("--model", "kr16", "--effort", "motor_torque")
COMMANDS: dict[str, tuple[str, ...]] = {
    "replay": ("replay", "BAG", "--model", "kr16"),
    "replay --out": ("replay", "BAG", "--model", "kr16", "--out", "NEW"),
    "check": ("check", "BAG", *EFFORT),
    "test": ("test", "BAG", *EFFORT),
    "identify friction": ("identify", "friction", "BAG", *EFFORT),
    "identify drives": ("identify", "drives", "BAG", *EFFORT),
    "identify dynamics": ("identify", "dynamics", "BAG", *EFFORT),
    "identify cabinet": ("identify", "cabinet", "BAG", "--model", "kr16"),
    "identify thermal": ("identify", "thermal", "BAG", "--model", "kr16"),
    "identify all --no-test": ("identify", "all", "BAG", *EFFORT, "--no-test"),
    "identify all": ("identify", "all", "BAG", *EFFORT),
    "import table": ("import", "table", "TABLE", "--mapping", "MAPPING", "--out", "NEW"),
    "fleet run": ("fleet", "run", "BAG", "--model", "kr16", "--workers", "0", "--out", "NEW"),
    "predict (G-code)": (
        "predict", "PROGRAM", "--model", "mantis", "--base=-1.2,-0.2,0", "--temperature", "40",
    ),
}  # fmt: skip
MAPPING = """\
schema_version: 1
time: {column: time, unit: s}
joints:
  names: [joint_a1, joint_a2, joint_a3, joint_a4, joint_a5, joint_a6]
  keys: ["1", "2", "3", "4", "5", "6"]
  position: {column: "q{joint}", unit: rad}
  velocity: {column: "w{joint}", unit: rad_per_s}
"""
LAYER = Path(__file__).parents[2] / "src/examples/programs/wall_layer.gcode"
LAYER_TIME = 24  # s
BY_POLARS = "import polars, sys; polars.read_csv(sys.argv[1])"
FLAT = 1.15  # most memory of the long recording over that of the short one
# Runs a command and writes its processor time [s] and memory [kB]: a process begins with the
# peak of the one that starts it, which must be small.
MEASURE = """
import os, subprocess, sys
process = subprocess.Popen(sys.argv[1:])
_, status, used = os.wait4(process.pid, 0)
print("\\n", used.ru_utime + used.ru_stime, used.ru_maxrss)
sys.exit(os.waitstatus_to_exitcode(status) and 1)
"""


class Cost(NamedTuple):
    """Of one process.

    Attributes:
        cpu: Processor time. [s]
        peak: Memory. [MB]
    """

    cpu: float
    peak: float


def cost(command: Sequence[str]) -> Cost:
    """Run a command in its own process, with one thread of BLAS as the benches have it."""
    done = subprocess.run(
        [sys.executable, "-S", "-c", MEASURE, *command],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}: {done.stdout[-1000:]}")
    cpu, peak = done.stdout.split()[-2:]
    return Cost(float(cpu), float(peak) / 1024.0)


def robot_energy(*arguments: str) -> list[str]:
    """The command of the library."""
    return [sys.executable, "-m", "robot_energy", *arguments]


def inputs(folder: Path, seconds: int) -> dict[str, str]:
    """Write what the commands read, of one length; later calls find it."""
    folder.mkdir(parents=True, exist_ok=True)
    bag = folder / f"rig_{seconds}"
    if not (bag / "metadata.yaml").exists():
        subprocess.run(
            robot_energy(
                "simulate", "--robot", "kr16", "--dwell", "1", "--rate", str(RATE), "--seed", "1",
                "--duration", str(seconds), "--out", str(bag), "--overwrite",
            ),
            check=True, capture_output=True,
        )  # fmt: skip
    table, mapping = folder / f"table_{seconds}.csv", folder / "mapping.yaml"
    mapping.write_text(MAPPING)
    if not table.exists():
        stamp, position, velocity = motion(seconds * RATE, RATE)
        names = ["time", *(f"q{k}" for k in range(1, 7)), *(f"w{k}" for k in range(1, 7))]
        rows = np.column_stack([stamp * 1e-9, position, velocity])
        form = ["%.6f", *["%.9g"] * 12]
        np.savetxt(table, rows, form, ",", header=",".join(names), comments="")
    program = folder / f"program_{seconds}.gcode"
    layer, end, _ = LAYER.read_text().rpartition("M2")
    program.write_text(layer * max(1, seconds // LAYER_TIME) + end)
    return {
        "BAG": str(bag), "TABLE": str(table), "MAPPING": str(mapping), "PROGRAM": str(program),
    }  # fmt: skip


def duration(program: str) -> float:
    """Time that a program takes. [s]"""
    command = [*COMMANDS["predict (G-code)"], "--json", "-"]
    command[1] = program
    done = subprocess.run(robot_energy(*command), capture_output=True, text=True, check=True)
    phases = json.loads(done.stdout)["runs"][0]["phases"]
    return sum(float(phase["time"]) for phase in phases.values())


def run(folder: Path, quick: bool) -> tuple[Table, dict[str, object], dict[str, bool]]:
    """Measure all commands on both lengths."""
    lengths = QUICK if quick else LENGTHS
    folder = folder / "length"
    given = [inputs(folder, seconds) for seconds in lengths]
    table = Table(title=f"cost over the length of a recording, 6 joints, {RATE} Hz")
    for column in ("command", "ms of CPU per s", *(f"{n} s: CPU s, MB" for n in lengths)):
        table.add_column(column, justify="left" if column == "command" else "right")
    found: dict[str, tuple[float, list[Cost]]] = {}

    def add(name: str, seconds: Sequence[float], costs: list[Cost]) -> None:
        slope = 1e3 * (costs[1].cpu - costs[0].cpu) / (seconds[1] - seconds[0])
        found[name] = slope, costs
        table.add_row(name, f"{slope:.1f}", *(f"{one.cpu:.1f}, {one.peak:.0f}" for one in costs))

    for name, command in COMMANDS.items():
        costs: list[Cost] = []
        for names in given:
            with tempfile.TemporaryDirectory(dir=folder) as new:
                places = {**names, "NEW": f"{new}/bag"}
                costs.append(cost(robot_energy(*(places.get(one, one) for one in command))))
        program = name.startswith("predict")
        add(name, [duration(one["PROGRAM"]) for one in given] if program else lengths, costs)
    add(
        "polars reads the table", lengths,
        [cost([sys.executable, "-c", BY_POLARS, one["TABLE"]]) for one in given],
    )  # fmt: skip
    hour = ONE_HOUR / lengths[1]
    whole, check = found["identify all"][1][1], found["check"][1][1]
    imported, read = found["import table"][0], found["polars reads the table"][0]
    planned = found["predict (G-code)"][0]
    goals = {
        f"identify all of an hour within 90 s of CPU: {whole.cpu * hour:.0f} s": whole.cpu * hour
        <= 90.0,
        f"and 1 GB: {whole.peak:.0f} MB": whole.peak <= 1000.0,
        f"check of an hour below 300 MB: {check.peak:.0f} MB": check.peak < 300.0,
        f"import table at most 4 times polars: {imported / read:.1f}": imported <= 4.0 * read,
        f"predict of G-code within 10 ms per second: {planned:.1f}": planned <= 10.0,
    }
    for name, (_, (short, long)) in found.items():
        if name != "polars reads the table":
            goals[f"{name}: memory as flat as 15 %: {short.peak:.0f}, {long.peak:.0f} MB"] = (
                long.peak <= FLAT * short.peak
            )
    figures: dict[str, object] = {
        name: {"slope_ms": slope, "cpu": [c.cpu for c in costs], "peak_mb": [c.peak for c in costs]}
        for name, (slope, costs) in found.items()
    }
    return table, figures, goals
