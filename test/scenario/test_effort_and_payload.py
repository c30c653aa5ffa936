"""Effort and payload through a whole bag. Each docstring says what must come out."""

import csv
import os
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import Writer

from places import ROOT
from plants import PROGRAM, two_link_profile
from robot_energy.bag import BagReader, BagWriter
from robot_energy.bag.cdr import Decoder
from robot_energy.bag.cdr.types import extended, typestore
from robot_energy.messages.payload import PAYLOAD, PayloadWriter
from robot_energy.model import load
from robot_energy.model.payload import payload
from robot_energy.pipeline import Settings
from robot_energy.pipeline.torque_stage import PayloadChange
from robot_energy.replay.bag_replay import replay
from robot_energy.replay.setup import ReplaySetup, Topics
from robot_energy.results.replay import replay_report
from robot_energy.timeline.blocks import EffortMeaning
from robot_energy_logs.ur_rtde import import_ur_rtde
from robot_energy_rig import RigConfig, RigOutput, VirtualRig
from robot_energy_rig.record import outputs, record
from robots import two_link

BAG = ROOT / "bags" / "kr16_cold"
MODEL = load("kr16")
SECOND_NS = 10**9
BY_MOTOR_TORQUE = Settings(effort=EffortMeaning.MOTOR_TORQUE)
DATA = os.environ.get("ROBOT_ENERGY_DATA", "")


def copy_of_the_bag(folder, change=None, payloads=()):
    """The bundled bag with every joint state changed, and payloads set on the way."""
    reader, store = BagReader(BAG), typestore()
    rows = []
    for part in reader.parts(list(reader.topics)):
        for topic, batch in part.items():
            for index, time in enumerate(batch.log_time_ns.tolist()):
                row = batch.row(index)
                if change is not None and topic == "/joint_states":
                    message = store.deserialize_cdr(row, batch.msgtype)
                    change(message, time - reader.start_ns)
                    row = bytes(store.serialize_cdr(message, batch.msgtype))
                rows.append((time, topic, row))
    writer = PayloadWriter("of another model")
    for body, after in payloads:
        stamp = reader.start_ns + round(after * SECOND_NS)
        rows.append((stamp, "/energy/payload", writer.encode(PayloadChange(stamp, body))[0]))
    with BagWriter(folder / "bag") as bag:
        for topic, info in reader.topics.items():
            bag.add_topic(topic, info.msgtype)
        bag.add_topic("/energy/payload", PAYLOAD)
        for time, topic, row in sorted(rows, key=lambda entry: entry[0]):
            bag.write(topic, [time], [bytes(row)])
    return folder / "bag"


@pytest.fixture(scope="module")
def reference():
    return replay(BAG, MODEL, ReplaySetup(settings=BY_MOTOR_TORQUE))


def net(shaft, kind):
    return shaft.joints(f"{kind}_positive") - shaft.joints(f"{kind}_negative")


def test_measured_is_what_the_plant_did_where_the_model_is_wrong(tmp_path):
    """The plant has a fifth of the model's Coulomb friction: the prediction of each joint is far
    too high, the measured energy is the plant's own, worked out from its true torque."""
    config = RigConfig().without("iron", "demagnetisation")  # which falsify the reported torque
    profile = two_link_profile(tmp_path)
    record(VirtualRig(profile, PROGRAM, config, seed=4), 12.0, tmp_path / "bag")
    truth = RigOutput.concatenate(
        list(outputs(VirtualRig(profile, PROGRAM, config, seed=4), 12.0))
    ).truth
    power = truth.motor_torque * truth.motor_velocity
    result = replay(tmp_path / "bag", two_link(), ReplaySetup(settings=BY_MOTOR_TORQUE))
    shaft = result.account.shaft
    error = np.abs(net(shaft, "measured") - np.trapezoid(power, dx=0.004, axis=0))
    noise = config.sensors.torque_noise * np.sqrt((truth.motor_velocity**2).sum(axis=0)) * 0.004
    turnover = np.trapezoid(np.abs(power), dx=0.004, axis=0)
    assert (noise < 0.05 * turnover).all()
    assert (error < 4 * noise + 0.002 * turnover).all()
    assert (net(shaft, "predicted") > 1.2 * net(shaft, "measured")).all()
    assert (shaft.joints("measured_negative") > 1.0).all()
    reported = [row.predicted_minus_measured_energy for row in replay_report(result).shaft.joints]
    np.testing.assert_allclose(reported, net(shaft, "predicted") - net(shaft, "measured"))


