# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""An exception inside one path costs that path's block, is counted and said, and nothing more."""

from __future__ import annotations

import math
from copy import deepcopy
from functools import partial

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from ros2_energy_msgs.msg import EnergyRegisters, MotorTemperatures, PowerReading, PowerState
from ros2_energy_msgs.srv import CloseInterval, OpenInterval, SetPayload
from sensor_msgs.msg import JointState

from robot_energy.pipeline import Settings
from ros2_energy_monitor.base.guard import INTERNAL_ERROR
from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor
from ros2_energy_monitor.nodes.friction_monitor import FrictionMonitor
from ros2_energy_monitor.nodes.power_monitor import PowerMonitor
from ros2_energy_monitor.nodes.torque_monitor import TorqueMonitor

TOPICS = {
    "/joint_states": JointState,
    "/motor_temperatures": MotorTemperatures,
    "/power_meter": PowerReading,
}
PATHS = {  # of the energy monitor: where a defect is put, and which topic loses messages
    "joint_states": (lambda node: (node.ingest, "step"), "/joint_states"),
    "joint_states.torque": (lambda node: (node._pipeline.torque, "step"), "/joint_states"),
    "joint_states.power": (lambda node: (node._pipeline.power, "step"), "/joint_states"),
    "motor_temperatures": (lambda node: (node._temperature, "step"), "/motor_temperatures"),
    "motor_temperatures.friction": (
        lambda node: (node._pipeline.friction, "step"),
        "/motor_temperatures",
    ),
    "meter": (lambda node: (node._meter, "step"), "/power_meter"),
    "meter.books": (lambda node: (node.account, "measure"), "/power_meter"),
    "publish.power": (lambda node: (node._power_writer, "encode"), ""),
    "publish.joint_friction": (lambda node: (node._friction_writer, "encode"), ""),
    "timer.Checkpoints._poll": (
        lambda node: (node.checkpoints.store, "poll"),
        "",
    ),
    "diagnostics": (lambda node: (node.sources, 1), ""),
}


class Defect:
    """Breaks one function until it is mended."""

    def __init__(self, owner, name) -> None:
        self.calls = 0
        self._owner, self._name = owner, name
        if isinstance(owner, list):
            self._kept, owner[name] = owner[name], self._fail
        else:
            self._kept = vars(owner).get(name)
            setattr(owner, name, self._fail)

    def _fail(self, *_args, **_options):
        self.calls += 1
        raise ZeroDivisionError("a defect \x1b[31m")

    def mend(self) -> None:
        if isinstance(self._owner, list):
            self._owner[self._name] = self._kept
        elif self._kept is not None:
            setattr(self._owner, self._name, self._kept)
        else:
            delattr(self._owner, self._name)


