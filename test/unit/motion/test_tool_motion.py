"""Tool motion -> joint motion, with an arm whose kinematics are known in closed form."""

import math
import re

import numpy as np
import pytest

from refusals import refused
from robot_energy.foundation.errors import MotionError
from robot_energy.model import load
from robot_energy.physics.rigid_body import Robot
from robot_energy.physics.urdf.checks import JointLimits
from robot_energy_papers.wall import Wall
from robot_energy_plan.motion import tool_motion
from robot_energy_plan.motion.gcode import read_gcode
from robot_energy_plan.motion.load_motion import ToolOptions, load_motion
from robot_energy_plan.motion.tool_corners import LineSegment, ToolPath
from robot_energy_plan.motion.tool_motion import TimedPath, ToolLimits, ToolMotion, ToolPlacement

L1, L2 = 0.6, 0.5  # m


class TwoLinks:
    """Planar arm about vertical axes, elbow positive."""

    def __init__(self):
        self.calls = 0

    def solve(self, tool_position, start):
        self.calls += 1
        x, y = tool_position[:, 0], tool_position[:, 1]
        cosine = (x**2 + y**2 - L1**2 - L2**2) / (2 * L1 * L2)
        if (np.abs(cosine) > 1).any():
            raise MotionError("a point lies out of reach", "points within 1.1 m", "move it")
        elbow = np.arccos(cosine)
        shoulder = np.arctan2(y, x) - np.arctan2(L2 * np.sin(elbow), L1 + L2 * np.cos(elbow))
        return np.stack([shoulder, elbow], axis=1)


def limits(velocity=5.0):
    two = np.ones(2)
    return JointLimits(
        ("shoulder", "elbow"), -3.0 * two, 3.0 * two, velocity * two, np.inf * two,
        np.zeros(2, dtype=bool), np.zeros(2, dtype=bool),
    )  # fmt: skip


def motion(text="G1 X700 F7500\nG1 Y300\nG2 X500 Y100 I-200\n", **options):
    path = TimedPath(read_gcode("G21 G90\nG0 X500 Y-200 Z0\n" + text, "part.gcode").path)
    options.setdefault("limits", limits())
    return ToolMotion(path, TwoLinks(), np.array([0.0, 1.0]), **options)


def together(planned):
    blocks = list(planned.blocks())
    time = np.concatenate([time for time, _ in blocks])
    parts = zip(*[(p.joint_position, p.joint_velocity, p.joint_acceleration) for _, p in blocks],
                strict=True)  # fmt: skip
    return (time, *(np.concatenate(part) for part in parts))


def jacobian(q):
    s1, c1, s12, c12 = np.sin(q[0]), np.cos(q[0]), np.sin(q.sum()), np.cos(q.sum())
    return np.array([[-L1 * s1 - L2 * s12, -L2 * s12], [L1 * c1 + L2 * c12, L2 * c12]])


def test_joint_velocity_moves_the_tool_at_its_speed():
    """Differential kinematics, worked out another way: J qd = tool velocity."""
    planned = motion(step=5e-3)
    time, q, qd, _ = together(planned)
    tool = planned._path.sample(time)
    made = np.array([jacobian(a) @ b for a, b in zip(q, qd, strict=True)])
    np.testing.assert_allclose(made, tool.velocity[:, :2], atol=2e-4)
    constant = (time > 0.3) & (time < 1.3)  # on the first line
    np.testing.assert_allclose(made[constant], tool.velocity[constant, :2], atol=1e-9)


def test_derivatives_agree_with_differences_at_a_finer_step():
    """Stated accuracy at 5 ms: 1e-3 rad/s, and 5 % of the greatest acceleration, at corners;
    elsewhere the fifth degree leaves nothing to see."""
    planned = motion(step=5e-3)
    time, _, qd, qdd = together(planned)
    h = 1e-4
    solve = TwoLinks().solve
    before, here, after = (
        solve(planned._path.sample(time + shift).position, np.zeros(2)) for shift in (-h, 0.0, h)
    )
    np.testing.assert_allclose(qd, (after - before) / (2 * h), atol=1e-3)
    reference = (after - 2 * here + before) / h**2
    greatest = np.abs(reference).max()
    assert np.abs(qdd - reference).max() < 0.08 * greatest
    constant = (time > 0.3) & (time < 1.3)
    assert np.abs(qdd - reference)[constant].max() < 1e-5 * greatest


def test_it_begins_and_ends_at_rest():
    """The tool's acceleration rises from 0, so nothing pulls at the robot at either end."""
    _, _, qd, qdd = together(motion(step=5e-3))
    greatest = np.abs(qdd).max()
    assert np.abs(qd[[0, -1]]).max() < 0.02 * np.abs(qd).max()
    assert np.abs(qdd[[0, -1]]).max() < 0.05 * greatest


