# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Each monitor alone, in process: what it publishes and what it says about itself."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.serialization import deserialize_message
from ros2_energy_msgs.msg import (
    EnergyRegisters,
    JointFriction,
    JointTorque,
    MotorTemperatures,
    PowerReading,
    PowerState,
)
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import Float64

import robot_energy
from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.record import Identity
from robot_energy.foundation.errors import ModelFileError, ParameterError
from robot_energy.inputs.meter.meter import MeterIngest
from robot_energy.timeline.blocks import Quality
from ros2_energy_monitor.base.parameters import parameter_lines
from ros2_energy_monitor.base.publishers import latched
from ros2_energy_monitor.diagnostics.energy import energy_source
from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor
from ros2_energy_monitor.nodes.friction_monitor import FrictionMonitor
from ros2_energy_monitor.nodes.power_monitor import PowerMonitor
from ros2_energy_monitor.nodes.torque_monitor import TorqueMonitor

MODELS = Path(robot_energy.__file__).parent / "models"
JOINTS = [f"joint_a{axis}" for axis in range(1, 7)]
MONITORS = [TorqueMonitor, FrictionMonitor, PowerMonitor, EnergyMonitor]


def joint_state(second: int, names=JOINTS) -> JointState:
    message = JointState(name=list(names), position=[0.0] * len(names))
    message.header.stamp.sec = second
    return message


def temperatures(second: int, degc: float = 30.0) -> MotorTemperatures:
    message = MotorTemperatures(joint_names=JOINTS, temperature_degc=[degc] * 6)
    message.header.stamp.sec = second
    return message


@pytest.mark.parametrize("monitor", MONITORS)
def test_unknown_model_is_refused(bench, monitor):
    with pytest.raises(ModelFileError, match="the model file 'kr17' cannot be read"):
        bench.add(monitor, model="kr17")


@pytest.mark.parametrize("monitor", [TorqueMonitor, EnergyMonitor])
def test_the_log_says_what_is_modelled(bench, monitor, capfd):
    node = bench.add(monitor, model="kr16")
    output = capfd.readouterr().err
    assert f"models {', '.join(JOINTS)}\n" in output
    assert "tick_rate" not in output  # at DEBUG only, one line for each group
    lines = parameter_lines(node)
    assert any("tick_rate 25.0" in line for line in lines)
    assert max(map(len, lines)) < 1000


def test_a_missing_friction_monitor_is_said(bench):
    bench.add(PowerMonitor, model="kr16", state_folder="")
    diagnosed = bench.diagnosed()
    sentence = "no joint friction has arrived on /energy/joint_friction, which has no publisher"
    diagnosed.wait("power_monitor: energy", sentence)
    bench.add(FrictionMonitor, model="kr16")

    def arrived() -> bool:
        return sentence[:30] not in diagnosed["power_monitor: energy"].message

    bench.spin_until(arrived, "friction of before any temperature")


@pytest.mark.parametrize(
    ("topic", "words"),
    [
        (
            "joint_states",
            "topic '/joint_states' cannot be read as MotorTemperatures: another input reads it as "
            "JointState; expected a",
        ),
        ("motors of the arm", "'motors of the arm' cannot be the name of a topic; expected le"),
    ],
)
def test_a_topic_that_cannot_be_subscribed_is_named(bench, topic, words):
    with pytest.raises(ParameterError, match=words):
        bench.add(EnergyMonitor, model="kr16", state_folder="", **{"motors.topic": topic})


def test_friction_of_another_model_or_of_a_node_that_has_ended_is_said(bench, tmp_path):
    """Friction is published when it changes: what is wrong is said until other friction comes."""
    other = tmp_path / "kr16.yaml"
    text = (MODELS / "kr16.yaml").read_text().replace("path: kr16", f"path: {MODELS}/kr16")
    other.write_text(text.replace("fallback_degc: 22", "fallback_degc: 23"))
    power = bench.add(PowerMonitor, model="kr16", state_folder="")
    diagnosed, name = bench.diagnosed(), "power_monitor: energy"
    friction = bench.add(FrictionMonitor, model=str(other))
    bench.spin_until(lambda: power.frictions.received, "friction of the other model")
    for _ in range(3):
        status = diagnosed.wait_anew(name, "messages on /energy/joint_friction rejected")
        assert "give all monitors the same model file: all 1 messages" in status.message
    assert "and none since, most as other_model" in status.message
    assert "give all monitors the same model file" in diagnosed.values(status).values()
    bench.remove(friction)
    friction = bench.add(FrictionMonitor, model="kr16")
    bench.spin_until(lambda: "friction" not in diagnosed[name].message, "friction of the model")
    bench.remove(friction)
    ended = "start friction_monitor: /energy/joint_friction has no publisher any more"
    diagnosed.wait(name, ended)


