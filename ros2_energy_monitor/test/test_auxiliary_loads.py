"""Loads outside of the cabinet, live: equal to a replay, kept over a kill, sane on nonsense."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
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
from robot_energy.bag_replay import replay
from robot_energy.cdr import Encoder, stamp_columns
from robot_energy.cdr.types import typestore
from robot_energy.inputs.inputs_file import read_inputs
from robot_energy.model import load, save
from robot_energy.model.auxiliary import AuxiliaryLoad
from robot_energy.pipeline import Settings
from robot_energy.results.replay import replay_report
from robot_energy.rig.auxiliary import auxiliary_loads
from robot_energy.rig.record import RigEncoder
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
    result = replay(printing, load(cell), settings=settings, out=tmp_path / "out", inputs=inputs)
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
        lambda: received(node, messages) and node.temperatures[0].received,
        lambda: node.joint_states.received,
    )
    node.close()
    bench.spin_until(
        lambda: listener.take() or expected["/energy/registers"][-1] in listener.rows["/energy/registers"],
        "the last registers",
    )
    bench.spin_until(
        lambda: listener.take()
        or len(listener.rows["/energy/power"]) >= len(expected["/energy/power"]),
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
        lambda: received(power, messages) and friction.temperatures[0].received,
        lambda: torque.joint_states.received,
    )
    torque.close()
    bench.spin_until(lambda: power.ledger.end_ns, "samples")
    newest = decoded(PowerState, expected["/energy/power"][-1]).header.stamp
    end_ns = newest.sec * 10**9 + newest.nanosec
    bench.spin_until(lambda: power.ledger.end_ns >= end_ns - 3 * 10**8, "the last samples")
    friction.close()
    power.close()
    bench.spin_until(
        lambda: listener.take() or expected["/energy/registers"][-1] in listener.rows["/energy/registers"],
        "the last registers",
    )
