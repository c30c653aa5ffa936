# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Loads outside of the cabinet, live: equal to a replay, kept over a kill, sane on nonsense."""

from __future__ import annotations

import math

import pytest
from ros2_energy_msgs.msg import (
    EnergyRegisters,
    LoadPower,
    MotorTemperatures,
    PowerReading,
    PowerState,
)
from ros2_energy_msgs.srv import CloseInterval, OpenInterval
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import UInt8

from robot_energy.bag import BagReader, BagWriter
from robot_energy.bag.cdr import Encoder, stamp_columns
from robot_energy.inputs.inputs_file import read_inputs
from robot_energy.model import load, save
from robot_energy.model.auxiliary import AuxiliaryLoad
from robot_energy.pipeline import Settings
from robot_energy.replay.bag_replay import replay
from robot_energy.replay.setup import ReplaySetup
from robot_energy.results.replay import replay_report
from robot_energy_rig.record import RigEncoder, auxiliary_loads
from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor
from ros2_energy_monitor.nodes.friction_monitor import FrictionMonitor
from ros2_energy_monitor.nodes.power_monitor import PowerMonitor
from ros2_energy_monitor.nodes.torque_monitor import TorqueMonitor

START_NS = 1_700_000_000 * 10**9  # of the recording
BURST = 300
PUMP, EXTRUDER = "/auxiliary/pump/power", "/auxiliary/extruder/power"
# Dated numbers of states: those without a header are dated when they arrive.
DATED = {
    "auxiliary_states": ["of_pump", "of_extruder"],
    **{
        f"of_{name}.{key}": value
        for name in ("pump", "extruder")
        for key, value in (
            ("load", name),
            ("topic", f"auxiliary/{name}/state"),
            ("type", "sensor_msgs/msg/Temperature"),
            ("value_path", "temperature"),
        )
    },
}


def figures(**powers):
    return {name: {"value": value, "tag": "assumed"} for name, value in powers.items()}


@pytest.fixture(scope="session")
def cell(tmp_path_factory):
    """A model file: pump with a meter, extruder by its state, a panel."""
    loads = [
        {"name": "pump", "states": figures(off=12.0, on=800.0), "metered": True},
        {
            "name": "extruder",
            "states": figures(off=5.0, heats=400.0, works=180.0),
            "state": "off",
        },
        {"name": "panel", "states": figures(on=35.0)},
    ]
    path = tmp_path_factory.mktemp("cell") / "cell.yaml"
    entries = tuple(AuxiliaryLoad.model_validate(one) for one in loads)
    save(load("kr16").changed(auxiliary=entries), path)
    return str(path)


@pytest.fixture(scope="session")
def printing(recording, tmp_path_factory):
    """The recording of the rig with pump and extruder, whose states are dated."""
    path = tmp_path_factory.mktemp("bags") / "printing"
    reader, encoder = BagReader(recording), RigEncoder(("joint",))
    state = Encoder("sensor_msgs/msg/Temperature", {"variance": 0.0})
    with BagWriter(path) as bag:
        for topic, info in reader.topics.items():
            bag.add_topic(topic, info.msgtype)
        for part in reader.parts(list(reader.topics)):
            for topic, batch in part.items():
                rows = [batch.row(i) for i in range(len(batch))]
                bag.write(topic, batch.log_time_ns, rows)
        for name, done in auxiliary_loads(START_NS, 8.0, 3).items():
            topics = f"/auxiliary/{name}/power", f"/auxiliary/{name}/state"
            bag.add_topic(topics[0], "ros2_energy_msgs/msg/PowerReading")
            bag.add_topic(topics[1], "sensor_msgs/msg/Temperature")
            bag.write(topics[0], done.readings.stamp_ns, encoder.meter(done.readings))
            columns = {**stamp_columns(done.changed_ns), "temperature": done.state.astype(float)}
            bag.write(topics[1], done.changed_ns, state.encode(columns, len(done.state)))
    return path


@pytest.fixture
def offline(printing, cell, tmp_path, read_bag):
    file = tmp_path / "inputs.yaml"
    lines = [f"    {key}: {value}" for key, value in DATED.items()]
    file.write_text("/**:\n  ros__parameters:\n" + "\n".join(lines).replace("'", "") + "\n")
    inputs, _ = read_inputs(file)
    settings = Settings(power_period=0.04)
    result = replay(
        printing, load(cell), ReplaySetup(settings=settings, out=tmp_path / "out", inputs=inputs)
    )
    return result, read_bag(tmp_path / "out"), read_bag(printing)


