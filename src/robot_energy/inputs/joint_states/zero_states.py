"""States of nothing but zeros, which a second publisher sends next to those of the robot."""

from __future__ import annotations

import numpy as np

from robot_energy.foundation.units import SECOND_NS
from robot_energy.inputs.joint_states.decode import ZERO_STATE, Mask
from robot_energy.inputs.joint_states.jumps import PositionJumpDetector
from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.physics.urdf.checks import JointLimits
from robot_energy.timeline.blocks import Float, Int, JointBlock

BESIDE_NS = SECOND_NS  # this long after another state, zeros may be those of the robot
KNOWN = 3  # states of zeros that show their publisher


class ZeroStateFilter:
    """Leaves out messages in which all joints are exactly zero and stand, between others.

    A ``joint_state_publisher`` without sliders, or a driver without its robot, sends such states
    next to the driver. They are found where no motion leads from the state before to zero, or
    where they have its stamp; once three were, every state of zeros within a second of another
    one is left out. The robot's own states stay in use, which the check for a second publisher
    would refuse with them. A robot that stands at zero is left alone.

    Args:
        limits: Limits from the URDF; None to allow what any joint can do.
    """

    def __init__(self, n_joints: int, limits: JointLimits | None, log: RejectionLog) -> None:
        self._log = log
        self._steps = PositionJumpDetector.of(n_joints, limits)
        self.count = self.first_ns = self.last_ns = 0
        self.restart()

    def restart(self) -> None:
        """Forget the last state, and what waits."""
        self._last: tuple[int, Float] | None = None  # that is not all zero
        self._held: JointBlock | None = None  # zeros before all other states wait for the next
        self._begun = False

    @property
    def waiting(self) -> int:
        """Messages that wait for the next one: 0 or 1."""
        return 0 if self._held is None else 1

    def flush(self) -> None:
        """Count what still waits: one state alone is of no use."""
        self._log.reject(ZERO_STATE, self.waiting)
        self._held = None

    @property
    def finding(self) -> str:
        """What is wrong, in one sentence; empty if nothing is."""
        if not self.count:
            return ""
        return (
            f"{self.count} joint states in which all joints are exactly zero come between others, "
            "as of a second publisher: they are left out; stop it, or name the topics in "
            "joint_states.topics"
        )

    def step(self, block: JointBlock) -> JointBlock | None:
        """Return the messages without those of a publisher of zeros, or None.

        Args:
            block: One or more, one sample each, in order of arrival.
        """
        if self._held is not None:
            block, self._held = JointBlock.concatenate([self._held, block]), None
        zero, other = self._kinds(block)
        rows, others = np.flatnonzero(zero), np.flatnonzero(other)
        if not self._begun and len(block) == len(rows) == 1:
            self._held = block
            return None
        stamp, position = block.stamp_ns, block.joint_position
        if not self._begun and zero[0] and other[1]:
            self._last = int(stamp[1]), position[1]
        self._begun = True
        foreign = self._foreign(stamp, position, rows, others) if len(rows) else []
        if len(others):
            self._last = int(stamp[others[-1]]), position[others[-1]].copy()
        if not foreign:
            return block
        self.first_ns = self.first_ns if self.count else int(stamp[foreign[0]])
        self.last_ns = int(stamp[foreign[-1]])
        self.count += len(foreign)
        self._log.reject(ZERO_STATE, len(foreign))
        left: Mask = np.ones(len(block), dtype=np.bool_)
        left[foreign] = False
        return block[left] if bool(left.any()) else None

    @staticmethod
    def _kinds(block: JointBlock) -> tuple[Mask, Mask]:
        """Which messages are all zero, and which of the others have all joints, shape (N,) each."""
        position, velocity = block.joint_position, block.joint_velocity
        full = ~np.isnan(position.sum(axis=1))
        zero = full & (position[:, 0] == 0)
        if bool(zero.any()):
            zero &= (position == 0).all(axis=1)
            zero &= ((velocity == 0) | np.isnan(velocity)).all(axis=1)
        return zero, full & ~zero

    def _foreign(self, stamp: Int, position: Float, rows: Int, others: Int) -> list[int]:
        """Which of the rows of zeros come next to another state."""
        found: list[int] = []
        before = np.searchsorted(others, rows) - 1
        for row, place in zip(rows.tolist(), before.tolist(), strict=True):
            at, other = int(stamp[row]), self._last
            if place >= 0:
                other = int(stamp[others[place]]), position[others[place]]
            if other is None or abs(at - other[0]) > BESIDE_NS:
                continue
            known = at == other[0] or self.count + len(found) >= KNOWN
            zero = at, position[row]
            if known or not self._steps.reaches(*sorted((other, zero), key=_stamp)):
                found.append(row)
        return found


def _stamp(sample: tuple[int, Float]) -> int:
    return sample[0]
