"""Recorder and energy page of many robots: processor time, memory, what is recorded."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path
from typing import Any

from bench_live import cpu_seconds
from rich.table import Table

from robot_energy_history.api import history
from robot_energy_history.check import check

ROBOTS = 100
RATE = 10.0  # of the power states of each robot [1/s]
LOOKING = 30.0  # until all robots are found [s]


def run(folder: Path, quick: bool) -> tuple[Table, dict[str, Any], dict[str, bool]]:
    """Measure both nodes next to one process that publishes for all robots."""
    from ros2_energy_monitor.demo.demo import free_port
    from ros2_energy_monitor.demo.node_processes import NodeProcesses

    seconds = 20.0 if quick else 120.0
    home = Path(tempfile.mkdtemp(prefix="robot_energy_"))
    environment = {
        **os.environ, "ROS_DOMAIN_ID": str(60 + os.getpid() % 40),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_HOME": str(home),
    }  # fmt: skip
    figures: dict[str, float] = {}
    for node, rate, given in (
        ("energy_recorder", 0.0, {"folder": str(home / "history"), "min_free": 0}),
        ("energy_dashboard", RATE, {"port": free_port()}),
    ):
        with (
            subprocess.Popen(
                [sys.executable, str(Path(__file__).with_name("many_robots.py")), str(ROBOTS),
                 str(rate)],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment,
            ) as robots,
            NodeProcesses(folder, environment) as nodes,
        ):  # fmt: skip
            assert robots.stdout is not None
            assert robots.stdin is not None
            assert robots.stdout.readline() == b"ready\n"
            nodes.start(node, **given)
            pid = nodes._running[node].pid
            time.sleep(LOOKING)
            begin, used = time.monotonic(), cpu_seconds(pid)
            if node == "energy_dashboard":
                url = f"http://127.0.0.1:{given['port']}/api/events?robot=cell3/r033"
                count = _read(url, seconds)
                figures["events"] = count / (time.monotonic() - begin)
            else:
                time.sleep(seconds)
            figures[f"{node} cpu"] = (cpu_seconds(pid) - used) / (time.monotonic() - begin)
            for kind, name in (("Pss", "memory"), ("Rss", "resident")):
                figures[f"{node} {name}"] = _memory(pid, kind)
            robots.stdin.close()
            if node == "energy_recorder":
                nodes.stop(node)
                found = history(home / "history", 0, 2**62, "all")
                figures["robots"] = len(found)
                figures["differences"] = len(check(home / "history"))
    table = Table("figure", "value", title=f"{ROBOTS} robots of 6 joints")
    for name, value in figures.items():
        table.add_row(name, f"{value:.4g}")
    goals = {
        "recorder at most 5 % of a core": figures["energy_recorder cpu"] <= 0.05,
        "recorder at most 100 MB": figures["energy_recorder memory"] <= 100.0,
        "all robots are recorded": figures["robots"] == ROBOTS and not figures["differences"],
        "page at most 30 % of a core": figures["energy_dashboard cpu"] <= 0.3,
        "page at most 250 MB": figures["energy_dashboard memory"] <= 250.0,
        "events at most 40 kB/s": figures["events"] <= 40e3,
    }
    return table, dict(figures), goals


def _read(url: str, seconds: float) -> int:
    """Bytes of events that arrive in a time."""
    end, count = time.monotonic() + seconds, 0
    with urllib.request.urlopen(url, timeout=20) as stream:
        while time.monotonic() < end:
            count += len(stream.read1(65536))
    return count


def _memory(pid: int, kind: str) -> float:
    """Memory of a process: Rss with all of its libraries, Pss with its share of them. [MB]"""
    with open(f"/proc/{pid}/smaps_rollup") as sums:
        return next(int(line.split()[1]) for line in sums if line.startswith(f"{kind}:")) / 1000.0
