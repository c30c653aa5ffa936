"""A network that goes away: how soon the monitor counts again once it is back.

Publisher and monitor live in two network namespaces, joined by a pair of virtual Ethernet
devices that is taken down and up again. That needs the rights of root and `ip`.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from figure import Figure

MINUTES = (22.0, 0.7)
HERE = Path(__file__).parent
LIMIT = 2.0  # s from the link being up to counting
OURS, THEIRS = "soak_ours", "soak_theirs"
JOINTS = [f"joint_a{number}" for number in range(1, 7)]
OUTAGE, TIMES = 60.0, 20


def run(folder: str, quick: bool) -> list[Figure]:
    """Take the link down for 60 s, 20 times; or for 3 s, 4 times."""
    outage, times = (3.0, 4) if quick else (OUTAGE, TIMES)
    what = f"link down {outage:g} s, {times} times"
    allowed = (
        shutil.which("ip")
        and not subprocess.run(
            ["unshare", "-n", "true"], capture_output=True, check=False
        ).returncode
    )
    if not allowed:
        return [Figure(what, "not allowed here: needs root and ip")]
    names = Path(folder) / "names.json"
    names.write_text(json.dumps(JOINTS))
    inside = subprocess.run(
        ["unshare", "-n", sys.executable, __file__, str(outage), str(times), str(names)],
        stdout=subprocess.PIPE,
        text=True,
        timeout=times * (outage + 60) + 60,
        check=True,
    )
    found = json.loads(inside.stdout.splitlines()[-1])
    worst = max(found["counting_after"])
    return [
        Figure(f"{what}: counts again after, worst [s]", worst, f"<= {LIMIT:g}", worst <= LIMIT),
        Figure(f"{what}: accounts that did not add up", found["wrong"], "0", not found["wrong"]),
        Figure(f"{what}: subscriptions made again", found["renewals"]),
        Figure(f"{what}: observed time of the span [-]", found["coverage"]),
    ]


def inside(outage: float, times: int, names: str) -> None:
    """Monitor, in a network namespace of its own; the publisher gets another one."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.parameter import Parameter

    from ros2_energy_monitor.diagnostics.node import unbalanced
    from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor

    os.environ |= {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
        "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
    }
    other = subprocess.Popen(["unshare", "-n", sys.executable, "-c", "input()"], stdin=-1)
    driver = None
    try:
        there = ["nsenter", "-t", str(other.pid), "-n"]
        connect(there, other.pid)
        command = [sys.executable, str(HERE / "publisher.py"), "100", "100000", names]
        driver = subprocess.Popen([*there, *command], stdin=-1, stdout=subprocess.DEVNULL)
        rclpy.init()
        node = EnergyMonitor(parameter_overrides=[Parameter("model", value="kr16")])
        executor = SingleThreadedExecutor()
        executor.add_node(node)

        def spin(seconds: float, until: Callable[[], bool] = lambda: False) -> float:
            begin = time.monotonic()
            while time.monotonic() < begin + seconds and not until():
                executor.spin_once(timeout_sec=0.02)
            return time.monotonic() - begin

        spin(30.0, lambda: node.account.registers.time.observed_ns > 0)
        counting_after: list[float] = []
        wrong = 0
        for _ in range(times):
            link("down")
            spin(outage)
            before = node.account.registers.time.observed_ns
            link("up")
            counting_after.append(
                spin(50.0, lambda last=before: node.account.registers.time.observed_ns > last)
            )
            spin(3.0)
            account = node.account.registers.time
            span = (account.end_ns or 0) - (account.start_ns or 0)
            wrong += span != account.observed_ns + account.gap_ns
            wrong += len(unbalanced(node.inputs))
        found = {
            "counting_after": counting_after,
            "wrong": wrong,
            "renewals": node.joint_states.renewals,
            "coverage": node.account.registers.time.coverage,
        }
        print(json.dumps(found), flush=True)
        node.destroy_node()
    finally:
        for process in (driver, other):
            if process is not None:
                process.kill()
                process.wait()


def connect(there: list[str], pid: int) -> None:
    """Join this namespace and that of a process."""
    time.sleep(0.5)  # until the process is in its namespace
    for command in (
        f"ip link add {OURS} type veth peer name {THEIRS}",
        f"ip link set {THEIRS} netns {pid}",
        f"ip addr add 10.9.0.1/24 dev {OURS}",
        "ip link set lo up",
        f"ip link set {OURS} up",
    ):
        subprocess.run(command.split(), check=True)
    for command in (
        f"ip addr add 10.9.0.2/24 dev {THEIRS}",
        "ip link set lo up",
        f"ip link set {THEIRS} up",
    ):
        subprocess.run([*there, *command.split()], check=True)


def link(state: str) -> None:
    """Take the link up or down."""
    subprocess.run(["ip", "link", "set", OURS, state], check=True)


if __name__ == "__main__":
    inside(float(sys.argv[1]), int(sys.argv[2]), sys.argv[3])
