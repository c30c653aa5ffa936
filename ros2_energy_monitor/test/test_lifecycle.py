# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The life cycle: what is kept, what is counted, and that nothing is left behind."""

from __future__ import annotations

import gc
import os
import struct
import threading
from functools import partial
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.lifecycle import TransitionCallbackReturn
from ros2_energy_msgs.msg import MotorTemperatures
from sensor_msgs.msg import JointState

from robot_energy.model import load, save
from ros2_energy_monitor.base.entities import EntitySnapshot
from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor
from ros2_energy_monitor.nodes.friction_monitor import FrictionMonitor
from ros2_energy_monitor.nodes.power_monitor import PowerMonitor
from ros2_energy_monitor.nodes.torque_monitor import TorqueMonitor

SUCCESS, FAILURE, ERROR = (
    TransitionCallbackReturn.SUCCESS,
    TransitionCallbackReturn.FAILURE,
    TransitionCallbackReturn.ERROR,
)
MONITORS = [TorqueMonitor, FrictionMonitor, PowerMonitor, EnergyMonitor]


def span(rows: list[bytes]) -> int:
    """Time between the stamps of the first and the last message. [ns]"""
    first, last = (struct.unpack_from("<iI", rows[index], 4) for index in (0, -1))
    return (last[0] - first[0]) * 10**9 + last[1] - first[1]


def feed(bench, node, publisher, rows: list[bytes]) -> None:
    """Publish joint states and wait until the node has taken them."""
    wanted = node.joint_states.received + len(rows)
    for row in rows:
        publisher.publish(row)
    bench.spin_until(lambda: node.joint_states.received == wanted, f"{wanted} joint states")


def ask(bench, service_type, name: str, request):
    client = bench.tester.create_client(service_type, name)
    bench.spin_until(client.service_is_ready, name)
    future = client.call_async(request)
    bench.spin_until(future.done, f"the answer of {name}")
    bench.tester.destroy_client(client)
    return future.result()


@pytest.mark.parametrize("monitor", MONITORS)
def test_autostart_makes_a_monitor_active(bench, monitor):
    node = bench.add(monitor, model="kr16")
    assert node.state == "active"
    assert node.active


def test_services_take_a_node_through_its_life(bench):
    node = bench.add(EnergyMonitor, model="kr16", autostart=False)
    states = []
    for number in (
        Transition.TRANSITION_CONFIGURE,
        Transition.TRANSITION_ACTIVATE,
        Transition.TRANSITION_DEACTIVATE,
        Transition.TRANSITION_CLEANUP,
        Transition.TRANSITION_UNCONFIGURED_SHUTDOWN,
    ):
        request = ChangeState.Request(transition=Transition(id=number))
        assert ask(bench, ChangeState, "energy_monitor/change_state", request).success
        found = ask(bench, GetState, "energy_monitor/get_state", GetState.Request())
        states.append(found.current_state.label)
    assert states == ["inactive", "active", "inactive", "unconfigured", "finalized"]
    assert node.finalized


@pytest.mark.parametrize("transition", [Transition(id=3), Transition(id=99), Transition(label="x")])
def test_a_transition_that_the_state_does_not_have_is_answered(bench, transition, capfd):
    """rclpy raises where it is asked for one by number, and its service never answers."""
    node = bench.add(EnergyMonitor, model="kr16", autostart=False)
    request = ChangeState.Request(transition=transition)
    assert not ask(bench, ChangeState, "energy_monitor/change_state", request).success
    words = (
        f"energy_monitor is unconfigured and has no transition {transition.label or transition.id}"
    )
    output = capfd.readouterr().err
    assert f"{words}; expected one of configure (1), shutdown (5)" in output
    assert "[ERROR]" not in output
    assert node.state == "unconfigured"
    status = bench.diagnosed().wait("energy_monitor: node", "configure and activate it")
    assert status.level == DiagnosticStatus.WARN


def test_temperatures_that_an_inactive_node_discards_are_no_fault_of_theirs(bench):
    node = bench.add(FrictionMonitor, model="kr16")
    node.trigger_deactivate()
    publisher = bench.publisher(MotorTemperatures, "motor_temperatures")
    publisher.publish(MotorTemperatures(joint_names=["joint_a1"], temperature_degc=[30.0]))
    diagnosed, name = bench.diagnosed(), "friction_monitor: motor temperatures"
    bench.spin_until(lambda: node.temperatures[0].received, "a temperature")
    diagnosed.wait_anew(name, "friction is taken at")
    assert "rejected" not in diagnosed[name].message


