"""Joint states -> joint blocks: names, order, units, quality."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from robot_energy.blocks import Float, Int, JointBlock, Quality, differences, in_any_joint, mark
from robot_energy.ingest.accounting import Accounting
from robot_energy.ingest.order import DUPLICATE, OLDER, StampOrder
from robot_energy.wire.batch import RawBatch
from robot_energy.wire.layout import Decoder, Run, stamp_ns

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

JOINT_STATE = "sensor_msgs/msg/JointState"

FIELDS = ("header.stamp.sec", "header.stamp.nanosec", "name", "position", "velocity")


class JointStateIngest:
    """Turns JointState messages into blocks in model joint order.

    Joints are matched by name in every message; joints that the model does not know are
    ignored and listed. A message that lacks a joint, has arrays of wrong length, a
    position that is not finite, or a stamp that is zero or not newer, is rejected and
    counted by reason. Missing or NaN velocity is left NaN for the derivative to fill.

    Args:
        joint_names: Modelled joints in model order.
        typestore: Message definitions of the source; those known here by default.
        effort: Whether to read the effort; NaN everywhere if not. A message whose effort
            is absent or of another length than its names has none.

    Attributes:
        account: Received, accepted and rejected messages.
        order: Gaps and backward jumps of the stamps.
        ignored_joints: Joints met that the model does not know.
        missing_joints: Joints of the model that a rejected message lacked.
    """

    def __init__(
        self,
        joint_names: Sequence[str],
        typestore: Typestore | None = None,
        *,
        effort: bool = False,
    ) -> None:
        self.account = Accounting()
        self.order = StampOrder()
        self.ignored_joints: set[str] = set()
        self.missing_joints: set[str] = set()
        self._names = tuple(joint_names)
        self._decoder = Decoder(
            JOINT_STATE,
            (*FIELDS, "effort") if effort else FIELDS,
            typestore,
        )
        self._columns: dict[tuple[str, ...], Int | slice | str] = {}

    def step(self, batch: RawBatch) -> JointBlock | None:
        """Take messages in order of arrival.

        Args:
            batch: Serialised JointState messages.

        Returns:
            The accepted samples, or None if there are none.
        """
        size = len(batch)
        self.account.received += size
        decoded = self._decoder.decode(batch)
        self.account.reject("malformed", len(decoded.malformed))
        stamp, position, velocity, effort, good = self._gather(decoded.runs, size)
        good = self._refuse("zero_stamp", good, stamp == 0)
        good = self._refuse("not_finite", good, _bad(position, velocity))
        rows = np.flatnonzero(good)
        verdict = self.order.verdict(stamp[rows])
        self.account.reject("duplicate_stamp", int((verdict == DUPLICATE).sum()))
        self.account.reject("older_stamp", int((verdict == OLDER).sum()))
        rows = rows[verdict == 0]
        self.account.accepted += len(rows)
        if not len(rows):
            return None
        if len(rows) == size:
            return self._block(stamp, position, velocity, effort)
        return self._block(stamp[rows], position[rows], velocity[rows], effort[rows])

    def _gather(
        self, runs: Sequence[Run], size: int
    ) -> tuple[Int, Float, Float, Float, NDArray[np.bool_]]:
        """Put the runs in order of arrival; the last result tells which rows are usable."""
        placed: list[tuple[Int, Int, Float, Float, Float]] = []
        for run in runs:
            part = self._place(run)
            if isinstance(part, str):
                self.account.reject(part, len(run.rows))
            else:
                placed.append((run.rows, *part))
        if len(placed) == 1 and len(placed[0][0]) == size:
            return *placed[0][1:], np.ones(size, dtype=np.bool_)
        shape = (size, len(self._names))
        stamp = np.zeros(size, dtype=np.int64)
        position, velocity, effort = (np.full(shape, np.nan) for _ in range(3))
        good = np.zeros(size, dtype=np.bool_)
        for rows, stamps, positions, velocities, efforts in placed:
            stamp[rows], position[rows], velocity[rows] = stamps, positions, velocities
            effort[rows] = efforts
            good[rows] = True
        return stamp, position, velocity, effort, good

    def _block(self, stamp: Int, position: Float, velocity: Float, effort: Float) -> JointBlock:
        before = self.order.segment
        segment = self.order.segments(stamp)
        quality = np.zeros(len(stamp), dtype=np.uint32)
        if self.order.segment > before:
            mark(quality, differences(segment, before) > 0, Quality.AFTER_GAP)
        return JointBlock(
            stamp_ns=stamp,
            segment=segment,
            quality=quality,
            joint_position=position,
            joint_velocity=velocity,
            joint_acceleration=np.full_like(position, np.nan),
            joint_effort=effort,
        )

    def _place(self, run: Run) -> tuple[Int, Float, Float, Float] | str:
        """Return stamps and quantities in model order, or why there are none."""
        names = run.columns["name"]
        positions, velocities = run.columns["position"], run.columns["velocity"]
        if (
            not isinstance(names, tuple)
            or isinstance(positions, str | tuple)
            or isinstance(velocities, str | tuple)
        ):
            return "malformed"
        columns = self._columns.get(names)
        if columns is None:
            columns = self._columns[names] = self._match(names)
        if isinstance(columns, str):
            return columns
        if positions.shape[1] != len(names) or velocities.shape[1] not in (0, len(names)):
            return "wrong_length"
        position = positions.astype(np.float64)[:, columns]
        velocity = effort = np.full_like(position, np.nan)
        if velocities.shape[1]:
            velocity = velocities.astype(np.float64)[:, columns]
        efforts = run.columns.get("effort")
        if isinstance(efforts, np.ndarray) and efforts.shape[1] == len(names):
            effort = efforts.astype(np.float64)[:, columns]
        return stamp_ns(run), position, velocity, effort

    def _match(self, names: tuple[str, ...]) -> Int | slice | str:
        """Columns of the model's joints in a message, or why there are none."""
        self.ignored_joints |= set(names) - set(self._names)
        missing = set(self._names) - set(names)
        if missing:
            self.missing_joints |= missing
            return "missing_joint"
        if len(set(names)) != len(names):
            return "repeated_joint"
        if names == self._names:
            return slice(None)  # nothing to copy
        return np.asarray([names.index(name) for name in self._names], dtype=np.int64)

    def _refuse(
        self, reason: str, good: NDArray[np.bool_], bad: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        refused = good & bad
        self.account.reject(reason, int(refused.sum()))
        return good & ~bad


def _bad(position: Float, velocity: Float) -> NDArray[np.bool_]:
    """Which samples have a position that is not finite or an infinite velocity."""
    if bool(np.isfinite(position.sum() + velocity.sum())):
        return np.zeros(len(position), dtype=np.bool_)
    return in_any_joint(~np.isfinite(position) | np.isinf(velocity))