def test_a_power_that_is_not_known_is_said_while_it_is_so(bench, messages):
    """The warning about a joint state alone between two gaps ends."""
    node = bench.add(EnergyMonitor, model="kr16", state_folder="")
    diagnosed, name = bench.diagnosed(), "energy_monitor: energy"
    publisher = bench.publisher(JointState, "joint_states")
    states = messages["/joint_states"]
    for message in (*states[:100], states[200], *states[300:400]):
        publisher.publish(message)
    diagnosed.wait(name, "the power of some joint states of the last second is not known")
    diagnosed.wait_anew(name, "no publisher on /power_meter")
    assert "not known" not in diagnosed[name].message
    assert node.account.counts.quality[Quality.NOT_FINITE] == 1


def test_powers_of_another_account_are_not_those_of_the_last_second():
    """A recording that is played begins and ends, and registers are read late."""
    account = EnergyAccount(6)
    findings = energy_source(account, [], MeterIngest(), 1.0)
    account.counts.quality[Quality.NOT_FINITE] += 1
    assert "not known" in findings().message
    record = account.state(
        Identity(robot_type="arm", robot_serial="7", joint_names=tuple(JOINTS), model_id="m1")
    )
    for change in (
        account.begin,
        partial(account.resume, record),
        partial(account.precede, record),
    ):
        change()
        assert "not known" not in findings().message
    account.counts.quality[Quality.NOT_FINITE] += 1
    assert "not known" in findings().message


@pytest.mark.parametrize("before", [0, 50])
def test_names_with_a_prefix_are_said_with_the_line_that_fits(bench, messages, before):
    """From the start, or from a restart of the driver on."""
    bench.add(TorqueMonitor, model="kr16")
    diagnosed, name = bench.diagnosed(), "torque_monitor: joint states"
    publisher = bench.publisher(JointState, "joint_states")
    for message in messages["/joint_states"][:before]:
        publisher.publish(message)
    diagnosed.wait_anew(name, "no joint state")
    for message in messages["/joint_states"][before:100]:
        state = deserialize_message(message, JointState)
        state.name = [f"left/{name}" for name in JOINTS]
        publisher.publish(state)
    names = ", ".join(f"left/{name}" for name in JOINTS)
    diagnosed.wait(name, f"set joint_states.joint_names to [{names}]: ")


def test_a_driver_that_stops_next_to_a_gripper_is_to_be_started(bench, messages):
    """Messages of a gripper go on; the names of the arm were right."""
    node = bench.add(TorqueMonitor, model="kr16")
    diagnosed, name = bench.diagnosed(), "torque_monitor: joint states"
    publisher = bench.publisher(JointState, "joint_states")
    gripper = JointState(name=["gripper"], position=[0.0])
    for message in messages["/joint_states"][:50]:
        publisher.publish(message)
        publisher.publish(gripper)
    bench.spin_until(lambda: node.joint_states.received == 100, "all of them")
    diagnosed.wait_anew(name, "no joint state for")
    publisher.publish(gripper)
    words = "start the driver or set joint_states.topics: all 1 messages on /joint_states rejected"
    assert "joint_names" not in diagnosed.wait(name, words).message


