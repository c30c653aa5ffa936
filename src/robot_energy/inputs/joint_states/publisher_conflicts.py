"""Two publishers of the same joint: found by what they say, refused while they do.

Signs are steps of positions that no motion makes, and that go forth and back.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import gcd

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.units import SECOND_NS
from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.physics.derivative import FULL_TURN
from robot_energy.physics.urdf.checks import JointLimits
from robot_energy.timeline.blocks import (
    NANOSECOND,
    Float,
    Int,
    JointBlock,
    Quality,
    differences,
)

Mask = NDArray[np.bool_]
Directions = NDArray[np.int8]

MAX_STEP_RATIO = 1.5  # times what the velocity limit allows
MIN_TIME = 0.005  # stamps jitter: a step is never judged by a shorter time [s]
MAX_HOLD = 0.1  # s that a driver may repeat a value before it sends the next one
MOVING_TIME = 0.001  # s at the greatest allowed speed: a smaller step may be resolution
LONGER = 1.5  # times the time between two messages, beyond which a value was repeated
MAX_SPEED = 20.0  # where the URDF knows no limit [rad/s] or [m/s]
MEMORY_NS = SECOND_NS  # a step back this long after a step forth belongs to it
CLEAN_NS = SECOND_NS  # how long it must be quiet before samples are used again
MAX_STEP_NS = SECOND_NS // 10  # more than this between two samples is not a time watched
CONFLICTING = "conflicting_publisher"  # the reason under which refused samples are counted
QUARANTINE_NS = SECOND_NS // 4  # how long a leap waits for the leap back
IMPOSSIBLE_POSITION = (
    "impossible_position"  # the reason of samples that one leap forth and back made
)
ALONE_NS = 5 * SECOND_NS  # another leap forth and back within this shows a second publisher
BROKEN = np.uint32(Quality.AFTER_GAP)  # something is missing right before a sample


class _Repeats:
    """Counts the steps of a moving robot after values that its driver has repeated."""

    def __init__(self) -> None:
        self.count = self.first_ns = self.last_ns = self.messages = 0
        self.hold = 0.0  # how long values stand [s]

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
        """Return a watch of all joints of a robot, by its limits if they are known."""
        if limits is None:
            return cls(np.full(n_joints, np.inf), np.zeros(n_joints, dtype=np.bool_))
        return cls(limits.velocity, limits.wraps)

    def joint(self, index: int) -> PositionJumpDetector:
        """Return a fresh watch of one of the joints."""
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
        """Return which joints leap back in a row of leaps, shape (n,); rows come in order."""
        fresh = stamp_ns - self.lone_ns <= MEMORY_NS
        lone = np.where(fresh, self.lone, 0)
        back = leap * lone < 0
        goes_on = leap * self._before > 0
        begins = (leap != 0) & ~goes_on & ((self._before == 0) | back)
        self.lone = np.where(begins, leap, np.where(goes_on, 0, lone)).astype(np.int8)
        self.lone_ns = np.where(begins, stamp_ns, self.lone_ns)
        self._before = leap
        return back


class PublisherConflictFilter:
    """Refuses samples while two publishers contradict each other.

    Signs of a second publisher: messages of one stamp that differ, stamps of two clocks that
    take turns, and positions that leap forth and back (see `PositionJumpDetector`). Samples
    after a lone leap wait a quarter of a second: if it leaps back, they are refused with it,
    so that nothing of a false position is used. Where it leads back to where the robot can be,
    and no other does so within five seconds, these samples alone are lost: one publisher sent a
    position that is corrupt. Messages of one stamp that lie on the way to the next sample show
    coarse stamps. A leap that stays is a jump of one publisher (an
    encoder referenced again) and begins a new segment. After a sign, samples are refused
    until a second has passed without another.

    Attributes:
        joints: Joints whose positions gave a sign, shape (n,).
        first_ns: Stamp of the first sign; None if there was none. [ns]
        held: Samples that wait whether a leap comes back; None if there are none.
        astray_ns: Stamp at which the last leap came back that showed no second publisher;
            None if there was none. [ns]
        coarse: Stamps with a message that lies between the sample of that stamp and the next one,
            less those with one that does not.
        grid_ns: What the stamps of the samples around them are multiples of. [ns]
    """

    def __init__(self, n_joints: int, log: RejectionLog, limits: JointLimits | None = None) -> None:
        self._log = log
        self.count = 0
        self.joints = np.zeros(n_joints, dtype=np.bool_)
        self.first_ns: int | None = None
        self.last_ns: int | None = None
        self.steps = PositionJumpDetector.of(n_joints, limits)
        self.held: JointBlock | None = None
        self.coarse = self.grid_ns = 0
        self._disputes: dict[int, Float] = {}  # position by stamp, for the first sample after each
        self.astray_ns: int | None = None
        self._last: tuple[int, Float] | None = None  # stamp and positions of the newest sample
        self._before: tuple[int, Float] | None = None  # the same, before those that wait
        self._alone_ns: int | None = None  # of the last leap that came back, in this epoch
        self._to_watch = 0  # time that must pass without a sign [ns]
        self._broken = False  # something is missing before the next sample

    def dispute(self, stamps_ns: Iterable[int], positions: Iterable[Float]) -> None:
        """Note that messages of these stamps contradicted earlier ones.

        Args:
            stamps_ns: Of the messages, in any order. [ns]
            positions: Of each, shape (n,); NaN where it has no position. [rad] or [m]
        """
        self._disputes.update(zip(stamps_ns, positions, strict=True))

    def begin_epoch(self, restless: bool, stamp_ns: int) -> JointBlock | None:
        """Return the samples that waited; stamps jumped back, twice within a second if restless."""
        held = self.flush()
        self.steps.begin_epoch()
        self._disputes.clear()
        self._last = self._alone_ns = None
        self._broken = True
        if restless:
            self._note(stamp_ns)
        return held

    def step(self, samples: JointBlock) -> JointBlock | None:
        """Return the samples that can be used, with some that waited before, or None."""
        leaps = self.steps.leaps(samples.stamp_ns, samples.joint_position)
        out: JointBlock | None = samples
        if leaps is not None or self._disputes or self._to_watch:
            if leaps is None:
                leaps = np.zeros(samples.joint_position.shape, dtype=np.int8)
            out = self._judge(samples, leaps, self._disputed(samples))
        elif self._broken:
            samples.quality[0] |= BROKEN
            self._broken = False
        self._last = int(samples.stamp_ns[-1]), samples.joint_position[-1].copy()
        return out

    def flush(self) -> JointBlock | None:
        """Return the samples that wait; nothing says that they are wrong."""
        held, self.held = self.held, None
        if held is not None:
            held.quality[0] |= BROKEN
        return held

    def _disputed(self, samples: JointBlock) -> NDArray[np.bool_]:
        """Which samples are the first after messages that contradicted each other."""
        disputed = np.zeros(len(samples), dtype=np.bool_)
        for stamp in list(self._disputes):
            row = int(np.searchsorted(samples.stamp_ns, stamp, side="right"))
            if row < len(samples):
                disputed[row] = True
                self._compare(samples, row, stamp, self._disputes.pop(stamp))
        return disputed

    def _compare(self, samples: JointBlock, row: int, stamp_ns: int, position: Float) -> None:
        """Note whether a message lies between the sample of its stamp and the next one."""
        before = self._last
        if row:
            before = int(samples.stamp_ns[row - 1]), samples.joint_position[row - 1]
        if before is not None and before[0] == stamp_ns:
            onward = (position - before[1]) * (samples.joint_position[row] - position)
            self.coarse += int(np.sign(np.nansum(onward)))
            self.grid_ns = gcd(self.grid_ns, stamp_ns, int(samples.stamp_ns[row]))

    def _note(self, stamp_ns: int) -> None:
        self.count += 1
        self.first_ns = stamp_ns if self.first_ns is None else self.first_ns
        self.last_ns = stamp_ns
        self._to_watch = CLEAN_NS
        if self.astray_ns is not None and stamp_ns - self.astray_ns <= ALONE_NS:
            self.astray_ns = None  # it was of the second publisher

    def _judge(
        self, samples: JointBlock, leaps: Directions, disputed: NDArray[np.bool_]
    ) -> JointBlock | None:
        """Go through the samples one by one."""
        whole = samples if self.held is None else JointBlock.concatenate([self.held, samples])
        held = [] if self.held is None else list(range(len(self.held)))
        first = len(held)
        broken: list[int] = []
        used: list[int] = []
        refused = astray = 0
        last = self._last
        steps = self.steps
        for row, stamp in enumerate(samples.stamp_ns.tolist()):
            back = steps.back(stamp, leaps[row])
            before, last = last, (stamp, samples.joint_position[row])
            elapsed = 0 if before is None else min(stamp - before[0], MAX_STEP_NS)
            self._to_watch = max(0, self._to_watch - elapsed)
            if held and not disputed[row] and self._comes_back(last, back):
                astray += len(held)
                held = []
            elif disputed[row] or bool(back.any()):
                self.joints |= back
                self.grid_ns = gcd(self.grid_ns, stamp, *([] if before is None else [before[0]]))
                self._note(stamp)
                refused += len(held)
                self._broken |= bool(held)
                held = []
            if self._to_watch:
                refused += 1
                self._broken = True
                continue
            index = first + row
            if self._broken:
                broken.append(index)
                self._broken = False
            lone = steps.lone != 0
            if bool((lone & (stamp - steps.lone_ns <= QUARANTINE_NS)).any()):
                self._before = self._before if held else before
                held.append(index)
                continue
            if held:
                if bool(lone.any()):
                    broken.append(held[0])
                used += held
                held = []
            used.append(index)
        self._log.reject(CONFLICTING, refused)
        self._log.reject(IMPOSSIBLE_POSITION, astray)
        whole.quality[broken] |= BROKEN
        self.held = whole[np.asarray(held, dtype=np.int64)] if held else None
        return whole[np.asarray(used, dtype=np.int64)] if used else None

    def _comes_back(self, sample: tuple[int, Float], back: NDArray[np.bool_]) -> bool:
        """Whether a leap back ends one excursion, which other samples than its own know nothing of.

        Args:
            back: Which joints leap back, shape (n,).
        """
        if not bool(back.any()):
            return False
        alone = self._alone_ns is None or sample[0] - self._alone_ns > ALONE_NS
        self._alone_ns = sample[0]
        if self._to_watch or not alone or self._before is None:
            return False
        if not self.steps.reaches(self._before, sample):
            return False
        self.steps.forget_leap()
        self.astray_ns = sample[0]
        return True


def shortest(step: Float) -> Float:
    """Return steps of a joint that turns without end, the short way round. [rad]

    Args:
        step: Differences of its positions, any shape (...). [rad]
    """
    return step - FULL_TURN * np.rint(step / FULL_TURN)
