"""Recording the rig: what a bag holds is what the rig gave."""

import numpy as np
import pytest

from plants import PROGRAM, two_link_profile
from refusals import refused
from robot_energy.bag import BagReader
from robot_energy.bag.cdr import Decoder, stamp_ns
from robot_energy.foundation.errors import BagError, RigError
from robot_energy.messages.fields import JOINT_STATES_TOPIC, METER_TOPIC, TEMPERATURES_TOPIC
from robot_energy_rig import RigConfig, RigOutput, VirtualRig
from robot_energy_rig.record import outputs, record


@pytest.fixture
def profile(tmp_path):
    return two_link_profile(tmp_path)


def read(bag, topic, fields):
    parts = [part[topic] for part in bag.parts([topic]) if topic in part]
    batch_rows = []
    for batch in parts:
        decoded = Decoder(
            batch.msgtype, ("header.stamp.sec", "header.stamp.nanosec", *fields)
        ).decode(batch)
        assert len(decoded.malformed) == 0
        (run,) = decoded.runs
        batch_rows.append((batch.log_time_ns, stamp_ns(run), *(run.columns[f] for f in fields)))
    return [
        np.concatenate(column) if isinstance(column[0], np.ndarray) else column[0]
        for column in zip(*batch_rows, strict=True)
    ]


def test_bag_holds_what_the_rig_gave(profile, tmp_path):
    recording = record(VirtualRig(profile, PROGRAM, seed=3), 5.0, tmp_path / "bag")
    expected = RigOutput.concatenate(list(outputs(VirtualRig(profile, PROGRAM, seed=3), 5.0)))
    bag = BagReader(tmp_path / "bag")
    assert recording.messages == {JOINT_STATES_TOPIC: 1250, TEMPERATURES_TOPIC: 5, METER_TOPIC: 49}
    assert {n: t.message_count for n, t in bag.topics.items()} == recording.messages
    log, stamp, names, position, velocity, effort = read(
        bag, JOINT_STATES_TOPIC, ("name", "position", "velocity", "effort")
    )
    assert names == ("shoulder", "elbow")
    np.testing.assert_array_equal(stamp, expected.joints.stamp_ns)
    np.testing.assert_array_equal(log, stamp + 500_000)
    np.testing.assert_array_equal(position, expected.joints.joint_position)
    np.testing.assert_array_equal(velocity, expected.joints.joint_velocity)
    np.testing.assert_array_equal(effort, expected.joints.measured_motor_torque)
    log, stamp, degc = read(bag, TEMPERATURES_TOPIC, ("temperature_degc",))
    np.testing.assert_array_equal(stamp, expected.temperatures.stamp_ns)
    np.testing.assert_array_equal(degc, expected.temperatures.motor_temperature_degc)
    log, stamp, power, interval, meaning, location = read(
        bag, METER_TOPIC, ("power", "interval", "meaning", "location")
    )
    np.testing.assert_array_equal(power, expected.meter.power)
    assert set(interval) == {0.1}
    assert set(meaning) == {2}
    assert set(location) == {1}
    assert (log > stamp).all()
    assert recording.energy == pytest.approx(expected.truth.grid_power.sum() * 0.004)


def test_bag_is_in_the_order_of_its_log_times(profile, tmp_path):
    record(VirtualRig(profile, PROGRAM), 3.0, tmp_path / "bag", compression="none")
    from mcap.reader import make_reader

    (file,) = (tmp_path / "bag").glob("*.mcap")
    with file.open("rb") as stream:
        times = [m.log_time for _, _, m in make_reader(stream).iter_messages(log_time_order=False)]
    assert times == sorted(times)
    assert len(times) == 750 + 3 + 29


def test_same_seed_same_bytes(profile, tmp_path):
    for name in ("one", "two"):
        record(VirtualRig(profile, PROGRAM, RigConfig(), seed=9), 2.0, tmp_path / name / "bag")
    files = [next((tmp_path / name / "bag").glob("*.mcap")) for name in ("one", "two")]
    assert files[0].read_bytes() == files[1].read_bytes()


def test_outputs_do_not_depend_on_their_step(profile):
    one = RigOutput.concatenate(list(outputs(VirtualRig(profile, PROGRAM), 2.5, 1.0)))
    other = RigOutput.concatenate(list(outputs(VirtualRig(profile, PROGRAM), 2.5, 0.013)))
    assert len(one.joints) == 625
    np.testing.assert_array_equal(one.joints.joint_velocity, other.joints.joint_velocity)


def test_refuses_no_time_and_a_bag_that_is_there(profile, tmp_path):
    with refused(RigError, found="0.0 s"):
        record(VirtualRig(profile, PROGRAM), 0.0, tmp_path / "none")
    assert not (tmp_path / "none").exists()
    record(VirtualRig(profile, PROGRAM), 0.1, tmp_path / "bag")
    with refused(BagError, expected="new folder"):
        record(VirtualRig(profile, PROGRAM), 0.1, tmp_path / "bag")


def test_what_was_true_is_said_next_to_the_bag(profile, tmp_path):
    config = RigConfig(thermal_speedup=20.0)
    made = record(VirtualRig(profile, PROGRAM, config, seed=3), 5.0, tmp_path / "bag")
    truth = RigOutput.concatenate(
        list(outputs(VirtualRig(profile, PROGRAM, config, seed=3), 5.0))
    ).truth
    assert made.peak_power == truth.grid_power.max()
    np.testing.assert_array_equal(
        made.motor_temperature_degc, truth.motor_temperature_degc[[0, -1]]
    )
    np.testing.assert_array_equal(made.gear_temperature_degc, truth.gear_temperature_degc[[0, -1]])
    assert (made.motor_temperature_degc[1] > made.motor_temperature_degc[0]).all()
