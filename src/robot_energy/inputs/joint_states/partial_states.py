"""Joint states that come in parts, put together at the stamps of the leading joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot_energy.blocks import NANOSECOND, Block, Float, Int
from robot_energy.inputs.joint_states.decode import JointReadings, Mask
from robot_energy.inputs.joint_states.jumps import PositionJumpDetector, shortest
from robot_energy.physics.urdf.checks import JointLimits
from robot_energy.timeline.gaps import LONGEST_GAP_NS, StampOrder

PATIENCE_NS = LONGEST_GAP_NS  # a part that comes later than this by stamp is missing
SAME = 1e-6  # positions of one stamp that differ by less are the same [rad] or [m]


@dataclass(frozen=True)
class MergedStates(Block):
    """States of all joints, in time order within an epoch.

    Attributes:
        joint_position: Shape (N, n). [rad] or [m]
        joint_velocity: NaN where unknown, shape (N, n). [rad/s] or [m/s]
        joint_effort: As the driver sent it, shape (N, n); None if it is not read.
        broken: Whether something is missing right before the sample, shape (N,).
        disputed: Whether messages of one stamp contradicted each other since the sample
            before, shape (N,).
    """

    joint_position: Float
    joint_velocity: Float
    joint_effort: Float | None
    broken: Mask
    disputed: Mask


@dataclass
class MergeCounts:
    """What became of the messages of a step.

    Attributes:
        duplicate: Messages whose stamp was known for each of their joints.
        older: Messages older than what is known of each of their joints.
        conflicting: Messages of a known stamp that said something else.
        missing: Messages of the leading joint that no reading of some other joint surrounds.
        parts: Messages that were used but make no sample of their own.
    """

    duplicate: int = 0
    older: int = 0
    conflicting: int = 0
    missing: int = 0
    parts: int = 0


class _Track:
    """Readings of one joint in time order, as far back as samples may need them."""

    def __init__(self, effort: bool, steps: PositionJumpDetector) -> None:
        self.order = StampOrder()
        self.steps = steps
        self.stamp: Int = np.empty(0, dtype=np.int64)
        self.segment: Int = np.empty(0, dtype=np.int64)
        self.newest: Int = np.empty(0, dtype=np.int64)  # newest stamp of all on its arrival
        width = 3 if effort else 2
        self.values: Float = np.empty((width, 0))  # position, velocity, effort

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
        if leaps is None and self.steps.calm:
            return []
        if leaps is None:
            leaps = np.zeros((len(stamp), 1), dtype=np.int8)
        rows = zip(stamp.tolist(), leaps, strict=True)
        return [at for at, leap in rows if bool(self.steps.back(at, leap)[0])]

    def forget(self, oldest: int) -> None:
        """Keep what lies at or after a stamp, and one reading before it."""
        first = max(0, int(np.searchsorted(self.stamp, oldest, side="left")) - 1)
        if first:
            self.stamp, self.segment = self.stamp[first:], self.segment[first:]
            self.newest, self.values = self.newest[first:], self.values[:, first:]


class PartialStateMerger:
    """Merges messages that carry some of the joints into samples of all of them.

    The first joint of the model leads: every reading of it is an instant to know all joints
    at. The others are interpolated between the readings on both sides of that instant, so
    that no joint is ever older than the rest: holding the last value would put steps into
    the derivative. Positions follow the cubic through both velocities where they are
    reported, else a line; velocity and effort a line. A joint that has no readings on both
    sides within one segment (see `StampOrder`) is missing, and with it the sample. A sample
    waits until all joints have passed its stamp, at most a second of stamps.

    Args:
        n_joints: Number of joints of the model.
        limits: Limits from the URDF; None to do without.
        effort: Whether effort is read.

    Attributes:
        conflicting: Joints whose readings leapt forth and back, shape (n,).
        missing: Joints that were missing when a sample was last given up, shape (n,).
    """

    def __init__(self, n_joints: int, limits: JointLimits | None, effort: bool) -> None:
        self.conflicting = np.zeros(n_joints, dtype=np.bool_)
        self.missing = np.zeros(n_joints, dtype=np.bool_)
        self._n_joints = n_joints
        self._wraps = np.zeros(n_joints, dtype=np.bool_) if limits is None else limits.wraps
        self._effort = effort
        self._steps = PositionJumpDetector.of(n_joints, limits)
        self._tracks = self._fresh_tracks()
        self._newest: int | None = None
        self._lead: Int = np.empty((2, 0), dtype=np.int64)  # stamp, newest stamp on arrival
        self._broken = False  # the sample before the next one was given up
        self._disputes: list[int] = []  # stamps, for the first sample after each

    @property
    def waiting(self) -> int:
        """Messages of the leading joint that wait for the other joints."""
        return self._lead.shape[1]

    def ages(self) -> Float:
        """Return how long each joint is behind the newest stamp, shape (n,); inf if unseen. [s]"""
        if self._newest is None:
            return np.full(self._n_joints, np.inf)
        last = [int(track.stamp[-1]) if len(track.stamp) else None for track in self._tracks]
        return np.array([np.inf if at is None else (self._newest - at) * NANOSECOND for at in last])

    def limits(self) -> Float:
        """Return the longest time between readings of a joint that is bridged, shape (n,). [s]"""
        return np.array([track.order.longest_gap_ns * NANOSECOND for track in self._tracks])

    def seed(self, last: MergedStates, disputed: bool) -> None:
        """Begin after whole messages.

        Args:
            last: The last sample of all joints.
            disputed: Whether a message of its stamp said something else.
        """
        for joint, track in enumerate(self._tracks):
            track.contradictions(last.stamp_ns, last.joint_position[:, joint])
            track.extend(last.stamp_ns, last.stamp_ns, self._values(last, joint, slice(None)))
        self._newest = int(last.stamp_ns[-1])
        if disputed:
            self._disputes = [self._newest]

    def begin_epoch(self) -> None:
        """Forget all readings: the stamps have jumped back."""
        self._tracks = self._fresh_tracks()
        self._newest = None
        self._disputes = [-1] if self._disputes else []

    def step(self, readings: JointReadings, verdict: MergeCounts) -> MergedStates | None:
        """Take messages of one epoch in order of arrival.

        Args:
            readings: At least one message.
            verdict: Where to count what became of them.

        Returns:
            The samples that are complete, or None.
        """
        stamp, mask = readings.stamp_ns, readings.mask
        first = int(stamp[0]) if self._newest is None else self._newest
        newest = np.maximum(np.maximum.accumulate(stamp), first)
        self._newest = int(newest[-1])
        used = np.zeros(len(stamp), dtype=np.bool_)
        same = np.zeros(len(stamp), dtype=np.bool_)
        conflict = np.zeros(len(stamp), dtype=np.bool_)
        for joint, track in enumerate(self._tracks):
            rows = np.flatnonzero(mask[:, joint])
            if not len(rows):
                continue
            fresh = self._fresh(track, readings, rows, joint, same, conflict)
            used[fresh] = True
            if len(fresh):
                position = readings.joint_position[fresh, joint]
                found = track.contradictions(stamp[fresh], position)
                self._disputes += found
                self.conflicting[joint] |= bool(found)
            track.extend(stamp[fresh], newest[fresh], self._values(readings, joint, fresh))
            if joint == 0:
                self._lead = np.concatenate(
                    [self._lead, np.stack([stamp[fresh], newest[fresh]])], axis=1
                )
                verdict.parts -= len(fresh)
        verdict.parts += int(used.sum())
        verdict.conflicting += int((conflict & ~used).sum())
        verdict.duplicate += int((same & ~conflict & ~used).sum())
        verdict.older += int((~used & ~same & ~conflict).sum())
        self._disputes += stamp[conflict].tolist()
        return self._decide(verdict, closing=False)

    def flush(self, verdict: MergeCounts) -> MergedStates | None:
        """Give up waiting, as at the end of an epoch."""
        return self._decide(verdict, closing=True)

    def _fresh_tracks(self) -> list[_Track]:
        joints = range(self._n_joints)
        return [_Track(self._effort, self._steps.joint(joint)) for joint in joints]

    def _fresh(
        self,
        track: _Track,
        readings: JointReadings,
        rows: Int,
        joint: int,
        same: Mask,
        conflict: Mask,
    ) -> Int:
        """Rows with a new reading of a joint; marks those that repeat or contradict the last."""
        stamp = readings.stamp_ns[rows]
        known = len(track.stamp) > 0
        last = int(track.stamp[-1]) if known else int(stamp[0]) - 1
        before = np.maximum(np.maximum.accumulate(np.append(last, stamp[:-1])), last)
        fresh = stamp > before
        if bool(fresh.all()):
            return rows
        again = np.flatnonzero(stamp == before)
        if len(again):
            same[rows[again]] = True
            position = readings.joint_position[rows, joint]
            of_last = float(track.values[0, -1]) if known else np.nan
            kept = np.append(of_last, position[fresh])
            earlier = kept[np.cumsum(fresh)[again]]
            conflict[rows[again]] |= differ(position[again], earlier)
        return rows[fresh]

    def _values(self, source: JointReadings | MergedStates, joint: int, rows: Int | slice) -> Float:
        columns = [source.joint_position[rows, joint], source.joint_velocity[rows, joint]]
        if source.joint_effort is not None:
            columns.append(source.joint_effort[rows, joint])
        return np.stack(columns)

    def _decide(self, verdict: MergeCounts, closing: bool) -> MergedStates | None:
        """Make samples of the leading readings whose fate is known."""
        at: Int = self._lead[0]
        arrived: Int = self._lead[1]
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
                timely = track.newest[index] <= at + PATIENCE_NS
                there = there & timely & (exact | linked)
            surrounded[:, joint] = there
            right[:, joint] = index
        fate = passed | (newest > at + PATIENCE_NS) | closing
        count = len(at) if bool(fate.all()) else int(np.argmin(fate))
        surrounded = surrounded[:count]
        complete = surrounded.all(axis=1) & (arrived[:count] <= at[:count] + PATIENCE_NS)
        self._lead = self._lead[:, count:]
        samples = self._samples(at[:count], right[:count], complete)
        verdict.missing += int((~complete).sum())
        given_up = np.flatnonzero(~complete)
        if len(given_up):
            self.missing = ~surrounded[given_up[-1]]
        self._forget(int(at[count - 1]) if count else None, newest)
        return samples

    def _samples(self, at: Int, right: Int, complete: Mask) -> MergedStates | None:
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
        values = np.stack(columns, axis=1)  # quantity, joint, sample
        disputed = np.zeros(len(rows), dtype=np.bool_)
        if self._disputes:
            after = np.searchsorted(at[rows], self._disputes, side="right")
            disputed[after[after < len(rows)]] = True
            self._disputes = [stamp for stamp in self._disputes if stamp >= at[rows[-1]]]
        return MergedStates(
            stamp_ns=at[rows],
            joint_position=values[0].T,
            joint_velocity=values[1].T,
            joint_effort=values[2].T if self._effort else None,
            broken=gaps[rows + 1] > gaps[since + 1],
            disputed=disputed,
        )

    def _interpolate(self, joint: int, at: Int, right: Int) -> Float:
        """Position, velocity and effort of a joint at some stamps, shape (2 or 3, N)."""
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

    def _forget(self, decided: int | None, newest: int) -> None:
        """Drop readings that no later sample needs."""
        if self.waiting:
            oldest = int(self._lead[0, 0])
        else:
            oldest = newest - PATIENCE_NS if decided is None else max(decided, newest - PATIENCE_NS)
        for track in self._tracks:
            track.forget(oldest)


def differ(position: Float, other: Float) -> NDArray[np.bool_]:
    """Whether two positions of one stamp contradict each other, elementwise."""
    return np.abs(position - other) > SAME * (1 + np.abs(other))
