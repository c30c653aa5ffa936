"""Velocities that no motion of the robot explains."""

from __future__ import annotations

import numpy as np

from robot_energy.inputs.joint_states.decode import Mask
from robot_energy.inputs.joint_states.jumps import shortest
from robot_energy.inputs.joint_states.plausibility import Plausibility
from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.physics.urdf.checks import JointLimits
from robot_energy.timeline.blocks import NANOSECOND, Float, Int, JointBlock

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
        limits: Limits from the URDF; None, or a joint without a limit, refuses nothing.
        ratio: How many times its limit a joint may be fast without being looked at. [-]
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
        self._held: JointBlock | None = None

    @property
    def waiting(self) -> int:
        """Messages that wait for the next one: 0 or 1."""
        return 0 if self._held is None else 1

    def step(self, block: JointBlock) -> JointBlock | None:
        """Return the messages that can be used, with the one that waited before, or None."""
        if self._fastest is None:
            return block
        fast = np.abs(block.joint_velocity) > self._fastest
        if self._held is None and not bool(fast.any()):
            self._remember(block)
            return block
        if self._held is not None:
            block, self._held = JointBlock.concatenate([self._held, block]), None
            fast = np.abs(block.joint_velocity) > self._fastest
        first = bool((self._stamp < 0).all()) and bool(fast[0].any())
        if first and len(block) == 1:
            self._held = block
            return None
        bad = np.logical_or.reduce(fast & ~self._supported(block, first), axis=1)
        self._remember(block)
        if not bool(bad.any()):
            return block
        self._refuse(block[bad])
        return None if bool(bad.all()) else block[~bad]

    def flush(self) -> None:
        """Refuse what still waits: nothing supports it."""
        if self._held is not None:
            self._refuse(self._held)
        self._held = None

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

    def _remember(self, block: JointBlock) -> None:
        """Keep the newest position of each joint."""
        last = block.joint_position[-1]
        if not bool(np.isnan(last).any()):
            self._stamp[:] = block.stamp_ns[-1]
            self._position = last.copy()
            return
        for joint in range(len(self._stamp)):
            rows = np.flatnonzero(~np.isnan(block.joint_position[:, joint]))
            if len(rows):
                self._stamp[joint] = block.stamp_ns[rows[-1]]
                self._position[joint] = block.joint_position[rows[-1], joint]
