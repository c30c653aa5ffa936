"""Every service of the energy monitor under load: the longest pause of its power, its memory.

A robot of 500 Hz runs, and another process calls: trajectories of 10,000, 300,000 and 1,000,000
points to be predicted and compared, payloads, registers and intervals. Power must go on meanwhile,
what is too long must be refused at once, and memory must come back.

Usage: ``python test/soak/service_load.py``; also a run of ``make soak``.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import rclpy
from builtin_interfaces.msg import Duration
from figure import Figure
from load import memory_of
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import qos_profile_sensor_data
from ros2_energy_msgs.msg import PowerState
from ros2_energy_msgs.srv import (
    CloseInterval,
    CompareTrajectories,
    ListIntervals,
    OpenInterval,
    PredictTrajectory,
    ResetRegisters,
    SetPayload,
)
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

MINUTES = (6.0, 3.0)
HERE = Path(__file__).resolve().parent
JOINTS = [f"joint_a{number}" for number in range(1, 7)]
PAUSE = 0.3  # s of power, at most
KEPT = 40.0  # MB that a call may leave behind, in the buffers of the middleware
SETTLING = 15.0  # s after an answer, in which the process of predictions ends
CALM = 15.0  # s without a call, to compare with
RATE = 500  # Hz, of the joint states
PERIOD = 5_000_000  # ns between two points
CALLS = ("others", "300000", "1000000", "10000", "compare 300000", "compare 1000000")


def run(folder: str, quick: bool) -> list[Figure]:
    """Call all services; without the comparisons if it shall be short."""
    names = Path(folder) / "kr16.json"
    names.write_text(json.dumps(JOINTS))
    environment = {
        **os.environ,
        "ROS_DOMAIN_ID": str(1 + os.getpid() % 90),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_HOME": str(Path(folder) / "ros"),
    }
    os.environ.update(environment)
    monitor = subprocess.Popen(
        [
            *(sys.executable, "-m", "ros2_energy_monitor", "energy_monitor", "--ros-args"),
            *("-p", "model:=kr16", "--log-level", "error"),
        ]
    )
    robot = subprocess.Popen(
        [sys.executable, str(HERE / "publisher.py"), str(RATE), "3600", str(names)],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
    )
    watch = Watch(monitor.pid)
    try:
        watch.for_(20.0)
        before = watch.seen(lambda: watch.for_(CALM))
        figures = [Figure("no call: longest pause of power [s]", round(before[0], 3))]
        for call in CALLS[:4] if quick else CALLS:
            figures += _called(watch, call)
            print(*figures[-3:], sep="\n", file=sys.stderr)  # it takes minutes
    finally:
        watch.close()
        for process in (monitor, robot):
            process.send_signal(signal.SIGINT)
        for process in (monitor, robot):
            try:
                process.wait(15)
            except subprocess.TimeoutExpired:
                process.kill()
    return figures


class Watch:
    """The power and the memory of a monitor.

    Args:
        pid: Of its process.
    """

    def __init__(self, pid: int) -> None:
        self._pid = pid
        rclpy.init()
        self._node = rclpy.create_node("watch")
        self._node.create_subscription(
            PowerState, "energy/power", self._take, qos_profile_sensor_data
        )
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._latest: float | None = None
        self._pause = self._memory = 0.0

    def close(self) -> None:
        """End the subscription."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown()

    def _take(self, _: PowerState) -> None:
        now = time.monotonic()
        if self._latest is not None:
            self._pause = max(self._pause, now - self._latest)
        self._latest = now

    def once(self) -> None:
        """Take what has arrived."""
        self._executor.spin_once(timeout_sec=0.05)
        self._memory = max(self._memory, memory_of(self._pid))

    def for_(self, seconds: float) -> None:
        """Watch for a while.

        Args:
            seconds: How long. [s]
        """
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.once()

    def seen(self, work: Any) -> tuple[float, float]:
        """Return the longest pause of power [s] and the most memory [MB] during some work.

        Args:
            work: Calls `once` again and again.
        """
        self._pause = self._memory = 0.0
        work()
        return self._pause, self._memory

    @property
    def memory(self) -> float:
        """Memory now. [MB]"""
        return memory_of(self._pid)


