# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Nodes in one process, isolated from every network; waiting is always for a condition."""

from __future__ import annotations

import gc
import os
import socket
import time
from collections.abc import Callable, Iterator
from concurrent.futures import wait
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from ros2_energy_msgs.srv import SetPayload

from robot_energy.bag import BagReader, BagWriter
from robot_energy.store import slots
from robot_energy_rig.record import RigEncoder
from ros2_energy_monitor.base import checkpoints, monitor_node, publishers
from ros2_energy_monitor.base.guard import Guard
from ros2_energy_monitor.base.inbox import Inbox
from ros2_energy_monitor.base.node_parameters import RobotParameters
from ros2_energy_monitor.base.publishers import best_effort, reliable
from ros2_energy_monitor.base.shared_memory import clear_ports
from ros2_energy_monitor.nodes.virtual_robot import make_rig
from ros2_energy_monitor.services.prediction_process import PredictionProcess

LOOPBACK = {  # UDP without shared memory, which what is killed would leave half made
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
    "FASTRTPS_DEFAULT_PROFILES_FILE": str(
        Path(__file__).resolve().parents[2] / "test/loopback.xml"
    ),
}
PATIENCE = 120.0  # s, on a machine that does much else


class Diagnosed:
    """Latest status of every name on /diagnostics."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._latest: dict[str, DiagnosticStatus] = {}
        bench.tester.create_subscription(DiagnosticArray, "/diagnostics", self._take, 100)

    def _take(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self._latest[status.name] = status

    def __getitem__(self, name: str) -> DiagnosticStatus:
        return self._latest[name]

    def wait(self, name: str, words: str) -> DiagnosticStatus:
        self._bench.spin_until(
            lambda: name in self._latest and words in self._latest[name].message,
            f"{name}: {words}",
        )
        return self._latest[name]

    def wait_anew(self, name: str, words: str) -> DiagnosticStatus:
        """Wait for words of a check that has begun after this call."""
        for _ in range(2):  # the first to come may be on its way already
            self._latest.pop(name, None)
            self._bench.spin_until(lambda: name in self._latest, name)
        return self.wait(name, words)

    @staticmethod
    def values(status: DiagnosticStatus) -> dict[str, Any]:
        """Key values; numbers as such, words as text."""
        return {pair.key: _number_or_text(pair.value) for pair in status.values}


def _number_or_text(value: str) -> float | str:
    try:
        return float(value)
    except ValueError:
        return value


class Bench:
    """Nodes of one test with their executor."""

    def __init__(self) -> None:
        clear_ports()  # of a process that another test has killed
        self.context = Context()
        rclpy.init(args=[], context=self.context, signal_handler_options=SignalHandlerOptions.NO)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.nodes: list[Node] = []
        self.tester = self.add(Node, "tester")

    def add(self, node_type: Callable[..., Any], *args: Any, **parameters: Any) -> Any:
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        node = node_type(*args, context=self.context, parameter_overrides=overrides)
        self.executor.add_node(node)
        self.nodes.append(node)
        return node

    def remove(self, node: Node) -> None:
        self.executor.remove_node(node)
        self.nodes.remove(node)
        node.destroy_node()

    def inbox(self, message_type: type[Any], topic: str, qos: Any = None) -> Inbox:
        return Inbox(self.tester, message_type, topic, qos or reliable(20_000))

    def publisher(self, message_type: type[Any], topic: str, subscribers: int = 1) -> Any:
        """Return a publisher that all its subscribers have found."""
        publisher = self.tester.create_publisher(message_type, topic, reliable(20_000))
        self.spin_until(lambda: publisher.get_subscription_count() >= subscribers, topic)
        return publisher

    def spin_until(self, condition: Callable[[], Any], what: str) -> Any:
        limit = time.monotonic() + PATIENCE
        while not (result := condition()):
            assert time.monotonic() < limit, f"waited {PATIENCE} s in vain for {what}"
            self.executor.spin_once(timeout_sec=0.05)
        return result

    def latest(self, message_type: type[Any], topic: str) -> Callable[[], Any]:
        """Subscribe a topic and return a function that gives its latest message."""
        received: list[Any] = []
        self.tester.create_subscription(
            message_type, topic, lambda message: received.append(message), best_effort(1000)
        )
        return lambda: received[-1] if received else None

    @staticmethod
    def payload(link: str = "tool0", m: float = 1.0, stamp: Any = None, **values: Any) -> Any:
        """Return a request of set_payload; `values` are ``com`` and entries of the inertia."""
        request = SetPayload.Request()
        request.payload.header.frame_id, request.payload.inertia.m = link, m
        if stamp is not None:
            request.payload.header.stamp = stamp
        for name, value in values.items():
            setattr(request.payload.inertia, name, value)
        return request

    def diagnosed(self) -> Diagnosed:
        return Diagnosed(self)

    def close(self) -> None:
        for node in list(self.nodes):
            self.remove(node)
        self.executor.shutdown()
        self.context.try_shutdown()


def pytest_collection_finish() -> None:
    """As in `test/conftest.py`; not frozen, as trio asks the collector who knows its numbers."""
    gc.set_threshold(10_000, 20, 20)


@pytest.fixture(autouse=True)
def own_state_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Every test begins with empty registers and leaves none behind."""
    monkeypatch.setenv("ROS_HOME", str(tmp_path / "ros"))


