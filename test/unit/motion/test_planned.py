"""Programs as files, trajectories of points, and repetition."""

import json

import numpy as np
import pytest
import yaml

from moves import PointToPoint
from refusals import refused
from robot_energy.bag import BagReader, BagWriter
from robot_energy.foundation.errors import BagError, MissingTopicError, MotionError
from robot_energy.physics.rigid_body import Robot
from robot_energy_plan.motion import FourierBasis, FourierMotion
from robot_energy_plan.motion.joint_trajectory import (
    MESSAGE,
    TOPIC,
    JointTrajectory,
    decode_trajectory,
    points,
    read_bag_trajectory,
    read_csv_trajectory,
    write_csv,
    write_trajectory,
)
from robot_energy_plan.motion.load_motion import joint_list, load_motion
from robot_energy_plan.motion.planned import BLOCK, SampledMotion, planned_ns, repeated
from robot_energy_plan.motion.ptp import MotionLimits
from robot_energy_plan.motion.ptp_file import program_for, read_program
from robots import two_link

PROGRAM = {
    "schema_version": 1,
    "motion": "point_to_point",
    "angle_unit": "deg",
    "via": [{"shoulder": 0, "elbow": 10}, {"elbow": -30, "shoulder": 45}],
    "dwell": [0.5, 0.0],
    "override": 0.5,
    "acceleration": {"shoulder": 90, "elbow": 180},
    "repeat": 3,
}
URDF = (
    two_link()
    .urdf_xml.replace('name="elbow" type="continuous"', 'name="elbow" type="revolute"')
    .replace(
        '<axis xyz="0 -1 0"/>\n  </joint>\n</robot>',
        '<axis xyz="0 -1 0"/><limit lower="-3" upper="3" effort="50" velocity="5"/>'
        "\n  </joint>\n</robot>",
    )
)


def robot():
    return Robot(URDF, ("shoulder", "elbow"))


def written(folder, **changes):
    path = folder / "moves.yaml"
    data = {key: value for key, value in {**PROGRAM, **changes}.items() if value != "absent"}
    path.write_text(yaml.safe_dump(json.loads(json.dumps(data))))
    return path


def test_a_program_file_is_the_loop_it_says(tmp_path):
    """Degrees, joints by name in any order, override and acceleration, as moves one by one."""
    loaded = program_for(read_program(written(tmp_path)), robot().limits)
    degree = np.pi / 180
    via = np.array([[0, 10], [45, -30]]) * degree
    limits = MotionLimits(
        np.full(2, -3.0), np.full(2, 3.0), np.array([4.0, 5.0]), np.array([90, 180]) * degree
    )
    move = PointToPoint(via[0], via[1], limits, 0.5)
    assert loaded.program.period == pytest.approx(0.5 + 2 * move.duration)
    at = loaded.program.sample(np.array([0.2, 0.5 + move.duration / 2]))
    np.testing.assert_allclose(at.joint_position, [via[0], via.mean(axis=0)], atol=1e-12)
    assert (loaded.repeat, loaded.notes) == (3, ())


def test_what_nobody_said_of_acceleration_is_said(tmp_path):
    loaded = program_for(read_program(written(tmp_path, acceleration="absent")), robot().limits)
    assert "assumed" in loaded.notes[0]


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"schema_version": 2}, "'schema_version' is 2"),
        ({"motion": "circle"}, "'motion' is 'circle'"),
        ({"angle_unit": "gon"}, "'angle_unit' is 'gon'"),
        ({"via": []}, "'via' is a list; expected at least 1"),
        ({"via": [{"shoulder": 0, "elbow": 1}, {"shoulder": 0}]}, "differ in 'elbow'"),
        ({"via": [{"shoulder": True, "elbow": 1}]}, "expected a number"),
        ({"via": [{"shoulder": ".inf", "elbow": 1}]}, "via"),
        ({"dwell": [1, 2, 3]}, "3 dwell times for 2 configurations"),
        ({"dwell": -1}, "dwell"),
        ({"override": 1.5}, "'override' is 1.5"),
        ({"acceleration": {"shoulder": 1}}, "same joints"),
        ({"repeat": 0}, "'repeat' is 0"),
        ({"repeat": 2.5}, "'repeat' is 2.5; expected a whole number"),
        ({"speed": 3}, "key 'speed' is unknown"),
    ],
)
def test_wrong_program_files_are_refused_by_key(tmp_path, changes, text):
    with pytest.raises(MotionError, match=text):
        read_program(written(tmp_path, **changes))