class Listener:
    """Rows of both topics."""

    def __init__(self, bench):
        self._inboxes = {
            "/energy/power": bench.inbox(PowerState, "energy/power"),
            "/energy/registers": bench.inbox(EnergyRegisters, "energy/registers"),
        }
        self.rows = {name: [] for name in self._inboxes}

    def take(self):
        for name, inbox in self._inboxes.items():
            batch = inbox.drain()
            if batch is not None:
                self.rows[name] += [batch.row(i) for i in range(len(batch))]


def publish(bench, messages, slow_taken, states_taken):
    kinds = {
        "/motor_temperatures": MotorTemperatures,
        "/power_meter": PowerReading,
        PUMP: PowerReading,
        "/auxiliary/pump/state": Temperature,
        "/auxiliary/extruder/state": Temperature,
    }
    for topic, kind in kinds.items():
        publisher = bench.publisher(kind, topic.lstrip("/"))
        for message in messages[topic]:
            publisher.publish(message)
    bench.spin_until(slow_taken, "all but joint states")
    states, rows = bench.publisher(JointState, "joint_states"), messages["/joint_states"]
    for start in range(0, len(rows), BURST):
        for message in rows[start : start + BURST]:
            states.publish(message)
        sent = min(start + BURST, len(rows))
        bench.spin_until(lambda sent=sent: states_taken() >= sent, f"{sent} joint states")


def received(node, messages):
    """Whether all messages of the loads have arrived."""
    return all(
        inbox.received == len(messages[inbox.topic])
        for one in node._loads.loads
        for inbox in one.inboxes
    )


def decoded(kind, row):
    """The message of a row."""
    from rclpy.serialization import deserialize_message

    return deserialize_message(row, kind)


def balance(registers: EnergyRegisters) -> None:
    """The outlet is what cabinet and loads drew; all time is known or missing."""
    parts = registers.outlet_cabinet_energy + sum(one.outlet_energy for one in registers.auxiliary)
    assert registers.outlet_energy == pytest.approx(parts, abs=1e-9)
    for one in registers.auxiliary:
        assert one.known_time + one.missing_time <= registers.observed_time + 1e-9
        states = [each for each in registers.auxiliary_states if each.load == one.name]
        assert sum(each.energy for each in states) <= one.energy + 1e-5


def test_energy_monitor_equals_replay_to_the_bit(bench, offline, cell):
    result, expected, messages = offline
    node = bench.add(EnergyMonitor, model=cell, state_folder="", **DATED)
    listener = Listener(bench)
    publish(
        bench,
        messages,
        lambda: (
            received(node, messages)
            and node.temperatures[0].received == len(messages["/motor_temperatures"])
            and node.readings[0].received == len(messages["/power_meter"])
        ),
        lambda: node.joint_states.received,
    )
    node.close()
    bench.spin_until(
        lambda: (
            listener.take()
            or expected["/energy/registers"][-1] in listener.rows["/energy/registers"]
        ),
        "the last registers",
    )
    bench.spin_until(
        lambda: (
            listener.take() or len(listener.rows["/energy/power"]) >= len(expected["/energy/power"])
        ),
        "all power states",
    )
    live = [decoded(PowerState, row) for row in listener.rows["/energy/power"]]
    offline_states = [decoded(PowerState, row) for row in expected["/energy/power"]]
    assert [str(one.auxiliary) for one in live] == [str(one.auxiliary) for one in offline_states]
    last = decoded(EnergyRegisters, listener.rows["/energy/registers"][-1])
    balance(last)
    report = replay_report(result).auxiliary
    for live_load, load_report in zip(last.auxiliary, report.loads, strict=True):
        assert live_load.energy == load_report.known_energy
        assert live_load.known_time + live_load.missing_time == pytest.approx(
            last.observed_time, abs=1e-9
        )
    assert last.outlet_time > 5.0
    truth = auxiliary_loads(START_NS, 8.0, 3)["extruder"]
    seen = [one.auxiliary[1].state for one in live]
    assert set(seen) == set(truth.state.tolist())
    for one in live[-20:]:
        parts = one.predicted_grid_power + sum(load.power for load in one.auxiliary)
        assert one.outlet_power == pytest.approx(parts, rel=1e-12)


