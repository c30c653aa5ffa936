"""Energy over what was done with it: a turn by hand, parts, noise, another cutting."""

import math

import numpy as np
import pytest

import robot_energy as re
import robots
from places import ROOT
from robot_energy.inputs.joint_states.decode import joint_block
from robot_energy.model import load
from robot_energy.physics.rigid_body import Robot
from robot_energy.pipeline import EnergyPipeline, Output
from robot_energy.pipeline.work_sums import TOOL, WorkSums
from robot_energy.replay.bag_replay import replay
from robot_energy.timeline.blocks import PowerBlock, TorqueBlock
from robot_energy_plan.motion.planned import SampledMotion
from robot_energy_plan.motion.ptp import Trajectory
from robot_energy_plan.motion.tool_motion import ToolPlacement

MODEL = load("kr16")
WALL = ROOT / "src/examples/programs/wall_layer.gcode"
POSE = np.array([0.0, -0.4, 0.5, 0.0, 1.0, 0.0])
ANGLE, RATE = 1.2, 0.5 * math.pi  # rad of the first joint, rad/s


class Turn:
    """Joint 1 turns and comes back, in 4 s; nothing is lifted."""

    def sample(self, time):
        position = np.tile(POSE, (len(time), 1))
        position[:, 0] = 0.5 * ANGLE * (1.0 - np.cos(RATE * time))
        velocity, acceleration = np.zeros_like(position), np.zeros_like(position)
        velocity[:, 0] = 0.5 * ANGLE * RATE * np.sin(RATE * time)
        acceleration[:, 0] = 0.5 * ANGLE * RATE**2 * np.cos(RATE * time)
        return Trajectory(position, velocity, acceleration)


def predicted(repeat=1):
    motion = SampledMotion(Turn(), MODEL.joint_names, 4.0)
    return re.predict(motion, MODEL, 40.0, repeat=repeat).report


def test_a_turn_of_the_first_joint_by_hand():
    report, robot = predicted(), Robot.from_model(MODEL)
    found = report.normalised
    reach = math.hypot(*robot.link_position(POSE, TOOL)[:2])
    assert found.tool_path == pytest.approx(2 * ANGLE * reach, rel=1e-3)  # an arc, there and back
    still, pose = np.zeros((1, 6)), POSE[None, :]
    unit = np.eye(6)[:1]
    torque = robot.joint_torque(pose, still, unit) - robot.joint_torque(pose, still, still)
    first = MODEL.joints[0]
    inertia = torque[0, 0] + first.gear_ratio.value**2 * first.rotor_inertia.value
    kinetic = 0.5 * inertia * (0.5 * ANGLE * RATE) ** 2  # at the greatest speed, once each way
    assert found.body_work == pytest.approx(2 * kinetic, rel=1e-3)
    assert found.body_work_share == pytest.approx(2 * kinetic / report.energy.net, rel=1e-3)
    assert found.energy_per_metre == pytest.approx(report.energy.net / found.tool_path)


def test_a_repeated_program_has_the_energy_of_one_part():
    report = predicted(3)
    (part,) = report.normalised.parts
    assert part.count == 3
    assert part.energy == pytest.approx(report.energy.net / 3)
    assert report.normalised.tool_path == pytest.approx(3 * predicted().normalised.tool_path)


def test_the_path_of_a_printed_layer_is_that_of_its_program():
    tool = re.ToolOptions(placement=ToolPlacement(-1.2, -0.2))
    report = re.predict(WALL, "mantis", 40.0, tool=tool).report
    assert report.normalised.tool_path == pytest.approx(report.tool.length, rel=1e-2)


def test_however_the_samples_are_cut():
    outputs = []
    whole = replay(ROOT / "bags/kr16_all_topics", MODEL, on_output=outputs.append).work
    assert whole.tool_path > 1.0
    torque = TorqueBlock.concatenate([one.torque for one in outputs if one.torque is not None])
    power = PowerBlock.concatenate([one.power for one in outputs if one.power is not None])
    cut = WorkSums(Robot.from_model(MODEL))
    for block, kind in ((torque, "torque"), (power, "power")):
        for first in range(0, len(block), 7):
            cut.take(Output(**{kind: block[slice(first, first + 7)]}))
    assert cut.tool_path == pytest.approx(whole.tool_path, rel=1e-12)
    assert cut.body_work == pytest.approx(whole.body_work, rel=1e-12)


def test_noise_of_the_encoders_is_no_path_and_a_robot_without_a_tool_has_none():
    random = np.random.default_rng(1)
    position = POSE + 1e-6 * random.standard_normal((5000, 6))
    stamp = np.arange(5000) * 10_000_000
    still = WorkSums(Robot.from_model(MODEL))
    pipeline = EnergyPipeline(MODEL)
    block = joint_block(stamp + 1, position, np.zeros_like(position))
    still.take(pipeline.step(block))
    still.take(pipeline.flush())
    assert still.tool_path == 0.0
    assert math.isnan(WorkSums(Robot.from_model(robots.two_link())).tool_path)
