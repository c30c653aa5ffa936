"""Motor temperatures -> temperature blocks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_energy.blocks import Int, TemperatureBlock
from robot_energy.ingest.accounting import Accounting
from robot_energy.ingest.order import BACKWARD_JUMP_NS
from robot_energy.wire.batch import RawBatch
from robot_energy.wire.layout import Decoder, Run, stamp_ns

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

MOTOR_TEMPERATURES = "ros2_energy_msgs/msg/MotorTemperatures"
TEMPERATURE = "sensor_msgs/msg/Temperature"
STAMP = ("header.stamp.sec", "header.stamp.nanosec")


class TemperatureIngest:
    """Turns temperature messages into blocks in model joint order.

    ``MotorTemperatures`` names its joints; ``sensor_msgs/Temperature`` is told apart by
    its ``frame_id``, which must be the joint's name. degC.

    Args:
        joint_names: Modelled joints in model order.
        typestore: Message definitions of the source; those known here by default.

    Attributes:
        account: Received, accepted and rejected messages.
        ignored_joints: Names met that the model does not know.
    """

    types = (MOTOR_TEMPERATURES, TEMPERATURE)

    def __init__(self, joint_names: Sequence[str], typestore: Typestore | None = None) -> None:
        self.account = Accounting()
        self.ignored_joints: set[str] = set()
        self._names = tuple(joint_names)
        self._typestore = typestore
        self._decoders: dict[str, Decoder] = {}

    def step(self, batches: Sequence[RawBatch]) -> TemperatureBlock | None:
        """Take messages of any number of topics.

        Args:
            batches: Serialised messages, each in order of arrival.

        Returns:
            Readings in the order of their stamps, which may interleave between topics; in
            order of arrival where the stamps of a topic jump back. None if there are none.
        """
        taken = [(batch, *self._decode(batch)) for batch in batches]
        blocks = [block for _, block, _ in taken if block is not None]
        if not blocks:
            return None
        block = TemperatureBlock.concatenate(blocks)
        jumped = any(bool((np.diff(part.stamp_ns) < -BACKWARD_JUMP_NS).any()) for part in blocks)
        if not jumped:
            return block[np.argsort(block.stamp_ns, kind="stable")]
        arrival = np.concatenate([batch.log_time_ns[rows] for batch, _, rows in taken])
        return block[np.argsort(arrival, kind="stable")]

    def _decode(self, batch: RawBatch) -> tuple[TemperatureBlock | None, Int]:
        """Return the readings of one topic in order of arrival, and their rows."""
        self.account.received += len(batch)
        decoder = self._decoders.get(batch.msgtype)
        if decoder is None:
            fields = (
                (*STAMP, "joint_names", "temperature_degc")
                if batch.msgtype == MOTOR_TEMPERATURES
                else (*STAMP, "header.frame_id", "temperature")
            )
            decoder = self._decoders[batch.msgtype] = Decoder(
                batch.msgtype, fields, self._typestore
            )
        decoded = decoder.decode(batch)
        self.account.reject("malformed", len(decoded.malformed))
        blocks: list[TemperatureBlock] = []
        rows: list[Int] = []
        for run in decoded.runs:
            block = self._place(run, batch.msgtype)
            if isinstance(block, str):
                self.account.reject(block, len(run.rows))
                continue
            given = ~np.isnan(block.motor_temperature_degc).all(axis=1)
            known = block.stamp_ns != 0
            self.account.reject("zero_stamp", int((~known).sum()))
            self.account.reject("not_finite", int((known & ~given).sum()))
            self.account.accepted += int((known & given).sum())
            blocks.append(block[known & given])
            rows.append(run.rows[known & given])
        if not blocks:
            return None, np.empty(0, dtype=np.int64)
        order = np.argsort(np.concatenate(rows))
        return TemperatureBlock.concatenate(blocks)[order], np.concatenate(rows)[order]

    def _place(self, run: Run, msgtype: str) -> TemperatureBlock | str:
        if msgtype == MOTOR_TEMPERATURES:
            names, values = run.columns["joint_names"], run.columns["temperature_degc"]
        else:
            names, values = (run.columns["header.frame_id"],), run.columns["temperature"]
        if not isinstance(names, tuple) or isinstance(values, str | tuple):
            return "malformed"
        values = values.reshape(len(run.rows), -1).astype(np.float64)
        if values.shape[1] != len(names):
            return "wrong_length"
        self.ignored_joints |= {str(name) for name in names} - set(self._names)
        block = np.full((len(run.rows), len(self._names)), np.nan)
        found = False
        for column, name in enumerate(names):
            if name in self._names:
                block[:, self._names.index(str(name))] = values[:, column]
                found = True
        if not found:
            return "unknown_joint"
        return TemperatureBlock(stamp_ns(run), block)
