"""CPU share and latency of the nodes, next to a plain subscriber that does nothing."""

from __future__ import annotations

import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from bench_pipeline import with_thermal
from rich.table import Table

from robot_energy.model import load, save

HERE = Path(__file__).parent
NODES = "ros2_energy_monitor"
CASES = {
    "plain callback subscriber": [[sys.executable, str(HERE / "plain_subscriber.py")]],
    "energy_monitor": [[sys.executable, "-m", NODES, "energy_monitor"]],
    "three nodes": [
        [sys.executable, "-m", NODES, name]
        for name in ("torque_monitor", "friction_monitor", "power_monitor")
    ],
}
EFFORT = "joint_states.effort_meaning:=motor_torque"
ADDED = "energy_monitor with bands, learner, wear alarm and thermal observer"
BARE = "the same node and inputs without them"


def cpu_seconds(pid: int) -> float:
    """Processor time of a process, all threads, as the scheduler counts it. [s]"""
    tasks = Path(f"/proc/{pid}/task").glob("*/schedstat")
    return sum(int(task.read_text().split()[0]) for task in tasks) * 1e-9


def _node(command: list[str]) -> list[str]:
    return [word for word in command if ":=" not in word]


def _parameters(command: list[str]) -> list[str]:
    settings = [word for word in command if ":=" in word]
    if not any(word.startswith("model:=") for word in settings):
        settings.append("model:=kr16")
    given = [word for setting in settings for word in ("-p", setting)]
    return ["--ros-args", *given, "--log-level", "error"]


def _additions(folder: Path) -> dict[str, list[list[str]]]:
    """The node with all that says how sure it is, and without; both get all inputs."""
    model = folder / "kr16_thermal.yaml"
    model.parent.mkdir(parents=True, exist_ok=True)
    save(with_thermal(load("kr16")), model)
    whole = [sys.executable, "-m", NODES, "energy_monitor", f"model:={model}", EFFORT]
    return {
        ADDED: [whole],
        BARE: [[sys.executable, str(HERE / "bare_node.py"), "learning:=off", EFFORT]],
    }


def measure(
    case: str, commands: list[list[str]], rate: int, seconds: float, domain: int
) -> dict[str, float]:
    """Run one case once against a fresh publisher."""
    environment = {
        **os.environ,
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "PYTHONWARNINGS": "ignore",
        "ROS_HOME": tempfile.mkdtemp(prefix="robot_energy_"),  # registers of this run only
    }
    kind = "no" if case.startswith("plain") else "all" if case in (ADDED, BARE) else "yes"
    started = [
        subprocess.Popen(
            [*_node(command), *([] if kind == "no" else _parameters(command))],
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for command in commands
    ]
    probe = subprocess.Popen(
        [sys.executable, str(HERE / "load.py"), str(rate), str(seconds), kind],
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert probe.stdout is not None
        if probe.stdout.readline().strip() != "running":
            raise RuntimeError(f"the load generator did not meet {case}")
        before, begin = [cpu_seconds(process.pid) for process in started], time.monotonic()
        if probe.stdout.readline().strip() != "measured":
            raise RuntimeError(f"{case} did not last")
        elapsed = time.monotonic() - begin
        used = sum(
            cpu_seconds(process.pid) - start for process, start in zip(started, before, strict=True)
        )
        rest = json.loads(probe.stdout.readline())
        return {"cpu": used / elapsed, **rest}
    finally:
        for process in started:
            process.send_signal(signal.SIGINT)
        for process in (*started, probe):
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()


def run(folder: Path, quick: bool) -> tuple[Table, dict[str, object], dict[str, bool]]:
    """Measure every case at both rates."""
    table = Table(title="live, 6 joints: share of one core and latency joint state -> power state")
    for column in ("rate Hz", "program", "CPU %", "x plain", "latency p50 ms", "p99 ms"):
        table.add_column(column, justify="left" if column == "program" else "right")
    figures: dict[str, object] = {}
    goals: dict[str, bool] = {}
    domain = 60 + os.getpid() % 40
    for rate in (1000,) if quick else (500, 1000):
        medians: dict[str, dict[str, float]] = {}
        cases = {**CASES, **(_additions(folder) if rate == 1000 else {})}
        runs: dict[str, list[dict[str, float]]] = {case: [] for case in cases}
        for _ in range(1 if quick else 5):  # interleaved, so that noise meets all alike
            for case, commands in cases.items():
                seconds = 4 if quick else 8
                runs[case].append(measure(case, commands, rate, seconds, domain))
        for case, results in runs.items():
            medians[case] = {
                key: statistics.median(result[key] for result in results) for key in results[0]
            }
        plain = medians["plain callback subscriber"]["cpu"]
        for case, result in medians.items():
            latency = [f"{result[key]:.0f}" if key in result else "" for key in ("p50", "p99")]
            table.add_row(
                str(rate), case, f"{result['cpu']:.1%}", f"{result['cpu'] / plain:.2f}", *latency
            )
        figures[str(rate)] = medians
        if rate == 1000:
            one = medians["energy_monitor"]["cpu"] / plain
            three = medians["three nodes"]["cpu"] / plain
            added = medians[ADDED]["cpu"] / medians[BARE]["cpu"] - 1.0
            goals[f"1 kHz: energy_monitor at most 0.3 of the plain subscriber: {one:.2f}"] = (
                one <= 0.3
            )
            goals[f"1 kHz: three nodes at most 0.6 of the plain subscriber: {three:.2f}"] = (
                three <= 0.6
            )
            goals[f"1 kHz: what says how sure it is adds at most 15 %: {added:+.0%}"] = (
                added <= 0.15
            )
    return table, figures, goals
