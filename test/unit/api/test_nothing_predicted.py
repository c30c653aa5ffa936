"""A recording of which nothing is predicted is refused with its reason: 0 J would be a result."""

import numpy as np
import pytest

import robots
from robot_energy.bag import BagWriter
from robot_energy.bag.cdr import Encoder, stamp_columns
from robot_energy.foundation.errors import BagError
from robot_energy.replay.api import replay

JOINT_STATE = "sensor_msgs/msg/JointState"
MODEL = robots.two_link()
SECOND = 10**9


def states(folder, times, positions, velocities=None):
    """Write a bag of joint states; times in s, positions (N, 2)."""
    stamp = np.rint((1000.0 + np.asarray(times, dtype=float)) * SECOND).astype(np.int64)
    positions = np.asarray(positions, dtype=float)
    velocities = np.zeros_like(positions) if velocities is None else velocities
    lengths = {"position": 2, "velocity": velocities.shape[1], "effort": 0}
    encoder = Encoder(JOINT_STATE, {"name": MODEL.joint_names}, lengths)
    columns = stamp_columns(stamp) | {
        "position": positions,
        "velocity": velocities,
        "effort": np.zeros((len(stamp), 0)),
    }
    with BagWriter(folder) as bag:
        bag.add_topic("/joint_states", JOINT_STATE)
        bag.write("/joint_states", stamp, encoder.encode(columns, len(stamp)))
    return folder


def test_one_joint_state_gives_no_energy(tmp_path):
    bag = states(tmp_path / "bag", [0.0], [[0.1, 0.2]])
    with pytest.raises(BagError, match=r"only one of the 1 messages .* Record longer"):
        replay(bag, MODEL)


def test_one_joint_state_among_refused_ones_says_why_they_are(tmp_path):
    positions = np.full((20, 2), 0.1)
    positions[1:] = np.nan
    bag = states(tmp_path / "bag", 0.01 * np.arange(20), positions)
    with pytest.raises(BagError, match=r"only one of the 20 messages .* \(19 not_finite\)"):
        replay(bag, MODEL)


def test_joint_states_all_apart_name_the_setting(tmp_path):
    bag = states(tmp_path / "bag", 5.0 * np.arange(20), np.full((20, 2), 0.1))
    with pytest.raises(BagError, match=r"gap lies between all .* joint states .* set max_gap"):
        replay(bag, MODEL)
    assert replay(bag, MODEL, max_gap=10.0).report.energy.net > 0  # the remedy helps


def test_power_beyond_any_robot_is_not_shown_as_none(tmp_path):
    data = robots.two_link_data()
    data["cabinet"]["loss_dc"] = robots.figure(1e12)
    bag = states(tmp_path / "bag", 0.01 * np.arange(20), np.full((20, 2), 0.1))
    with pytest.raises(BagError, match="no power is predicted: that of all 20 joint states"):
        replay(bag, robots.two_link(**data))


@pytest.mark.parametrize("good", [slice(0, 50), slice(950, 1000)])
def test_what_is_refused_at_either_end_is_a_gap_of_the_recording(tmp_path, good):
    """The share that is predicted is that of all that was recorded, and a small one is said."""
    positions = np.full((1000, 2), np.nan)
    positions[good] = 0.1
    bag = states(tmp_path / "bag", 0.01 * np.arange(1000), positions)
    report = replay(bag, MODEL).report
    assert report.time.span_ns == pytest.approx(9.99 * SECOND, abs=1e7)
    assert report.time.observed_ns == pytest.approx(0.49 * SECOND, abs=1e7)
    assert report.time.span_ns == report.time.observed_ns + report.time.gap_ns
    assert report.time.coverage == pytest.approx(0.049, abs=0.001)
    assert any("4.90% of the recorded time is predicted" in note for note in report.notes)