def test_effort_lost_on_the_way_costs_its_own_joint_only(reference, tmp_path):
    """NaN effort of one joint for five seconds: five seconds less of that joint's comparison,
    every predicted figure and every other joint exactly as before."""

    def lose(message, elapsed_ns):
        if 10 * SECOND_NS <= elapsed_ns < 15 * SECOND_NS:
            message.effort = np.where(np.arange(6) == 2, np.nan, message.effort)

    found = replay(
        copy_of_the_bag(tmp_path, lose), MODEL, ReplaySetup(settings=BY_MOTOR_TORQUE)
    ).account
    before = reference.account
    np.testing.assert_array_equal(found.registers.microjoule, before.registers.microjoule)
    assert found.registers.time == before.registers.time
    lost = before.shaft.compared_ns - found.shaft.compared_ns
    assert lost.tolist() == [0, 0, pytest.approx(5 * SECOND_NS, abs=SECOND_NS // 50), 0, 0, 0]
    others = [0, 1, 3, 4, 5]
    for name in ("measured_positive", "predicted_negative"):
        a, b = found.shaft.joints(name), before.shaft.joints(name)
        np.testing.assert_array_equal(a[others], b[others])
        assert 0 < a[2] < b[2]


def test_driver_without_effort_leaves_measured_unknown(reference, tmp_path):
    """Empty effort arrays with a meaning set: all samples accepted, measured None, never 0."""

    def strip(message, _):
        message.effort = np.empty(0)

    result = replay(copy_of_the_bag(tmp_path, strip), MODEL, ReplaySetup(settings=BY_MOTOR_TORQUE))
    np.testing.assert_array_equal(
        result.account.registers.microjoule, reference.account.registers.microjoule
    )
    assert not result.joint_states.rejections.rejected
    for joint in replay_report(result).shaft.joints:
        assert joint.coverage == 0.0
        assert joint.shaft_energy_positive_measured is None


def test_payload_of_a_bag_counts_from_its_stamp(tmp_path):
    """The tool is taken off at 10 s and put back at 20 s: less energy than with it throughout,
    more than without it throughout, and every torque says which payload it was made with."""
    (body,) = MODEL.payload
    off, on = payload(body.link, 0.0), body.model_copy(update={"tag": "assumed"})
    bag = copy_of_the_bag(tmp_path, payloads=[(on, 20.0), (off, 10.0)])
    result = replay(bag, MODEL, ReplaySetup(out=tmp_path / "out"))
    bare = replay(BAG, MODEL.model_copy(update={"payload": ()}).with_urdf(MODEL.urdf_xml, ""))
    full = replay(bag, MODEL, ReplaySetup(topics=Topics(payload="")))

    def lifted(found):
        return found.account.registers.joints("shaft_positive")[1]

    assert lifted(bare) < lifted(result) < lifted(full)
    assert result.payload.rejections.balanced
    start = result.account.registers.time.start_ns
    changes = replay_report(result).payload.changes
    after = [round((change.from_ns - start) * 1e-9) for change in changes]
    assert [(change.payload.mass, s) for change, s in zip(changes, after, strict=True)] == [
        (0.0, 10),
        (body.mass, 20),
    ]
    reader = BagReader(tmp_path / "out")
    assert reader.topics["/energy/payload"].message_count == 2
    decoder = Decoder("ros2_energy_msgs/msg/JointTorque", ("payload_mass",))
    mass = np.concatenate(
        [
            run.array("payload_mass")
            for part in reader.parts(["/energy/joint_torque"])
            for run in decoder.decode(part["/energy/joint_torque"]).runs
        ]
    )
    steps = np.flatnonzero(np.diff(mass))
    assert mass[[0, *(steps + 1)]].tolist() == [body.mass, 0.0, body.mass]
    np.testing.assert_allclose(steps / 250, [10, 20], atol=0.1)


PAYLOAD_OF_0_1 = """std_msgs/Header header
string model_id
string link
float64 mass
float64[3] centre_of_mass
float64[6] inertia
"""


def with_payloads_of_0_1(bag, folder):
    """The same bag, its payloads as release 0.1 recorded them, by another writer."""
    known, old = typestore(), extended(typestore(), {PAYLOAD: ("ros2msg", PAYLOAD_OF_0_1)})
    reader = BagReader(bag)
    rows = [
        (time, topic, batch.msgtype, batch.row(index))
        for part in reader.parts(list(reader.topics))
        for topic, batch in part.items()
        for index, time in enumerate(batch.log_time_ns.tolist())
    ]
    with Writer(folder, version=9) as writer:
        connections = {
            topic: writer.add_connection(topic, info.msgtype, typestore=old)
            for topic, info in reader.topics.items()
        }
        for time, topic, msgtype, row in sorted(rows, key=lambda entry: entry[0]):
            if msgtype == PAYLOAD:
                new = known.deserialize_cdr(row, PAYLOAD)
                body, centre = new.inertia, new.inertia.com
                entries = (body.ixx, body.iyy, body.izz, body.ixy, body.ixz, body.iyz)
                fields = (new.header.frame_id, body.m, (centre.x, centre.y, centre.z), entries)
                link, mass, com, inertia = fields
                message = old.types[PAYLOAD](
                    new.header, new.model_id, link, mass, np.array(com), np.array(inertia)
                )
                row = bytes(old.serialize_cdr(message, PAYLOAD))
            writer.write(connections[topic], time, row)
    return folder


def test_payloads_recorded_by_release_0_1_give_the_same_energies(tmp_path):
    """Then the message had its own fields, and the inertia began with its diagonal."""
    (body,) = MODEL.payload
    inertia = (0.2, 0.3, 0.4, 0.01, -0.02, 0.03)
    carried = body.model_copy(update={"tag": "assumed", "inertia": inertia})
    bag = copy_of_the_bag(tmp_path, payloads=[(carried, 5.0)])
    result = replay(bag, MODEL)
    older = replay(with_payloads_of_0_1(bag, tmp_path / "older"), MODEL)
    assert older.payload.changes == result.payload.changes
    assert older.payload.changes[0].payload.inertia == inertia
    np.testing.assert_array_equal(
        older.account.registers.microjoule, result.account.registers.microjoule
    )


def test_impossible_payload_of_a_bag_is_refused_and_named(reference, tmp_path):
    """A payload on a link that the robot lacks: counted, named, and nothing else changes."""
    bag = copy_of_the_bag(tmp_path, payloads=[(payload("hand", 5.0), 20.0)])
    result = replay(bag, MODEL)
    np.testing.assert_array_equal(
        result.account.registers.microjoule, reference.account.registers.microjoule
    )
    report = replay_report(result)
    account = report.inputs["payload_messages"]
    assert account.rejected == {"impossible_payload": 1}
    assert account.balanced
    assert any("'hand'" in note for note in report.notes)


@pytest.mark.skipif(not DATA, reason="no data folder")
def test_recorded_ur3e_measures_what_its_motors_gave(tmp_path):
    """Motor currents of a real arm through the derived torque constants: every joint that moved
    took energy, and the assumed friction predicts the sum to within a third."""
    import_ur_rtde(sorted(Path(DATA).glob("rad_ur3e/*.csv"), reverse=True), tmp_path / "bag")
    settings = Settings(effort=EffortMeaning.MOTOR_CURRENT)
    shaft = replay(tmp_path / "bag", load("ur3e"), ReplaySetup(settings=settings)).account.shaft
    measured, predicted = net(shaft, "measured"), net(shaft, "predicted")
    assert (measured[:5] > 1.0).all()
    assert predicted.sum() == pytest.approx(measured.sum(), rel=1 / 3)


@pytest.mark.skipif(not DATA, reason="no data folder")
def test_torque_constants_of_the_ur3e_are_those_of_its_controller():
    """Target current = (target moment + friction) / k: the model file holds k / 101 of each
    joint that the recording loads."""
    rows = [
        row
        for path in sorted(Path(DATA).glob("rad_ur3e/*.csv"))
        for row in csv.DictReader(path.read_text().splitlines())
        if None not in row.values()
    ]
    joints = load("ur3e").joints
    for index, joint in enumerate(joints[:5]):
        moment, current, speed = (
            np.array([float(row[f"target_{name}_{index}"]) for row in rows])
            for name in ("moment", "current", "qd")
        )
        sense = np.sign(speed) * (np.abs(speed) > 1e-3)
        terms = np.stack([moment, sense, speed, np.ones_like(speed)], axis=1)
        per_moment = np.linalg.lstsq(terms, current, rcond=None)[0][0]
        assert joint.torque_constant is not None
        constant = joint.torque_constant.value * joint.gear_ratio.value
        assert constant == pytest.approx(1.0 / per_moment, rel=0.01)
