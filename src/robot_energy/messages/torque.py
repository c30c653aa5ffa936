"""Torque blocks <-> ``ros2_energy_msgs/JointTorque``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robot_energy.bag.cdr.decode import Encoder, RawBatch, Run, stamp_columns, stamp_ns
from robot_energy.messages.fields import FRAME, RECORDING
from robot_energy.messages.model_messages import ModelMessageReader
from robot_energy.timeline.blocks import Quality, TorqueBlock, differences, mark
from robot_energy.timeline.stamps import BY_PERIOD, OLDER, EpochRun, Reach, newer, valid_stamps
from robot_energy.timeline.streams import StampOrder

JOINT_TORQUE = "ros2_energy_msgs/msg/JointTorque"
ARRAYS = (
    "joint_position", "joint_velocity", "joint_acceleration", "joint_torque_rigid",
    "motor_velocity", "motor_torque_rigid", "motor_torque_measured",
)  # fmt: skip


class TorqueWriter:
    """Serialises torque blocks, one message per sample."""

    def __init__(self, joint_names: Sequence[str], model_id: str) -> None:
        self._encoders = [
            Encoder(
                JOINT_TORQUE,
                {FRAME: frame, "model_id": model_id, "joint_names": tuple(joint_names)},
                dict.fromkeys(ARRAYS, len(joint_names)),
            )
            for frame in ("", RECORDING)
        ]

    def encode(self, block: TorqueBlock, recording: bool = False) -> NDArray[np.uint8]:
        """Return one serialised message per sample, shape (N, size)."""
        columns = {name: getattr(block, name) for name in ARRAYS}
        return self._encoders[recording].encode(
            {
                **stamp_columns(block.stamp_ns),
                "quality": block.quality,
                "segment": block.segment.astype(np.uint32),
                "payload_mass": block.payload_mass,
                **columns,
            },
            len(block),
        )


class TorqueReader(ModelMessageReader[TorqueBlock]):
    """Reads torque messages of the same model back into blocks.

    Segments are numbered again: one ends where the writer says so, and wherever the stamps
    show a gap, because a restarted writer begins again at segment 0 and because messages
    may be lost on the way. Samples that are not newer than the last one are rejected, as
    they are for joint states (two writers, one sample twice).

    Args:
        max_gap: Longest time between two samples that is bridged; 0: five median periods,
            0.1 s to 1 s. [s]
    """

    def __init__(
        self, joint_names: Sequence[str], model_id: str, max_gap: float = BY_PERIOD
    ) -> None:
        fields = ("segment", "payload_mass")
        reach = Reach(prompt=True)
        super().__init__(JOINT_TORQUE, joint_names, model_id, ARRAYS, fields, reach)
        self.order = StampOrder(max_gap)
        self._newest_ns: int | None = None  # of the running epoch
        self._written: int | None = None  # segment number of the last sample, as written
        self._breaks = 0  # segments that ended by the writer's word alone

    def decode(self, batch: RawBatch) -> TorqueBlock | None:
        """Return the samples of a batch in order of arrival, or None if there are none."""
        block = self._read(batch)
        return None if block is None else self._taken(self._stream.step(block))

    def flush(self) -> TorqueBlock | None:
        """Return what still waits and is not an outlier, as at the end."""
        return self._taken(self._stream.flush())

    def restart(self) -> None:
        """Drop what waits, as after an error; a gap follows."""
        super().restart()
        self.order.interrupt()

    def _block(self, run: Run, arrays: dict[str, Any]) -> tuple[TorqueBlock, NDArray[np.bool_]]:
        block = TorqueBlock(
            stamp_ns=stamp_ns(run),
            segment=run.array("segment").astype(np.int64),
            quality=run.array("quality").astype(np.uint32),
            payload_mass=run.array("payload_mass"),
            **arrays,
        )
        return block, valid_stamps(block.stamp_ns)

    def _taken(self, runs: list[tuple[TorqueBlock, EpochRun]]) -> TorqueBlock | None:
        """Bring the account up to date and number the segments."""
        self.rejections.waiting = self._stream.waiting
        parts: list[TorqueBlock] = []
        for block, run in runs:
            fresh, again = newer(block.stamp_ns, None if run.new_epoch else self._newest_ns)
            self.rejections.reject("duplicate_stamp", int(again.sum()))
            self.rejections.reject(OLDER, int((~fresh & ~again).sum()))
            if bool(fresh.any()):
                parts.append(block[fresh])
                self._newest_ns = int(parts[-1].stamp_ns[-1])
        if not parts:
            return None
        accepted = TorqueBlock.concatenate(parts)
        self.rejections.accepted += len(accepted)
        return self._renumbered(accepted)

    def _renumbered(self, block: TorqueBlock) -> TorqueBlock:
        """Number the segments by the writer's word and by the stamps."""
        written = block.segment
        before = self.order.segment
        seen = self.order.segments(block.stamp_ns)
        by_stamps = differences(seen, before) > 0
        by_writer = (
            np.diff(written, prepend=written[0] if self._written is None else self._written) != 0
        )
        breaks = self._breaks + np.cumsum(by_writer & ~by_stamps)
        self._breaks, self._written = int(breaks[-1]), int(written[-1])
        quality = block.quality.copy()
        mark(quality, by_stamps, Quality.AFTER_GAP)
        return replace(block, segment=seen + breaks, quality=quality)
