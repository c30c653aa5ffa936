"""Joint states -> joint blocks: names, order, units, quality."""

from __future__ import annotations

from collections.abc import Sequence
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np

from robot_energy.bag.cdr.decode import RawBatch
from robot_energy.foundation.units import SECOND_NS
from robot_energy.inputs.joint_states.decode import (
    JOINT_STATE,
    ZERO_STATE,
    JointStateReader,
    Mask,
    RecordedTime,
)
from robot_energy.inputs.joint_states.partial_states import SAME_STAMP, PartialStateMerger
from robot_energy.inputs.joint_states.plausibility import (
    JointStateProblem,
    Plausibility,
    VelocityCheck,
)
from robot_energy.inputs.joint_states.publisher_conflicts import (
    CONFLICTING,
    IMPOSSIBLE_POSITION,
    PositionJumpDetector,
    PublisherConflictFilter,
)
from robot_energy.inputs.parameters import RECEIVE
from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.inputs.remedies import NO_CLOCK
from robot_energy.inputs.sources import JointStateSource
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
from robot_energy.timeline.stamps import (
    BY_PERIOD,
    MAX_MAX_GAP,
    MIN_PERIOD_NS,
    EpochRun,
    Reach,
    sentence_of,
)
from robot_energy.timeline.streams import StampOrder, StreamSplitter

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

MIN_REPEATS = 20  # steps after repeated states that make a driver known for it
SEVERE_GAP_SHARE = 0.1  # of the steps, that a driver's gaps are named [-]
MIN_ROUNDED_NS = SECOND_NS // 1000  # that make steps of a robot uneven
MIN_GRID_NS = SECOND_NS // 10_000  # a driver rounds its stamps to no less
CHANGES_IN_WINDOW = 5  # of the positions, for a slope that is none of a staircase
BESIDE_NS = SECOND_NS  # this long after another state, zeros may be those of the robot
KNOWN = 3  # states of zeros that show their publisher

__all__ = ["JOINT_STATE", "JointStateIngest"]