def test_three_nodes_count_them_as_one_node_does(bench, offline, cell):
    _, expected, messages = offline
    torque, friction = bench.add(TorqueMonitor, model=cell), bench.add(FrictionMonitor, model=cell)
    power = bench.add(PowerMonitor, model=cell, state_folder="", **DATED)
    listener = Listener(bench)
    publish(
        bench,
        messages,
        lambda: (
            received(power, messages)
            and power.frictions.received == 1 + len(messages["/motor_temperatures"])
            and power.readings[0].received == len(messages["/power_meter"])
        ),
        lambda: torque.joint_states.received,
    )
    torque.close()
    accepted = torque.ingest.rejections.accepted
    bench.spin_until(lambda: power.torques.received == accepted, "all torques")
    friction.close()
    power.close()
    bench.spin_until(
        lambda: (
            listener.take()
            or expected["/energy/registers"][-1] in listener.rows["/energy/registers"]
        ),
        "the last registers",
    )


class Player:
    """Plays the recording, with loads as a test wishes."""

    def __init__(self, bench, messages):
        self.bench, self._rows, self._sent = bench, messages["/joint_states"], 0
        self._states = bench.publisher(JointState, "joint_states")
        self.pump = bench.publisher(PowerReading, PUMP.lstrip("/"))
        self.state = bench.publisher(Temperature, "auxiliary/extruder/state")

    def until(self, node, seconds):
        """Publish joint states up to a time of the recording, and wait for them."""
        sent = min(round(250 * seconds), len(self._rows))
        while self._sent < sent:
            stop = min(self._sent + BURST, sent)
            for row in self._rows[self._sent : stop]:
                self._states.publish(row)
            before = node.joint_states.received + stop - self._sent
            self.bench.spin_until(lambda n=before: node.joint_states.received >= n, "joint states")
            self._sent = stop

    def read(self, node, seconds, power):
        """Let the meter of the pump say a power, the mean of the second before."""
        message = PowerReading(
            meaning=PowerReading.MEANING_MEAN_OVER_INTERVAL,
            location=PowerReading.LOCATION_GRID,
            power=power,
            energy=math.nan,
            interval=1.0,
        )
        self._send(node, self.pump, message, seconds, node._loads.loads[0].meters[0])

    def say(self, node, seconds, number):
        """Let the extruder say the number of its state."""
        message = Temperature(temperature=number)
        self._send(node, self.state, message, seconds, node._loads.loads[1].states[0])

    def _send(self, node, publisher, message, seconds, inbox):
        stamp = START_NS + round(seconds * 1e9)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        before = inbox.received
        publisher.publish(message)
        self.bench.spin_until(lambda: inbox.received > before, inbox.topic)


def test_nonsense_is_unknown_flagged_and_counted(bench, messages, cell):
    node = bench.add(EnergyMonitor, model=cell, state_folder="", **DATED)
    latest, diagnosed = bench.latest(PowerState, "energy/power"), bench.diagnosed()
    play = Player(bench, messages)
    play.until(node, 0.5)
    bench.spin_until(lambda: latest() and latest().auxiliary[0].remarks, "a first power state")
    pump, extruder, panel = latest().auxiliary
    unsaid = LoadPower.STATE_UNKNOWN  # of the pump, whose meter says its power all the same
    assert pump.remarks == LoadPower.METER_MISSING | unsaid
    assert extruder.remarks == LoadPower.STATE_ASSUMED
    assert math.isnan(pump.power)
    assert math.isnan(latest().outlet_power)
    assert (extruder.power, panel.power) == (5.0, 35.0)  # the state of the model file
    play.read(node, 0.5, 700.0)
    play.say(node, 0.6, 2.0)
    play.until(node, 1.2)
    bench.spin_until(lambda: latest().auxiliary[1].state == 2, "the state of the extruder")
    pump, extruder, _ = latest().auxiliary
    assert (pump.power, pump.remarks, extruder.remarks) == (700.0, unsaid, 0)
    assert extruder.power == extruder.model_power == 180.0
    assert latest().outlet_power == pytest.approx(latest().predicted_grid_power + 915.0)
    play.read(node, 1.2, math.nan)
    play.say(node, 1.2, 250.0)
    play.until(node, 1.8)
    bench.spin_until(lambda: latest().auxiliary[1].state < 0, "an unknown state")
    pump, extruder, _ = latest().auxiliary
    assert pump.remarks == LoadPower.METER_REFUSED | unsaid
    assert extruder.remarks == LoadPower.STATE_UNKNOWN
    assert all(math.isnan(one.power) for one in (pump, extruder))
    status = diagnosed.wait("energy_monitor: auxiliary loads", "the state of extruder is not known")
    values = diagnosed.values(status)
    assert values["extruder.state_unknown_numbers"] == 1
    assert values["pump.meter_readings_rejected.meter_not_finite"] == 1
    assert "is refused" in status.message
    node.close()  # what waits for the meter is missing now
    totals = node.account.totals()
    for one in totals.auxiliary.values():
        assert one.known_ns + one.missing_ns == totals.observed_ns
    assert totals.auxiliary["pump"].missing_ns > 0
    assert totals.auxiliary["extruder"].missing_ns > 0