@pytest.mark.parametrize("gone", [0, 5])  # the first one leads where messages lack some
def test_a_joint_that_no_message_has_any_more_is_named(bench, messages, gone):
    bench.add(TorqueMonitor, model="kr16", input_timeout=0.3)
    diagnosed, name = bench.diagnosed(), "torque_monitor: joint states"
    publisher = bench.publisher(JointState, "joint_states")
    for message in messages["/joint_states"][:50]:
        publisher.publish(message)
    diagnosed.wait_anew(name, "no joint state for")
    for message in messages["/joint_states"][50:150]:
        state = deserialize_message(message, JointState)
        for values in (state.name, state.position, state.velocity):
            del values[gone]
        publisher.publish(state)
    words = "start its driver or name the topics of all joints in joint_states.topics: no joint_a"
    status = diagnosed.wait(name, f"{words}{gone + 1} for ")
    assert status.level == DiagnosticStatus.ERROR
    for message in messages["/joint_states"][150:200]:
        publisher.publish(message)
    diagnosed.wait_anew(name, "no joint state for")
    assert words not in diagnosed[name].message


def test_stamps_that_become_zero_are_said_with_the_setting(bench, messages):
    bench.add(EnergyMonitor, model="kr16", state_folder="")
    diagnosed = bench.diagnosed()
    states = bench.publisher(JointState, "joint_states")
    for message in messages["/joint_states"][:50]:
        states.publish(message)
    diagnosed.wait_anew("energy_monitor: joint states", "no joint state for")
    states.publish(joint_state(0))
    bench.publisher(PowerReading, "power_meter").publish(PowerReading())
    for name, group in (("joint states", "joint_states"), ("energy", "meter")):
        setting = f"let the driver set the stamp, or set {group}.stamp_source to receive: all 1 mes"
        diagnosed.wait(f"energy_monitor: {name}", setting)
    states.publish(joint_state(1_700_000_100, [*JOINTS, JOINTS[0]]))  # as of a bag
    diagnosed.wait("energy_monitor: joint states", "let the driver name each joint once: all 1 mes")


def test_receive_times_of_zero_need_a_clock(bench):
    """Messages without a stamp, in simulated time that has not begun."""
    sources = {"meter.topic": "p", "meter.type": "std_msgs/msg/Float64", "meter.unit": "W",
               "meter.meaning": "instantaneous", "meter.location": "grid",
               "motors.stamp_source": "receive"}  # fmt: skip
    bench.add(EnergyMonitor, model="kr16", state_folder="", use_sim_time=True, **sources)
    diagnosed = bench.diagnosed()
    remedy = "start the source of /clock, or set use_sim_time to false"
    bench.publisher(Float64, "p").publish(Float64(data=100.0))
    diagnosed.wait("energy_monitor: energy", f"{remedy}: all 1 messages on /p rejected")
    bench.publisher(MotorTemperatures, "motor_temperatures").publish(temperatures(1))
    words = f"{remedy}: every message on /motor_temperatures is rejected as zero_stamp"
    diagnosed.wait("energy_monitor: motor temperatures", words)


READINGS = {"location": PowerReading.LOCATION_GRID, "meaning": PowerReading.MEANING_INSTANTANEOUS}
OTHERS = {"location": PowerReading.LOCATION_DC_BUS, "meaning": PowerReading.MEANING_INSTANTANEOUS}


@pytest.mark.parametrize(
    ("readings", "remedy", "reason"),
    [
        (
            [{"meaning": 1}],
            "let the publisher set location to 1 (grid) or 2 (DC bus)",
            "unknown_location",
        ),
        (
            [{"location": 1}],
            "let the publisher set meaning to 1, 2 or 3, as PowerReading says",
            "unknown_meaning",
        ),
        (
            [READINGS, OTHERS],
            "where its meaning or place has changed, restart the monitor",
            "changed_meaning",
        ),
    ],
)
def test_readings_that_are_all_rejected_are_said_with_what_to_do(bench, readings, remedy, reason):
    bench.add(PowerMonitor, model="kr16", state_folder="")
    diagnosed, name = bench.diagnosed(), "power_monitor: energy"
    publisher = bench.publisher(PowerReading, "power_meter")
    for second, fields in enumerate(readings, 1):
        message = PowerReading(power=100.0, **fields)
        message.header.stamp.sec = second
        publisher.publish(message)
        status = diagnosed.wait_anew(name, "no joint torque")
    assert f"{remedy}: all 1 messages on /power_meter rejected" in status.message
    assert f"most as {reason}" in status.message


