"""Recorded joint states -> the trajectory that the robot followed, with its rests.

Positions are filtered without delay and differentiated. A robot that was commanded to rest does
not measure a velocity of exactly 0: where every joint is slower than `STILL` of its greatest
velocity, and stays within `MAX_CREEP`, the robot is taken to rest.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from robot_energy.bag.reader import TimeRange
from robot_energy.foundation.errors import MotionError
from robot_energy.model import RobotModel
from robot_energy.pipeline import Output, Settings
from robot_energy.replay.bag_replay import replay
from robot_energy.replay.replay_topics import Topics
from robot_energy.replay.setup import ReplaySetup
from robot_energy.timeline.blocks import NANOSECOND, Float, TorqueBlock
from robot_energy_plan.motion.joint_trajectory import JointTrajectory
from robot_energy_plan.motion.sampled_motion import motion_from_position, uniform
from robot_energy_plan.optimization.trajectory_form import MAX_CREEP

RATE = 100.0  # of the grid [Hz]
CUTOFF = 10.0  # of the filter [Hz]
KNOT_EVERY = 2  # samples of the grid between two points of the trajectory
STILL = 0.01  # of the greatest velocity of a joint, below which it rests [-]
MIN_STILL = 1e-3  # rad/s or m/s, for joints that hardly move
MAX_TIME = 900.0  # s


def recorded_motion(
    path: str | Path,
    model: RobotModel,
    time_range: TimeRange | None = None,
    topic: str | None = None,
) -> JointTrajectory:
    """Return the motion of recorded joint states, joint side; 20 ms between points.

    Args:
        time_range: Part of the bag, such as one cycle; None for all.
    """
    found: list[TorqueBlock] = []

    def keep(output: Output) -> None:
        if output.torque is not None and len(output.torque.stamp_ns):
            found.append(output.torque)

    topics, settings = Topics((topic,) if topic else None), Settings(power_period=None)
    setup = ReplaySetup(topics=topics, settings=settings, time_range=time_range)
    result = replay(path, model, setup, on_output=keep)
    expected = f"one recorded cycle without a gap, at most {MAX_TIME:g} s long"
    remedy = "choose a part of the bag with --start and --end"
    if not found:
        raise MotionError(f"{path} has no motion in this part", expected, remedy)
    block = TorqueBlock.concatenate(found)
    cuts = np.flatnonzero(np.diff(block.segment))
    if cuts.size:
        gaps = (block.stamp_ns[cuts] - block.stamp_ns[0]) * NANOSECOND
        raise MotionError(
            f"{path} has a gap {gaps[0]:.3f} s after the first joint state", expected, remedy
        )
    length = float(block.stamp_ns[-1] - block.stamp_ns[0]) * NANOSECOND
    if not 0.5 < length <= MAX_TIME:
        raise MotionError(f"{path} has {length:.4g} s of joint states", expected, remedy)
    position = uniform(block.stamp_ns, block.joint_position, RATE)
    motion = motion_from_position(position, RATE, CUTOFF)
    rows = slice(None, None, KNOT_EVERY)
    position, velocity, acceleration, kept = _with_rests(
        motion.joint_position[rows], motion.joint_velocity[rows], motion.joint_acceleration[rows]
    )
    step = KNOT_EVERY / RATE
    if len(position) < 2:
        raise MotionError(f"{path} has no rest in this part", "moves between rests", remedy)
    time = np.arange(len(position)) * step
    trajectory = JointTrajectory(
        model.joint_names, time, position, velocity, acceleration, str(path)
    )
    trajectory.notes = (
        f"{path} is a recording: its positions passed a filter of {CUTOFF:g} Hz; a rest is where "
        f"every joint is slower than {100 * STILL:.0f} % of its greatest velocity",
        f"of {length:.4g} s recorded, those from the first to the last rest are used: "
        f"{kept.start * step:.4g} to {(kept.stop - 1) * step:.4g} s",
        *result.problems,
    )
    return trajectory


def _with_rests(
    position: Float, velocity: Float, acceleration: Float
) -> tuple[Float, Float, Float, slice]:
    """Make exact rests of those that were measured, and leave out what is cut off at the ends."""
    slow = np.maximum(STILL * np.abs(velocity).max(axis=0), MIN_STILL)
    still = np.asarray((np.abs(velocity) <= slow).all(axis=1))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]])))
    position, velocity, acceleration = position.copy(), velocity.copy(), acceleration.copy()
    rests: list[slice] = []
    for first, behind in edges.reshape(-1, 2).tolist():
        rows = slice(first, behind)
        if np.ptp(position[rows], axis=0).max() <= MAX_CREEP:
            position[rows] = position[rows].mean(axis=0)
            velocity[rows] = acceleration[rows] = 0.0
            rests.append(rows)
    for before, after in pairwise(rests):  # a jump there would be an acceleration that never was
        rows = slice(before.stop, after.start)
        own = (position[rows], velocity[rows], acceleration[rows])
        to_first = position[before.stop - 1] + _first_step(own[1][0], own[2][0]) - own[0][0]
        to_last = position[after.start] - _first_step(own[1][-1], -own[2][-1]) - own[0][-1]
        position[rows] += np.linspace(to_first, to_last, len(own[0]))
    kept = slice(rests[0].start, rests[-1].stop) if rests else slice(0)
    return position[kept], velocity[kept], acceleration[kept], kept


def _first_step(velocity: Float, acceleration: Float) -> Float:
    """How far joints get from rest until they have these: ``h v / 2 - h^2 a / 12``."""
    step = KNOT_EVERY / RATE
    return 0.5 * step * velocity - step**2 / 12.0 * acceleration
