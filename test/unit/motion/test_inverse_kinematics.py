"""Joint positions from tool positions, against Pinocchio and closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from refusals import refused
from robot_energy.foundation.errors import MotionError
from robot_energy.model import load
from robot_energy.physics.rigid_body import Robot
from robot_energy_plan.motion import InverseKinematics
from robot_energy_plan.motion.inverse_kinematics import rotation_vector

MANTIS = Robot.from_model(load("mantis"))
GANTRY = Robot.from_model(load("testbed"))
ARM = Robot.from_model(load("irb4600"))
UR = Robot.from_model(load("ur5e"))
L1, L2, L3, PLANE = 1.15, 1.00, 0.65, 1.0
ELBOW = np.array([0.0, -1.2, 1.8])
POSTURE = np.array([0.1, 0.3, 0.2, 0.0, 1.0, 0.0])  # of the IRB 4600, hand down
SKEW = """
<robot name="skew">
  <link name="base"/>
  {links}
  <link name="tip"/>
  <joint name="a" type="continuous"><parent link="base"/><child link="l0"/>
    <origin xyz="0.2 0.3 0.5" rpy="0.4 0 0"/><axis xyz="0 -1 0"/></joint>
  <joint name="b" type="continuous"><parent link="l0"/><child link="l1"/>
    <origin xyz="0.6 0.1 0.1" rpy="0 0.3 0"/><axis xyz="0 1 0"/></joint>
  <joint name="c" type="continuous"><parent link="l1"/><child link="l2"/>
    <origin xyz="0.5 -0.2 0"/><axis xyz="0 -1 0"/></joint>
  <joint name="t" type="fixed"><parent link="l2"/><child link="tip"/>
    <origin xyz="0.3 0 0.1"/></joint>
