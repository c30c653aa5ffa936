"""Joint states as they arrive -> joint blocks in model order, NaN where a message lacks a joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from robot_energy.bag.cdr.decode import Decoder, RawBatch, Run, stamp_ns
from robot_energy.foundation.units import SECOND_NS
from robot_energy.inputs.parameters import MESSAGES, RECEIVE
from robot_energy.inputs.rejection_log import MAX_JOINTS, ByNames, RejectionLog, remember_names
from robot_energy.inputs.sources import JointStateSource
from robot_energy.timeline.blocks import Float, Int, JointBlock
from robot_energy.timeline.stamps import (
    BACKWARD_JUMP_NS,
    BAD_STAMP,
    MAX_STAMP_NS,
    newest_by_epoch,
    valid_stamps,
)

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

JOINT_STATE = "sensor_msgs/msg/JointState"
MAX_DECODED_BYTES = 8 * 2**20  # of messages decoded at once: names that always change take room
ZERO_STATE = "zero_state"  # the reason under which zeros between other states are counted
Mask = NDArray[np.bool_]
_Places = tuple[Int, Mask, bool]
"""Column of each joint in a message, -1 for none; which have one; whether all are in order."""
_Rows = tuple[Int, list[Float]]
"""Stamps; positions, velocities and, where it is read, effort of some messages."""


@dataclass
class RecordedTime:
    """When messages came, used or not.

    A stray stamp at either end says nothing about when its message came: times of receipt do.

    Attributes:
        first_ns: Time of receipt of the first one. [ns]
        ahead_ns: Stamp less time of receipt of the first one and of the last one that can be read
            and has a stamp; empty before the first one. [ns]
        ordered: Whether no time of receipt was before one that the file holds earlier.
    """

    first_ns: int = 0
    last_ns: int = 0
    ahead_ns: tuple[int, ...] = ()
    ordered: bool = True

    def note(self, received_ns: Int, dated_ns: Int, stamp_ns: Int) -> None:
        """Take messages.

        Args:
            received_ns: Times of receipt of all, shape (M,), M >= 1. [ns]
            dated_ns: Those of the readable ones, shape (N,). [ns]
            stamp_ns: Their stamps, shape (N,). [ns]
        """
        self.first_ns = self.first_ns or int(received_ns[0])
        self.ordered &= self.last_ns <= received_ns[0] and bool((np.diff(received_ns) >= 0).all())
        self.last_ns = int(received_ns[-1])
        if len(dated_ns):
            first = self.ahead_ns[0] if self.ahead_ns else int(stamp_ns[0]) - int(dated_ns[0])
            self.ahead_ns = first, int(stamp_ns[-1]) - int(dated_ns[-1])

    def unused_ns(self, start_ns: int, end_ns: int) -> tuple[int, int]:
        """Return how long messages came before the first sample and after the last one. [ns]"""
        if not self.ordered or not self.ahead_ns:
            return 0, 0
        before = min(start_ns - self.first_ns - ahead for ahead in self.ahead_ns)
        after = min(self.last_ns + ahead - end_ns for ahead in self.ahead_ns)
        return max(before, 0), max(after, 0)


class JointStateReader:
    """Decodes JointState messages and matches their joints by name.

    Args:
        typestore: Message definitions of the source; those known here by default.
        source: What dates the messages, what they call the joints, where that is not
            ``joint_names``, which are read as well, and what corrects them.
        recorded: Notes when messages came, used or not; None where that is of no use.

    Attributes:
        ignored_joints: Joints met that the model does not know.
        known_names: What messages may call the joints, in model order: each way that is read.
        arrival_ns: When the last message that was read came. [ns]
    """

    def __init__(
        self,
        joint_names: Sequence[str],
        log: RejectionLog,
        effort: bool = False,
        typestore: Typestore | None = None,
        source: JointStateSource | None = None,
        recorded: RecordedTime | None = None,
    ) -> None:
        source = source or JointStateSource()
        self.ignored_joints: set[str] = set()
        self._recorded = recorded
        self.arrival_ns = 0
        self._log = log
        names = tuple(joint_names)
        self.known_names = tuple(dict.fromkeys((source.names_of(names), names)))
        self._corrections = source.corrections_of(names)
        self._n_joints = len(names)
        self._effort, self._velocity = effort, source.velocity_source == MESSAGES
        self._receive_time = source.stamp_source == RECEIVE
        fields = ("header.stamp.sec", "header.stamp.nanosec", "name", "position", "velocity")
        fields = (*fields, "effort") if effort else fields
        self._decoder = Decoder(JOINT_STATE, fields, typestore, MAX_JOINTS)
        self._columns = ByNames[_Places | str]()

    def read(self, batches: Sequence[RawBatch]) -> JointBlock | None:
        """Return what can be read, in order of arrival, or None if that is nothing.

        Messages of one batch stay in order. Batches are merged by their stamps; where those of
        a batch jump, by the time of receipt, if it distinguishes messages of a batch.

        Returns:
            One row per message, of segment 0 and not differentiated. The position of a joint
            is NaN where the message lacks it; velocity and effort are also where it has none.
        """
        self._log.received += sum(map(len, batches))
        read: list[tuple[RawBatch, tuple[JointBlock, Int]]] = []
        self.arrival_ns = 0
        for batch in batches:
            if len(batch):
                self.arrival_ns = max(self.arrival_ns, int(batch.log_time_ns[-1]))
                part, rows = self._batch(batch)
                if self._recorded is not None:
                    received_ns = batch.log_time_ns
                    self._recorded.note(received_ns, received_ns[rows], part.stamp_ns)
                if len(part):
                    read.append((batch, (part, rows)))
        if not read:
            return None
        return self._merged(read) if len(read) > 1 else read[0][1][0]

    def _merged(self, read: Sequence[tuple[RawBatch, tuple[JointBlock, Int]]]) -> JointBlock:
        """Join the messages of several topics, which each came with their rows."""
        parts = [part for _, (part, _) in read]
        whole = JointBlock.concatenate(parts)
        steps = [np.diff(part.stamp_ns) for part in parts]
        received = [batch.log_time_ns[rows] for batch, (_, rows) in read]
        steady = all(bool((np.abs(step) < SECOND_NS).all()) for step in steps)
        if not steady and any(bool((times != times[0]).any()) for times in received):
            return whole[np.argsort(np.concatenate(received), kind="stable")]
        # epochs counted from the last one, which the topics have in common
        epochs = [np.append(0, np.cumsum(step <= -BACKWARD_JUMP_NS)) for step in steps]
        epochs = [epoch - epoch[-1] for epoch in epochs]
        stamps = [part.stamp_ns for part in parts]
        newest = list(map(newest_by_epoch, stamps, epochs))
        return whole[np.lexsort((np.concatenate(newest), np.concatenate(epochs)))]

    def _batch(self, batch: RawBatch) -> tuple[JointBlock, Int]:
        """Return the messages of one batch and their rows, both in order of arrival."""
        placed: list[tuple[Int, _Rows]] = []
        short = int(batch.length.sum()) <= MAX_DECODED_BYTES  # as nearly always
        for first, piece in [(0, batch)] if short else batch.pieces(MAX_DECODED_BYTES):
            decoded = self._decoder.decode(piece)
            if len(decoded.malformed):
                self._log.reject("malformed", len(decoded.malformed))
            for run in decoded.runs:
                part = self._place(run, piece)
                if isinstance(part, str):
                    self._log.reject(part, len(run.rows))
                else:
                    placed.append((run.rows + first if first else run.rows, part))
        if not placed:
            none, empty = np.empty(0, dtype=np.int64), np.empty((0, self._n_joints))
            return joint_block(none, empty, empty), none
        rows, (stamp, quantities) = placed[0]
        if len(placed) > 1:
            rows = np.concatenate([each for each, _ in placed])
            order = np.argsort(rows)
            rows, stamp = rows[order], np.concatenate([part[0] for _, part in placed])[order]
            quantities = [
                np.asarray(np.concatenate(parts)[order], order="F")
                for parts in zip(*(part[1] for _, part in placed), strict=True)
            ]
        for place, each in enumerate(self._corrections[: len(quantities)]):
            if each is not None:
                quantities[place] = each.apply(quantities[place])
        position, velocity = quantities[:2]
        part = joint_block(stamp, *quantities)
        dated = int(stamp.min(initial=1)) > 0 and int(stamp.max(initial=1)) <= MAX_STAMP_NS
        with np.errstate(over="ignore", invalid="ignore"):
            if dated and np.isfinite(position.sum() + velocity.sum()):
                return part, rows
        infinite = np.logical_or.reduce(np.isinf(position) | np.isinf(velocity), axis=1)
        left = self._log.refuse(
            {"zero_stamp": stamp == 0, BAD_STAMP: ~valid_stamps(stamp), "not_finite": infinite}
        )
        return part[left], rows[left]

    def _place(self, run: Run, batch: RawBatch) -> _Rows | str:
        """Return stamps and quantities of a run in model order, or why there are none."""
        names = run.columns["name"]
        arrays = [run.columns["position"], run.columns["velocity"]]
        if self._effort:
            arrays.append(run.columns["effort"])
        if not isinstance(names, tuple) or {*map(type, arrays)} != {np.ndarray}:
            return "malformed"
        places = self._columns.get(names)
        if places is None:
            places = self._columns.put(names, self._match(names))
        if isinstance(places, str):
            return places
        found, present, same = places
        position, *others = map(partial(np.asarray, dtype=np.float64), arrays)
        if position.shape[1] != len(names):
            return "wrong_length"
        if not self._velocity:
            others[0] = np.empty((len(position), 0))
        if others[0].shape[1] not in (0, len(names)):
            return "wrong_length"
        if self._effort and others[1].shape[1] != len(names):
            others[1] = np.empty((len(position), 0))
        placed: list[Float] = []
        for values in (position, *others):
            if not (same and values.shape[1]):  # else there is nothing to copy
                given, values = values, np.full((len(values), len(found)), np.nan, order="F")
                if given.shape[1]:
                    values[:, present] = given[:, found[present]]
            placed.append(values)
        position = placed[0]
        if bool(np.isnan(position.sum())):
            lost = np.isnan(position) & present
            position[lost] = np.inf  # which is refused; NaN says that the message lacks the joint
        return batch.log_time_ns[run.rows] if self._receive_time else stamp_ns(run), placed

    def _match(self, names: tuple[str, ...]) -> _Places | str:
        """Where the model's joints are in a message, or why it cannot be used."""
        known = next(
            (one for one in self.known_names if not set(one).isdisjoint(names)), self.known_names[0]
        )
        remember_names(self.ignored_joints, (name for name in names if name not in known))
        found = [names.index(name) if name in names else -1 for name in known]
        if max(found, default=-1) < 0:
            return "unknown_joint"
        if len(set(names)) != len(names):
            return "repeated_joint"
        places = np.asarray(found, dtype=np.int64)
        return places, places >= 0, found == list(range(len(names)))


def joint_block(
    stamp: Int, position: Float, velocity: Float, effort: Float | None = None
) -> JointBlock:
    """Return samples of segment 0, without a mark and not differentiated.

    Args:
        stamp: Shape (N,). [ns]
        position: Shape (N, n). [rad] or [m]
        velocity: Shape (N, n). [rad/s] or [m/s]
        effort: Shape (N, n); None for NaN. [N m] or [A]
    """
    return JointBlock(
        stamp_ns=stamp,
        segment=np.zeros(len(stamp), dtype=np.int64),
        quality=np.zeros(len(stamp), dtype=np.uint32),
        joint_position=position,
        joint_velocity=velocity,
        joint_acceleration=np.full_like(position, np.nan),
        joint_effort=np.full_like(position, np.nan) if effort is None else effort,
    )
