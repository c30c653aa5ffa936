"""Velocities that no motion of the robot explains."""

from __future__ import annotations

import numpy as np

from robot_energy.blocks import NANOSECOND, Float, Int, in_any_joint
from robot_energy.inputs.joint_states.decode import JointReadings, Mask
from robot_energy.inputs.joint_states.jumps import shortest
from robot_energy.physics.urdf.checks import JointLimits

IMPOSSIBLE_VELOCITY = "impossible_velocity"  # the reason under which such messages are counted
MIN_SUPPORT = 0.25  # share of a velocity that the step of the position must show


class VelocityCheck:
    """Refuses messages with a velocity beyond the robot that their positions do not support.

    A joint that is faster than some multiple of its limit must have moved accordingly since
    the message before: else the velocity is an outlier, or has another unit than the
    position, and its energy would be wrong by orders of magnitude. Where the positions do
    follow, the limit or the unit of both is wrong: the message is used, and flagged by
    `Plausibility`. The very first message waits for the second, in the same way.

    Args:
        n_joints: Number of joints of the model.
        limits: Limits from the URDF; None, or a joint without a limit, refuses nothing.
        ratio: How many times its limit a joint may be fast without being looked at. [-]

    Attributes:
        refused: What the last step refused; None for nothing.
    """

    def __init__(self, n_joints: int, limits: JointLimits | None, ratio: float) -> None:
        velocity = np.full(n_joints, np.inf) if limits is None else ratio * limits.velocity
        self.refused: JointReadings | None = None
        self._fastest = velocity if bool(np.isfinite(velocity).any()) else None
        self._wraps = np.zeros(n_joints, dtype=np.bool_) if limits is None else limits.wraps
        self._stamp: Int = np.full(n_joints, -1, dtype=np.int64)  # of the last position, or -1
        self._position: Float = np.full(n_joints, np.nan)
        self._held: JointReadings | None = None

    @property
    def waiting(self) -> int:
        """Messages that wait for the next one: 0 or 1."""
        return 0 if self._held is None else 1

    def step(self, readings: JointReadings) -> JointReadings | None:
        """Take messages in order of arrival; return those that can be used, None for none."""
        self.refused = None
        if self._fastest is None:
            return readings
        fast = np.abs(readings.joint_velocity) > self._fastest
        if self._held is None and not bool(fast.any()):
            self._remember(readings)
            return readings
        if self._held is not None:
            readings, self._held = JointReadings.joined([self._held, readings]), None
            fast = np.abs(readings.joint_velocity) > self._fastest
        first = bool((self._stamp < 0).all()) and bool(fast[0].any())
        if first and len(readings) == 1:
            self._held = readings
            return None
        bad = in_any_joint(fast & ~self._supported(readings, first))
        self._remember(readings)
        if not bool(bad.any()):
            return readings
        self.refused = readings[bad]
        return None if bool(bad.all()) else readings[~bad]

    def flush(self) -> None:
        """Refuse what still waits: nothing supports it."""
        self.refused, self._held = self._held, None

    def _supported(self, readings: JointReadings, first: bool) -> Mask:
        """Whether each position has moved as its velocity says, shape (N, n)."""
        stamp = np.repeat(readings.stamp_ns[:, None], len(self._stamp), axis=1)
        position = readings.joint_position
        known = np.concatenate([self._stamp[None] >= 0, readings.mask])
        row = np.where(known, np.arange(len(known))[:, None], 0)
        row = np.maximum.accumulate(row, axis=0)[:-1]  # that brought the position before
        stamp_before = np.take_along_axis(np.concatenate([self._stamp[None], stamp]), row, 0)
        before = np.take_along_axis(np.concatenate([self._position[None], position]), row, 0)
        elapsed, step = stamp - stamp_before, position - before
        elapsed[stamp_before < 0] = 0
        if first:
            elapsed[0], step[0] = elapsed[1], step[1]
        step[:, self._wraps] = shortest(step[:, self._wraps])
        enough = MIN_SUPPORT * np.abs(readings.joint_velocity) * (elapsed * NANOSECOND)
        return (elapsed > 0) & (np.abs(step) >= enough)

    def _remember(self, readings: JointReadings) -> None:
        """Keep the newest position of each joint."""
        if readings.present is None:
            self._stamp[:] = readings.stamp_ns[-1]
            self._position = readings.joint_position[-1].copy()
            return
        for joint in range(len(self._stamp)):
            rows = np.flatnonzero(readings.present[:, joint])
            if len(rows):
                self._stamp[joint] = readings.stamp_ns[rows[-1]]
                self._position[joint] = readings.joint_position[rows[-1], joint]