</robot>
""".format(
    links="".join(
        f'<link name="l{k}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" '
        'ixz="0" iyz="0"/></inertial></link>'
        for k in range(3)
    )
)


def placed(robot, link, joint_position):
    return np.array([robot.link_position(row, link) for row in joint_position])


def outline(x, y, z, count=400):
    """A rectangle of 0.3 by 1.2 m, walked round once."""
    corners = np.array([[0, 0], [0.3, 0], [0.3, 1.2], [0, 1.2], [0, 0]]) + np.array([x, y])
    way = np.linspace(0.0, 3.0, count)
    at = [0.0, 0.3, 1.5, 1.8, 3.0]
    columns = [np.interp(way, at, column) for column in corners.T]
    return np.column_stack([*columns, np.full(count, z)])


WALL = outline(1.9, -0.6, PLANE)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 1.0, 2.6, 2.8, np.pi - 1e-9, np.pi])
def test_a_rotation_is_its_axis_times_its_angle(angle):
    for axis in np.random.default_rng(1).standard_normal((20, 3)):
        vector = angle * axis / np.linalg.norm(axis)
        found = rotation_vector(Rotation.from_rotvec(vector).as_matrix())
        # half a turn is the same either way round
        sign = np.sign(found @ vector) if angle == np.pi else 1.0
        np.testing.assert_allclose(sign * found, vector, rtol=0, atol=1e-13)


def test_gantry_is_exact():
    path = np.array([[0.5, 0.2, 0.1], [3.5, 1.1, 1.5], [0.0, 0.0, 0.0]])
    found = InverseKinematics(GANTRY).solve(path, np.array([1.0, 1.0, 1.0]))
    np.testing.assert_allclose(found, path, atol=1e-15)


@settings(max_examples=60)
@given(
    held=st.sampled_from(["joint_1", "joint_2", "joint_3"]),
    q=st.tuples(st.floats(-2.5, 2.5), st.floats(0.2, 2.4), st.floats(0.2, 2.4)),
    side=st.sampled_from([(1, 1), (1, -1), (-1, 1), (-1, -1)]),
)
def test_two_free_joints_come_back_to_where_they_were(held, q, side):
    """From a start on the same side, the solution is the configuration itself."""
    wanted = np.array([q[0], side[0] * q[1], side[1] * q[2]])
    near = wanted + np.where(np.array(MANTIS.joint_names) == held, 0.0, 0.05)
    solver = InverseKinematics(MANTIS, held=[held])
    place = placed(MANTIS, "tool0", wanted[None])
    try:
        found = solver.solve(place, near)[0]
    except MotionError:  # both links nearly in line, or the start beyond it
        free = [k for k in range(3) if MANTIS.joint_names[k] != held]
        arms = MANTIS.link_jacobian(wanted, "tool0")[2][:2, free]
        assert abs(np.linalg.det(arms)) < 0.15
        return
    np.testing.assert_allclose(placed(MANTIS, "tool0", found[None]), place, atol=1e-9)
    if np.abs(found - wanted).max() > 1e-6:  # the start was beyond the stretched line
        free = [k for k in range(3) if MANTIS.joint_names[k] != held]
        signs = [
            np.sign(np.linalg.det(MANTIS.link_jacobian(row, "tool0")[2][:2, free]))
            for row in (near, found)
        ]
        assert signs[0] == signs[1]


@pytest.mark.parametrize("start", [[0.0, 0.0, 0.0], [0.0, 0.01, 0.0], [0.3, 0.8, 0.2]])
def test_two_free_joints_reach_a_place_from_any_start(start):
    """Also from the stretched arm, and where the straight way crosses the hole round the base."""
    solver = InverseKinematics(MANTIS, held=["joint_3"])
    wanted = np.array([[q1, q2, start[2]] for q1 in (-1.5, 0.0, 2.0) for q2 in (0.3, 1.2, 2.4)])
    place = placed(MANTIS, "tool0", wanted)
    found = np.vstack([solver.solve(one[None], np.array(start)) for one in place])
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-9)


def test_first_joint_held_by_the_law_of_cosines():
    q1 = 0.2
    start = np.array([q1, -1.0, 1.5])
    found = InverseKinematics(MANTIS, held=["joint_1"]).solve(WALL, start)
    assert np.ptp(found[:, 0]) == 0.0
    away = WALL[:, :2] - L1 * np.array([np.cos(q1), np.sin(q1)])
    cosine = ((away**2).sum(axis=1) - L2**2 - L3**2) / (2 * L2 * L3)
    np.testing.assert_allclose(found[:, 2], np.arccos(cosine), atol=1e-9)
    np.testing.assert_allclose(placed(MANTIS, "tool0", found), WALL, atol=1e-9)


def test_all_joints_take_the_nearest_configuration():
    """Against a search over the first joint, the other two in closed form."""
    weight = np.array([3.0, 1.0, 0.5])
    found = InverseKinematics(MANTIS, weight=weight).solve(WALL, ELBOW)
    np.testing.assert_allclose(placed(MANTIS, "tool0", found), WALL, atol=1e-9)
    cost = (weight * (found - ELBOW) ** 2).sum(axis=1)
    first = np.linspace(-0.8, 0.8, 3201)
    for row in (0, 57, 200, 333):
        away = WALL[row, :2] - L1 * np.column_stack([np.cos(first), np.sin(first)])
        cosine = ((away**2).sum(axis=1) - L2**2 - L3**2) / (2 * L2 * L3)
        third = np.arccos(np.clip(cosine, -1, 1))
        bent = np.arctan2(L3 * np.sin(third), L2 + L3 * np.cos(third))
        second = np.arctan2(away[:, 1], away[:, 0]) - first - bent
        tried = (weight * (np.column_stack([first, second, third]) - ELBOW) ** 2).sum(axis=1)
        tried[np.abs(cosine) > 1] = np.inf
        assert cost[row] == pytest.approx(tried.min(), abs=1e-6)


def test_small_weight_moves_a_joint_more():
    ways = [
        np.ptp(InverseKinematics(MANTIS, weight=np.array([w, 1, 1])).solve(WALL, ELBOW)[:, 0])
        for w in (10.0, 1.0, 0.1)
    ]
    assert ways[0] < ways[1] < ways[2]


@pytest.mark.parametrize("options", [{}, {"held": ["joint_1"]}])
def test_closed_tool_path_is_a_closed_and_continuous_joint_path(options):
    twice = np.vstack([WALL, WALL[1:]])
    found = InverseKinematics(MANTIS, **options).solve(twice, ELBOW)
    np.testing.assert_allclose(found[0], found[len(WALL) - 1], atol=1e-9)
    np.testing.assert_allclose(found[1 : len(WALL)], found[len(WALL) :], atol=1e-9)
    assert np.abs(np.diff(found, axis=0)).max() < 0.03


@settings(max_examples=30)
@given(q=st.tuples(st.floats(-3, 3), st.floats(-2, 2), st.floats(-2, 2)), seed=st.integers(0, 99))
def test_planar_arm_in_a_tilted_plane_with_mixed_senses(q, seed):
    """Senses, offsets along the axes and a tilted base come from the robot, not from us."""
    robot = Robot(SKEW, ("a", "b", "c"))
    solver = InverseKinematics(robot, "tip")
    assert solver.structure == "planar"
    start = np.asarray(q)
    near = start + 0.05 * np.random.default_rng(seed).uniform(-1, 1, 3)
    place = placed(robot, "tip", near[None])
    origin, least, greatest = solver._planar.reach(start, [0, 1, 2])
    away = abs(solver._planar.split(place)[0][0] - origin)
    if not least + 0.05 < away < greatest - 0.05:
        return
    found = solver.solve(place, start)
    np.testing.assert_allclose(placed(robot, "tip", found), place, atol=1e-9)
    assert np.abs(found[0] - start).sum() < 4 * np.abs(near - start).sum() + 1e-9


@pytest.mark.parametrize(
    ("robot", "link", "start", "path"),
    [
        (ARM, "nozzle", POSTURE, outline(1.3, -0.6, 0.3)),
        (UR, "tool0", np.array([0.3, -1.2, 1.6, -1.9, -1.5, 0.4]), outline(0.9, -0.6, 0.3) * 0.5),
    ],
)
def test_six_joints_hold_the_orientation(robot, link, start, path):
    turn = robot.link_pose(start, link)[1]
    found = InverseKinematics(robot, link).solve(path, start)
    np.testing.assert_allclose(placed(robot, link, found), path, atol=1e-9)
    for row in found[::40]:
        np.testing.assert_allclose(robot.link_pose(row, link)[1], turn, atol=1e-9)
    assert np.abs(np.diff(found, axis=0)).max() < 0.1
    np.testing.assert_allclose(found[0], found[-1], atol=1e-9)


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000))
def test_six_joints_come_back_to_a_known_configuration(seed):
    random = np.random.default_rng(seed)
    wanted = POSTURE + random.uniform(-0.4, 0.4, 6)
    place, turn = ARM.link_pose(wanted, "nozzle")
    near = wanted + random.uniform(-0.05, 0.05, 6)
    found = InverseKinematics(ARM, "nozzle", orientation=turn).solve(place[None], near)[0]
    np.testing.assert_allclose(found, wanted, atol=1e-8)


def test_a_tool_turned_by_half_a_turn_is_brought_round():
    down = np.diag([1.0, -1.0, -1.0])
    start = np.array([0.0, 0.3, 0.2, 0.0, 0.5 * np.pi - 0.5, 0.0])
    np.testing.assert_allclose(ARM.link_pose(start, "nozzle")[1], np.diag([-1, 1, -1]), atol=1e-12)
    path = np.array([[1.5, 0.0, 0.5]])
    found = InverseKinematics(ARM, "nozzle", orientation=down).solve(path, start)[0]
    place, turn = ARM.link_pose(found, "nozzle")
    np.testing.assert_allclose(place, path[0], atol=1e-9)
    np.testing.assert_allclose(turn, down, atol=1e-9)


def test_jacobian_is_the_slope_of_the_pose():
    q, step = POSTURE, 1e-6
    _, turn, jacobian = ARM.link_jacobian(q, "nozzle")
    for joint in range(6):
        moved = q.copy()
        moved[joint] += step
        place, turned = ARM.link_pose(moved, "nozzle")
        slope = (place - ARM.link_position(q, "nozzle")) / step
        np.testing.assert_allclose(jacobian[:3, joint], slope, atol=1e-5)
        spin = (turned @ turn.T - np.eye(3)) / step
        expected = [spin[2, 1], spin[0, 2], spin[1, 0]]
        np.testing.assert_allclose(jacobian[3:, joint], expected, atol=1e-5)


def test_jacobian_follows_the_joint_order_of_the_model():
    names = tuple(reversed(ARM.joint_names))
    other = Robot(load("irb4600").urdf_xml, names)
    straight = ARM.link_jacobian(POSTURE, "nozzle")[2]
    np.testing.assert_allclose(other.link_jacobian(POSTURE[::-1], "nozzle")[2], straight[:, ::-1])
    np.testing.assert_allclose(other.joint_origins(POSTURE[::-1]), ARM.joint_origins(POSTURE)[::-1])


@pytest.mark.parametrize(
    ("robot", "options", "path", "start", "words"),
    [
        (MANTIS, {}, [[1, 0, 1], [3, 1, 1]], ELBOW, r"point 2 .*3\.162 m from joint_1.* 2\.8 m"),
        (MANTIS, {"held": ["joint_1"]}, [[1.2, 0, 1]], ELBOW, r"0\.05 m from joint_2.*0\.35 to"),
        (MANTIS, {"held": ["joint_1"]}, [[2.8, 0, 1]], ELBOW, r"singular.*1\.65 m"),
        (MANTIS, {}, [[2, 0, 1], [2, 0, 0.5]], ELBOW, r"point 2 .*-0\.5 m off the plane"),
        (GANTRY, {}, [[3.6, 0, 0]], np.zeros(3), "joint_x at 3.6 m; expected 0 to 3.5"),
        (ARM, {"link": "nozzle"}, [[4, 0, 0]], POSTURE, r"4\.0.* m from joint_1; expected 0 to 3"),
        (ARM, {"link": "nozzle"}, [[2.7, 0, 0.1]], POSTURE, "is missed by"),
        (ARM, {"link": "nozzle"}, [[0.2, 0, 0.3]], POSTURE, "missed|puts joint"),
    ],
)
def test_what_cannot_be_reached_is_refused_in_one_sentence(robot, options, path, start, words):
    with pytest.raises(MotionError, match=words):
        InverseKinematics(robot, **options).solve(np.array(path, dtype=float), start)


def test_other_structures_are_refused():
    kinds = SKEW.replace('<axis xyz="0 1 0"/>', '<axis xyz="1 0 0"/>')
    with refused(MotionError, found="3 joints", expected="six joints"):
        InverseKinematics(Robot(kinds, ("a", "b", "c")), "tip")


def test_height_can_be_left_to_an_axis_outside_of_the_model():
    high = WALL + np.array([0.0, 0.0, 0.37])
    found = InverseKinematics(MANTIS, lifted=True).solve(high, ELBOW)
    np.testing.assert_allclose(placed(MANTIS, "tool0", found)[:, :2], high[:, :2], atol=1e-9)
