"""Joint states -> joint blocks: names, order, units, quality."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_energy.blocks import NANOSECOND, JointBlock, Quality, differences, mark
from robot_energy.cdr.batch import RawBatch
from robot_energy.inputs.joint_states.decode import JOINT_STATE, JointReadings, JointStateReader
from robot_energy.inputs.joint_states.partial_states import (
    MergeCounts,
    MergedStates,
    PartialStateMerger,
    differ,
)
from robot_energy.inputs.joint_states.plausibility import Finding, Plausibility
from robot_energy.inputs.joint_states.publisher_conflicts import PublisherConflictFilter
from robot_energy.inputs.joint_states.reorder_buffer import ReorderBuffer
from robot_energy.inputs.joint_states.velocities import IMPOSSIBLE_VELOCITY, VelocityCheck
from robot_energy.inputs.parameters import RECEIVE
from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.inputs.sources import JointStateSource
from robot_energy.physics.urdf.checks import JointLimits
from robot_energy.timeline.epochs import STRAY_STAMP, Reach
from robot_energy.timeline.gaps import StampOrder
from robot_energy.timeline.streams import StreamRun, StreamSplitter, sentence_of

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

__all__ = ["JOINT_STATE", "JointStateIngest"]


class JointStateIngest:
    """Turns JointState messages into blocks in model joint order.

    Joints are matched by name in every message; joints that the model does not know are
    ignored and listed. Messages may carry some of the joints only, on one topic or several:
    see `PartialStateMerger`. Stamps decide, never the clock: see `StreamSplitter`,
    `ReorderBuffer` and `StampOrder`. While two publishers contradict each other nothing is
    used: see `PublisherConflictFilter`.
    What cannot be right is flagged: see `Plausibility`. Missing or NaN velocity is left NaN
    for the derivative to fill. Every message that is not used is counted by its reason.

    Args:
        joint_names: Modelled joints in model order.
        typestore: Message definitions of the source; those known here by default.
        limits: Limits from the URDF (`Robot.limits`), which tell units, robots and
            publishers apart; None to do without.
        effort: Whether to read the effort; NaN everywhere if not. A message whose effort
            is absent or of another length than its names has none.
        source: What dates the messages, whether they are sorted, and what they call the joints.

    Attributes:
        account: Received, accepted and rejected messages. A message with some of the joints
            is accepted when its readings are taken; one of the leading joint when it makes
            a sample.
        order: Gaps and backward jumps of the samples.
        samples: Samples given out.
        conflicts: What was seen of second publishers.

    Raises:
        ParameterError: If the source names more or fewer joints than the model has.
    """

    def __init__(
        self,
        joint_names: Sequence[str],
        typestore: Typestore | None = None,
        *,
        limits: JointLimits | None = None,
        effort: bool = False,
        source: JointStateSource | None = None,
    ) -> None:
        source = source or JointStateSource()
        self.account = RejectionLog()
        self.order = StampOrder()
        self.samples = 0
        n_joints = len(joint_names)
        self.conflicts = PublisherConflictFilter(n_joints, limits)
        self._names = tuple(joint_names)
        self._effort = effort
        self._receive_time = source.stamp_source == RECEIVE
        names = source.names_of(joint_names)
        self._reader = JointStateReader(names, effort, self._receive_time, typestore)
        self._continuity = StreamSplitter(Reach(patient=False), JointReadings.joined)
        self._source, self._limits = source, limits
        self._plausibility = Plausibility(joint_names, limits)
        self._in_parts = False  # whether a message with some of the joints was ever met
        self._broken = False  # something is missing before the next sample
        self._begin()

    def _begin(self) -> None:
        """Make all that holds messages."""
        n_joints, source = len(self._names), self._source
        self._velocities = VelocityCheck(n_joints, self._limits, source.max_velocity_ratio)
        self._sorter = ReorderBuffer(round(source.reorder_window / NANOSECOND))
        self._late = 0  # late messages of the sorter that are in the account
        self._assembly = PartialStateMerger(n_joints, self._limits, self._effort)
        self._last: MergedStates | None = None  # the newest whole message of the epoch
        self._disputed = False  # another message of that stamp said something else
        self._first = 0  # whether the first message waits; it counts as accepted meanwhile

    @property
    def newest_ns(self) -> int | None:
        """Newest stamp of the running epoch, of any joint; None before the first. [ns]"""
        return self._continuity.epochs.newest_ns

    @property
    def ignored_joints(self) -> set[str]:
        """Joints met that the model does not know."""
        return self._reader.ignored_joints

    @property
    def missing_joints(self) -> set[str]:
        """Joints that were never seen, or that the last message given up had to do without."""
        if not self._in_parts:
            if self._continuity.held is not None and self._continuity.epochs.beginning:
                present = self._continuity.held.mask[0]
                return {name for name, met in zip(self._names, present, strict=True) if not met}
            strange = self.account.rejected["unknown_joint"] and not self.samples
            return set(self._names) if strange else set()
        lacking = self._assembly.missing | ~np.isfinite(self._assembly.ages())
        return {name for name, absent in zip(self._names, lacking, strict=True) if absent}

    @property
    def ages(self) -> dict[str, float]:
        """How long each joint is behind the newest of all; inf where never seen. [s]"""
        if self._in_parts:
            return dict(zip(self._names, self._assembly.ages().tolist(), strict=True))
        return dict.fromkeys(self._names, np.inf if self._last is None else 0.0)

    @property
    def stale_joints(self) -> set[str]:
        """Joints that are further behind than their usual rate explains: samples wait for them."""
        if not self._in_parts:
            return set()
        late = self._assembly.ages() > self._assembly.limits()
        return {name for name, old in zip(self._names, late, strict=True) if old}

    @property
    def conflicting_joints(self) -> set[str]:
        """Joints whose positions two publishers contradict each other about."""
        joints = self.conflicts.joints | self._assembly.conflicting
        named = zip(self._names, joints, strict=True)
        return {name for name, met in named if met}

    def findings(self, within: float | None = None) -> list[Finding]:
        """Return what makes the joint states doubtful, one sentence each, with its time.

        Args:
            within: Only what concerns so much of the newest time; None for all. [s]
        """
        found = self._plausibility.findings()
        if self.conflicts.first_ns is not None and self.conflicts.last_ns is not None:
            joints = ", ".join(sorted(self.conflicting_joints)) or "some joints"
            sentence = (
                f"two publishers contradict each other about {joints}: "
                f"{self.conflicts.refused} samples refused"
            )
            first, last = self.conflicts.first_ns, self.conflicts.last_ns
            found.append(Finding(sentence, first, last, severe=True))
        epochs = self._continuity.epochs
        stray = sentence_of(epochs, "joint states")
        if stray and epochs.odd_ns is not None:
            found.append(Finding(stray, epochs.odd_ns, epochs.odd_ns, severe=False))
        zero = self.account.rejected["zero_stamp"]
        if zero and not self.account.accepted:
            sentence = (
                f"all {zero} joint states were received at time zero: let the clock run"
                if self._receive_time
                else f"all {zero} joint states have a zero stamp: let the driver set it, "
                "or set stamps to 'receive'"
            )
            found.append(Finding(sentence, 0, 0, severe=True))
        if within is None or self.newest_ns is None:
            return found
        oldest = self.newest_ns - within / NANOSECOND
        return [finding for finding in found if finding.last_ns >= oldest]

    def step(self, batches: RawBatch | Sequence[RawBatch]) -> JointBlock | None:
        """Take messages of one topic or several.

        Args:
            batches: Serialised JointState messages, one batch per topic, each in order of
                arrival. It makes no difference how they are spread over steps, as long as
                each topic stays in order and none is ahead of another by more than a second.

        Returns:
            The samples that are known by now, or None if there are none.
        """
        batches = [batches] if isinstance(batches, RawBatch) else batches
        self.account.received += sum(len(batch) for batch in batches)
        readings = self._reader.read(batches, self.account.reject)
        if readings is not None:
            readings = self._velocities.step(readings)
            self._refuse_velocities()
        parts: list[MergedStates] = []
        if readings is not None:
            for stretch in self._continuity.step(readings):
                parts += self._stretch(stretch)
        return self._block(parts)

    def flush(self) -> JointBlock | None:
        """Return what still waits, as at the end of a bag."""
        parts: list[MergedStates] = []
        self._velocities.flush()
        self._refuse_velocities()
        for stretch in self._continuity.flush():
            parts += self._stretch(stretch)
        parts += self._end_epoch()
        held = self.conflicts.flush()
        parts += [] if held is None else [held]
        return self._block(parts)

    def restart(self) -> None:
        """Drop what waits, as after an error; a gap follows. The account is left alone."""
        self._continuity.restart()
        self._begin()
        self.conflicts.begin_epoch(restless=False, stamp_ns=0)
        self._broken = True
        self.order.interrupt()

    def _refuse_velocities(self) -> None:
        refused = self._velocities.refused
        if refused is not None:
            self.account.reject(IMPOSSIBLE_VELOCITY, len(refused))
            self._plausibility.refused(refused)

    def _stretch(self, stretch: StreamRun[JointReadings]) -> list[MergedStates]:
        """Take messages of one epoch."""
        parts: list[MergedStates] = []
        if stretch.new_epoch:
            parts += self._end_epoch()
            held = self.conflicts.begin_epoch(stretch.restless, int(stretch.block.stamp_ns[0]))
            parts += [] if held is None else [held]
            self._assembly.begin_epoch()
            self._last = None
            self._disputed = False
            self._broken = True
        ordered = self._sorter.step(stretch.block)
        if ordered is not None:
            parts += self._ordered(ordered, stretch.rising and ordered is stretch.block)
        return parts

    def _end_epoch(self) -> list[MergedStates]:
        """Take what waits for later messages of the epoch that ends."""
        parts: list[MergedStates] = []
        ordered = self._sorter.flush()
        if ordered is not None:
            parts += self._ordered(ordered)
        verdict = MergeCounts()
        parts += self._use(self._assembly.flush(verdict))
        self._count(verdict)
        return parts

    def _ordered(self, readings: JointReadings, rising: bool = False) -> list[MergedStates]:
        """Make samples of messages, whole ones in one go."""
        if not self._in_parts:
            if readings.present is None:
                return self._use(self._whole(readings, rising))
            partial = np.flatnonzero(~readings.present.all(axis=1))
            whole = int(partial[0]) if len(partial) else len(readings)
            parts = self._use(self._whole(readings[slice(0, whole)])) if whole else []
            if whole == len(readings):
                return parts
            self._in_parts = True
            if self._last is not None:
                self._assembly.seed(self._last, self._disputed)
            return parts + self._ordered(readings[slice(whole, None)])
        verdict = MergeCounts()
        samples = self._assembly.step(readings, verdict)
        self._count(verdict)
        return self._use(samples)

    def _whole(self, readings: JointReadings, rising: bool = False) -> MergedStates | None:
        """Messages with all joints are samples, if they are newer than the one before."""
        stamp = readings.stamp_ns
        disputed = np.zeros(len(stamp), dtype=np.bool_)
        last = int(stamp[0]) - 1 if self._last is None else int(self._last.stamp_ns[0])
        if not rising and not bool((differences(stamp, last) > 0).all()):
            before = np.maximum.accumulate(np.append(last, stamp[:-1]))
            fresh, again = stamp > before, np.flatnonzero(stamp == before)
            kept = readings.joint_position[fresh]
            if self._last is not None:
                kept = np.concatenate([self._last.joint_position, kept])
            else:
                kept = np.concatenate([kept[:1], kept])
            newest = np.cumsum(fresh)
            conflict = again[
                differ(readings.joint_position[again], kept[newest[again]]).any(axis=1)
            ]
            self.account.reject("conflicting_stamp", len(conflict))
            self.account.reject("duplicate_stamp", len(again) - len(conflict))
            self.account.reject("older_stamp", int((~fresh).sum()) - len(again))
            readings, stamp = readings[fresh], stamp[fresh]
            disputed = np.zeros(len(stamp) + 1, dtype=np.bool_)
            disputed[newest[conflict]] = True  # before the sample of that number
            if len(stamp):
                disputed[0] |= self._disputed
                self._disputed = bool(disputed[-1])
            else:
                self._disputed |= bool(disputed[0])
            disputed = disputed[:-1]
        elif self._disputed:
            disputed[0], self._disputed = True, False
        if not len(stamp):
            return None
        samples = MergedStates(
            stamp_ns=stamp,
            joint_position=readings.joint_position,
            joint_velocity=readings.joint_velocity,
            joint_effort=readings.joint_effort,
            broken=np.zeros(len(stamp), dtype=np.bool_),
            disputed=disputed,
        )
        self._last = samples[slice(-1, None)]
        return samples

    def _use(self, samples: MergedStates | None) -> list[MergedStates]:
        """Leave out what two publishers contradict each other about."""
        if samples is None:
            return []
        if self._broken:
            samples.broken[0] = True
            self._broken = False
        refused = self.conflicts.refused
        used = self.conflicts.step(samples)
        self.account.reject("conflicting_publisher", self.conflicts.refused - refused)
        return [] if used is None else [used]

    def _count(self, verdict: MergeCounts) -> None:
        self.account.accepted += verdict.parts
        self.account.reject("conflicting_stamp", verdict.conflicting)
        self.account.reject("duplicate_stamp", verdict.duplicate)
        self.account.reject("older_stamp", verdict.older)
        self.account.reject("missing_joint", verdict.missing)

    def _block(self, parts: list[MergedStates]) -> JointBlock | None:
        """Number the segments, mark what is doubtful, and bring the account up to date."""
        strays = self._continuity.epochs.strays - self.account.rejected[STRAY_STAMP]
        self.account.reject(STRAY_STAMP, strays)
        late = self._sorter.late - self._late
        self._late += late
        self.account.reject("older_stamp", late)
        first = int(self._continuity.epochs.beginning)
        self.account.accepted += first - self._first
        self._first = first
        self.account.waiting = (
            self._velocities.waiting
            + self._continuity.waiting
            - first
            + self._sorter.waiting
            + self._assembly.waiting
            + self.conflicts.waiting
        )
        if not parts:
            return None
        samples = parts[0] if len(parts) == 1 else MergedStates.concatenate(parts)
        self.account.accepted += len(samples)
        self.samples += len(samples)
        before = self.order.segment
        broken = samples.broken if bool(samples.broken.any()) else None
        segment = self.order.segments(samples.stamp_ns, broken)
        quality = np.zeros(len(samples), dtype=np.uint32)
        if self.order.segment > before:
            mark(quality, differences(segment, before) > 0, Quality.AFTER_GAP)
        position, effort = samples.joint_position, samples.joint_effort
        block = JointBlock(
            stamp_ns=samples.stamp_ns,
            segment=segment,
            quality=quality,
            joint_position=position,
            joint_velocity=samples.joint_velocity,
            joint_acceleration=np.full_like(position, np.nan),
            joint_effort=np.full_like(position, np.nan) if effort is None else effort,
        )
        self._plausibility.step(block)
        return block
