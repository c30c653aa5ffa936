"""A JointTrajectory: its moves between rests, each made faster or slower in time.

The path stays; a move that takes ``1/f`` of its time has ``f`` times its velocities and ``f^2``
times its accelerations. A trajectory states no limits of acceleration, so no joint accelerates
harder than it does somewhere in the trajectory as given.

Recorded joint states become such a trajectory: positions are filtered without delay and
differentiated. A robot that was commanded to rest does not measure a velocity of exactly 0: where
every joint is slower than `RESTING` of its greatest velocity, and stays within `MAX_CREEP`, the
robot is taken to rest.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from robot_energy.bag.reader import TimeRange
from robot_energy.foundation.errors import MotionError
from robot_energy.model import RobotModel
from robot_energy.physics.rigid_body import Robot
from robot_energy.pipeline import Output, Settings
from robot_energy.replay.bag_replay import replay
from robot_energy.replay.setup import ReplaySetup, Topics
from robot_energy.timeline.blocks import NANOSECOND, Float, Int, TorqueBlock
from robot_energy_plan.motion.joint_trajectory import JointTrajectory
from robot_energy_plan.motion.ptp import DEFAULT_JERK_TIME, Trajectory
from robot_energy_plan.motion.sampled_motion import motion_from_position, uniform
from robot_energy_plan.optimization.chain import SPEEDS, Candidates, Moves
from robot_energy_plan.optimization.program_form import WrittenTrajectory

STILL = 1e-4  # rad/s or m/s, below which all joints rest
MAX_CREEP = 2e-3  # rad or m; a joint that turns less in a move or in a rest is at rest
PROBES = 200  # of a move, for its greatest velocity and acceleration
RATE = 100.0  # of the grid [Hz]
CUTOFF = 10.0  # of the filter [Hz]
KNOT_EVERY = 2  # samples of the grid between two points of the trajectory
RESTING = 0.01  # of the greatest velocity of a joint, below which it rests [-]
MIN_STILL = 1e-3  # rad/s or m/s, for joints that hardly move
MAX_TIME = 900.0  # s


class _StretchedMoves(Moves):
    """Moves of a trajectory from ``begin`` to ``end``, stretched in time.

    Attributes:
        hardest: Greatest acceleration of each joint in the moves in which it moves, infinite where
            there are none, shape (n,). [rad/s^2] or [m/s^2]
        fastest: Greatest factor on the speed of each move, shape (K,). [-]
    """

    def __init__(self, motion: JointTrajectory, begin: Float, end: Float, velocity: Float) -> None:
        self.count = len(begin)
        self._motion, self._begin, self._length = motion, begin, end - begin
        inner = np.linspace(0.0, 1.0, PROBES)
        paths = [motion.sample(b + inner * (e - b)) for b, e in zip(begin, end, strict=True)]
        fast = np.array([np.abs(path.joint_velocity).max(axis=0) for path in paths])
        hard = np.array([np.abs(path.joint_acceleration).max(axis=0) for path in paths])
        # what a joint at rest shows in a recording is noise
        moved = np.array([np.ptp(path.joint_position, axis=0) > MAX_CREEP for path in paths])
        moved |= ~moved.any(axis=1, keepdims=True)
        most = np.where(moved, hard, 0.0).max(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            by_speed = np.where(fast > 0, velocity / fast, np.inf).min(axis=1)
            by_force = np.where(moved & (hard > 0), most / hard, np.inf).min(axis=1)
        self.hardest: Float = np.where(moved.any(axis=0), most, np.inf)
        self.fastest = np.maximum(np.minimum(by_speed, np.sqrt(by_force)), 1e-9)

    def factor(self, candidates: Candidates) -> Float:
        """Factor on the speed of each candidate, shape (P,). [-]"""
        return candidates.speed * self.fastest[candidates.move]

    def duration(self, candidates: Candidates) -> Float:
        return self._length[candidates.move] / self.factor(candidates)

    def sample(self, candidates: Candidates, place: Int, time: Float) -> Trajectory:
        factor = self.factor(candidates)[place]
        path = self._motion.sample(self._begin[candidates.move[place]] + time * factor)
        factor = factor[:, None]
        return Trajectory(
            path.joint_position, path.joint_velocity * factor, path.joint_acceleration * factor**2
        )

    def instants(self, candidates: Candidates, place: int) -> Float:
        move = candidates.move[place]
        points, length = self._motion.instants - self._begin[move], self._length[move]
        own = points[(points > 0.0) & (points < length)]
        return np.concatenate([[0.0], own, [length]]) / self.factor(candidates)[place]


class TrajectoryForm(WrittenTrajectory):
    """A trajectory."""

    def __init__(
        self, given: JointTrajectory, robot: Robot, path: str | Path, recorded: bool = False
    ) -> None:
        if set(given.joint_names) != set(robot.joint_names):
            raise MotionError(
                f"{path} moves {', '.join(given.joint_names)}",
                f"the joints of the model, {', '.join(robot.joint_names)}",
            )
        order = [given.joint_names.index(name) for name in robot.joint_names]
        at = given.sample(given.instants)
        motion = JointTrajectory(
            robot.joint_names, given.instants, at.joint_position[:, order],
            at.joint_velocity[:, order], at.joint_acceleration[:, order],
        )  # fmt: skip
        begin, end, needed = _rests(motion, str(path))
        moves = _StretchedMoves(motion, begin, end, robot.limits.velocity)
        hardest, count = moves.hardest, len(begin)
        super().__init__(
            robot=robot,
            moves=moves,
            base=Candidates(np.arange(count), 1.0 / moves.fastest, np.ones(count)),
            needed=needed,
            joint_position=motion.sample(begin).joint_position,
            labels=tuple(f"{b:.2f} s to {e:.2f} s" for b, e in zip(begin, end, strict=True)),
            speeds=SPEEDS,
            accelerations=np.ones(1),
            acceleration=hardest,
            jerk=hardest / DEFAULT_JERK_TIME,
            notes=(
                *given.notes,
                f"{path} states no acceleration limits: no joint accelerates harder than it does "
                "somewhere in it as given",
            ),
            recorded=recorded,
        )


def _rests(motion: JointTrajectory, name: str) -> tuple[Float, Float, Float]:
    """Begin and end of each move, and the rest before it."""
    time = motion.instants
    at = motion.sample(time)
    still = np.asarray((np.abs(at.joint_velocity) <= STILL).all(axis=1))
    still[[0, -1]] = True
    stops = np.flatnonzero(still)
    begin: list[float] = []
    end: list[float] = []
    needed: list[float] = []
    rest = 0.0
    for first, last in zip(stops[:-1].tolist(), stops[1:].tolist(), strict=True):
        inner = motion.sample(np.linspace(time[first], time[last], PROBES))
        if (np.abs(inner.joint_velocity) <= STILL).all():
            rest += float(time[last] - time[first])
            continue
        begin.append(float(time[first]))
        end.append(float(time[last]))
        needed.append(rest)
        rest = 0.0
    if not begin:
        raise MotionError(f"{name} never moves", "a motion")
    needed[0] += rest  # the last rest is followed by the first move of the next cycle
    return np.array(begin), np.array(end), np.array(needed)


def recorded_motion(
    path: str | Path,
    model: RobotModel,
    time_range: TimeRange | None = None,
    topic: str | None = None,
) -> JointTrajectory:
    """Return the motion of recorded joint states, joint side; 20 ms between points."""
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
        f"every joint is slower than {100 * RESTING:.0f} % of its greatest velocity",
        f"of {length:.4g} s recorded, those from the first to the last rest are used: "
        f"{kept.start * step:.4g} to {(kept.stop - 1) * step:.4g} s",
        *result.problems,
    )
    return trajectory


def _with_rests(
    position: Float, velocity: Float, acceleration: Float
) -> tuple[Float, Float, Float, slice]:
    """Make exact rests of those that were measured, and leave out what is cut off at the ends."""
    slow = np.maximum(RESTING * np.abs(velocity).max(axis=0), MIN_STILL)
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