def test_blocks_do_not_show(monkeypatch):
    whole = together(motion())
    monkeypatch.setattr(tool_motion, "BLOCK", 64)
    parts = together(motion())
    for one, two in zip(whole, parts, strict=True):
        rounding = 1e-10 * np.abs(one).max()  # of the position, over the square of the step
        np.testing.assert_allclose(one, two, rtol=0.0, atol=rounding)
    assert (np.diff(parts[0]) > 0).all()
    assert parts[0][-1] == pytest.approx(motion().duration)


def test_the_base_is_placed_and_turned():
    """A base at (1, 0) turned by 90 degrees sees (1, 2) of the program at (2, 0)."""
    seen = ToolPlacement(1.0, 0.0, 0.5, math.pi / 2).in_base(np.array([[1.0, 2.0, 0.75]]))
    np.testing.assert_allclose(seen, [[2.0, 0.0, 0.25]], atol=1e-15)


def test_speed_beyond_a_limit_names_joint_time_and_line():
    with refused(MotionError, ("part.gcode, line 3", "joint '"), "0.2 rad/s") as error:
        together(motion(limits=limits(velocity=0.2)))
    assert re.search(r"-?0\.\d+ rad/s at \d\.\d+ s", error.value.found)


def test_what_is_out_of_reach_has_its_line_and_time():
    """The arm of 1.1 m leaves its reach on the second line, from (0.7, -0.2) along x at
    x = sqrt(1.1^2 - 0.2^2) = 1.0817 m: some 3.1 s later at 125 mm/s."""
    with refused(MotionError, "line 4", "1.1 m") as caught:
        together(motion("G1 X700 F7500\nG1 X2000\n"))
    time = float(re.findall(r"at (\d+\.\d+) s", caught.value.found)[0])
    assert time == pytest.approx((1.0817 - 0.5) / 0.125 + 0.0625 / 2 + 0.01, abs=0.02)


def test_a_jump_between_solutions_is_refused():
    class Jumps(TwoLinks):
        def solve(self, tool_position, start):
            joints = super().solve(tool_position, start)
            joints[len(joints) // 2 :, 1] *= -1
            return joints

    path = TimedPath(ToolPath([LineSegment((0.5, 0, 0), (0.7, 0, 0), 0.1, 12)]))
    planned = ToolMotion(path, Jumps(), np.zeros(2), limits())
    with refused(MotionError, found=("line 12", "'elbow'"), expected="0.5 rad"):
        together(planned)


def test_too_many_steps_are_refused():
    with refused(MotionError, found=("8.279 s", "1e-08 s")):
        motion(step=1e-8)
    with refused(MotionError, found="0.0 s"):
        motion(step=0.0)


BASES = {
    "mantis": ToolPlacement(-1.2, -0.2, 0.0),
    "testbed": ToolPlacement(),
    "irb4600": ToolPlacement(-1.0, 0.15, 0.0),
}


@pytest.mark.parametrize("name", BASES)
def test_the_nozzle_of_every_printing_robot_follows_the_wall(name, tmp_path, monkeypatch):
    """Forward kinematics of the joint motion give the path of paper B back, in many blocks."""
    monkeypatch.setattr(tool_motion, "BLOCK", 100)
    program = tmp_path / "wall.gcode"
    program.write_text(Wall(length=0.4, width=0.2).gcode())
    robot = Robot.from_model(load(name))
    options = ToolOptions(placement=BASES[name], step=0.02)
    planned = load_motion(program, robot, options).motion
    time, q, _, _ = together(planned)
    wanted = planned._path.sample(time).position
    for row in range(0, len(time), 40):
        base = np.array([BASES[name].x, BASES[name].y, BASES[name].z])
        tool = robot.link_position(q[row], "tool0") + base
        heights = slice(0, 2 if name == "mantis" else 3)
        np.testing.assert_allclose(tool[heights], wanted[row][heights], atol=1e-8)
    np.testing.assert_allclose(q[-1], q[0], atol=1e-7)  # a closed path, redundant or not


def test_smoothing_can_be_none_where_corners_are_stops():
    path = TimedPath(read_gcode("G0 X500 Y0 Z0\nG1 X600 F6000\n").path, ToolLimits(1.0, 0.0, 0.0))
    time, q, _, _ = together(ToolMotion(path, TwoLinks(), np.zeros(2), limits()))
    assert time[-1] == pytest.approx(path.duration)
    assert np.isfinite(q).all()
