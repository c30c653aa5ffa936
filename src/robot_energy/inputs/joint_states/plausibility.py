"""Joint states checked against the limits of the robot: units, robot, robot at all.

A velocity beyond the robot that its positions do not support is refused; others are flagged.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import Described
from robot_energy.inputs.joint_states.decode import Mask
from robot_energy.inputs.joint_states.publisher_conflicts import shortest
from robot_energy.inputs.parameters import POSITIONS
from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.physics.urdf.checks import JointLimits
from robot_energy.timeline.blocks import (
    NANOSECOND,
    Float,
    Int,
    JointBlock,
    Quality,
    differences,
    mark,
)

SLACK = 0.05  # share of its range that a joint may be beyond a limit
MIN_SLACK = 0.05  # rad or m
MAX_SPEED_RATIO = 2.0  # times its velocity limit
FAR = 4.0  # times a limit, beyond which another unit explains a position
ZEROS_NS = 5_000_000_000  # all joints exactly zero for so long is suspicious
DEGREES = 180 / np.pi
MILLIMETRES = 1000.0
EVERY_NS = 250_000_000  # how often velocity and position are compared
PAIRS = 24  # comparisons that make a verdict
MIN_SPEED = 0.05  # slower joints say nothing of their velocities [rad/s] or [m/s]
MIN_MOVING_PAIRS = 3  # that show a joint in motion; a joint whose zero is set again shows one
MIN_AGREEMENT = 0.8  # share of the velocity that must follow the positions
MAX_PAIR_TIME_NS = 100_000_000
ALWAYS_ZERO = "the velocity of {} stays 0 while its positions move"
IMPOSSIBLE_VELOCITY = "impossible_velocity"  # the reason under which such messages are counted
MIN_SUPPORT = 0.25  # share of a velocity that the step of the position must show


class JointStateProblem(Described):
    """Something that makes joint states doubtful."""

    sentence: str
    first_ns: Annotated[int, "Stamp of the first sample concerned. [ns]"]
    last_ns: int
    severe: Annotated[bool, "Whether samples cannot be used because of it."] = False
    everywhere: Annotated[bool, "Whether it concerns all samples, so that no figure is right."] = (
        False
    )
    setting: Annotated[str, "Line of the parameter file that mends it, where one does."] = ""
    wrong_power: Annotated[
        bool, "Whether velocities, or a unit, are wrong, so that the power of every sample is."
    ] = False


class _Seen:
    """First and last stamp of something."""

    def __init__(self) -> None:
        self.first_ns: int | None = None
        self.last_ns = 0

    def note(self, stamp_ns: Int) -> None:
        if self.first_ns is None:
            self.first_ns = int(stamp_ns[0])
        self.last_ns = int(stamp_ns[-1])

    def finding(self, sentence: str, wrong_power: bool = False) -> list[JointStateProblem]:
        if self.first_ns is None:
            return []
        return [JointStateProblem(sentence, self.first_ns, self.last_ns, wrong_power=wrong_power)]


class Plausibility:
    """Flags samples that cannot be right as they are; never changes one.

    Three things are looked at: positions and velocities beyond the limits of the URDF (the
    wrong unit, or another robot with the same names of joints); all joints exactly zero for
    five seconds (a driver without a robot); and, on some of the samples, velocities that
    the positions contradict (deg/s, a wrong sign, zeros of a driver that knows no velocity).
    """

    def __init__(self, joint_names: Sequence[str], limits: JointLimits | None = None) -> None:
        self._names = tuple(joint_names)
        n_joints = len(self._names)
        self._limits = limits
        wide = np.full(n_joints, np.inf)
        self._low, self._high, self._fastest = -wide, wide, wide
        self._wraps = np.zeros(n_joints, dtype=np.bool_)
        if limits is not None:
            spread = limits.upper - limits.lower
            slack = np.maximum(SLACK * np.where(np.isfinite(spread), spread, 0.0), MIN_SLACK)
            self._low, self._high = limits.lower - slack, limits.upper + slack
            self._fastest = MAX_SPEED_RATIO * limits.velocity
            self._wraps = limits.wraps
        self._any_wraps = bool(self._wraps.any())
        self._beyond, self._zeros, self._astray = _Seen(), _Seen(), _Seen()
        self._least, self._most, self._speed = wide, -wide, np.zeros(n_joints)
        self._zero_since: int | None = None
        self._zero_for = 0
        self._last: tuple[int, int, Float, Float] | None = None
        self._pairs: Float = np.empty((0, 2, n_joints))  # mean velocity, slope of position
        self._ratio = (0, 1.0)  # joint and ratio of the last verdict

    def step(self, block: JointBlock) -> None:
        """Look at samples in time order; set ``JOINT_STATE_IMPLAUSIBLE`` in place."""
        beyond = (block.joint_position > self._high) | (block.joint_position < self._low)
        beyond |= np.abs(block.joint_velocity) > self._fastest
        if bool(beyond.any()):
            rows = np.logical_or.reduce(beyond, axis=1)
            mark(block.quality, rows, Quality.JOINT_STATE_IMPLAUSIBLE)
            self._note_beyond(block, rows)
        position = block.joint_position
        if self._zero_since is not None or np.count_nonzero(position) < position.size:
            self._check_zeros(block)
        before, last = self._last, len(block) - 1
        stamp, segment, velocity = block.stamp_ns, block.segment, block.joint_velocity
        self._last = int(stamp[last]), int(segment[last]), position[last], velocity[last]
        known = int(stamp[0]) if before is None else before[0]
        rows = np.flatnonzero(differences(stamp // EVERY_NS, known // EVERY_NS))
        if len(rows):
            self._check_velocities(block, rows, before)

    def refused(self, block: JointBlock) -> None:
        """Note messages that were refused for their velocity: they may show the unit."""
        self._note_beyond(block, np.ones(len(block), dtype=np.bool_))

    def findings(self) -> list[JointStateProblem]:
        """Return what was found so far, one sentence each."""
        found: list[JointStateProblem] = []
        if self._beyond.first_ns is not None:
            found += self._beyond.finding(*self._beyond_limits())
        found += self._zeros.finding(
            "all joints have been exactly zero (position and velocity) for "
            f"{self._zero_for * NANOSECOND:.0f} s: is the driver connected to a robot?"
        )
        if self._astray.first_ns is not None:
            found += self._astray.finding(self._ratio_sentence(), wrong_power=True)
        return found

    def _note_beyond(self, block: JointBlock, rows: NDArray[np.bool_]) -> None:
        self._beyond.note(block.stamp_ns[rows])
        position = block.joint_position[rows]
        self._least = np.fmin(self._least, np.fmin.reduce(position, axis=0))
        self._most = np.fmax(self._most, np.fmax.reduce(position, axis=0))
        speed = np.nan_to_num(np.abs(block.joint_velocity[rows]))
        self._speed = np.maximum(self._speed, speed.max(axis=0))

    def _check_zeros(self, block: JointBlock) -> None:
        zero = (block.joint_position == 0).all(axis=1) & (
            (block.joint_velocity == 0) | np.isnan(block.joint_velocity)
        ).all(axis=1)
        size = len(zero)
        index = np.arange(size)
        broken = np.maximum.accumulate(np.where(zero, -1, index))  # last row that was not zero
        stamp = block.stamp_ns
        since = stamp[np.minimum(broken + 1, size - 1)]
        if self._zero_since is not None:
            since = np.where(broken < 0, self._zero_since, since)
        rows = zero & (stamp - since >= ZEROS_NS)
        if bool(rows.any()):
            mark(block.quality, rows, Quality.JOINT_STATE_IMPLAUSIBLE)
            self._zeros.note(stamp[rows])
            self._zero_for = max(self._zero_for, int((stamp - since)[rows].max()))
        self._zero_since = int(since[-1]) if zero[-1] else None

    def _check_velocities(
        self, block: JointBlock, rows: Int, before: tuple[int, int, Float, Float] | None
    ) -> None:
        """Compare velocity with the slope of the position at some samples, four a second."""
        stamp, segment = block.stamp_ns, block.segment
        position, velocity = block.joint_position, block.joint_velocity
        elapsed = stamp[rows] - stamp[rows - 1]
        same = segment[rows] == segment[rows - 1]
        step = position[rows] - position[rows - 1]
        mean = 0.5 * (velocity[rows] + velocity[rows - 1])
        if rows[0] == 0:
            same[0] = before is not None and before[1] == segment[0]
            if before is not None:
                elapsed[0] = stamp[0] - before[0]
                step[0] = position[0] - before[2]
                mean[0] = 0.5 * (velocity[0] + before[3])
        good = same & (elapsed > 0) & (elapsed <= MAX_PAIR_TIME_NS)
        good &= np.isfinite(mean).all(axis=1)
        if self._any_wraps:
            step[:, self._wraps] = shortest(step[:, self._wraps])
        slope = step[good] / (elapsed[good] * NANOSECOND)[:, None]
        pairs = np.empty((len(slope), 2, len(self._names)))
        pairs[:, 0], pairs[:, 1] = mean[good], slope
        self._pairs = np.concatenate([self._pairs, pairs])
        while len(self._pairs) >= PAIRS:
            self._compare(self._pairs[:PAIRS], stamp[rows])
            self._pairs = self._pairs[PAIRS:]

    def _compare(self, pairs: Float, stamp_ns: Int) -> None:
        given, slope = pairs[:, 0], pairs[:, 1]
        of_given, of_slope = (given**2).sum(axis=0), (slope**2).sum(axis=0)
        both = (given * slope).sum(axis=0)
        moves = of_slope > PAIRS * MIN_SPEED**2
        moves &= both**2 > MIN_AGREEMENT * of_given * of_slope
        ratio = np.ones(len(both))
        ratio[moves] = of_given[moves] / both[moves]
        moving = (np.abs(slope) > MIN_SPEED).sum(axis=0) >= MIN_MOVING_PAIRS
        ratio[moving & (of_given == 0)] = 0.0
        wrong = (ratio < 0.5) | (ratio > 2.0)
        if bool(wrong.any()):
            joint = int(np.argmax(wrong))
            self._ratio = (joint, float(ratio[joint]))
            self._astray.note(stamp_ns)

    def _beyond_limits(self) -> tuple[str, bool]:
        """Name the joint that is furthest out; and whether another unit explains it."""
        limits = self._limits
        if limits is None:
            return "", False
        above, below = self._most - self._high, self._low - self._least
        out = np.maximum(above, below)
        fast = self._speed - self._fastest
        if bool((out > 0).any()):
            joint = int(np.argmax(out))
            value = self._most[joint] if above[joint] > below[joint] else self._least[joint]
            what = (
                f"{self._names[joint]} is at {value:.4g}, its limits are "
                f"{limits.lower[joint]:.4g} to {limits.upper[joint]:.4g} {limits.unit(joint)}"
            )
        else:
            joint = int(np.argmax(fast / limits.velocity))
            what = (
                f"{self._names[joint]} moves at {self._speed[joint]:.4g}, its limit is "
                f"{limits.velocity[joint]:.4g} {limits.unit(joint)}/s"
            )
        wrong = (out > 0) | (fast > 0)
        kind = limits.prismatic
        unit, factor = ("millimetres", MILLIMETRES) if kind[wrong].all() else ("degrees", DEGREES)
        scale = np.where(kind == kind[wrong].all(), factor, 1.0)
        positions = bool((out > 0).any())
        least, most = self._least / scale, self._most / scale
        fits = (least >= self._low) & (most <= self._high) | (not positions)
        fits &= self._speed / scale <= self._fastest
        size = np.maximum(np.abs(self._least), np.abs(self._most))
        reach = np.maximum(np.abs(limits.lower), np.abs(limits.upper))
        if bool(fits.all()) and bool((size > FAR * reach)[wrong].any() or not positions):
            subject = "joint states look" if positions else "velocities look"
            return f"{what}: the {subject} like {unit}{'' if positions else ' per second'}", True
        return f"{what}: is this the model of the robot, and are the units rad and m?", False

    def _ratio_sentence(self) -> str:
        joint, ratio = self._ratio
        name = self._names[joint]
        if ratio == 0:
            return f"{ALWAYS_ZERO.format(name)}: set joint_states.velocity_source to {POSITIONS}"
        if ratio < 0:
            return f"the velocity of {name} has the opposite sign of the change of its positions"
        looks = ""
        if abs(ratio / DEGREES - 1) < 0.2:
            looks = ": it looks like degrees per second"
        if abs(ratio * DEGREES - 1) < 0.2:
            looks = ": the positions look like degrees"
        return f"the velocity of {name} is {ratio:.3g} times the change of its positions{looks}"


class VelocityCheck:
    """Refuses messages with a velocity beyond the robot that their positions do not support.

    A joint that is faster than some multiple of its limit must have moved accordingly since
    the message before: else the velocity is an outlier, or has another unit than the
    position, and its energy would be wrong by orders of magnitude. Where the positions do
    follow, the limit or the unit of both is wrong: the message is used, and flagged by
    `Plausibility`. The very first message waits for the second, in the same way.

    Args:
        limits: Limits from the URDF; None, or a joint without a limit, refuses nothing.
        ratio: How many times its limit a joint may be fast without being looked at. [-]

    Attributes:
        held: A message that waits for the next one; None if there is none.
    """

    def __init__(
        self,
        n_joints: int,
        limits: JointLimits | None,
        ratio: float,
        log: RejectionLog,
        plausibility: Plausibility,
    ) -> None:
        velocity = np.full(n_joints, np.inf) if limits is None else ratio * limits.velocity
        self._log, self._plausibility = log, plausibility
        self._fastest = velocity if bool(np.isfinite(velocity).any()) else None
        self._wraps = np.zeros(n_joints, dtype=np.bool_) if limits is None else limits.wraps
        self.restart()

    def restart(self) -> None:
        """Forget the last positions, and what waits."""
        n_joints = len(self._wraps)
        self._stamp: Int = np.full(n_joints, -1, dtype=np.int64)  # of the last position, or -1
        self._position: Float = np.full(n_joints, np.nan)
        self.held: JointBlock | None = None

    def step(self, block: JointBlock) -> JointBlock | None:
        """Return the messages that can be used, with the one that waited before, or None."""
        if self._fastest is None:
            return block
        if self.held is not None:
            block, self.held = JointBlock.concatenate([self.held, block]), None
        fast = np.abs(block.joint_velocity) > self._fastest
        bad: Mask | None = None
        if bool(fast.any()):
            first = bool((self._stamp < 0).all()) and bool(fast[0].any())
            if first and len(block) == 1:
                self.held = block
                return None
            bad = np.logical_or.reduce(fast & ~self._supported(block, first), axis=1)
        last = block.joint_position[-1]
        if not bool(np.isnan(last).any()):
            self._stamp[:] = block.stamp_ns[-1]
            self._position = last.copy()
        else:
            self._remember_parts(block)
        if bad is None or not bool(bad.any()):
            return block
        self._refuse(block[bad])
        return None if bool(bad.all()) else block[~bad]

    def flush(self) -> None:
        """Refuse what still waits: nothing supports it."""
        if self.held is not None:
            self._refuse(self.held)
        self.held = None

    def _refuse(self, block: JointBlock) -> None:
        self._log.reject(IMPOSSIBLE_VELOCITY, len(block))
        self._plausibility.refused(block)

    def _supported(self, block: JointBlock, first: bool) -> Mask:
        """Whether each position has moved as its velocity says, shape (N, n)."""
        stamp = np.repeat(block.stamp_ns[:, None], len(self._stamp), axis=1)
        position = block.joint_position
        known = np.concatenate([self._stamp[None] >= 0, ~np.isnan(position)])
        row = np.where(known, np.arange(len(known))[:, None], 0)
        row = np.maximum.accumulate(row, axis=0)[:-1]  # that brought the position before
        stamp_before = np.take_along_axis(np.concatenate([self._stamp[None], stamp]), row, 0)
        before = np.take_along_axis(np.concatenate([self._position[None], position]), row, 0)
        elapsed, step = stamp - stamp_before, position - before
        elapsed[stamp_before < 0] = 0
        if first:
            elapsed[0], step[0] = elapsed[1], step[1]
        step[:, self._wraps] = shortest(step[:, self._wraps])
        enough = MIN_SUPPORT * np.abs(block.joint_velocity) * (elapsed * NANOSECOND)
        return (elapsed > 0) & (np.abs(step) >= enough)

    def _remember_parts(self, block: JointBlock) -> None:
        """Keep the newest position of each joint, where no message has all."""
        for joint in range(len(self._stamp)):
            rows = np.flatnonzero(~np.isnan(block.joint_position[:, joint]))
            if len(rows):
                self._stamp[joint] = block.stamp_ns[rows[-1]]
                self._position[joint] = block.joint_position[rows[-1], joint]