def test_an_unconfigured_node_only_reports(bench):
    node = bench.add(EnergyMonitor, model="kr16", autostart=False)
    reports = bench.latest(DiagnosticArray, "/diagnostics")
    bench.spin_until(reports, "diagnostics")
    (status,) = reports().status
    assert status.level == DiagnosticStatus.WARN
    assert status.message == (
        "configure and activate it: the node is unconfigured: nothing is counted or published"
    )
    assert node.count_publishers("energy/power") == 0
    assert node.count_subscribers("joint_states") == 0


def test_what_arrives_while_inactive_is_counted_and_leaves_a_gap(bench, messages):
    node = bench.add(EnergyMonitor, model="kr16")
    publisher = bench.publisher(JointState, "joint_states")
    rows = messages["/joint_states"]
    feed(bench, node, publisher, rows[:200])
    node.trigger_deactivate()
    before = node.account.registers.microjoule.copy()
    observed = node.account.registers.time.observed_ns
    assert observed == span(rows[:200])  # what waited for its window is booked
    feed(bench, node, publisher, rows[200:210])  # 40 ms: no gap by its length alone
    assert (node.account.registers.microjoule == before).all()
    node.trigger_activate()
    feed(bench, node, publisher, rows[210:400])
    node.close()
    time, account = node.account.registers.time, node.ingest.rejections
    assert (account.received, account.accepted) == (400, 390)
    assert account.rejected == {"inactive": 10}
    assert time.observed_ns == observed + span(rows[210:400])
    assert (time.gap_ns, time.gap_count) == (span(rows[199:211]), 1)
    assert time.end_ns - time.start_ns == time.observed_ns + time.gap_ns
    assert (node.account.registers.microjoule[:1] > before[:1]).all()


def test_a_power_monitor_that_was_inactive_bridges_nothing(bench, messages):
    torque = bench.add(TorqueMonitor, model="kr16")
    power = bench.add(PowerMonitor, model="kr16")
    bench.spin_until(lambda: power.torques.publishers, "the torque monitor")
    publisher = bench.publisher(JointState, "joint_states")
    rows = messages["/joint_states"]
    for start, active in ((0, True), (100, False), (105, True)):
        if not active:
            power.trigger_deactivate()
        elif not power.active:
            power.trigger_activate()
        stop = 105 if not active else start + 100
        feed(bench, torque, publisher, rows[start:stop])
        torque.close()  # hands out the torques that wait for their window
        torque.trigger_activate()
        bench.spin_until(lambda wanted=stop: power.torques.received == wanted, "torques")
    power.close()
    time = power.account.registers.time
    assert power.inputs[0][1].rejected == {"inactive": 5}
    assert time.observed_ns == span(rows[:100]) + span(rows[105:205])
    assert time.gap_ns == span(rows[99:106])


def test_configure_reads_the_model_again(bench, tmp_path: Path, capfd):
    path = tmp_path / "robot.yaml"
    path.write_text("schema_version: 1\n")
    node = bench.add(EnergyMonitor, model=str(path), autostart=False)
    assert node.trigger_configure() == FAILURE
    assert node.state == "unconfigured"
    lines = [line for line in capfd.readouterr().err.splitlines() if str(path) in line]
    assert len(lines) == 1
    assert "energy_monitor cannot be configured" in lines[0]
    path.unlink()
    save(load("kr16"), path)
    assert node.trigger_configure() == SUCCESS
    first = node.model.model_id
    text = path.read_text().replace("fallback_degc: 22.0", "fallback_degc: 30.0")
    path.write_text(text)
    assert node.trigger_activate() == node.trigger_deactivate() == SUCCESS
    assert node.model.model_id == first
    assert node.trigger_cleanup() == node.trigger_configure() == SUCCESS
    assert node.model.temperature.fallback_degc == 30.0
    assert node.model.model_id != first


def test_a_deactivated_node_is_logged_and_is_no_warning(bench, messages, capfd):
    """An operator asked for it, so the diagnostics raise no alarm, whatever still arrives."""
    node = bench.add(EnergyMonitor, model="kr16", input_timeout=60.0)
    publisher = bench.publisher(JointState, "joint_states")
    temperatures = bench.publisher(MotorTemperatures, "motor_temperatures")
    temperatures.publish(messages["/motor_temperatures"][0])
    bench.spin_until(lambda: node.temperatures[0].received == 1, "a temperature")
    feed(bench, node, publisher, messages["/joint_states"][:100])
    node.trigger_deactivate()
    assert "deactivated" in capfd.readouterr().err
    feed(bench, node, publisher, messages["/joint_states"][100:150])
    diagnosed = bench.diagnosed()
    diagnosed.wait("energy_monitor: node", "inactive")
    for name in ("node", "joint states", "motor temperatures", "energy", "registers"):
        status = diagnosed[f"energy_monitor: {name}"]
        assert status.level == DiagnosticStatus.OK, status.message
    assert diagnosed.values(diagnosed["energy_monitor: node"])["lifecycle_state"] == "inactive"


