"""Joint states as they arrive: columns in model order, and which joints each message has."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from robot_energy.blocks import Block, Float, Int, in_any_joint
from robot_energy.cdr.batch import RawBatch
from robot_energy.cdr.decode import Decoder, Run, stamp_ns
from robot_energy.inputs.rejection_log import MAX_JOINTS, ByNames, remember_names
from robot_energy.timeline.gaps import BACKWARD_JUMP_NS, SECOND_NS
from robot_energy.timeline.stamps import BAD_STAMP, valid_stamps

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

JOINT_STATE = "sensor_msgs/msg/JointState"
MAX_DECODED_BYTES = 8 * 2**20  # of messages decoded at once: names that always change take room
Mask = NDArray[np.bool_]
Reject = Callable[[str, int], None]


@dataclass(frozen=True)
class JointReadings(Block):
    """Messages in order of arrival.

    Attributes:
        stamp_ns: Shape (N,). [ns]
        joint_position: NaN where a message lacks the joint, shape (N, n). [rad] or [m]
        joint_velocity: NaN where it is not reported, shape (N, n). [rad/s] or [m/s]
        joint_effort: As the driver sent it, NaN where it did not, shape (N, n); None if
            effort is not read.
        present: Which joints each message has, shape (N, n); None if all have all.
    """

    joint_position: Float
    joint_velocity: Float
    joint_effort: Float | None
    present: Mask | None

    @property
    def mask(self) -> Mask:
        """Which joints each message has, shape (N, n)."""
        if self.present is not None:
            return self.present
        return np.ones(self.joint_position.shape, dtype=np.bool_)

    @staticmethod
    def joined(parts: Sequence[JointReadings]) -> JointReadings:
        """Join readings in the order given; at least one."""
        if len(parts) == 1:
            return parts[0]
        if any(part.present is None for part in parts) and any(
            part.present is not None for part in parts
        ):
            parts = [replace(part, present=part.mask) for part in parts]
        return JointReadings.concatenate(parts)


class JointStateReader:
    """Decodes JointState messages and matches their joints by name.

    Args:
        joint_names: Modelled joints in model order.
        effort: Whether to read the effort too.
        receive_time: Whether the time of receipt counts instead of the header's stamp.
        typestore: Message definitions of the source; those known here by default.

    Attributes:
        ignored_joints: Joints met that the model does not know.
    """

    def __init__(
        self,
        joint_names: Sequence[str],
        effort: bool = False,
        receive_time: bool = False,
        typestore: Typestore | None = None,
    ) -> None:
        self.ignored_joints: set[str] = set()
        self._names = tuple(joint_names)
        self._effort = effort
        self._receive_time = receive_time
        fields = ("header.stamp.sec", "header.stamp.nanosec", "name", "position", "velocity")
        fields = (*fields, "effort") if effort else fields
        self._decoder = Decoder(JOINT_STATE, fields, typestore, MAX_JOINTS)
        self._columns = ByNames[_Columns | str]()

    def read(self, batches: Sequence[RawBatch], reject: Reject) -> JointReadings | None:
        """Return what can be read, in order of arrival, or None if that is nothing.

        Messages of one batch stay in order. Batches are merged by their stamps; where those of
        a batch jump, by the time of receipt, if it tells messages of a batch apart.

        Args:
            batches: Serialised messages, one batch per topic.
            reject: Told the reason and number of messages that cannot be used.
        """
        read = [(batch, self._batch(batch, reject)) for batch in batches if len(batch)]
        read = [entry for entry in read if len(entry[1][0])]
        if not read:
            return None
        if len(read) == 1:
            return read[0][1][0]
        parts = [part for _, (part, _) in read]
        whole = JointReadings.joined(parts)
        steps = [np.diff(part.stamp_ns) for part in parts]
        received = [batch.log_time_ns[rows] for batch, (_, rows) in read]
        steady = all(bool((np.abs(step) < SECOND_NS).all()) for step in steps)
        if not steady and any(bool((times != times[0]).any()) for times in received):
            return whole[np.argsort(np.concatenate(received), kind="stable")]
        # epochs counted from the last one, which the topics have in common
        epochs = [np.append(0, np.cumsum(step <= -BACKWARD_JUMP_NS)) for step in steps]
        epochs = [epoch - epoch[-1] for epoch in epochs]
        newest = [
            _newest_by_epoch(part.stamp_ns, epoch)
            for part, epoch in zip(parts, epochs, strict=True)
        ]
        return whole[np.lexsort((np.concatenate(newest), np.concatenate(epochs)))]

    def _batch(self, batch: RawBatch, reject: Reject) -> tuple[JointReadings, Int]:
        """Return the readings of one batch and their rows, both in order of arrival."""
        placed: list[tuple[Int, JointReadings]] = []
        for first, piece in batch.pieces(MAX_DECODED_BYTES):
            decoded = self._decoder.decode(piece)
            reject("malformed", len(decoded.malformed))
            for run in decoded.runs:
                part = self._place(run, piece)
                if isinstance(part, str):
                    reject(part, len(run.rows))
                else:
                    placed.append((run.rows + first if first else run.rows, part))
        if len(placed) == 1:
            rows, part = placed[0]
        elif placed:
            rows = np.concatenate([rows for rows, _ in placed])
            part = JointReadings.joined([part for _, part in placed])
            order = np.argsort(rows)
            rows, part = rows[order], part[order]
        else:
            empty = np.empty((0, len(self._names)))
            rows = np.empty(0, dtype=np.int64)
            return JointReadings(rows, empty, empty, empty if self._effort else None, None), rows
        bad = _unusable(part)
        for reason, wrong in bad.items():
            reject(reason, int(wrong.sum()))
        if bad:
            good = ~np.logical_or.reduce(list(bad.values()))
            rows, part = rows[good], part[good]
        return part, rows

    def _place(self, run: Run, batch: RawBatch) -> JointReadings | str:
        """Return the readings of a run in model order, or why there are none."""
        names = run.columns["name"]
        arrays = [run.columns[key] for key in ("position", "velocity")]
        if self._effort:
            arrays.append(run.columns["effort"])
        if not isinstance(names, tuple) or any(isinstance(array, str | tuple) for array in arrays):
            return "malformed"
        columns = self._columns.get(names)
        if columns is None:
            columns = self._columns.put(names, self._match(names))
        if isinstance(columns, str):
            return columns
        position, *others = (np.asarray(array, dtype=np.float64) for array in arrays)
        if position.shape[1] != len(names):
            return "wrong_length"
        if others[0].shape[1] not in (0, len(names)):
            return "wrong_length"
        if self._effort and others[1].shape[1] != len(names):
            others[1] = np.empty((len(position), 0))
        placed = [columns.place(array) for array in (position, *others)]
        effort = placed[2] if self._effort else None
        stamp = batch.log_time_ns[run.rows] if self._receive_time else stamp_ns(run)
        present = columns.present
        if present is not None:
            present = np.broadcast_to(present, position.shape[:1] + present.shape)
        return JointReadings(stamp, placed[0], placed[1], effort, present)

    def _match(self, names: tuple[str, ...]) -> _Columns | str:
        """Where the model's joints are in a message, or why it cannot be used."""
        remember_names(self.ignored_joints, (n for n in names if n not in self._names))
        found = [names.index(name) if name in names else -1 for name in self._names]
        if max(found, default=-1) < 0:
            return "unknown_joint"
        if len(set(names)) != len(names):
            return "repeated_joint"
        return _Columns(np.asarray(found, dtype=np.int64), len(names))