def test_files_that_are_no_program(tmp_path):
    path = tmp_path / "list.yaml"
    path.write_text("- 1\n")
    with refused(MotionError, found="list", expected="schema_version"):
        read_program(path)
    with pytest.raises(MotionError, match="cannot be read"):
        read_program(tmp_path / "none.yaml")
    path.write_text("a: [")
    with pytest.raises(MotionError, match="not valid YAML"):
        read_program(path)
    (tmp_path / "a.txt").write_text("")
    for name, text in (("a.txt", "the kind of the program"), ("b.yaml", "there is no program")):
        with pytest.raises(MotionError, match=text):
            load_motion(tmp_path / name, robot())


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"via": [{"shoulder": 0}], "dwell": 1, "acceleration": 9}, "it lacks elbow"),
        (
            {"via": [{"shoulder": 0, "elbow": 0, "wrist": 0}], "dwell": 1, "acceleration": 9},
            "wrist is not a joint",
        ),
        ({"via": [{"shoulder": 200, "elbow": 0}], "dwell": 1}, "puts joint 1 at 3.49"),
        ({"via": [{"shoulder": 0, "elbow": 0}], "dwell": 0}, "neither moves nor rests"),
    ],
)
def test_programs_of_another_robot_are_refused(tmp_path, changes, text):
    with pytest.raises(MotionError, match=text):
        load_motion(written(tmp_path, **changes), robot())


def test_a_robot_without_speeds_is_refused(tmp_path):
    with refused(MotionError, found=("velocity", "'elbow'")):
        load_motion(written(tmp_path), Robot.from_model(two_link()))


TIME = np.array([0.0, 0.4, 1.0, 1.5])


def polynomial(order):
    """A motion of that degree, which points with enough derivatives must give back."""
    rng = np.random.default_rng(order)
    curves = [np.polynomial.Polynomial(rng.uniform(-1, 1, order + 1)) for _ in range(2)]

    def sampled(time, derivative=0):
        return np.stack([c.deriv(derivative)(time) if derivative else c(time) for c in curves], 1)

    return sampled


@pytest.mark.parametrize("order", [3, 5])
def test_points_with_derivatives_give_a_polynomial_back(order):
    truth = polynomial(order)
    found = JointTrajectory(
        ("a", "b"), TIME + 7.0, truth(TIME), truth(TIME, 1), truth(TIME, 2) if order == 5 else None
    )
    time = np.linspace(0.0, 1.5, 91)
    at = found.sample(time)
    np.testing.assert_allclose(at.joint_position, truth(time), atol=1e-11)
    np.testing.assert_allclose(at.joint_velocity, truth(time, 1), atol=1e-10)
    np.testing.assert_allclose(at.joint_acceleration, truth(time, 2), atol=1e-9)
    assert (found.duration, found.notes) == (1.5, ())


def test_points_without_derivatives_are_passed_smoothly_from_rest_to_rest():
    position = np.array([[0.0, 1.0], [0.5, 0.0], [0.2, 0.3], [1.0, 1.0]])
    found = JointTrajectory(("a", "b"), TIME, position)
    at = found.sample(np.array([*TIME, 0.4 - 1e-9, 0.4 + 1e-9]))
    np.testing.assert_allclose(at.joint_position[:4], position, atol=1e-12)
    np.testing.assert_allclose(at.joint_velocity[[0, 3]], 0.0, atol=1e-12)
    np.testing.assert_allclose(at.joint_acceleration[4], at.joint_acceleration[5], atol=1e-6)
    assert "positions only" in found.notes[0]


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"time": TIME[[0, 2, 1, 3]]}, "point 3 comes at 0.4 s, after one at 1 s"),
        ({"time": TIME[:1], "joint_position": np.zeros((1, 2))}, "1 points"),
        ({"joint_position": np.full((4, 2), np.nan)}, "a position is not finite"),
        ({"joint_names": ("a", "a")}, "each joint once"),
    ],
)
def test_points_without_sense_are_refused(changes, text):
    given = {"joint_names": ("a", "b"), "time": TIME, "joint_position": np.zeros((4, 2))}
    with pytest.raises(MotionError, match=text):
        JointTrajectory(**{**given, **changes})


def excitation(folder):
    basis = FourierBasis(3, 2.0)
    motion = FourierMotion(basis, np.random.default_rng(1).uniform(-0.5, 0.5, (basis.size, 2)))
    time, path = points(motion, 50.0)
    names = ("shoulder", "elbow")
    write_trajectory(folder / "bag", names, time, path)
    write_csv(folder / "it.csv", names, time, path)
    return motion


def test_written_trajectories_are_read_back(tmp_path):
    """What `identify excitation` writes, as bag and as CSV."""
    motion = excitation(tmp_path)
    time = np.linspace(0.0, 2.0, 333)
    truth = motion.sample(time)
    for found in (read_bag_trajectory(tmp_path / "bag"), read_csv_trajectory(tmp_path / "it.csv")):
        assert found.joint_names == ("shoulder", "elbow")
        at = found.sample(time)
        np.testing.assert_allclose(at.joint_position[:-1], truth.joint_position[:-1], atol=1e-7)
        np.testing.assert_allclose(at.joint_velocity[:-1], truth.joint_velocity[:-1], atol=1e-5)