def test_a_slow_meter_is_not_called_silent_between_its_readings(bench):
    bench.add(PowerMonitor, model="kr16", state_folder="", meter_max_gap=0.1)
    diagnosed, name = bench.diagnosed(), "power_monitor: energy"
    publisher = bench.publisher(PowerReading, "power_meter")
    for second in (60, 120, 180):  # means over a minute
        message = PowerReading(power=100.0, interval=60.0, location=1, meaning=2)
        message.header.stamp.sec = second
        publisher.publish(message)
    diagnosed.wait(name, "no joint torque")
    bench.spin_until(
        lambda: diagnosed.values(diagnosed[name])["meter_input_age_s"] > 0.5, "a report on them"
    )
    assert "no meter reading for" not in diagnosed[name].message


def test_temperatures_of_other_joints_are_said_with_the_setting(bench):
    bench.add(FrictionMonitor, model="kr16")
    message = temperatures(1)
    message.joint_names = [f"axis_{number}" for number in range(6)]
    bench.publisher(MotorTemperatures, "motor_temperatures").publish(message)
    words = "set joints and names of the source: every message on /motor_temperatures is rejected"
    bench.diagnosed().wait("friction_monitor: motor temperatures", words)


def test_a_remark_is_logged_once(bench, capfd):
    bench.add(TorqueMonitor, model="kr16")
    diagnosed = bench.diagnosed()
    publisher = bench.publisher(JointState, "joint_states")
    publisher.publish(JointState(name=["gripper", "lift"], position=[0.0, 0.0]))
    name = "torque_monitor: joint states"

    def ignored() -> float:
        return diagnosed.values(diagnosed[name])["joints_ignored"]

    diagnosed.wait(name, "lack joint_a1")
    bench.spin_until(lambda: ignored() == 2, "a report on two joints")
    first = diagnosed[name]
    bench.spin_until(lambda: diagnosed[name] is not first, "another report")
    output = capfd.readouterr().err
    for stranger in ("gripper", "lift"):
        assert output.count(f"also names '{stranger}', which the model does not know") == 1


def test_torque_monitor_publishes_one_torque_per_state(bench, messages):
    node = bench.add(TorqueMonitor, model="kr16")
    torques = bench.inbox(JointTorque, "energy/joint_torque")
    publisher = bench.publisher(JointState, "joint_states")
    for message in messages["/joint_states"][:300]:
        publisher.publish(message)
    bench.spin_until(lambda: node.joint_states.received == 300, "joint states")
    node.close()
    taken = 0

    def all_taken() -> bool:
        nonlocal taken
        taken += len(torques.drain() or ())
        return taken >= 300

    bench.spin_until(all_taken, "torques")
    assert taken == node.ingest.rejections.accepted == 300


def test_friction_reaches_those_who_come_late(bench):
    bench.add(FrictionMonitor, model="kr16")
    publisher = bench.publisher(MotorTemperatures, "motor_temperatures")
    early = bench.latest(JointFriction, "energy/joint_friction")
    publisher.publish(temperatures(5, 40.0))
    bench.spin_until(lambda: early() and early().header.stamp.sec == 5, "friction at 40 degC")
    received: list[JointFriction] = []
    bench.tester.create_subscription(
        JointFriction, "energy/joint_friction", lambda m: received.append(m), latched(100)
    )
    bench.spin_until(lambda: len(received) >= 2, "friction from before")
    initial, warm = received
    assert initial.header.stamp.sec == 0
    assert initial.quality & Quality.TEMPERATURE_MISSING
    assert list(initial.temperature_source) == [JointFriction.SOURCE_FALLBACK] * 6
    assert list(warm.motor_temperature_degc) == [40.0] * 6
    assert list(warm.temperature_source) == [JointFriction.SOURCE_MEASURED] * 6
    assert all(np.less(warm.viscous, initial.viscous))  # initial: at 22 degC