class _Columns:
    """How the columns of one layout of messages go to those of the model."""

    def __init__(self, found: Int, size: int) -> None:
        self.present: Mask | None = None if bool((found >= 0).all()) else found >= 0
        self._found = found
        self._same = self.present is None and bool(np.array_equal(found, np.arange(size)))

    def place(self, values: Float) -> Float:
        """Return columns in model order, NaN where there are none."""
        if self._same and values.shape[1]:
            return values  # nothing to copy
        placed = np.full((len(values), len(self._found)), np.nan, order="F")
        if values.shape[1]:
            if self.present is None:
                return values[:, self._found]
            placed[:, self.present] = values[:, self._found[self.present]]
        return placed


def _newest_by_epoch(stamp: Int, epoch: Int) -> Int:
    """Newest stamp so far in each epoch."""
    parts = np.split(stamp, np.flatnonzero(np.diff(epoch)) + 1)
    return np.concatenate([np.maximum.accumulate(part) for part in parts])


def _unusable(part: JointReadings) -> dict[str, Mask]:
    """Which messages cannot be used, each under the first reason that applies."""
    bad: dict[str, Mask] = {}
    left = np.ones(len(part), dtype=np.bool_)

    def note(reason: str, wrong: Mask) -> None:
        nonlocal left
        wrong = wrong & left
        if bool(wrong.any()):
            bad[reason] = wrong
            left = left & ~wrong

    stamp, position, velocity = part.stamp_ns, part.joint_position, part.joint_velocity
    if not bool(((stamp > 0) & valid_stamps(stamp)).all()):
        note("zero_stamp", stamp == 0)
        note(BAD_STAMP, ~valid_stamps(stamp))
    with np.errstate(over="ignore", invalid="ignore"):
        finite = bool(np.isfinite(position.sum() + velocity.sum()))
    if not finite:
        note("not_finite", in_any_joint((~np.isfinite(position) & part.mask) | np.isinf(velocity)))
    return bad