@pytest.fixture(autouse=True)
def no_internal_errors(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> Iterator[None]:
    """A border must hide no fault: only a test that injects errors may see some counted."""
    guards: list[Guard] = []
    make = Guard.__init__

    def made(self: Guard, *args: Any, **options: Any) -> None:
        make(self, *args, **options)
        guards.append(self)

    monkeypatch.setattr(Guard, "__init__", made)
    yield
    counted = [dict(guard.errors) for guard in guards if guard.errors]
    if request.node.get_closest_marker("injects_errors"):
        assert counted, "the test is marked as injecting errors, and none was counted"
    else:
        assert not counted, f"nodes counted internal errors: {counted}"


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    monkeypatch.setattr(monitor_node, "REPORT_PERIOD", 0.2)  # nobody waits a second for each
    # A busy disk is not what is tested.
    monkeypatch.setattr(slots, "wait", lambda jobs, _: wait(jobs, PATIENCE))
    monkeypatch.setattr(checkpoints, "ANSWERING", PATIENCE)
    monkeypatch.setattr(publishers, "MAX_FINISH", PATIENCE)  # nor is a busy processor
    bench = Bench()
    yield bench
    bench.close()


@pytest.fixture
def loopback_bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    """Nodes of this process that meet those of child processes."""
    for name, value in LOOPBACK.items():
        monkeypatch.setenv(name, value)
    bench = Bench()
    yield bench
    bench.close()


@pytest.fixture(scope="session")
def one_prediction_process() -> Iterator[PredictionProcess]:
    process = PredictionProcess()
    process.start()  # here, as services of a node would start it at the same time
    yield process
    process.end()


@pytest.fixture
def kept_process(
    one_prediction_process: PredictionProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nodes ask the process of those before them: it keeps nothing of a request, and starts long.

    Not for tests of its end, nor for those that leave an answer unread.
    """
    start = PredictionProcess.start

    def started(process: PredictionProcess) -> Any:
        process._process = start(one_prediction_process)
        return process._process

    def left(process: PredictionProcess) -> None:
        process._process = None

    monkeypatch.setattr(PredictionProcess, "start", started)
    monkeypatch.setattr(PredictionProcess, "end", left)


@pytest.fixture(scope="session")
def free_port() -> Iterator[Callable[[], int]]:
    """Finds ports that nobody else gets: they stay bound, and SO_REUSEADDR lets a server in."""
    with ExitStack() as held:

        def find() -> int:
            found = held.enter_context(socket.socket())
            found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            found.bind(("127.0.0.1", 0))
            return int(found.getsockname()[1])

        yield find


@pytest.fixture
def child_environment() -> dict[str, str]:
    """Environment of processes that may be killed, in the domain of this test run."""
    return {
        **os.environ,
        **LOOPBACK,
        "PYTHONUNBUFFERED": "1",
    }


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight seconds of the rig, with a gap of half a second and one sample sent twice."""
    path = tmp_path_factory.mktemp("bags") / "rig"
    output = make_rig(RobotParameters(thermal_speedup=200.0), 1_700_000_000 * 10**9).step(2000)
    encoder = RigEncoder(JOINTS)
    rows = np.concatenate([np.arange(0, 800), [799], np.arange(925, 2000)])
    joints = output.joints[rows]
    assert output.temperatures is not None
    assert output.meter is not None
    with BagWriter(path) as bag:
        for topic, msgtype, stamp, messages in (
            (
                "/motor_temperatures",
                "ros2_energy_msgs/msg/MotorTemperatures",
                output.temperatures.stamp_ns,
                encoder.temperatures(output.temperatures),
            ),
            (
                "/power_meter",
                "ros2_energy_msgs/msg/PowerReading",
                output.meter.stamp_ns,
                encoder.meter(output.meter),
            ),
            (
                "/joint_states",
                "sensor_msgs/msg/JointState",
                joints.stamp_ns,
                encoder.joint_states(joints),
            ),
        ):
            bag.add_topic(topic, msgtype)
            bag.write(topic, np.sort(stamp), messages)
    return path


JOINTS = tuple(f"joint_a{axis}" for axis in range(1, 7))


def messages_of(bag: Path) -> dict[str, list[bytes]]:
    """Return the serialised messages of every topic in order."""
    found: dict[str, list[bytes]] = {}
    reader = BagReader(bag)
    for part in reader.parts(list(reader.topics)):
        for topic, batch in part.items():
            found.setdefault(topic, []).extend(batch.row(i) for i in range(len(batch)))
    return found


@pytest.fixture(scope="session")
def messages(recording: Path) -> dict[str, list[bytes]]:
    """Serialised messages of the recording by topic."""
    return messages_of(recording)


@pytest.fixture
def read_bag() -> Callable[[Path], dict[str, list[bytes]]]:
    return messages_of
