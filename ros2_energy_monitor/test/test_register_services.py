# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Registers of the nodes: kept on disk, published when they are there, served."""

from __future__ import annotations

import math
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from ros2_energy_msgs.msg import EnergyRegisters, PowerState
from ros2_energy_msgs.srv import (
    CloseInterval,
    ListIntervals,
    OpenInterval,
    ResetRegisters,
    SetPayload,
)
from sensor_msgs.msg import JointState

from robot_energy.accounting.record import FORMAT_VERSION, AccountRecord
from robot_energy.foundation.errors import ParameterError, StateFileError
from robot_energy.store import slots
from robot_energy.store.slots import unwrap
from robot_energy_report.page.alarms import REMEDY_KEY
from ros2_energy_monitor.base import checkpoints
from ros2_energy_monitor.base.parameters import folder_of
from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor
from ros2_energy_monitor.nodes.power_monitor import PowerMonitor

FAST: dict[str, Any] = {"model": "kr16", "checkpoint_period": 0.1}
KILLS = Path(__file__).resolve().parents[2] / "test/soak/kills.py"


class Observer:
    """All registers that were published, and the latest diagnostics of them."""

    def __init__(self, bench) -> None:
        self._bench = bench
        self.rows: list[EnergyRegisters] = []
        self.status: DiagnosticStatus | None = None
        bench.tester.create_subscription(EnergyRegisters, "energy/registers", self.rows.append, 99)
        bench.tester.create_subscription(DiagnosticArray, "/diagnostics", self._take, 99)

    def _take(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name.endswith("_monitor: registers"):
                self.status = status

    def wait(
        self, fits: Callable[[EnergyRegisters], bool] = lambda row: True, **fields: Any
    ) -> EnergyRegisters:
        """Return the next message that fits and has these fields.

        The first to come may have been on its way before what the test did last.
        """
        count = len(self.rows)

        def found() -> EnergyRegisters | None:
            for row in self.rows[count:]:
                if all(getattr(row, name) == value for name, value in fields.items()) and fits(row):
                    return row
            return None

        return self._bench.spin_until(found, f"registers with {fields}")

    def diagnosed(self, *words: str) -> DiagnosticStatus:
        """Return the status once its message holds all these words."""
        self.status = None
        return self._bench.spin_until(
            lambda: self.status and all(word in self.status.message for word in words)
            and self.status, f"diagnostics with {words}",
        )  # fmt: skip


def values(status: DiagnosticStatus) -> dict[str, float]:
    own = (pair for pair in status.values if not pair.key.startswith(REMEDY_KEY))
    return {pair.key: float(pair.value) for pair in own}


def asked(bench, node, kind: Any, service: str, /, **fields: Any) -> Any:
    """Call a service, and return the future of its answer."""
    client = bench.tester.create_client(kind, f"{node.get_name()}/{service}")
    bench.spin_until(client.service_is_ready, service)
    return client.call_async(kind.Request(**fields))


def answer(bench, future: Any) -> Any:
    bench.spin_until(future.done, "the answer of a service")
    return future.result()


def call(bench, node, kind: Any, service: str, /, **fields: Any) -> Any:
    return answer(bench, asked(bench, node, kind, service, **fields))


def feed(bench, node, publisher, rows) -> None:
    """Publish joint states and wait until the node has them."""
    before = node.joint_states.received
    for row in rows:
        publisher.publish(row)
    bench.spin_until(lambda: node.joint_states.received >= before + len(rows), "joint states")


def states(folder: Path) -> list[AccountRecord]:
    """The states on disk, oldest first; one of the two slots may be half written just now."""
    found = []
    for path in folder.glob("*.state"):
        with suppress(StateFileError):
            found.append(unwrap(FORMAT_VERSION, path.read_bytes()))
    return [AccountRecord.from_json(payload) for _, payload in sorted(found)]


def newest(folder: Path) -> AccountRecord:
    return states(folder)[-1]


def counted(row: EnergyRegisters) -> bool:
    return row.predicted_import_energy > 0


def start(bench, folder: Path | str, **parameters: Any) -> EnergyMonitor:
    return bench.add(EnergyMonitor, **{**FAST, "state_folder": str(folder), **parameters})


def test_what_is_published_is_on_disk_and_outlives_the_node(bench, messages, tmp_path):
    node, observer = start(bench, tmp_path), Observer(bench)
    publisher = bench.publisher(JointState, "joint_states")
    rows = messages["/joint_states"]
    feed(bench, node, publisher, rows[:300])
    row = observer.wait(counted, persisted=True)
    kept = newest(tmp_path).totals.cabinet_energy_microjoule["grid_import"] * 1e-6
    assert 0 < row.predicted_import_energy <= kept
    assert values(observer.diagnosed("all is well"))["checkpoint_failures"] == 0
    node.close()
    total = node.account.registers.cabinet("grid_import")
    assert newest(tmp_path).totals.cabinet_energy_microjoule["grid_import"] == total * 1e6
    bench.remove(node)
    node = start(bench, tmp_path)
    assert node.account.registers.cabinet("grid_import") == total
    bench.spin_until(lambda: node.joint_states.publishers, "the publisher")
    feed(bench, node, publisher, rows[400:500])
    node.close()
    time = node.account.registers.time
    assert (time.gap_count, node.account.restarts) == (1, 1)
    assert time.span_ns == time.end_ns - time.start_ns
    energies = [row.predicted_import_energy for row in observer.rows]
    assert energies == sorted(energies)


def test_cleanup_lets_go_and_configure_continues(bench, messages, tmp_path):
    node = start(bench, tmp_path)
    publisher = bench.publisher(JointState, "joint_states")
    rows = messages["/joint_states"]
    feed(bench, node, publisher, rows[:200])
    node.trigger_deactivate()
    before = node.account.totals()
    node.trigger_cleanup()
    other = start(bench, tmp_path, autostart=False)
    other.trigger_configure()  # the lock is free
    assert other.account.totals() == before
    other.trigger_cleanup()
    node.trigger_configure()
    assert node.account.totals() == before
    node.trigger_activate()
    bench.spin_until(lambda: node.joint_states.publishers, "the publisher")
    feed(bench, node, publisher, rows[300:400])
    node.close()
    time = node.account.registers.time
    assert time.gap_count == 1
    assert time.observed_ns + time.gap_ns == time.end_ns - time.start_ns
    assert node.account.totals().observed_ns > before.observed_ns


def test_where_the_files_are(monkeypatch, tmp_path):
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    assert folder_of("$ROS_HOME/robot_energy") == tmp_path / "robot_energy"
    monkeypatch.delenv("ROS_HOME")
    assert folder_of("$ROS_HOME/robot_energy") == Path.home() / ".ros/robot_energy"
    assert folder_of("~/kept") == Path.home() / "kept"
    monkeypatch.setenv("CELL", str(tmp_path))
    assert folder_of("$CELL/kept") == folder_of("${CELL}/kept") == tmp_path / "kept"
    with pytest.raises(
        ParameterError, match=r"'/var/\$HALL/kept' names a variable that is not set"
    ):
        folder_of("/var/$HALL/kept")
    assert folder_of("") is folder_of("none") is None


def test_an_interval_begins_with_what_has_arrived(bench, messages, tmp_path):
    node = start(bench, tmp_path)
    rows = messages["/joint_states"]
    publisher = bench.publisher(JointState, "joint_states")
    feed(bench, node, publisher, rows[:200])
    bench.spin_until(lambda: not node.checkpoints.store.busy, "the disk, which a timer looks after")
    for timer in node.timers:  # from now on only a service takes what arrives
        timer.cancel()
    for row in rows[200:400]:
        publisher.publish(row)
    names = map(str, range(10_000))
    newest_ns = nanoseconds(deserialize_message(bytes(rows[399]), JointState).header.stamp)

    def opened() -> bool:
        interval = call(bench, node, OpenInterval, "open_interval", name=next(names)).interval
        return nanoseconds(interval.start) >= newest_ns - 250_000_000

    bench.spin_until(opened, "an interval that begins at the newest joint states")


def nanoseconds(stamp: Time) -> int:
    return stamp.sec * 10**9 + stamp.nanosec


def test_readings_at_minutes_and_before_a_reset_are_on_disk_when_they_are_published(
    bench, messages, tmp_path
):
    node, observer = start(bench, tmp_path, checkpoint_period=5.0), Observer(bench)
    rows = messages["/joint_states"]
    publisher = bench.publisher(JointState, "joint_states")
    stamps = [nanoseconds(deserialize_message(row, JointState).header.stamp) for row in rows[:400]]
    minute = (stamps[0] // (60 * 10**9) + 1) * 60 * 10**9
    shift = minute - stamps[200]  # the minute ends in the middle
    moved = []
    for row in rows[:400]:
        message = deserialize_message(row, JointState)
        stamp = nanoseconds(message.header.stamp) + shift
        message.header.stamp = Time(sec=stamp // 10**9, nanosec=stamp % 10**9)
        moved.append(serialize_message(message))
    feed(bench, node, publisher, moved)
    row = bench.spin_until(
        lambda: next((row for row in observer.rows if row.minute.sec), None), "the minute"
    )
    assert nanoseconds(row.minute) == minute == nanoseconds(row.header.stamp)
    assert row.persisted
    assert row.observed_ns == stamps[200] - stamps[0] == row.phase_ns.sum()
    place = observer.rows.index(row)
    after = observer.wait(lambda one: nanoseconds(one.header.stamp) > minute)
    assert after.predicted_import_microjoule > row.predicted_import_microjoule
    assert all(
        one.predicted_import_microjoule <= row.predicted_import_microjoule
        for one in observer.rows[:place]
    )
    last = node.account.totals().cabinet_energy_microjoule["grid_import"]
    assert call(bench, node, ResetRegisters, "reset_registers", reason="test").success
    observer.wait(predicted_import_microjoule=0)
    assert max(one.predicted_import_microjoule for one in observer.rows) == last
    assert [one for one in observer.rows if one.predicted_import_microjoule == last][-1].persisted


def test_intervals_and_reset_by_service(bench, messages, tmp_path):
    node, observer = start(bench, tmp_path), Observer(bench)
    rows = messages["/joint_states"]
    early = call(bench, node, OpenInterval, "open_interval", name="job")
    assert (early.success, early.persisted) == (False, False)
    assert early.message == "no sample has been counted yet; expected a first joint state."
    publisher = bench.publisher(JointState, "joint_states")
    feed(bench, node, publisher, rows[:200])
    opened = call(bench, node, OpenInterval, "open_interval", name="job")
    assert (opened.success, opened.persisted, opened.interval.is_open) == (True, True, True)
    assert [entry.name for entry in newest(tmp_path).open_intervals] == ["job"]
    again = call(bench, node, OpenInterval, "open_interval", name="job")
    assert not again.success
    assert "is open already" in again.message
    feed(bench, node, publisher, rows[200:400])
    refused = call(bench, node, ResetRegisters, "reset_registers", reason=" ")
    assert not refused.success
    before = node.account.registers.cabinet("grid_import")
    done = call(bench, node, ResetRegisters, "reset_registers", reason="new shift")
    assert (done.success, done.persisted) == (True, True)
    row = observer.wait(lambda row: row.predicted_import_energy < before, persisted=True)
    assert row.energy_start.nanosec == newest(tmp_path).energy_start_ns % 10**9
    assert newest(tmp_path).trace[-1].text == "new shift"
    feed(bench, node, publisher, rows[400:600])
    (listed,) = call(bench, node, ListIntervals, "list_intervals").intervals
    assert listed.is_open
    closed = call(bench, node, CloseInterval, "close_interval", id=listed.id).interval
    assert closed.name == "job"
    assert closed.predicted_import_energy >= listed.predicted_import_energy > 0
    assert closed.predicted_mean_power == pytest.approx(
        closed.predicted_import_energy / closed.observed_time
    )
    assert closed.predicted_peak_power >= closed.predicted_mean_power
    assert closed.coverage == 1.0
    assert np.isnan(closed.measured_energy)
    assert [joint.name for joint in closed.joints] == list(node.model.joint_names)
    begin, end = map(nanoseconds, (closed.start, closed.end))
    assert (end - begin) * 1e-9 == pytest.approx(closed.observed_time + closed.gap_time)
    (kept,) = newest(tmp_path).closed_intervals
    assert kept.counted.observed_ns / 1e9 == closed.observed_time


def test_power_monitor_serves_too(bench):
    node = bench.add(PowerMonitor, **FAST)
    answer = call(bench, node, CloseInterval, "close_interval", name="job")
    assert answer.message == "no interval 'job' is open; expected an open interval; none is."
    assert math.isnan(answer.interval.predicted_import_energy)
    assert not call(bench, node, ListIntervals, "list_intervals").intervals


def test_a_hundred_requests_at_once_are_all_answered(bench):
    """By default ROS keeps ten requests of a service, and loses the others without a word."""
    node = bench.add(PowerMonitor, **FAST)
    many = QoSProfile(depth=100)
    name = f"{node.get_name()}/list_intervals"
    client = bench.tester.create_client(ListIntervals, name, qos_profile=many)
    bench.spin_until(client.service_is_ready, "the service")
    answers = [client.call_async(ListIntervals.Request()) for _ in range(100)]
    bench.spin_until(lambda: all(answer.done() for answer in answers), "the answers")


def test_a_disk_in_trouble_and_back(bench, messages, tmp_path):
    """A file stands where the folder should be: an error until it is gone, no restart."""
    folder = tmp_path / "state"
    folder.write_text("in the way")
    node, observer = start(bench, folder), Observer(bench)
    publisher = bench.publisher(JointState, "joint_states")
    rows = messages["/joint_states"]
    feed(bench, node, publisher, rows[:200])
    row = observer.wait(counted, persisted=False)
    status = observer.diagnosed("cannot be kept in", str(folder))
    assert status.level == DiagnosticStatus.ERROR
    assert values(status)["checkpoint_failures"] > 0
    assert status.message.startswith("counting goes on in memory")
    assert status.message.lower().count("counting goes on in memory") == 1
    answer = call(bench, node, ResetRegisters, "reset_registers", reason="to see")
    assert not answer.success
    assert "have not been read yet" in answer.message
    folder.unlink()
    assert observer.diagnosed("all is well").level == DiagnosticStatus.OK
    kept = observer.wait(persisted=True)
    assert kept.predicted_import_energy >= row.predicted_import_energy > 0

    def unplug() -> None:
        for path in folder.iterdir():  # the folder vanishes, as an unplugged disk does
            path.unlink()
        folder.rmdir()
        folder.write_text("in the way again")

    node.checkpoints._thread.submit(unplug).result()  # while nothing is written
    feed(bench, node, publisher, rows[200:300])
    observer.wait(persisted=False)
    answer = call(bench, node, ResetRegisters, "reset_registers", reason="to see")
    assert (answer.success, answer.persisted) == (True, False)
    assert answer.message.endswith("it is in memory only")
    folder.unlink()
    observer.wait(persisted=True)
    assert newest(folder).trace[-1].text == "to see"


def test_nothing_is_kept_if_so_wished(bench, messages):
    node, observer = start(bench, ""), Observer(bench)
    publisher = bench.publisher(JointState, "joint_states")
    feed(bench, node, publisher, messages["/joint_states"][:200])
    observer.wait(persisted=False)
    assert observer.diagnosed("all is well").level == DiagnosticStatus.OK


def test_a_second_monitor_says_so_and_takes_over(bench, messages, tmp_path):
    first = start(bench, tmp_path)
    publisher = bench.publisher(JointState, "joint_states")
    rows = messages["/joint_states"]
    feed(bench, first, publisher, rows[:300])
    assert first.checkpoints.now()
    total = first.account.registers.cabinet("grid_import")
    second, observer = start(bench, tmp_path), Observer(bench)
    status = observer.diagnosed("another monitor", str(tmp_path))
    assert status.level == DiagnosticStatus.ERROR
    assert not second.account.restarts
    bench.remove(first)
    bench.spin_until(lambda: second.account.restarts, "the take-over")
    assert second.account.registers.cabinet("grid_import") >= total
    assert observer.diagnosed("all is well").level == DiagnosticStatus.OK


def test_ticks_go_on_while_the_disk_hangs(bench, messages, tmp_path):
    """A card that takes its time: joint states are drained, and no value falls afterwards."""
    node, observer = start(bench, tmp_path), Observer(bench)
    publisher = bench.publisher(JointState, "joint_states")
    rows = messages["/joint_states"]
    feed(bench, node, publisher, rows[:200])
    observer.wait(persisted=True)
    card = threading.Event()
    node.checkpoints._thread.submit(card.wait)
    try:
        observer.wait(persisted=False)
        hung = len(observer.rows)
        feed(bench, node, publisher, rows[200:400])
        observer.diagnosed("has been under way for")
        assert not any(row.persisted for row in observer.rows[hung:])
    finally:
        card.set()
    observer.wait(persisted=True)
    energies = [row.predicted_import_energy for row in observer.rows]
    assert energies == sorted(energies)


@pytest.fixture
def card(bench, messages, tmp_path) -> Iterator[Any]:
    """A monitor that has counted, and whose disk does not answer until `release` is called."""
    node, released = start(bench, tmp_path, checkpoint_period=3600.0), threading.Event()
    publisher = bench.publisher(JointState, "joint_states")
    feed(bench, node, publisher, messages["/joint_states"][:200])
    node.checkpoints._thread.submit(released.wait)
    yield SimpleNamespace(node=node, publisher=publisher, release=released.set)
    released.set()


def test_services_wait_for_the_disk_next_to_the_ticks(bench, messages, tmp_path, card):
    """Power goes on while their answers wait; they come once the change is on disk."""
    node, powers = card.node, []
    opened = asked(bench, node, OpenInterval, "open_interval", name="job")
    bench.spin_until(lambda: node.account.intervals.open_entries, "the interval")
    reset = asked(bench, node, ResetRegisters, "reset_registers", reason="new shift")
    before = node.account.start_ns
    bench.spin_until(lambda: node.account.start_ns != before, "the reset")
    bench.tester.create_subscription(PowerState, "energy/power", powers.append, 99)
    rows = messages["/joint_states"]
    for begin in range(200, 700, 100):
        feed(bench, node, card.publisher, rows[begin : begin + 100])
    bench.spin_until(lambda: len(powers) > 10, "powers")
    assert not opened.done()
    assert not reset.done()
    assert not any(one.open_intervals for one in states(tmp_path))
    card.release()
    assert answer(bench, opened).persisted
    assert [one.name for one in newest(tmp_path).open_intervals] == ["job"]
    assert answer(bench, reset).persisted
    assert newest(tmp_path).trace[-1].text == "new shift"


def test_a_disk_that_takes_too_long_is_said(bench, tmp_path, card, monkeypatch):
    monkeypatch.setattr(checkpoints, "ANSWERING", 0.05)
    late = call(bench, card.node, OpenInterval, "open_interval", name="job")
    assert (late.success, late.persisted) == (True, False)
    assert late.message.endswith("it is in memory only so far: the disk has not finished writing")
    card.release()
    bench.spin_until(lambda: any(one.open_intervals for one in states(tmp_path)), "the interval")


def test_who_waits_is_answered_when_the_node_stops(bench, card, monkeypatch):
    opened = asked(bench, card.node, OpenInterval, "open_interval", name="job")
    bench.spin_until(lambda: card.node.account.intervals.open_entries, "the interval")
    monkeypatch.setattr(slots, "wait", lambda jobs, _: None)  # the disk is not waited for
    card.node.trigger_deactivate()
    late = answer(bench, opened)
    assert (late.success, late.persisted) == (True, False)


def test_an_inactive_monitor_answers(bench, tmp_path, card):
    card.release()
    card.node.trigger_deactivate()
    assert call(bench, card.node, OpenInterval, "open_interval", name="job").persisted
    assert [one.name for one in newest(tmp_path).open_intervals] == ["job"]


def test_files_that_cannot_be_used_are_said(bench, tmp_path):
    node = start(bench, tmp_path)
    bench.spin_until(lambda: len(list(tmp_path.glob("*.state"))) == 2, "both slots")
    bench.remove(node)
    for path in tmp_path.glob("*.state"):
        path.write_bytes(b"rubbish")
    start(bench, tmp_path)
    status = Observer(bench).diagnosed("begin at zero")
    assert status.level == DiagnosticStatus.WARN


HOSTILE = ["x" * 3_000_000, "a\n[ERROR] forged", "\x1b[2J", "", " ", "\U0001f916" * 300, "a\u2028b"]


def test_a_barrage_of_strings_and_numbers_changes_nothing(bench, messages, tmp_path, capfd):
    """Refused in one short line each; the registers go on and can be read back."""
    node = start(bench, tmp_path)
    publisher = bench.publisher(JointState, "joint_states")
    feed(bench, node, publisher, messages["/joint_states"][:300])
    assert call(bench, node, OpenInterval, "open_interval", name="job").persisted
    before = node.account.totals()
    answers = []
    for text in HOSTILE:
        answers += [
            call(bench, node, ResetRegisters, "reset_registers", reason=text),
            call(bench, node, OpenInterval, "open_interval", name=text),
            call(bench, node, CloseInterval, "close_interval", name=text),
            call(bench, node, SetPayload, "set_payload", payload=bench.payload(text).payload),
        ]
    for sec, nanosec in ((2**31 - 1, 2**32 - 1), (2**31 - 1, 0), (0, 10**9)):
        request = bench.payload(stamp=Time(sec=sec, nanosec=nanosec))
        answers.append(call(bench, node, SetPayload, "set_payload", payload=request.payload))
    for mass in (1e308, float("nan"), float("inf"), -1.0):
        request = bench.payload(m=mass)
        answers.append(call(bench, node, SetPayload, "set_payload", payload=request.payload))
    assert not any(answer.success for answer in answers)
    assert all(answer.message.isprintable() for answer in answers)
    assert max(len(answer.message) for answer in answers) < 5000
    assert node.account.totals() == before
    logged = capfd.readouterr().err
    assert logged.count("[WARN]") >= len(answers)  # a refusal is not news of a healthy node
    widest = "\U0001f916" * 100
    assert call(bench, node, OpenInterval, "open_interval", name=widest).persisted
    assert call(bench, node, ResetRegisters, "reset_registers", reason=2 * widest).persisted
    kept = newest(tmp_path)
    assert [one.name for one in kept.open_intervals] == ["job", widest]
    assert kept.trace[-1].text == 2 * widest


def test_namespaces_have_registers_of_their_own(bench, messages, tmp_path):
    nodes = [
        bench.add(partial(EnergyMonitor, namespace=name), **{**FAST, "state_folder": str(tmp_path)})
        for name in ("cell1", "cell2")
    ]
    assert all(node.checkpoints.now() for node in nodes)
    assert len(list(tmp_path.glob("cell1-*.state"))) == 1
    assert len(list(tmp_path.glob("cell2-*.state"))) == 1


def test_kills_while_services_are_called_and_the_clock_steps(child_environment):
    """See test/soak/service_kills.py."""
    done = subprocess.run(
        [sys.executable, str(KILLS.with_name("service_kills.py")), "--kills=8"],
        env=child_environment, capture_output=True, text=True, timeout=1800, check=False,
    )  # fmt: skip
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.long
def test_kills_in_motion(child_environment):
    """See test/soak/kills.py: what a thousand kills must not do, fifteen must not do either."""
    done = subprocess.run(
        [sys.executable, str(KILLS), "--kills=15"],
        env=child_environment, capture_output=True, text=True, timeout=1800, check=False,
    )  # fmt: skip
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr
