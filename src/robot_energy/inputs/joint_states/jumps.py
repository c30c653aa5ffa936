"""Steps of positions that no motion makes, and whether they go forth and back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.units import SECOND_NS
from robot_energy.physics.derivative import FULL_TURN
from robot_energy.physics.urdf.checks import JointLimits
from robot_energy.timeline.blocks import NANOSECOND, Float, Int, differences

Mask = NDArray[np.bool_]
Directions = NDArray[np.int8]

MAX_STEP_RATIO = 1.5  # times what the velocity limit allows
MIN_TIME = 0.005  # stamps jitter: a step is never judged by a shorter time [s]
MAX_HOLD = 0.1  # s that a driver may repeat a value before it sends the next one
MOVING_TIME = 0.001  # s at the greatest allowed speed: a smaller step may be resolution
LONGER = 1.5  # times the time between two messages, beyond which a value was repeated
MAX_SPEED = 20.0  # where the URDF knows no limit [rad/s] or [m/s]
MEMORY_NS = SECOND_NS  # a step back this long after a step forth belongs to it


class _Repeats:
    """Counts the steps of a moving robot after values that its driver has repeated.

    Attributes:
        hold: How long values stand. [s]
    """

    def __init__(self) -> None:
        self.count = self.first_ns = self.last_ns = self.messages = 0
        self.hold = 0.0

    def note(self, stamp_ns: Int, elapsed: Int, held: Int, repeated: Mask) -> None:
        """Take samples.

        ``elapsed`` is the time since the sample before, shape (N, 1); ``held`` how long values
        stood before they changed, ``repeated`` where longer than that, shape (N, n). [ns]
        """
        rows = np.flatnonzero(repeated.any(axis=1))
        last = rows[-1]
        self.first_ns = self.first_ns if self.count else int(stamp_ns[rows[0]])
        self.last_ns = int(stamp_ns[last])
        self.count += len(rows)
        stood = int(held[last][repeated[last]].max())
        self.hold, self.messages = stood * NANOSECOND, round(stood / int(elapsed[last, 0]))


class PositionJumpDetector:
    """Watches the positions of some joints for leaps: steps too far for the joint's velocity.

    A leap that its neighbours do not continue is a lone one: no motion, whatever the unit or
    the limit. A second leap in the opposite direction within a second makes it forth and
    back. Leaps that follow each other in one direction are fast motion, or another unit.
    A driver that repeats each value some times moves in steps: such a step is judged by the
    time since the value last changed, but by no longer one than between the two changes before.

    Args:
        fastest: Velocity limits, inf where there are none, shape (n,). [rad/s] or [m/s]
        wraps: Joints of which a full turn is not a step, shape (n,).

    Attributes:
        lone: Direction of the last lone leap of each joint, 0 for none, shape (n,).
        lone_ns: Its stamp, shape (n,). [ns]
        repeats: Steps of a moving robot after values that stood still.
    """

    def __init__(self, fastest: Float, wraps: Mask) -> None:
        self._allowed = MAX_STEP_RATIO * np.where(np.isfinite(fastest), fastest, MAX_SPEED)
        self._always = self._allowed * MIN_TIME
        self._moving = self._allowed * MOVING_TIME
        self.repeats = _Repeats()
        self._wraps = wraps
        self._any_wraps = bool(wraps.any())
        self._last: tuple[int, Float] | None = None
        self._changed: Int = np.zeros(len(fastest), dtype=np.int64)  # stamp of the last change
        self._hold: Int = np.zeros(len(fastest), dtype=np.int64)  # from the change before to it
        self._before: Directions = np.zeros(len(fastest), dtype=np.int8)
        self.lone = self._before
        self.lone_ns: Int = np.zeros(len(fastest), dtype=np.int64)

    @classmethod
    def of(cls, n_joints: int, limits: JointLimits | None) -> PositionJumpDetector:
        """Return a watch of all joints of a robot, by its limits if they are known.

        Args:
            limits: Limits from the URDF; without them (None) no joint has a limit or turns without
                end.
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
        """Forget the last position: the next is not a step."""
        self._last = None
        self._before = self.lone = np.zeros_like(self._before)

    def leaps(self, stamp_ns: Int, position: Float) -> Directions | None:
        """Return the direction of every leap, else 0, shape (N, n).

        None where no step is a leap, the one before was none and no lone leap is remembered.

        Args:
            stamp_ns: Rising, shape (N,), N >= 1. [ns]
            position: Shape (N, n). [rad] or [m]
        """
        if self._last is None:
            self._last = int(stamp_ns[0]), position[0]
            self._changed = np.full_like(self._changed, self._last[0])
            self._hold = np.zeros_like(self._hold)
        start, before = self._last
        self._last = (int(stamp_ns[-1]), position[-1].copy())
        step = np.empty_like(position)
        np.subtract(position[1:], position[:-1], out=step[1:])
        np.subtract(position[0], before, out=step[0])
        if self._any_wraps:
            step[:, self._wraps] = shortest(step[:, self._wraps])
        size = np.abs(step)
        held = self._held(stamp_ns, start, step != 0)
        elapsed = differences(stamp_ns, start)[:, None]
        if held is not None:
            repeated = (size > self._moving) & (held > LONGER * elapsed)
            repeated &= held <= MAX_HOLD / NANOSECOND
            if repeated.any():
                self.repeats.note(stamp_ns, elapsed, held, repeated)
        far = size > self._always
        if far.any():
            time = np.maximum(elapsed * NANOSECOND, MIN_TIME)
            if held is not None:
                time = np.maximum(time, np.minimum(held * NANOSECOND, MAX_HOLD))
            far = size > self._allowed * time
        if not (far.any() or self._before.any() or self.lone.any()):
            return None
        return np.where(far, np.sign(step), 0.0).astype(np.int8)

    def reaches(self, first: tuple[int, Float], second: tuple[int, Float]) -> bool:
        """Return whether a motion can lead from one sample to another.

        Args:
            first: Stamp [ns] and positions, shape (n,). [rad] or [m]
            second: Stamp [ns] and positions, shape (n,), later. [rad] or [m]
        """
        step = second[1] - first[1]
        step[self._wraps] = shortest(step[self._wraps])
        time = max((second[0] - first[0]) * NANOSECOND, MIN_TIME)
        return bool((np.abs(step) <= self._allowed * time).all())

    def forget_leap(self) -> None:
        """Take the last sample as one that continues those before the leap."""
        self._before = self.lone = np.zeros_like(self._before)

    def _held(self, stamp_ns: Int, start: int, changed: Mask) -> Int | None:
        """Return how long values stood before they changed, at most as long as the one before.

        Shape (N, n), or None where every sample brings new ones. [ns]
        """
        if bool(changed.all()) and bool((self._changed == start).all()):
            self._changed[:] = stamp_ns[-1]
            self._hold[:] = stamp_ns[-1] - (stamp_ns[-2] if len(stamp_ns) > 1 else start)
            return None
        if len(stamp_ns) == 1:  # as below, in few calls
            stood = stamp_ns - self._changed
            held = np.minimum(stood, self._hold)
            np.copyto(self._hold, stood, where=changed[0])
            np.copyto(self._changed, stamp_ns, where=changed[0])
            return held[None]
        stamps = np.broadcast_to(stamp_ns[:, None], changed.shape)
        stamps = np.concatenate([self._changed[None], stamps])
        rows = np.zeros(stamps.shape, dtype=np.int64)
        np.copyto(rows[1:], np.arange(1, len(rows))[:, None], where=changed)
        last = np.maximum.accumulate(rows, axis=0)  # that brought the value, 0: before
        stood = stamps[1:] - np.take_along_axis(stamps, last[:-1], 0)
        holds = np.concatenate([self._hold[None], stood])
        self._changed = np.take_along_axis(stamps, last[-1:], 0)[0]
        self._hold = np.take_along_axis(holds, last[-1:], 0)[0]
        return np.minimum(stood, np.take_along_axis(holds, last[:-1], 0))

    def back(self, stamp_ns: int, leap: Directions) -> Mask:
        """Return which joints leap back in a row of leaps, shape (n,); rows come in order.

        Args:
            leap: Shape (n,).
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