def test_unused_bytes_behind_a_message_are_ignored(tmp_path):
    """`rclpy.serialization` returns whole buffers."""
    motion = excitation(tmp_path)
    reader = BagReader(tmp_path / "bag")
    (part,) = reader.parts([TOPIC])
    with BagWriter(tmp_path / "padded") as bag:
        bag.add_topic(TOPIC, MESSAGE)
        bag.write(TOPIC, [0], [part[TOPIC].row(0) + bytes(13)])
    found = read_bag_trajectory(tmp_path / "padded")
    np.testing.assert_allclose(
        found.sample(TIME).joint_position, motion.sample(TIME).joint_position, atol=1e-7
    )
    for data in (b"", b"\x00\x07\x00\x00", b"\x00\x01\x00\x00\xff\xff"):
        with refused(MotionError, expected="trajectory_msgs/msg/JointTrajectory"):
            decode_trajectory(reader.typestore, data, "it")


def test_bags_and_tables_without_a_trajectory_are_refused(tmp_path):
    excitation(tmp_path)
    with refused(MissingTopicError, found="/other", remedy="/joint_trajectory"):
        read_bag_trajectory(tmp_path / "bag", "/other")
    with refused(BagError, expected=".mcap"):
        load_motion(tmp_path, robot())
    table = tmp_path / "t.csv"
    for text, why in (
        ("time,angle\n0,1\n1,2\n", "has the columns"),
        ("time,position_a\n0,x\n", "line 2 holds a cell that is not a number"),
        ("time,position_a\n0,1,2\n1,2,3\n", "line 2 has 3 values"),
        ("time,position_a\n0,1\n", "1 points"),
    ):
        table.write_text(text)
        with pytest.raises(MotionError, match=why):
            read_csv_trajectory(table)


def test_samples_come_in_blocks_with_every_kink():
    found = JointTrajectory(("a",), TIME, np.zeros((4, 1)))
    sampled = SampledMotion(found, ("a",), 1.5, 1e-4, found.instants.tolist())
    times = [time for time, _ in sampled.blocks()]
    assert max(map(len, times)) <= BLOCK + len(TIME)
    time = np.concatenate(times)
    assert (np.diff(time) > 0).all()
    assert set(TIME) <= set(time)


def test_times_on_one_nanosecond_are_one_sample():
    """A point 0.3 ns next to the grid, at its begin, within it, at a block's end and at its end."""
    adjacent = [3e-10, 0.01 + 3e-10, 0.01 * BLOCK - 3e-10, 60.0 - 3e-10]
    path = JointTrajectory(("a",), np.array([0.0, 30.0, 60.0]), np.zeros((3, 1)))
    sampled = SampledMotion(path, ("a",), 60.0, 0.01, adjacent)
    for times in (1, 2):
        time = np.concatenate([time for time, _ in repeated(sampled, times)])
        assert (np.diff(planned_ns(time)) > 0).all()
        assert len(time) == 6000 * times + 1


def test_a_point_that_repeats_the_one_before_is_left_out_and_one_elsewhere_refused():
    time = np.array([0.0, 0.4, 0.4, 0.4 + 1e-9, 1.0])
    position = np.array([[0.0], [0.2], [0.2], [0.2], [1.0]])
    found = JointTrajectory(("a",), time, position)
    assert found.instants.tolist() == [0.0, 0.4, 1.0]
    assert "2 points of the trajectory repeat the one before" in found.notes[0]
    position[2] = 0.3
    with refused(MotionError, found="point 3 comes at 0.4 s, after one at 0.4 s"):
        JointTrajectory(("a",), time, position)
    with refused(MotionError, found="are the same"):
        JointTrajectory(("a",), np.array([0.0, 1e-9]), np.zeros((2, 1)))


def test_repetition_needs_an_end_at_the_start():
    there = JointTrajectory(("a",), TIME, np.array([[0.0], [1.0], [1.0], [0.0]]))
    sampled = SampledMotion(there, ("a",), 1.5, 0.01)
    time = np.concatenate([time for time, _ in repeated(sampled, 3)])
    assert (np.diff(time) > 0).all()
    assert time[-1] == pytest.approx(4.5)
    away = JointTrajectory(("a",), TIME, np.array([[0.0], [1.0], [1.0], [0.5]]))
    with refused(MotionError, found=("'a'", "0.5")):
        list(repeated(SampledMotion(away, ("a",), 1.5, 0.01), 2))


def test_lists_of_numbers():
    np.testing.assert_array_equal(joint_list("1,-2.5", "--x", (2,)), [1.0, -2.5])
    for text in ("1,a", "1", "nan,1", ""):
        with refused(MotionError, found="--x"):
            joint_list(text, "--x", (2,))
