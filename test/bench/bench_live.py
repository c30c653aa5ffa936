"""CPU share and latency of the nodes, beside a plain subscriber that does nothing."""

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

from rich.table import Table

HERE = Path(__file__).parent
TICKS = os.sysconf("SC_CLK_TCK")
NODES = "ros2_energy_monitor"
CASES = {
    "plain callback subscriber": [[sys.executable, str(HERE / "plain_subscriber.py")]],
    "energy_monitor": [[sys.executable, "-m", NODES, "energy_monitor"]],
    "energy_monitor that learns nothing": [
        [sys.executable, "-m", NODES, "energy_monitor", "learning:=off"]
    ],
    "three nodes": [
        [sys.executable, "-m", NODES, name]
        for name in ("torque_monitor", "friction_monitor", "power_monitor")
    ],
}
MODEL = ["--ros-args", "-p", "model:=kr16", "--log-level", "error"]


def cpu_seconds(pid: int) -> float:
    """Processor time of a process, all threads. [s]"""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def _node(command: list[str]) -> list[str]:
    return [word for word in command if ":=" not in word]


def _parameters(command: list[str]) -> list[str]:
    return [word for setting in command if ":=" in setting for word in ("-p", setting)]


def measure(case: str, rate: int, seconds: float, domain: int) -> dict[str, float]:
    """Run one case once against a fresh publisher."""
    environment = {
        **os.environ,
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "PYTHONWARNINGS": "ignore",
        "ROS_HOME": tempfile.mkdtemp(prefix="robot_energy_"),  # registers of this run only
    }
    plain = case.startswith("plain")
    started = [
        subprocess.Popen(
            [*_node(command), *([] if plain else MODEL), *_parameters(command)],
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for command in CASES[case]
    ]
    probe = subprocess.Popen(
        [sys.executable, str(HERE / "load.py"), str(rate), str(seconds), "no" if plain else "yes"],
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
    del folder
    table = Table(title="live, 6 joints: share of one core and latency joint state -> power state")
    for column in ("rate Hz", "program", "CPU %", "x plain", "latency p50 ms", "p99 ms"):
        table.add_column(column, justify="left" if column == "program" else "right")
    figures: dict[str, object] = {}
    goals: dict[str, bool] = {}
    domain = 60 + os.getpid() % 40
    for rate in (1000,) if quick else (500, 1000):
        medians: dict[str, dict[str, float]] = {}
        runs: dict[str, list[dict[str, float]]] = {case: [] for case in CASES}
        for _ in range(1 if quick else 3):  # interleaved, so that noise meets all alike
            for case in CASES:
                runs[case].append(measure(case, rate, 4 if quick else 8, domain))
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
            learned = (
                medians["energy_monitor"]["cpu"]
                / medians["energy_monitor that learns nothing"]["cpu"]
            )
            goals[f"1 kHz: energy_monitor at most 0.3 of the plain subscriber: {one:.2f}"] = (
                one <= 0.3
            )
            goals[f"1 kHz: three nodes at most 0.6 of the plain subscriber: {three:.2f}"] = (
                three <= 0.6
            )
            goals[f"1 kHz: learning adds at most 15 % of processor time: {learned - 1:+.0%}"] = (
                learned <= 1.15
            )
    return table, figures, goals
