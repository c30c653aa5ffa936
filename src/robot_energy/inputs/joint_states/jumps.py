"""Steps of positions that no motion makes, and whether they go forth and back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_energy.blocks import NANOSECOND, Float, Int, differences
from robot_energy.physics.urdf.checks import JointLimits
from robot_energy.timeline.stamps import SECOND_NS

Mask = NDArray[np.bool_]
Directions = NDArray[np.int8]

MAX_STEP_RATIO = 1.5  # times what the velocity limit allows
MIN_TIME = 0.005  # stamps jitter: a step is never judged by a shorter time [s]
MAX_SPEED = 20.0  # where the URDF knows no limit [rad/s] or [m/s]
MEMORY_NS = SECOND_NS  # a step back this long after a step forth belongs to it
FULL_TURN = 2 * np.pi


class PositionJumpDetector:
    """Watches the positions of some joints for leaps: steps too far for the joint's velocity.

    A leap that its neighbours do not continue is a lone one: no motion, whatever the unit or
    the limit. A second leap in the opposite direction within a second makes it forth and
    back. Leaps that follow each other in one direction are fast motion, or another unit.

    Args:
        fastest: Velocity limits, inf where there are none, shape (n,). [rad/s] or [m/s]
        wraps: Joints of which a full turn is no step, shape (n,).

    Attributes:
        lone: Direction of the last lone leap of each joint, 0 for none, shape (n,).
        lone_ns: Its stamp, shape (n,). [ns]
    """

    def __init__(self, fastest: Float, wraps: Mask) -> None:
        self._allowed = MAX_STEP_RATIO * np.where(np.isfinite(fastest), fastest, MAX_SPEED)
        self._always = self._allowed * MIN_TIME
        self._wraps = wraps
        self._any_wraps = bool(wraps.any())
        self._last: tuple[int, Float] | None = None
        self._before: Directions = np.zeros(len(fastest), dtype=np.int8)
        self.lone = self._before
        self.lone_ns: Int = np.zeros(len(fastest), dtype=np.int64)

    @classmethod
    def of(cls, n_joints: int, limits: JointLimits | None) -> PositionJumpDetector:
        """Watch all joints of a robot, by its limits if they are known.

        Args:
            n_joints: Number of joints of the model.
            limits: Limits from the URDF; without them (None) no joint has a limit or turns without
                end.

        Returns:
            A fresh detector.
        """
        if limits is None:
            return cls(np.full(n_joints, np.inf), np.zeros(n_joints, dtype=np.bool_))
        return cls(limits.velocity, limits.wraps)

    def joint(self, index: int) -> PositionJumpDetector:
        """Return a fresh watch of one of the joints.

        Args:
            index: Of the joint, 0 to n - 1.
        """
        one = slice(index, index + 1)
        return PositionJumpDetector(self._allowed[one] / MAX_STEP_RATIO, self._wraps[one])

    def begin_epoch(self) -> None:
        """Forget the last position: the next is no step."""
        self._last = None
        self._before = self.lone = np.zeros_like(self._before)

    @property
    def calm(self) -> bool:
        """Whether neither the last step was a leap nor a lone leap is remembered."""
        return not (self._before.any() or self.lone.any())

    def leaps(self, stamp_ns: Int, position: Float) -> Directions | None:
        """Return the direction of every leap, 0 where the step is possible.

        Args:
            stamp_ns: Rising, shape (N,), N >= 1. [ns]
            position: Shape (N, n). [rad] or [m]

        Returns:
            Shape (N, n); None if there is no leap.
        """
        before, start = position[0], int(stamp_ns[0])
        if self._last is not None:
            start, before = self._last
        self._last = (int(stamp_ns[-1]), position[-1].copy())
        step = np.empty_like(position)
        np.subtract(position[1:], position[:-1], out=step[1:])
        np.subtract(position[0], before, out=step[0])
        if self._any_wraps:
            step[:, self._wraps] = shortest(step[:, self._wraps])
        size = np.abs(step)
        if bool((size <= self._always).all()):
            return None
        time = np.maximum(differences(stamp_ns, start) * NANOSECOND, MIN_TIME)
        far = size > self._allowed * time[:, None]
        if not bool(far.any()):
            return None
        return np.where(far, np.sign(step), 0.0).astype(np.int8)

    def back(self, stamp_ns: int, leap: Directions) -> Mask:
        """Take one row of leaps.

        Args:
            stamp_ns: Its stamp. [ns]
            leap: Shape (n,).

        Returns:
            Which joints have leapt back, shape (n,).
        """
        fresh = stamp_ns - self.lone_ns <= MEMORY_NS
        lone = np.where(fresh, self.lone, 0)
        back = leap * lone < 0
        goes_on = leap * self._before > 0
        begins = (leap != 0) & ~goes_on & ((self._before == 0) | back)
        self.lone = np.where(begins, leap, np.where(goes_on, 0, lone)).astype(np.int8)
        self.lone_ns = np.where(begins, stamp_ns, self.lone_ns)
        self._before = leap
        return back


def shortest(step: Float) -> Float:
    """Return steps of a joint that turns without end, the short way round. [rad]

    Args:
        step: Differences of its positions, any shape (...). [rad]
    """
    return step - FULL_TURN * np.rint(step / FULL_TURN)