def test_registers_and_intervals_go_on_after_a_restart(bench, messages, cell, tmp_path):
    folder = str(tmp_path / "state")
    node = bench.add(EnergyMonitor, model=cell, state_folder=folder, checkpoint_period=0.1, **DATED)
    latest = bench.latest(EnergyRegisters, "energy/registers")
    play = Player(bench, messages)
    play.read(node, 0.0, 100.0)
    for second in (1, 2, 3):
        play.read(node, float(second), 700.0)
    play.until(node, 1.5)
    opened = bench.tester.create_client(OpenInterval, "energy_monitor/open_interval")
    bench.spin_until(opened.service_is_ready, "the service")
    answer = opened.call_async(OpenInterval.Request(name="print"))
    bench.spin_until(answer.done, "an open interval")
    assert answer.result().success
    play.until(node, 2.9)
    bench.spin_until(
        lambda: latest() and latest().persisted and latest().auxiliary[0].known_time > 1.4,
        "registers on disk",
    )
    before = latest()
    balance(before)
    bench.remove(node)  # nothing is flushed, as by a kill
    again = bench.add(
        EnergyMonitor, model=cell, state_folder=folder, checkpoint_period=0.1, **DATED
    )
    totals = again.account.totals()
    for published, entry in zip(before.auxiliary, totals.auxiliary.values(), strict=True):
        assert entry.energy_microjoule * 1e-6 >= published.energy
        assert entry.known_ns + entry.missing_ns == totals.observed_ns
    play.read(again, 4.0, 700.0)
    play.read(again, 5.0, 700.0)
    play.until(again, 6.0)
    bench.spin_until(lambda: latest().observed_time > 4.0, "registers that go on")
    closed = bench.tester.create_client(CloseInterval, "energy_monitor/close_interval")
    bench.spin_until(closed.service_is_ready, "the service")
    answer = closed.call_async(CloseInterval.Request(name="print"))
    bench.spin_until(answer.done, "a closed interval")
    interval = answer.result().interval
    assert [one.name for one in interval.auxiliary] == ["pump", "extruder", "panel"]
    assert interval.auxiliary[2].energy == pytest.approx(35.0 * interval.auxiliary[2].known_time)
    parts = interval.outlet_cabinet_energy + sum(one.outlet_energy for one in interval.auxiliary)
    assert interval.outlet_energy == pytest.approx(parts, abs=1e-9)
    assert interval.auxiliary[0].energy > 0
    balance(latest())


def test_states_without_a_header_are_dated_when_they_arrive(bench, messages, cell):
    """A PLC that sends bare numbers; the robot's stamps are those of today."""
    node = bench.add(EnergyMonitor, model=cell, state_folder="")
    latest = bench.latest(PowerState, "energy/power")
    state = bench.publisher(UInt8, "auxiliary/extruder/state")
    state.publish(UInt8(data=1))
    bench.spin_until(lambda: node._loads.loads[1].states[0].received, "a state")
    states = bench.publisher(JointState, "joint_states")
    first = JointState(name=[f"joint_a{axis}" for axis in range(1, 7)], position=[0.0] * 6)

    def stand():
        first.header.stamp = bench.tester.get_clock().now().to_msg()
        states.publish(first)
        bench.executor.spin_once(timeout_sec=0.01)
        return latest() and latest().auxiliary[1].state == 1

    bench.spin_until(stand, "the state of the extruder")
    assert latest().auxiliary[1].power == 400.0
