"""Joint states that come in parts, put together at the stamps of the leading joint."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from robot_energy.inputs.joint_states.decode import Mask, joint_block
from robot_energy.inputs.joint_states.publisher_conflicts import (
    BROKEN,
    PositionJumpDetector,
    shortest,
)
from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.physics.urdf.checks import JointLimits
from robot_energy.timeline.blocks import NANOSECOND, Float, Int, JointBlock
from robot_energy.timeline.stamps import BY_PERIOD, MAX_GAP_NS, OLDER, newer
from robot_energy.timeline.streams import StampOrder

SAME = 1e-6  # positions of one stamp that differ by less are the same [rad] or [m]
SAME_STAMP = "conflicting_stamp"  # the reason under which messages that contradict it are counted


class _Track:
    """Readings of one joint in time order, as far back as samples may need them."""

    def __init__(self, steps: PositionJumpDetector, max_gap: float) -> None:
        self.order = StampOrder(max_gap)
        self.steps = steps
        self.stamp: Int = np.empty(0, dtype=np.int64)
        self.segment: Int = np.empty(0, dtype=np.int64)
        self.newest: Int = np.empty(0, dtype=np.int64)  # newest stamp of all on its arrival
        self.values: Float = np.empty((3, 0))  # position, velocity, effort

    def extend(self, stamp: Int, newest: Int, values: Float) -> None:
        if not len(stamp):
            return
        self.segment = np.concatenate([self.segment, self.order.segments(stamp)])
        self.stamp = np.concatenate([self.stamp, stamp])
        self.newest = np.concatenate([self.newest, newest])
        self.values = np.concatenate([self.values, values], axis=1)

    def contradictions(self, stamp: Int, position: Float) -> list[int]:
        """Stamps of new readings that leapt back, as those of two publishers do."""
        leaps = self.steps.leaps(stamp, position[:, None])
        if leaps is None:
            return []
        rows = zip(stamp.tolist(), leaps, strict=True)
        return [at for at, leap in rows if bool(self.steps.back(at, leap)[0])]

    def forget(self, oldest: int) -> None:
        """Keep what lies at or after a stamp, and one reading before it."""
        first = max(0, int(np.searchsorted(self.stamp, oldest, side="left")) - 1)
        if first:
            self.stamp, self.segment = self.stamp[first:], self.segment[first:]
            self.newest, self.values = self.newest[first:], self.values[:, first:]


class PartialStateMerger:
    """Makes samples of all joints of messages, each of which may carry some of them.

    As long as every message has all joints, the messages are the samples. Otherwise the first
    joint of the model leads: every reading of it is an instant to know all joints at. The
    others are interpolated between the readings on both sides of that instant, so
    that no joint is ever older than the rest: holding the last value would put steps into
    the derivative. Positions follow the cubic through both velocities where they are
    reported, else a line; velocity and effort a line. A joint that has no readings on both
    sides within one segment (see `StampOrder`) is missing, and with it the sample. A sample
    waits until all joints have passed its stamp, at most a second of stamps, or as long as
    gaps are bridged.

    Args:
        log: Where messages are counted. One with some of the joints is accepted when its
            readings are taken; one of the leading joint when it makes a sample.
        dispute: Takes stamps and positions of messages that contradict earlier ones.
        limits: Limits from the URDF; None to do without.
        max_gap: Longest gap between readings of a joint, as of `StampOrder`. [s]

    Attributes:
        in_parts: Whether a message with some of the joints was ever met.
        last: The newest message with all joints, while none had some of them; None before.
        conflicting: Joints whose readings leapt forth and back, shape (n,).
        lead: Stamps of the leading joint that wait for the other joints, and the newest stamp on
            their arrival, shape (2, N). [ns]
        missing: Joints that were missing when a sample was last given up, shape (n,).
    """

    def __init__(
        self,
        n_joints: int,
        log: RejectionLog,
        dispute: Callable[[Iterable[int], Iterable[Float]], None],
        limits: JointLimits | None,
        max_gap: float = BY_PERIOD,
    ) -> None:
        self.in_parts = False
        self.conflicting = np.zeros(n_joints, dtype=np.bool_)
        self.missing = np.zeros(n_joints, dtype=np.bool_)
        self._log, self._dispute = log, dispute
        self._n_joints, self._max_gap = n_joints, max_gap
        self._patience_ns = max(MAX_GAP_NS, round(max_gap / NANOSECOND))
        self._wraps = np.zeros(n_joints, dtype=np.bool_) if limits is None else limits.wraps
        self._steps = PositionJumpDetector.of(n_joints, limits)
        self.restart()

    @property
    def ages(self) -> Float:
        """How long each joint is behind the newest stamp, shape (n,); inf if unseen. [s]"""
        if not self.in_parts:
            return np.full(self._n_joints, np.inf if self.last is None else 0.0)
        if self._newest is None:
            return np.full(self._n_joints, np.inf)
        last = [int(track.stamp[-1]) if len(track.stamp) else None for track in self._tracks]
        return np.array([np.inf if at is None else (self._newest - at) * NANOSECOND for at in last])

    def restart(self) -> None:
        """Forget all that waits, as after an error."""
        self._broken = False  # the sample before the next one was given up
        self.begin_epoch()
        self.lead: Int = np.empty((2, 0), dtype=np.int64)

    def begin_epoch(self) -> None:
        """Forget all readings: the stamps have jumped back."""
        self.last: JointBlock | None = None
        self._newest: int | None = None
        self._tracks = [
            _Track(self._steps.joint(joint), self._max_gap) for joint in range(self._n_joints)
        ]

    def step(self, block: JointBlock) -> JointBlock | None:
        """Return the samples that messages of one epoch complete, or None."""
        if self.in_parts or not len(block):
            return self._merge(block) if len(block) else None
        if not bool(np.isnan(block.joint_position.sum())):
            return self._whole(block)
        partial = np.isnan(block.joint_position).any(axis=1)
        first = int(np.argmax(partial)) if bool(partial.any()) else len(block)
        whole = self._whole(block[slice(0, first)]) if first else None
        if first == len(block):
            return whole
        self.in_parts = True
        if self.last is not None:
            self._seed(self.last)
        merged = self._merge(block[slice(first, None)])
        parts = [part for part in (whole, merged) if part is not None]
        return JointBlock.concatenate(parts) if parts else None

    def flush(self) -> JointBlock | None:
        """Give up waiting, as at the end of an epoch."""
        return self._decide(closing=True)

    def _whole(self, block: JointBlock) -> JointBlock | None:
        """Messages with all joints are samples, if they are newer than the one before."""
        last = self.last
        fresh, again = newer(block.stamp_ns, None if last is None else int(last.stamp_ns[0]))
        if not bool(fresh.all()):
            block = self._new(block, last, fresh, np.flatnonzero(again))
        if not len(block):
            return None
        self.last = block[slice(-1, None)]
        return block

    def _new(
        self, block: JointBlock, last: JointBlock | None, fresh: Mask, again: Int
    ) -> JointBlock:
        """Return the new messages, and count the others."""
        kept = block.joint_position[fresh]
        kept = np.concatenate([kept[:1] if last is None else last.joint_position, kept])
        newest = np.cumsum(fresh)
        conflict = _differ(block.joint_position[again], kept[newest[again]]).any(axis=1)
        refused = again[conflict]
        self._dispute(block.stamp_ns[refused].tolist(), block.joint_position[refused])
        self._log.reject(SAME_STAMP, int(conflict.sum()))
        self._log.reject("duplicate_stamp", int((~conflict).sum()))
        self._log.reject(OLDER, int((~fresh).sum()) - len(again))
        return block[fresh]

    def _seed(self, last: JointBlock) -> None:
        """Begin after messages with all joints, the last of which is known."""
        for joint, track in enumerate(self._tracks):
            track.contradictions(last.stamp_ns, last.joint_position[:, joint])
            track.extend(last.stamp_ns, last.stamp_ns, _values(last, joint, slice(None)))
        self._newest = int(last.stamp_ns[-1])

    def _merge(self, block: JointBlock) -> JointBlock | None:
        """Take messages with some of the joints."""
        stamp, mask = block.stamp_ns, ~np.isnan(block.joint_position)
        first = int(stamp[0]) if self._newest is None else self._newest
        newest = np.maximum(np.maximum.accumulate(stamp), first)
        self._newest = int(newest[-1])
        used, same, conflict = np.zeros((3, len(stamp)), dtype=np.bool_)
        disputes: list[int] = []
        for joint, track in enumerate(self._tracks):
            rows = np.flatnonzero(mask[:, joint])
            if not len(rows):
                continue
            fresh = self._fresh(track, block, rows, joint, same, conflict)
            used[fresh] = True
            if len(fresh):
                found = track.contradictions(stamp[fresh], block.joint_position[fresh, joint])
                disputes += found
                self.conflicting[joint] |= bool(found)
            track.extend(stamp[fresh], newest[fresh], _values(block, joint, fresh))
            if joint == 0:
                lead = np.stack([stamp[fresh], newest[fresh]])
                self.lead = np.concatenate([self.lead, lead], axis=1)
                self._log.accepted -= len(fresh)
        self._log.accepted += int(used.sum())
        self._log.reject(SAME_STAMP, int((conflict & ~used).sum()))
        self._log.reject("duplicate_stamp", int((same & ~conflict & ~used).sum()))
        self._log.reject(OLDER, int((~used & ~same & ~conflict).sum()))
        self._dispute(disputes, np.full((len(disputes), self._n_joints), np.nan))
        self._dispute(stamp[conflict].tolist(), block.joint_position[conflict])
        return self._decide(closing=False)

    def _fresh(
        self, track: _Track, block: JointBlock, rows: Int, joint: int, same: Mask, conflict: Mask
    ) -> Int:
        """Rows with a new reading of a joint; marks those that repeat or contradict the last."""
        known = len(track.stamp) > 0
        fresh, repeats = newer(block.stamp_ns[rows], int(track.stamp[-1]) if known else None)
        if bool(fresh.all()):
            return rows
        again = np.flatnonzero(repeats)
        if len(again):
            same[rows[again]] = True
            position = block.joint_position[rows, joint]
            of_last = float(track.values[0, -1]) if known else np.nan
            kept = np.append(of_last, position[fresh])
            earlier = kept[np.cumsum(fresh)[again]]
            conflict[rows[again]] |= _differ(position[again], earlier)
        return rows[fresh]

    def _decide(self, closing: bool) -> JointBlock | None:
        """Make samples of the leading readings whose fate is known."""
        at: Int = self.lead[0]
        arrived: Int = self.lead[1]
        newest = 0 if self._newest is None else self._newest
        surrounded = np.ones((len(at), self._n_joints), dtype=np.bool_)
        passed = np.ones(len(at), dtype=np.bool_)
        right = np.zeros((len(at), self._n_joints), dtype=np.int64)
        for joint, track in enumerate(self._tracks):
            found: Int = np.searchsorted(track.stamp, at, side="left").astype(np.int64)
            there = found < len(track.stamp)
            passed &= there
            index = np.minimum(found, len(track.stamp) - 1)
            if len(track.stamp):
                exact = track.stamp[index] == at
                linked = (index > 0) & (track.segment[index] == track.segment[index - 1])
                timely = track.newest[index] <= at + self._patience_ns
                there = there & timely & (exact | linked)
            surrounded[:, joint] = there
            right[:, joint] = index
        fate = passed | (newest > at + self._patience_ns) | closing
        count = len(at) if bool(fate.all()) else int(np.argmin(fate))
        surrounded = surrounded[:count]
        complete = surrounded.all(axis=1) & (arrived[:count] <= at[:count] + self._patience_ns)
        self.lead = self.lead[:, count:]
        samples = self._samples(at[:count], right[:count], complete)
        self._log.reject("missing_joint", int((~complete).sum()))
        given_up = np.flatnonzero(~complete)
        if len(given_up):
            self.missing = ~surrounded[given_up[-1]]
        if self.lead.size:
            oldest = int(self.lead[0, 0])
        else:
            oldest = max(newest - self._patience_ns, int(at[count - 1]) if count else 0)
        for track in self._tracks:  # no later sample needs what is older
            track.forget(oldest)
        return samples

    def _samples(self, at: Int, right: Int, complete: Mask) -> JointBlock | None:
        """Make the complete samples; note what was given up or disputed before each."""
        rows = np.flatnonzero(complete)
        if not len(rows):
            self._broken |= bool(len(at))
            return None
        broken = np.append(self._broken, ~complete)
        since = np.append(-1, rows[:-1])
        gaps = np.cumsum(np.append(0, broken))
        self._broken = bool(broken[rows[-1] + 1 :].any())
        columns = [
            self._interpolate(joint, at[rows], right[rows, joint])
            for joint in range(self._n_joints)
        ]
        position, velocity, effort = np.stack(columns, axis=1)  # joint by joint contiguous
        samples = joint_block(at[rows], position.T, velocity.T, effort.T)
        samples.quality[gaps[rows + 1] > gaps[since + 1]] = BROKEN
        return samples

    def _interpolate(self, joint: int, at: Int, right: Int) -> Float:
        """Position, velocity and effort of a joint at some stamps, shape (3, N)."""
        track = self._tracks[joint]
        exact = track.stamp[right] == at
        values = track.values[:, right]
        if bool(exact.all()):
            return values
        rows = np.flatnonzero(~exact)
        after = right[rows]
        before = after - 1
        length = (track.stamp[after] - track.stamp[before]) * NANOSECOND
        share = (at[rows] - track.stamp[before]) * NANOSECOND / length
        begin, end = track.values[:, before], track.values[:, after]
        between = begin + share * (end - begin)
        step = end[0] - begin[0]
        if self._wraps[joint]:
            step = shortest(step)
        line = begin[0] + share * step
        bend = share * (1 - share)
        cubic = line + bend * (
            (1 - share) * (begin[1] * length - step) - share * (end[1] * length - step)
        )
        between[0] = np.where(np.isfinite(cubic), cubic, line)
        values[:, rows] = between
        return values


def _values(block: JointBlock, joint: int, rows: Int | slice) -> Float:
    """Position, velocity and effort of a joint, shape (3, N)."""
    columns = (block.joint_position, block.joint_velocity, block.joint_effort)
    return np.stack([column[rows, joint] for column in columns])


def _differ(position: Float, other: Float) -> Mask:
    """Whether two positions of one stamp contradict each other, elementwise."""
    return np.abs(position - other) > SAME * (1 + np.abs(other))