def test_single_temperatures_of_several_topics(bench):
    node = bench.add(
        FrictionMonitor,
        model="kr16",
        temperature_sources=["one", "two"],
        **{
            "one.topic": "one",
            "one.type": "sensor_msgs/msg/Temperature",
            "two.topic": "two",
            "two.type": "sensor_msgs/msg/Temperature",
        },
    )
    latest = bench.latest(JointFriction, "energy/joint_friction")
    for topic, joint, degc in (("one", "joint_a1", 31.0), ("two", "joint_a6", 36.0)):
        publisher = bench.publisher(Temperature, topic)
        message = Temperature(temperature=degc)
        message.header.frame_id = joint
        message.header.stamp.sec = 7
        publisher.publish(message)
    bench.spin_until(lambda: node.ingest.rejections.accepted == 2, "both temperatures")
    bench.spin_until(
        lambda: latest() and np.isfinite(latest().motor_temperature_degc).sum() == 2, "both"
    )
    assert latest().motor_temperature_degc[0] == 31.0
    assert latest().motor_temperature_degc[5] == 36.0


def test_energy_monitor_publishes_torque_only_if_asked(bench):
    silent = bench.add(EnergyMonitor, model="kr16")
    assert silent.count_publishers("energy/joint_torque") == 0
    bench.remove(silent)
    node = bench.add(EnergyMonitor, model="kr16", publish_torque=True)
    bench.spin_until(lambda: node.count_publishers("energy/joint_torque") == 1, "publisher")


def test_energy_monitor_reports_powers_and_registers(bench, messages):
    node = bench.add(EnergyMonitor, model="kr16", power_rate=12.5)
    power = bench.latest(PowerState, "energy/power")
    registers = bench.latest(EnergyRegisters, "energy/registers")
    slow = [
        (bench.publisher(MotorTemperatures, "motor_temperatures"), "/motor_temperatures"),
        (bench.publisher(PowerReading, "power_meter"), "/power_meter"),
    ]
    for publisher, topic in slow:
        for message in messages[topic]:
            publisher.publish(message)
    bench.spin_until(
        lambda: (
            node.readings[0].received == len(messages["/power_meter"])
            and node.temperatures[0].received == len(messages["/motor_temperatures"])
        ),
        "slow topics",
    )
    states = bench.publisher(JointState, "joint_states")
    for message in messages["/joint_states"][:750]:
        states.publish(message)
    bench.spin_until(lambda: registers() and registers().observed_time > 2.5, "registers")
    bench.spin_until(lambda: power() and np.isfinite(power().measured_power), "measured power")
    state = power()
    assert state.model_id == node.model.model_id
    assert state.period == pytest.approx(0.08, abs=0.01)
    assert [joint.name for joint in state.joints] == JOINTS
    assert np.isnan([state.drive_loss, state.capacitor_power]).all()  # kr16 has neither
    parts = (
        state.rigid_power + state.friction_power + state.loss_dc + state.loss_grid
        + state.brake_power
    )  # fmt: skip
    assert state.predicted_grid_power == pytest.approx(parts, rel=1e-9)
    found = registers()
    assert np.isnan(found.predicted_energy_at_meter)  # 3 s of motion with a lag that is not known
    assert found.measured_energy == pytest.approx(
        1e-6 * found.predicted_microjoule_at_meter, rel=0.15
    )


def test_restarted_torque_monitor_leaves_a_gap(bench, messages):
    power = bench.add(PowerMonitor, model="kr16")
    rows = messages["/joint_states"]
    total = 0
    for start in (0, 400):  # 0.8 s pass while the torque monitor is away
        torque = bench.add(TorqueMonitor, model="kr16")
        publisher = bench.publisher(JointState, "joint_states")
        for message in rows[start : start + 200]:
            publisher.publish(message)
        bench.spin_until(lambda node=torque: node.joint_states.received == 200, "states")
        torque.close()
        total += 200
        bench.spin_until(lambda wanted=total: power.torques.received == wanted, "torques")
        bench.tester.destroy_publisher(publisher)
        bench.remove(torque)
    power.close()
    time = power.account.registers.time
    assert time.gap_count == 1
    assert time.gap_ns == pytest.approx(0.804e9, rel=0.01)
    assert time.observed_ns == pytest.approx(2 * 0.796e9, rel=0.01)


