"""Two publishers of the same joint: found by what they say, refused while they do.

One that sends nothing but zeros is known, and left out alone.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.units import SECOND_NS
from robot_energy.inputs.joint_states.decode import ZERO_STATE, Mask
from robot_energy.inputs.joint_states.jumps import Directions, PositionJumpDetector
from robot_energy.inputs.joint_states.partial_states import BROKEN
from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.physics.urdf.checks import JointLimits
from robot_energy.timeline.blocks import Float, Int, JointBlock

CLEAN_NS = SECOND_NS  # how long it must be quiet before samples are used again
MAX_STEP_NS = SECOND_NS // 10  # more than this between two samples is not a time watched
CONFLICTING = "conflicting_publisher"  # the reason under which refused samples are counted
QUARANTINE_NS = SECOND_NS // 4  # how long a leap waits for the leap back
IMPOSSIBLE_POSITION = (
    "impossible_position"  # the reason of samples that one leap forth and back made
)
ALONE_NS = 5 * SECOND_NS  # another leap forth and back within this shows a second publisher
BESIDE_NS = SECOND_NS  # this long after another state, zeros may be those of the robot
KNOWN = 3  # states of zeros that show their publisher


class PublisherConflictFilter:
    """Refuses samples while two publishers contradict each other.

    Signs of a second publisher: messages of one stamp that differ, stamps of two clocks that
    take turns, and positions that leap forth and back (see `PositionJumpDetector`). Samples
    after a lone leap wait a quarter of a second: if it leaps back, they are refused with it,
    so that nothing of a false position is used. Where it leads back to where the robot can be,
    and no other does so within five seconds, these samples alone are lost: one publisher sent a
    position that is corrupt. A leap that stays is a jump of one publisher (an
    encoder referenced again) and begins a new segment. After a sign, samples are refused
    until a second has passed without another.

    Args:
        limits: Limits from the URDF; None to allow what any joint can do.

    Attributes:
        joints: Joints whose positions gave a sign, shape (n,).
        first_ns: Stamp of the first sign; None if there was none. [ns]
        held: Samples that wait whether a leap comes back; None if there are none.
        astray_ns: Stamp at which the last leap came back that showed no second publisher;
            None if there was none. [ns]
    """

    def __init__(self, n_joints: int, log: RejectionLog, limits: JointLimits | None = None) -> None:
        self._log = log
        self.count = 0
        self.joints = np.zeros(n_joints, dtype=np.bool_)
        self.first_ns: int | None = None
        self.last_ns: int | None = None
        self.steps = PositionJumpDetector.of(n_joints, limits)
        self.held: JointBlock | None = None
        self._disputes: list[int] = []  # stamps, for the first sample after each
        self.astray_ns: int | None = None
        self._last: tuple[int, Float] | None = None  # stamp and positions of the newest sample
        self._before: tuple[int, Float] | None = None  # the same, before those that wait
        self._alone_ns: int | None = None  # of the last leap that came back, in this epoch
        self._to_watch = 0  # time that must pass without a sign [ns]
        self._broken = False  # something is missing before the next sample

    def dispute(self, stamps_ns: Iterable[int]) -> None:
        """Note that messages contradicted each other.

        Args:
            stamps_ns: Of the messages; the first sample after each gives the sign. [ns]
        """
        self._disputes += stamps_ns

    def begin_epoch(self, restless: bool, stamp_ns: int) -> JointBlock | None:
        """Return the samples that waited, or None; the stamps have jumped back.

        Args:
            restless: Whether they did so twice within a second: two clocks take turns.
        """
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
        after = np.searchsorted(samples.stamp_ns, self._disputes, side="right")
        self._disputes = [
            stamp for stamp, row in zip(self._disputes, after, strict=True) if row == len(samples)
        ]
        disputed = np.zeros(len(samples), dtype=np.bool_)
        disputed[after[after < len(samples)]] = True
        return disputed

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


class ZeroStateFilter:
    """Leaves out messages in which all joints are exactly zero and stand, between others.

    A ``joint_state_publisher`` without sliders, or a driver without its robot, sends such states
    next to the driver. They are found where no motion leads from the state before to zero, or
    where they have its stamp; once three were, every state of zeros within a second of another
    one is left out. The robot's own states stay in use, which the check for a second publisher
    would refuse with them. A robot that stands at zero is left alone.

    Args:
        limits: Limits from the URDF; None to allow what any joint can do.

    Attributes:
        held: A message that waits for the next one; None if there is none.
    """

    def __init__(self, n_joints: int, limits: JointLimits | None, log: RejectionLog) -> None:
        self._log = log
        self._steps = PositionJumpDetector.of(n_joints, limits)
        self.count = self.first_ns = self.last_ns = 0
        self.restart()

    def restart(self) -> None:
        """Forget the last state, and what waits."""
        self._last: tuple[int, Float] | None = None  # that is not all zero
        self.held: JointBlock | None = None  # zeros before all other states wait for the next
        self._begun = False

    def flush(self) -> None:
        """Count what still waits: one state alone is of no use."""
        if self.held is not None:
            self._log.reject(ZERO_STATE)
        self.held = None

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
        if self.held is not None:
            block, self.held = JointBlock.concatenate([self.held, block]), None
        stamp, position, velocity = block.stamp_ns, block.joint_position, block.joint_velocity
        other = ~np.isnan(position.sum(axis=1))  # those with all joints
        zero = other & (position[:, 0] == 0)
        if bool(zero.any()):
            zero &= (position == 0).all(axis=1)
            zero &= ((velocity == 0) | np.isnan(velocity)).all(axis=1)
            other &= ~zero
        rows, others = np.flatnonzero(zero), np.flatnonzero(other)
        if not self._begun and len(block) == len(rows) == 1:
            self.held = block
            return None
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