class ZeroStateFilter:
    """Leaves out messages in which all joints are exactly zero and stand, between others.

    A ``joint_state_publisher`` without sliders, or a driver without its robot, sends such states
    next to the driver. They are found where no motion leads from the state before to zero, or
    where they have its stamp; once three were, every state of zeros within a second of another
    one is left out. The robot's own states stay in use, which the check for a second publisher
    would refuse with them. A robot that stands at zero is left alone.

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
        """Return the messages without those of a publisher of zeros, or None."""
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
            if known or not self._steps.reaches(*sorted((other, zero), key=itemgetter(0))):
                found.append(row)
        return found


class JointStateIngest:
    """Turns JointState messages into blocks in model joint order.

    Joints are matched by name in every message; joints that the model does not know are
    ignored and listed. Messages may carry some of the joints only, on one topic or several:
    see `PartialStateMerger`. Stamps decide, never the clock: see `StreamSplitter` and
    `StampOrder`. While two publishers contradict each other nothing is
    used: see `PublisherConflictFilter`.
    What cannot be right is flagged: see `Plausibility`. Missing or NaN velocity is left NaN
    for the derivative to fill. Every message that is not used is counted by its reason.

    Args:
        typestore: Message definitions of the source; those known here by default.
        limits: Limits from the URDF (`Robot.limits`), which reveal units, robots and
            publishers apart; None to do without.
        effort: Whether to read the effort; NaN everywhere if not. A message whose effort
            is absent or of another length than its names has none.
        source: What dates the messages, whether they are sorted, and what they call the joints.
        max_gap: Longest time between two samples that is bridged; 0: five median periods,
            0.1 s to 1 s. [s]
        recorded: Notes when messages came, used or not; None where that is of no use.

    Attributes:
        rejections: Received, accepted and rejected messages. A message with some of the joints
            is accepted when its readings are taken; one of the leading joint when it makes
            a sample.
        ignored_joints: Joints met that the model does not know.
        known_names: What messages may call the joints, in model order: each way that is read.
        receive_time: Whether messages are dated by their receipt.
    """

    def __init__(
        self,
        joint_names: Sequence[str],
        typestore: Typestore | None = None,
        *,
        limits: JointLimits | None = None,
        effort: bool = False,
        source: JointStateSource | None = None,
        max_gap: float = BY_PERIOD,
        recorded: RecordedTime | None = None,
    ) -> None:
        source, log, n_joints = source or JointStateSource(), RejectionLog(), len(joint_names)
        self.rejections = log
        self.order = StampOrder(max_gap)
        self.samples = 0
        self._names = tuple(joint_names)
        self.receive_time = source.stamp_source == RECEIVE
        self._plausibility = Plausibility(joint_names, limits)
        self._velocities = VelocityCheck(
            n_joints, limits, source.max_velocity_ratio, log, self._plausibility
        )
        self._zeros = ZeroStateFilter(n_joints, limits, log)
        self.recorded = recorded
        self._reader = JointStateReader(joint_names, log, effort, typestore, source, recorded)
        self.ignored_joints, self.known_names = (
            self._reader.ignored_joints,
            self._reader.known_names,
        )
        self._stream = StreamSplitter[JointBlock](
            Reach(patient=False), log.reject, round(source.reorder_window / NANOSECOND), _by_joints
        )
        self.conflicts = PublisherConflictFilter(n_joints, log, limits)
        self._merger = PartialStateMerger(n_joints, log, self.conflicts.dispute, limits, max_gap)
        self._first = 0  # whether the first message waits; it counts as accepted meanwhile

    @property
    def newest_ns(self) -> int | None:
        """Newest stamp of the running epoch, of any joint; None before the first. [ns]"""
        return self._stream.epochs.newest_ns

    @property
    def lag_ns(self) -> int | None:
        """Newest stamp minus the time at which it arrived; None before the first. [ns]"""
        return self._stream.lag_ns

    @property
    def missing_joints(self) -> set[str]:
        """Joints that were never seen, or that the last message given up had to do without."""
        if not self._merger.in_parts:
            if self._stream.held is not None and self._stream.epochs.beginning:
                return self._named(np.isnan(self._stream.held.joint_position[0]))
            strange = self.rejections.rejected["unknown_joint"] and not self.samples
            return set(self._names) if strange else set()
        return self._named(self._merger.missing | ~np.isfinite(self._merger.ages))

    @property
    def ages(self) -> dict[str, float]:
        """How long each joint is behind the newest of all; inf where never seen. [s]"""
        return dict(zip(self._names, self._merger.ages.tolist(), strict=True))

    @property
    def repeating(self) -> bool:
        """Whether the driver sends each state of a motion several times, with new stamps."""
        return self.conflicts.steps.repeats.count >= MIN_REPEATS

    @property
    def conflicting_joints(self) -> set[str]:
        """Joints whose positions two publishers contradict each other about."""
        return self._named(self.conflicts.joints | self._merger.conflicting)

    def _named(self, joints: Mask) -> set[str]:
        return {name for name, met in zip(self._names, joints, strict=True) if met}

    def findings(self, within: float | None = None) -> list[JointStateProblem]:
        """Return what makes the joint states doubtful, one sentence each, with its time.

        Args:
            within: Only what concerns so much of the newest time; None for all. [s]
        """
        found = [*self._plausibility.findings(), *self.stream_findings()]
        if within is None or self.newest_ns is None:
            return found
        newest, span = self.newest_ns, within / NANOSECOND  # before a jump back stamps were later
        return [finding for finding in found if abs(newest - finding.last_ns) <= span]

    def stream_findings(self) -> list[JointStateProblem]:
        """Return what is wrong with stamps and publishers, one sentence each, with its time."""
        found = [*self._conflict(), *self._astray(), *self._repeats(), *self._spacing()]
        epochs = self._stream.epochs
        stray = sentence_of(epochs, "joint states")
        if stray and epochs.odd_ns is not None:
            found.append(JointStateProblem(stray, epochs.odd_ns, epochs.odd_ns, severe=False))
        zero = self.rejections.rejected["zero_stamp"]
        if zero and not self.rejections.accepted:
            sentence = (
                f"all {zero} joint states were received at time zero: {NO_CLOCK}"
                if self.receive_time
                else f"all {zero} joint states have a zero stamp: let the driver set it, "
                "or set joint_states.stamp_source to receive"
            )
            found.append(JointStateProblem(sentence, 0, 0, severe=True))
        return found

    def _conflict(self) -> list[JointStateProblem]:
        """Say what messages contradict each other about, and what else makes it look so."""
        setting = ""
        refused, same = self.rejections.rejected[CONFLICTING], self.rejections.rejected[SAME_STAMP]
        joints = ", ".join(sorted(self.conflicting_joints))
        coarse, grid_ns = self.conflicts.coarse > 0, self.conflicts.grid_ns
        if same and (coarse or not joints):
            remedy = "let the driver send a stamp for each state"
            if not self.receive_time:
                setting = "joint_states: {stamp_source: receive}"
                remedy = "set joint_states.stamp_source to receive"
            grid = f", multiples of {1e-6 * grid_ns:.3g} ms" if grid_ns >= MIN_GRID_NS else ""
            sentence = (
                f"stamps are coarser than the states{grid}: {same} joint states have the stamp of "
                "the one before and positions on the way to the next one, "
                f"{same + refused} are refused for it: {remedy}"
                if coarse
                else f"{same} joint states have the stamp of the one before and other positions, "
                f"{same + refused} are refused for it: if stamps are coarse or do not change, "
                f"{remedy}; if there are two publishers, stop one"
            )
        elif self.conflicts.last_ns is not None:
            sentence = (
                f"the positions of {joints or 'some joints'} jump back and forth, as where two "
                "publishers contradict each other, stamps are rounded or late, or rows are "
                f"corrupt: {refused} samples refused"
            )
            if grid_ns >= MIN_ROUNDED_NS and not self.receive_time:
                setting = "joint_states: {stamp_source: receive}"
                sentence += (
                    f"; the stamps are multiples of {1e-6 * grid_ns:.3g} ms: if the driver rounds "
                    "them, set joint_states.stamp_source to receive"
                )
        else:
            return []
        newest = self.newest_ns or 0  # a stamp that stands still is as new
        first, last = self.conflicts.first_ns or newest, self.conflicts.last_ns or newest
        return [JointStateProblem(sentence, first, last, severe=True, setting=setting)]

    def _astray(self) -> list[JointStateProblem]:
        """Say which states no motion reaches, without a sign that two publishers sent them."""
        found: list[JointStateProblem] = []
        zeros, at_ns = self._zeros, self.conflicts.astray_ns
        if zeros.finding:
            found.append(JointStateProblem(zeros.finding, zeros.first_ns, zeros.last_ns))
        if at_ns is not None:
            count = self.rejections.rejected[IMPOSSIBLE_POSITION]
            sentence = (
                f"{count} joint states refused as {IMPOSSIBLE_POSITION}: no motion reaches them, "
                "and the next state is back where the robot was: are rows or bits corrupt?"
            )
            found.append(JointStateProblem(sentence, at_ns, at_ns))
        return found

    def _repeats(self) -> list[JointStateProblem]:
        """Say that the driver repeats its states, whose slope is then a staircase."""
        repeats = self.conflicts.steps.repeats
        if not self.repeating:
            return []
        sentence = (
            f"positions stay the same for {repeats.messages} messages "
            f"({1e3 * repeats.hold:.0f} ms) and then step, as of a driver that repeats its states: "
            "let it send each state once, or give derivative_window at least "
            f"{CHANGES_IN_WINDOW * repeats.hold:.2g} s"
        )
        return [JointStateProblem(sentence, repeats.first_ns, repeats.last_ns)]

    def _spacing(self) -> list[JointStateProblem]:
        """Say that samples are too far apart, or nearer than any driver sends them."""
        period_ns, longest_ns = self.order.usual_period_ns, self.order.longest_gap_ns
        newest, setting = self.newest_ns or 0, ""
        if period_ns is None:
            return []
        lost = self.order.gap_share if 2 * period_ns > longest_ns else 0.0
        if period_ns >= MIN_PERIOD_NS and lost < SEVERE_GAP_SHARE:
            return []
        apart = f"joint states come {period_ns * NANOSECOND:.3g} s apart"
        if period_ns < MIN_PERIOD_NS:
            sentence = f"{apart}, which no driver does: is the unit of their times right?"
        else:
            sentence = (
                f"{apart}, and {lost:.0%} of the steps are longer than the "
                f"{longest_ns * NANOSECOND:.3g} s that are bridged: nothing is predicted in these; "
                "check the unit of their times, or set max_gap"
            )
            if 2 * period_ns <= MAX_MAX_GAP / NANOSECOND:
                setting = f"max_gap: {2 * period_ns * NANOSECOND:.3g}"
        return [JointStateProblem(sentence, newest, newest, True, True, setting)]

    def step(self, batches: RawBatch | Sequence[RawBatch]) -> JointBlock | None:
        """Return the samples known with messages of one topic or several; None for none."""
        block = self._reader.read([batches] if isinstance(batches, RawBatch) else batches)
        block = None if block is None else self._zeros.step(block)
        block = None if block is None else self._velocities.step(block)
        if block is None:
            return self._samples([])
        return self._samples(self._stream.step(block, self._reader.arrival_ns))

    def flush(self) -> JointBlock | None:
        """Return what still waits, as at the end of a bag."""
        self._zeros.flush()
        self._velocities.flush()
        return self._samples(self._stream.flush(), closing=True)

    def restart(self) -> None:
        """Drop what waits, as after an error; a gap follows. The account is left alone."""
        self._zeros.restart()
        self._velocities.restart()
        self._stream.restart()
        self._merger.restart()
        self.conflicts.begin_epoch(restless=False, stamp_ns=0)
        self._first = 0
        self.order.interrupt()

    def _samples(
        self, runs: Sequence[tuple[JointBlock, EpochRun]], closing: bool = False
    ) -> JointBlock | None:
        """Make samples of messages that are known to belong to their epoch; count what waits."""
        parts: list[JointBlock] = []
        for block, run in runs:
            if run.new_epoch:
                parts += self._end_of_epoch()
                self.conflicts.begin_epoch(run.restless, run.first_ns)
                self._merger.begin_epoch()
            merger, merged = self._merger, block
            if run.rising and not (merger.in_parts or np.isnan(block.joint_position.sum())):
                merger.last = block[slice(-1, None)]  # nothing is to be put together
            else:
                merged = merger.step(block)
            if merged is not None and (part := self.conflicts.step(merged)) is not None:
                parts.append(part)
        if closing:
            parts += self._end_of_epoch()
        rejections, stream = self.rejections, self._stream
        first = 0 if stream.held is None else int(stream.epochs.beginning)
        rejections.accepted += first - self._first
        self._first = first
        rejections.waiting = self._merger.lead.shape[1] - first
        for holder in (self._zeros, self._velocities, stream, stream.order, self.conflicts):
            rejections.waiting += 0 if holder.held is None else len(holder.held)
        if not parts:
            return None
        samples = JointBlock.concatenate(parts)
        rejections.accepted += len(samples)
        self.samples += len(samples)
        before = self.order.segment
        broken = samples.quality > 0
        segment = self.order.segments(samples.stamp_ns, broken if bool(broken.any()) else None)
        if self.order.segment > before:
            mark(samples.quality, differences(segment, before) > 0, Quality.AFTER_GAP)
        samples.segment[:] = segment
        self._plausibility.step(samples)
        return samples

    def _end_of_epoch(self) -> list[JointBlock]:
        """Take what waits for later messages of the epoch that ends."""
        merged = self._merger.flush()
        used = None if merged is None else self.conflicts.step(merged)
        return [part for part in (used, self.conflicts.flush()) if part is not None]


def _by_joints(block: JointBlock) -> dict[bytes, Int]:
    """Rows of the messages that have the same joints."""
    present = ~np.isnan(block.joint_position)
    kinds, which = np.unique(present, axis=0, return_inverse=True)
    return {
        b"" if kinds[kind].all() else kinds[kind].tobytes(): np.flatnonzero(which.ravel() == kind)
        for kind in range(len(kinds))
    }