def feed(bench, node, publishers, messages, part) -> None:
    """Publish a part of every topic and wait until it has been taken."""
    inboxes = {
        "/joint_states": node.joint_states,
        "/motor_temperatures": node.temperatures[0],
        "/power_meter": node.readings[0],
    }
    for topic, publisher in publishers.items():
        rows = messages[topic]
        some = rows[len(rows) * part // 8 : len(rows) * (part + 1) // 8]
        wanted = inboxes[topic].received + len(some)
        for row in some:
            publisher.publish(row)
        bench.spin_until(lambda topic=topic, n=wanted: inboxes[topic].received == n, topic)


def account(node, topic):
    return next(account for inbox, account in node.inputs if inbox.topic == topic)


@pytest.mark.injects_errors
@pytest.mark.parametrize("path", PATHS)
def test_a_defect_in_one_path_leaves_the_others_and_is_counted_once(bench, messages, path, capfd):
    node = bench.add(EnergyMonitor, model="kr16", checkpoint_period=0.1)
    diagnosed, powers = bench.diagnosed(), bench.latest(PowerState, "energy/power")
    publishers = {topic: bench.publisher(kind, topic) for topic, kind in TOPICS.items()}
    feed(bench, node, publishers, messages, 0)
    place, hit = PATHS[path]
    before = {topic: deepcopy(account(node, topic)) for topic in TOPICS}
    defect = Defect(*place(node))
    feed(bench, node, publishers, messages, 1)
    bench.spin_until(lambda: defect.calls, "a failure")
    status = diagnosed.wait("energy_monitor: node", "report this fault of the program")
    assert status.level == DiagnosticStatus.ERROR
    defect.mend()
    for part in range(2, 5):
        feed(bench, node, publishers, messages, part)
    node.close()
    name = path if path.startswith(("publish", "timer")) else path.split(".")[0]
    assert dict(node.guard.errors) == {name: defect.calls}
    for topic, earlier in before.items():
        now = account(node, topic)
        assert now.balanced
        assert now.accepted > earlier.accepted, topic
        assert (now.rejected[INTERNAL_ERROR] > 0) == (topic == hit), topic
        others = now.rejected.total() - now.rejected[INTERNAL_ERROR]
        assert others <= 1 or topic == hit, now  # the one that the recording has twice
    time = node.account.registers.time
    assert time.end_ns - time.start_ns == time.observed_ns + time.gap_ns
    assert np.isfinite(node.account.registers.cabinet("grid_import"))
    bench.spin_until(powers, "powers")
    log = capfd.readouterr().err
    assert log.count("internal error in") == 1
    assert log.count("Traceback (most recent call last)") == 1
    assert "\x1b[31m" not in log


@pytest.mark.injects_errors
def test_registers_after_a_defect_are_those_without_the_lost_messages(bench, messages, monkeypatch):
    """What a defect hides is a gap; before and after it every joule is counted."""
    at_once = partial(Settings, temperature_wait=0.0)
    monkeypatch.setattr("ros2_energy_monitor.base.settings.Settings", at_once)
    rows = messages["/joint_states"][:750]
    energy = []
    for broken in (False, True):
        node = bench.add(EnergyMonitor, model="kr16", state_folder="")
        publisher = bench.publisher(JointState, "joint_states")

        def take(part, node=node, publisher=publisher):
            wanted = node.joint_states.received + len(part)
            for row in part:
                publisher.publish(row)
            bench.spin_until(lambda: node.joint_states.received == wanted, "joint states")

        take(rows[:250])
        if broken:
            defect = Defect(node.ingest, "step")
            take(rows[250:500])
            defect.mend()
        else:  # the clean run has the same two pieces
            node.trigger_deactivate()
            take(rows[250:500])
            node.trigger_activate()
        take(rows[500:])
        node.close()
        time = node.account.registers.time
        assert node.ingest.rejections.rejected.total() == 250
        assert time.gap_count == 1
        energy.append((node.account.registers.cabinet("grid_import"), time.gap_ns))
        bench.tester.destroy_publisher(publisher)
        bench.remove(node)
    # the filter's last samples before the defect were still waiting, and are lost with it
    assert energy[1][0] == pytest.approx(energy[0][0], rel=0.02)
    assert energy[1][1] == pytest.approx(energy[0][1], rel=0.05)


@pytest.mark.injects_errors
@pytest.mark.parametrize(
    ("monitor", "inner", "topic", "kind"),
    [
        (TorqueMonitor, lambda node: (node.stage, "step"), "/joint_states", JointState),
        (
            FrictionMonitor,
            lambda node: (node._stage, "step"),
            "/motor_temperatures",
            MotorTemperatures,
        ),
        (PowerMonitor, lambda node: (node.account, "measure"), "/power_meter", PowerReading),
    ],
)
def test_every_monitor_goes_on(bench, messages, monitor, inner, topic, kind):
    node = bench.add(monitor, model="kr16")
    publisher = bench.publisher(kind, topic.lstrip("/"))
    inbox = next(inbox for inbox, _ in node.inputs if inbox.topic == topic)
    defect = Defect(*inner(node))
    for row in messages[topic][:3]:
        publisher.publish(row)
    bench.spin_until(lambda: defect.calls, "the defect")
    bench.spin_until(lambda: inbox.received == 3, "three messages")
    defect.mend()
    for row in messages[topic][3:8]:
        publisher.publish(row)
    bench.spin_until(lambda: account(node, topic).accepted == 5, "the messages after it")
    assert account(node, topic).rejected == {INTERNAL_ERROR: 3}
    assert account(node, topic).balanced
    assert node.active


@pytest.mark.injects_errors
def test_a_service_with_a_defect_answers(bench):
    node = bench.add(EnergyMonitor, model="kr16")
    Defect(node._pipeline.torque, "set_payload")
    client = bench.tester.create_client(SetPayload, "energy_monitor/set_payload")
    bench.spin_until(client.service_is_ready, "the service")
    future = client.call_async(bench.payload("flange"))
    bench.spin_until(future.done, "an answer")
    assert not future.result().success
    assert "internal error" in future.result().message
    assert dict(node.guard.errors) == {"service.set_payload": 1}
    assert node.active


@pytest.mark.injects_errors
@pytest.mark.parametrize(
    ("name", "kind"), [("open_interval", OpenInterval), ("close_interval", CloseInterval)]
)
def test_figures_of_an_interval_that_a_defect_cost_are_unknown(bench, name, kind):
    node = bench.add(EnergyMonitor, model="kr16", state_folder="")
    Defect(node.account, name)
    client = bench.tester.create_client(kind, f"energy_monitor/{name}")
    bench.spin_until(client.service_is_ready, "the service")
    future = client.call_async(kind.Request(name="part 7"))
    bench.spin_until(future.done, "an answer")
    assert not future.result().success
    assert math.isnan(future.result().interval.predicted_import_energy)
    assert math.isnan(future.result().interval.observed_time)


@pytest.mark.injects_errors
def test_a_checkpoint_timer_with_a_defect_is_tried_again(bench, messages):
    node = bench.add(EnergyMonitor, model="kr16", checkpoint_period=0.1)
    registers = bench.latest(EnergyRegisters, "energy/registers")
    publisher = bench.publisher(JointState, "joint_states")
    defect = Defect(node.checkpoints, "_encode")
    for row in messages["/joint_states"][:100]:
        publisher.publish(row)
    bench.spin_until(lambda: defect.calls >= 2, "two failures")
    assert set(node.guard.errors) == {"timer.Checkpoints._begin"}
    assert registers() is None
    defect.mend()
    bench.spin_until(registers, "registers, now that they can be encoded")