def _called(watch: Watch, call: str) -> list[Figure]:
    before = watch.memory
    caller = subprocess.Popen(
        [sys.executable, str(Path(__file__).resolve()), "--call", *call.split()],
        stdout=subprocess.PIPE,
        text=True,
    )

    def wait() -> None:
        while caller.poll() is None:
            watch.once()
        watch.for_(SETTLING)

    pause, most = watch.seen(wait)
    assert caller.stdout is not None
    answers = json.loads(caller.stdout.read() or "[]")
    kept = watch.memory - before
    figures = [
        Figure(f"{call}: {name} answered in [s]", f"{seconds:.2f} {'yes' if done else 'refused'}")
        for name, seconds, done, _ in answers
    ]
    return [
        *figures,
        Figure(f"{call}: answered", len(answers), "> 0", bool(answers)),
        Figure(
            f"{call}: longest pause of power [s]", round(pause, 3), f"<= {PAUSE:g}", pause <= PAUSE
        ),
        Figure(f"{call}: most memory of the monitor [MB]", round(most)),
        Figure(f"{call}: memory kept [MB]", round(kept, 1), f"<= {KEPT:g}", kept <= KEPT),
    ]


def _trajectory(count: int) -> JointTrajectory:
    """A slow swing in a place that the robot reaches."""
    place = [0.0, -1.2, 1.2, 0.0, 0.0, 0.0]
    points = []
    for row in range(count):
        sec, nanosec = divmod(row * PERIOD, 1_000_000_000)
        move = 0.1 * (row % 400) / 400
        points.append(
            JointTrajectoryPoint(
                positions=[each + move for each in place],
                velocities=[0.05] * 6,
                time_from_start=Duration(sec=sec, nanosec=nanosec),
            )
        )
    return JointTrajectory(joint_names=JOINTS, points=points)


def _requests(words: list[str]) -> list[tuple[str, Any, Any]]:
    """Names, classes and requests of the services to call."""
    if words == ["others"]:
        payload = SetPayload.Request()
        payload.payload.header.frame_id, payload.payload.inertia.m = "tool0", 2.0
        long = "x" * 300_000
        return [
            ("set_payload", SetPayload, payload),
            ("open_interval", OpenInterval, OpenInterval.Request(name="job")),
            ("open_interval", OpenInterval, OpenInterval.Request(name=long)),
            ("list_intervals", ListIntervals, ListIntervals.Request()),
            ("close_interval", CloseInterval, CloseInterval.Request(name="job")),
            ("reset_registers", ResetRegisters, ResetRegisters.Request(reason="a trial")),
            ("reset_registers", ResetRegisters, ResetRegisters.Request(reason=long)),
        ]
    trajectory = _trajectory(int(words[-1]))
    if words[0] == "compare":
        request = CompareTrajectories.Request(trajectories=[trajectory, _trajectory(1000)])
        return [("compare_trajectories", CompareTrajectories, request)]
    return [
        ("predict_trajectory", PredictTrajectory, PredictTrajectory.Request(trajectory=trajectory))
    ]


def _call(words: list[str]) -> None:
    """Call and print the answers: service, time [s], whether it was done, message."""
    import gc

    gc.disable()  # millions of objects that stay
    requests = _requests(words)
    rclpy.init()
    node = rclpy.create_node("caller")
    answers = []
    for name, kind, request in requests:
        client = node.create_client(kind, f"energy_monitor/{name}")
        client.wait_for_service()
        future = client.call_async(request)
        begin = time.monotonic()  # it was written into C by now, which takes rclpy its time
        rclpy.spin_until_future_complete(node, future, timeout_sec=600.0)
        answer = future.result()
        answers.append((
            name,
            time.monotonic() - begin,
            getattr(answer, "success", answer is not None),
            getattr(answer, "message", ""),
        ))  # fmt: skip
    print(json.dumps(answers), flush=True)
    node.destroy_node()  # what only disappears is taken for a client for 20 s more
    rclpy.shutdown()
    os._exit(0)


def main() -> int:
    """Print the figures; the exit code is 1 if a goal was missed."""
    import tempfile

    if sys.argv[1:2] == ["--call"]:
        _call(sys.argv[2:])
    with tempfile.TemporaryDirectory(prefix="service_load_") as folder:
        figures = run(folder, "--quick" in sys.argv)
    for figure in figures:
        verdict = "" if not figure.goal else "yes" if figure.reached else "NO"
        print(f"{figure.what:56} {figure.value!s:>16}  {figure.goal:10} {verdict}")
    return 0 if all(figure.reached for figure in figures) else 1


if __name__ == "__main__":
    sys.exit(main())
