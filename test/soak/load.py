"""The energy monitor under load: every message accounted for, memory flat.

500 Hz of 30 joints for 10 minutes must not lose a message. At 5 kHz a short queue must
lose some: then published = received + lost, exactly.
"""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from figure import Figure
from many_joints import write_cell
from rclpy.executors import SingleThreadedExecutor

from ros2_energy_monitor.base.shared_memory import clear_ports

MINUTES = (16.5, 1.2)
HERE = Path(__file__).parent
SETTLED = 200.0  # s: the last minute without a meter is held, then buffers find their size
FLAT = 2.0  # MB/h that count as flat
PIECE = 20.0  # s over which growth is read; the median of the pieces is what creeps
LEAST_PIECES = 4
PATIENCE = 60.0  # s until the last message is accounted for


@dataclass
class Watch:
    """What the monitor says about itself, and its memory."""

    latest: dict[str, str] = field(default_factory=dict)
    levels: set[str] = field(default_factory=set)
    times: list[float] = field(default_factory=list)
    memory: list[float] = field(default_factory=list)

    def take(self, message: DiagnosticArray) -> None:
        """Keep the values of the joint states, and every complaint."""
        for status in message.status:
            if status.name.endswith(": joint states"):
                self.latest = {value.key: value.value for value in status.values}
            if status.level == status.ERROR and _count(self.latest, "received"):
                self.levels.add(f"{status.name}: {status.message}")


def run(folder: str, quick: bool) -> list[Figure]:
    """Run both loads, one after the other."""
    cell, names = write_cell(Path(folder), 5)
    kr16 = Path(folder) / "kr16.json"
    kr16.write_text(json.dumps([f"joint_a{number}" for number in range(1, 7)]))
    figures = _load("500 Hz x 30 joints", str(cell), names, 500, 20 if quick else 600, {})
    figures += _load("5 kHz x 6 joints", "kr16", kr16, 5000, 15 if quick else 300, {})
    few = {"joint_state_depth": "100"}
    return figures + _load(
        "5 kHz, queue of 100", "kr16", kr16, 5000, 10 if quick else 60, few, lossy=True
    )


def _load(
    what: str,
    model: str,
    names: Path,
    rate: int,
    seconds: float,
    parameters: dict[str, str],
    lossy: bool = False,
) -> list[Figure]:
    domain = 1 + os.getpid() % 90
    environment = {
        **os.environ,
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_HOME": str(names.parent / "ros"),  # registers of this run only
    }
    options = [part for key, value in parameters.items() for part in ("-p", f"{key}:={value}")]
    clear_ports()  # of another process that was killed: the driver would wait without end
    monitor = subprocess.Popen(
        [
            *(sys.executable, "-m", "ros2_energy_monitor", "energy_monitor", "--ros-args"),
            *("-p", f"model:={model}", *options, "--log-level", "error"),
        ],
        env=environment,
    )
    driver = subprocess.Popen(
        [sys.executable, str(HERE / "publisher.py"), str(rate), str(seconds), str(names)],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    node = rclpy.create_node("soak_observer", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    watch = Watch()
    node.create_subscription(DiagnosticArray, "/diagnostics", watch.take, 10)
    try:
        published = _observe(monitor.pid, driver, executor, watch, seconds)
        used = _cpu_seconds(monitor.pid)
    finally:
        for process in (monitor, driver):
            process.send_signal(signal.SIGINT)
        for process in (monitor, driver):
            try:
                process.wait(15)
            except subprocess.TimeoutExpired:
                process.kill()
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown(context=context)
    return _figures(what, published, watch, lossy, used / seconds)


def _observe(
    pid: int,
    driver: subprocess.Popen[str],
    executor: SingleThreadedExecutor,
    watch: Watch,
    seconds: float,
) -> int:
    """Watch until every published message is accounted for; return how many there were."""
    assert driver.stdout is not None
    published, begin = None, time.monotonic()
    deadline = begin + 1.5 * seconds + PATIENCE
    while time.monotonic() < deadline:
        executor.spin_once(timeout_sec=1.0)
        watch.times.append(time.monotonic() - begin)
        watch.memory.append(memory_of(pid))
        if published is None and select.select([driver.stdout], [], [], 0)[0]:
            word, _, number = driver.stdout.readline().partition(" ")
            if word == "published":
                published, deadline = int(number), time.monotonic() + 10.0
        if published is not None and _accounted(watch) == published:
            return published
    return published if published is not None else -1


def _count(values: dict[str, str], key: str) -> int:
    return int(values.get(key, "0"))


def _accounted(watch: Watch) -> int:
    return _count(watch.latest, "received") + _count(watch.latest, "lost_in_transport")


def _figures(what: str, published: int, watch: Watch, lossy: bool, cpu: float) -> list[Figure]:
    values = watch.latest
    received, accepted = _count(values, "received"), _count(values, "accepted")
    lost = _count(values, "lost_in_transport")
    rejected = sum(int(value) for key, value in values.items() if key.startswith("rejected."))
    sums = published == received + lost and received == accepted + rejected
    return [
        Figure(f"{what}: published", published, "> 0", published > 0),
        Figure(
            f"{what}: lost", lost, "> 0, queue too short" if lossy else "0", (lost > 0) == lossy
        ),
        Figure(f"{what}: rejected", rejected, "0", rejected == 0),
        Figure(f"{what}: published = received + lost", "yes" if sums else "no", "yes", sums),
        Figure(f"{what}: share of one core", f"{cpu:.1%}"),
        Figure(f"{what}: memory [MB]", round(max(watch.memory, default=0.0), 1)),
        *_growth(what, watch),
        Figure(f"{what}: errors said", " ".join(watch.levels) or "none", "none", not watch.levels),
    ]


def _growth(what: str, watch: Watch) -> list[Figure]:
    """Split growth into what creeps and what comes in steps.

    A node that was held up (a busy machine) takes a longer queue at once and keeps the memory
    for it: a step, bounded by the depth of the queue. What is lost for good with every
    message, or with time, creeps in every piece.
    """
    time, memory = np.array(watch.times), np.array(watch.memory)
    marks = np.arange(SETTLED, time[-1] if len(time) else 0.0, PIECE)
    if len(marks) < LEAST_PIECES:
        return [Figure(f"{what}: growth of memory", "run too short to decide")]
    pieces = np.diff(np.interp(marks, time, memory))
    creep = float(np.median(pieces)) / PIECE * 3600
    return [
        Figure(f"{what}: memory creeps by [MB/h]", round(creep, 2), f"<= {FLAT:g}", creep <= FLAT),
        Figure(f"{what}: steps of it in the run [MB]", round(float(pieces.sum()), 2)),
    ]


def memory_of(pid: int) -> float:
    """Resident memory of a process of its own, without files and shared buffers. [MB]"""
    with open(f"/proc/{pid}/status") as status:
        kib = next(int(line.split()[1]) for line in status if line.startswith("RssAnon"))
    return kib / 1024


def _cpu_seconds(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