def test_restarted_friction_monitor_does_not_forget(bench, messages):
    power = bench.add(PowerMonitor, model="kr16")
    for degc in (40.0, None):
        friction = bench.add(FrictionMonitor, model="kr16")
        if degc is not None:
            publisher = bench.publisher(MotorTemperatures, "motor_temperatures")
            publisher.publish(temperatures(1_699_999_999, degc))
            bench.spin_until(lambda: power.frictions.received == 2, "friction")
            bench.remove(friction)
    bench.spin_until(lambda: power.frictions.received == 3, "friction of the restarted node")
    torque = bench.add(TorqueMonitor, model="kr16")
    states = bench.publisher(JointState, "joint_states")
    latest = bench.latest(PowerState, "energy/power")
    for message in messages["/joint_states"][:200]:
        states.publish(message)
    bench.spin_until(lambda: torque.joint_states.received == 200, "joint states")
    bench.spin_until(latest, "power")
    assert [joint.motor_temperature_degc for joint in latest().joints] == [40.0] * 6
    assert not power.account.counts.quality[Quality.TEMPERATURE_MISSING]


def test_silence_is_diagnosed(bench):
    bench.add(TorqueMonitor, model="kr16", input_timeout=0.1)
    diagnosed = bench.diagnosed()
    name = "torque_monitor: joint states"
    status = diagnosed.wait(name, "no joint state has arrived on /joint_states, which has no")
    assert status.message.startswith("start the driver or set joint_states.topics: ")
    assert status.level == DiagnosticStatus.ERROR
    assert np.isnan(diagnosed.values(status)["input_age_s"])
    publisher = bench.publisher(JointState, "joint_states")
    for second in (1, 2):  # one state of zeros alone may be that of another publisher
        publisher.publish(joint_state(second))
    status = diagnosed.wait(name, "no joint state for ")
    assert status.level == DiagnosticStatus.STALE
    assert status.message.endswith("s on /joint_states")
    assert diagnosed.values(status)["accepted"] == 2


def test_missing_joint_is_named(bench):
    bench.add(TorqueMonitor, model="kr16")
    diagnosed = bench.diagnosed()
    publisher = bench.publisher(JointState, "joint_states")
    publisher.publish(joint_state(1, JOINTS[:5]))
    status = diagnosed.wait(
        "torque_monitor: joint states", "the joint names of /joint_states lack joint_a6"
    )
    assert status.level == DiagnosticStatus.ERROR
    assert diagnosed.values(status)["joints_missing"] == 1


def test_joints_of_two_topics_make_one_torque(bench, messages):
    """A limb on a topic of its own: every state of the first joint's topic gives a torque."""
    topics = ["arm/joint_states", "wrist/joint_states"]
    node = bench.add(TorqueMonitor, model="kr16", **{"joint_states.topics": topics})
    torques = bench.inbox(JointTorque, "energy/joint_torque")
    sent = {topic: bench.publisher(JointState, topic) for topic in topics}
    for whole in messages["/joint_states"][:100]:
        state = deserialize_message(whole, JointState)
        for topic, part in zip(topics, (slice(0, 3), slice(3, 6)), strict=True):
            some = JointState(header=state.header, name=state.name[part])
            some.position, some.velocity = state.position[part], state.velocity[part]
            sent[topic].publish(some)
    bench.spin_until(lambda: node.ingest.rejections.received == 200, "states of both topics")
    node.close()
    taken = 0

    def all_taken() -> bool:
        nonlocal taken
        taken += len(torques.drain() or ())
        return taken >= 100

    bench.spin_until(all_taken, "torques")
    assert taken == node.ingest.samples == 100
    assert node.ingest.rejections.accepted == 200


def test_rejected_messages_are_counted_by_reason(bench):
    bench.add(TorqueMonitor, model="kr16", input_timeout=60.0)
    diagnosed = bench.diagnosed()
    publisher = bench.publisher(JointState, "joint_states")
    for second in (1, 1, 1, 2):
        publisher.publish(joint_state(second))
    status = diagnosed.wait("torque_monitor: joint states", "2 of 4 messages on /joint_states")
    assert status.level == DiagnosticStatus.WARN
    assert "duplicate_stamp" in status.message
    values = diagnosed.values(status)
    assert values["received"] == values["accepted"] + values["rejected.duplicate_stamp"] == 4