@pytest.mark.parametrize(
    ("serial", "namespace", "expected"),
    [
        ("", "", "KR 16 class"),
        ("4711", "", "KR 16 class 4711"),
        ("", "/cell1", "KR 16 class (/cell1)"),
        ("4711", "/hall/cell2", "KR 16 class 4711 (/hall/cell2)"),
    ],
)
def test_two_robots_of_a_type_have_different_hardware_ids(
    bench, tmp_path, serial, namespace, expected
):
    model = load("kr16")
    robot = model.robot.model_copy(update={"serial": serial})
    save(model.model_copy(update={"robot": robot}), tmp_path / "robot.yaml")
    path = str(tmp_path / "robot.yaml")
    bench.add(partial(TorqueMonitor, namespace=namespace), model=path)
    name = f"{namespace}/torque_monitor: node".lstrip("/")
    assert bench.diagnosed().wait(name, "all is well").hardware_id == expected


@pytest.mark.parametrize("monitor", MONITORS)
def test_a_constructor_opens_nothing(bench, monitor):
    """Threads, files, publishers and services come with configure."""
    before = set(threading.enumerate())  # some of earlier tests may just be ending
    node = bench.add(monitor, model="kr16", autostart=False)
    assert set(threading.enumerate()) <= before
    assert not list(Path(os.environ["ROS_HOME"]).rglob("*"))
    kept = {service.srv_name for service in node.services}
    node.trigger_configure()
    node.trigger_cleanup()
    assert {service.srv_name for service in node.services} == kept


class Broken(EnergyMonitor):
    """A monitor with a defect in one of its steps."""

    defect = True

    def set_up(self) -> None:
        super().set_up()
        if self.defect:
            raise ZeroDivisionError("a defect")


def test_a_defect_is_logged_and_leaves_nothing_behind(bench, capfd):
    node = bench.add(Broken, model="kr16", autostart=False)
    size = len(EntitySnapshot(node))
    assert node.trigger_configure() == ERROR
    assert node.state == "unconfigured"
    assert "ZeroDivisionError: a defect" in capfd.readouterr().err
    assert len(EntitySnapshot(node)) == size
    node.defect = False
    assert node.trigger_configure() == node.trigger_activate() == SUCCESS


def test_a_defect_ends_a_node_that_starts_itself(bench):
    with pytest.raises(ZeroDivisionError):
        bench.add(Broken, model="kr16")


def memory() -> int:
    """Resident memory of this process. [bytes]"""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.long
def test_a_hundred_lives_leave_nothing_behind(bench, messages):
    node = bench.add(EnergyMonitor, model="kr16", publish_torque=True)
    node.trigger_deactivate()
    node.trigger_cleanup()
    bare = (
        len(EntitySnapshot(node)),
        len(list(node.waitables)),
        len(node.default_callback_group.entities),
    )
    sizes = []
    for number in range(25):  # four transitions each
        for transition in (
            node.trigger_configure,
            node.trigger_activate,
            node.trigger_deactivate,
            node.trigger_cleanup,
        ):
            assert transition() == SUCCESS
            bench.executor.spin_once(timeout_sec=0)
        assert len(EntitySnapshot(node)) == bare[0]
        assert len(list(node.waitables)) == bare[1]
        gc.collect()  # entities of earlier lives, which only circles still hold
        left = len(node.default_callback_group.entities) - bare[2]
        assert left <= 31  # of the last life, which the executor may still hold
        if number in (9, 24):
            sizes.append((memory(), len(os.listdir("/proc/self/fd"))))
    assert sizes[1][0] - sizes[0][0] < 4e6, sizes
    assert sizes[1][1] == sizes[0][1]
    node.trigger_configure()
    node.trigger_activate()
    publisher = bench.publisher(JointState, "joint_states")
    feed(bench, node, publisher, messages["/joint_states"][:100])
    assert node.ingest.rejections.accepted == 100


def test_totals_survive_many_pauses(bench, messages):
    node = bench.add(EnergyMonitor, model="kr16")
    publisher = bench.publisher(JointState, "joint_states")
    rows = messages["/joint_states"]
    last = 0.0
    for number in range(15):
        feed(bench, node, publisher, rows[number * 10 : number * 10 + 5])
        node.trigger_deactivate()
        total = node.account.registers.cabinet("grid_import")
        assert total > last
        last = total
        feed(bench, node, publisher, rows[number * 10 + 5 : number * 10 + 10])
        node.trigger_activate()
    account, time = node.ingest.rejections, node.account.registers.time
    assert (account.received, account.accepted, account.rejected["inactive"]) == (150, 75, 75)
    assert time.observed_ns == sum(span(rows[start : start + 5]) for start in range(0, 150, 10))
    assert time.gap_count == 14
    assert time.end_ns - time.start_ns == time.observed_ns + time.gap_ns
