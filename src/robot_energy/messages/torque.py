"""Torque blocks <-> ``ros2_energy_msgs/JointTorque``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from robot_energy.blocks import Quality, TorqueBlock, differences, mark
from robot_energy.cdr.batch import RawBatch
from robot_energy.cdr.decode import Decoder, Encoder, stamp_columns, stamp_ns
from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.timeline.epochs import STRAY_STAMP, Reach
from robot_energy.timeline.gaps import ACCEPTED, DUPLICATE, OLDER, StampOrder
from robot_energy.timeline.stamps import BAD_STAMP, valid_stamps
from robot_energy.timeline.streams import StreamRun, StreamSplitter

JOINT_TORQUE = "ros2_energy_msgs/msg/JointTorque"
ARRAYS = (
    "joint_position",
    "joint_velocity",
    "joint_acceleration",
    "joint_torque_rigid",
    "motor_velocity",
    "motor_torque_rigid",
    "motor_torque_measured",
)


class TorqueWriter:
    """Serialises torque blocks, one message per sample.

    Args:
        joint_names: Joints in model order.
        model_id: Identity of the model file.
    """

    def __init__(self, joint_names: Sequence[str], model_id: str) -> None:
        self._encoder = Encoder(
            JOINT_TORQUE,
            {"model_id": model_id, "joint_names": tuple(joint_names)},
            dict.fromkeys(ARRAYS, len(joint_names)),
        )

    def encode(self, block: TorqueBlock) -> NDArray[np.uint8]:
        """Return one serialised message per sample, shape (N, size)."""
        columns = {name: getattr(block, name) for name in ARRAYS}
        return self._encoder.encode(
            {
                **stamp_columns(block.stamp_ns),
                "quality": block.quality,
                "segment": block.segment.astype(np.uint32),
                "payload_mass": block.payload_mass,
                **columns,
            },
            len(block),
        )


class TorqueReader:
    """Reads torque messages of the same model back into blocks.

    Segments are numbered anew: one ends where the writer says so, and wherever the stamps
    show a gap, because a restarted writer begins again at segment 0 and because messages
    may be lost on the way. Samples that are not newer than the last one are rejected, as
    they are for joint states (two writers, one sample twice).

    Args:
        joint_names: Joints in model order.
        model_id: Identity of the model file; messages of another model are rejected.

    Attributes:
        account: Received, accepted and rejected messages.
        order: Gaps and backward jumps of the stamps.
        epochs: Jumps and outliers of the stamps.
    """

    def __init__(self, joint_names: Sequence[str], model_id: str) -> None:
        self.account = RejectionLog()
        self.order = StampOrder()
        reach = Reach(prompt=True)
        self._continuity = StreamSplitter[TorqueBlock](reach, TorqueBlock.concatenate)
        self.epochs = self._continuity.epochs
        self._written: int | None = None  # segment number of the last sample, as written
        self._breaks = 0  # segments that ended by the writer's word alone
        self._identity = (tuple(joint_names), model_id)
        self._decoder = Decoder(
            JOINT_TORQUE,
            (
                "header.stamp.sec",
                "header.stamp.nanosec",
                "model_id",
                "quality",
                "segment",
                "joint_names",
                *ARRAYS,
                "payload_mass",
            ),
        )

    def decode(self, batch: RawBatch) -> TorqueBlock | None:
        """Return the samples of a batch in order of arrival, or None if there are none."""
        self.account.received += len(batch)
        decoded = self._decoder.decode(batch)
        self.account.reject("malformed", len(decoded.malformed))
        blocks: list[TorqueBlock] = []
        rows: list[NDArray[np.int64]] = []
        n_joints = len(self._identity[0])
        for run in decoded.runs:
            arrays = {name: run.array(name) for name in ARRAYS}
            if (run.columns["joint_names"], run.columns["model_id"]) != self._identity:
                self.account.reject("other_model", len(run.rows))
            elif any(array.shape[1] != n_joints for array in arrays.values()):
                self.account.reject("wrong_length", len(run.rows))
            else:
                rows.append(run.rows)
                blocks.append(
                    TorqueBlock(
                        stamp_ns=stamp_ns(run),
                        segment=run.array("segment").astype(np.int64),
                        quality=run.array("quality").astype(np.uint32),
                        payload_mass=run.array("payload_mass"),
                        **arrays,
                    )
                )
        if not blocks:
            return None
        block = TorqueBlock.concatenate(blocks)
        if len(blocks) > 1:
            block = block[np.argsort(np.concatenate(rows))]
        valid = valid_stamps(block.stamp_ns)
        self.account.reject(BAD_STAMP, int((~valid).sum()))
        block = block[valid]
        return self._taken(self._continuity.step(block)) if len(block) else None

    def flush(self) -> TorqueBlock | None:
        """Return what still waits and is no outlier, as at the end."""
        return self._taken(self._continuity.flush())

    def _taken(self, stretches: list[StreamRun[TorqueBlock]]) -> TorqueBlock | None:
        """Bring the account up to date and number the segments."""
        self.account.reject(STRAY_STAMP, self.epochs.strays - self.account.rejected[STRAY_STAMP])
        self.account.waiting = self._continuity.waiting
        if not stretches:
            return None
        block = TorqueBlock.concatenate([stretch.block for stretch in stretches])
        verdict = self.order.verdict(block.stamp_ns)
        self.account.reject("duplicate_stamp", int((verdict == DUPLICATE).sum()))
        self.account.reject("older_stamp", int((verdict == OLDER).sum()))
        accepted = block[verdict == ACCEPTED]
        self.account.accepted += len(accepted)
        return self._renumbered(accepted) if len(accepted) else None

    def restart(self) -> None:
        """Drop what waits, as after an error; a gap follows."""
        self._continuity.restart()
        self.order.interrupt()

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