def test_joint_states_that_are_all_rejected_are_an_error(bench):
    bench.add(TorqueMonitor, model="kr16", input_timeout=60.0)
    diagnosed = bench.diagnosed()
    publisher = bench.publisher(JointState, "joint_states")
    for _ in range(4):
        publisher.publish(joint_state(0))
    status = diagnosed.wait("torque_monitor: joint states", "all 4 messages on /joint_states")
    assert status.level == DiagnosticStatus.ERROR
    assert "zero_stamp" in status.message
    assert "set joint_states.stamp_source to receive" in status.message


def test_a_robot_without_thermometers_is_no_fault(bench):
    bench.add(FrictionMonitor, model="kr16", temperature_sources=[""])
    status = bench.diagnosed().wait("friction_monitor: motor temperatures", "friction is taken at")
    assert status.message == "temperature_sources is empty: friction is taken at 22 degC"
    assert status.level == DiagnosticStatus.OK


@pytest.mark.parametrize(
    ("count", "words"),
    [
        (6, "they are estimated from the losses"),
        (
            5,
            "they are estimated from the losses, and where the model has no network friction is "
            "taken at 22 degC",
        ),
    ],
)
def test_missing_temperatures_that_the_model_estimates_are_said_to_be(
    bench, tmp_path, count, words
):
    document = yaml.safe_load((MODELS / "kr16.yaml").read_text())
    document["urdf"]["path"] = str(MODELS / "kr16.urdf")
    figure = {"value": 10.0, "tag": "assumed"}
    for joint in document["joints"][:count]:
        joint["thermal"] = {"capacity": figure, "conductance": figure}
    (tmp_path / "own.yaml").write_text(json.dumps(document))
    bench.add(FrictionMonitor, model=str(tmp_path / "own.yaml"))
    status = bench.diagnosed().wait("friction_monitor: motor temperatures", "has arrived on")
    assert status.message.endswith(f"which has no publisher; {words}")


def test_missing_temperature_is_diagnosed_until_it_comes(bench):
    bench.add(FrictionMonitor, model="kr16")
    diagnosed = bench.diagnosed()
    name = "friction_monitor: motor temperatures"
    status = diagnosed.wait(name, "no motor temperature has arrived on /motor_temperatures")
    assert status.level == DiagnosticStatus.WARN
    assert "friction is taken at 22 degC" in status.message
    assert "temperature_sources to [] if there is none" in status.message
    publisher = bench.publisher(MotorTemperatures, "motor_temperatures")
    publisher.publish(temperatures(1))
    status = diagnosed.wait(name, "all is well")
    assert status.level == DiagnosticStatus.OK
    assert diagnosed.values(status)["motor_temperature_degc.joint_a6"] == 30.0
    publisher.publish(temperatures(30, 95.0))
    assert diagnosed.wait(name, "the motor of joint_a6 is at 95").level == DiagnosticStatus.WARN


def test_power_monitor_diagnoses_torque_and_meter(bench):
    bench.add(PowerMonitor, model="kr16", meter_max_gap=0.1)
    diagnosed = bench.diagnosed()
    name = "power_monitor: energy"
    status = diagnosed.wait(name, "no joint torque has arrived on /energy/joint_torque")
    assert status.level == DiagnosticStatus.ERROR
    assert {"coverage", "gaps", "residual_energy_j", "extrapolated_share", "learned_share"} <= set(
        diagnosed.values(status)
    )


def test_a_typing_error_in_the_topic_of_the_meter_shows(bench):
    """At level OK, since a robot without a meter is not a fault."""
    bench.add(EnergyMonitor, model="kr16", **{"meter.topic": "power_metre"})
    bench.publisher(PowerReading, "power_meter", subscribers=0)
    status = bench.diagnosed().wait(
        "energy_monitor: energy", "no publisher on /power_metre: prediction only"
    )
    assert status.level == DiagnosticStatus.OK


def test_silent_meter_is_diagnosed(bench, messages):
    bench.add(EnergyMonitor, model="kr16", meter_max_gap=0.1)
    diagnosed = bench.diagnosed()
    name = "energy_monitor: energy"
    note = "no publisher on /power_meter: prediction only"
    assert diagnosed.wait(name, note).level == DiagnosticStatus.OK
    publisher = bench.publisher(PowerReading, "power_meter")
    publisher.publish(messages["/power_meter"][0])
    assert diagnosed.wait(name, "no meter reading for").level == DiagnosticStatus.STALE
