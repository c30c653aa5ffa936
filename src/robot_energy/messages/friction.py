"""Friction blocks <-> ``ros2_energy_msgs/JointFriction``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_energy.blocks import NANOSECOND, FrictionBlock, TemperatureOrigin
from robot_energy.cdr.batch import RawBatch
from robot_energy.cdr.decode import Decoder, Encoder, stamp_columns, stamp_ns
from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.model import RobotModel
from robot_energy.pipeline.friction_certainty import FrictionCertainty
from robot_energy.timeline.epochs import STRAY_STAMP, slow_reach
from robot_energy.timeline.stamps import BAD_STAMP, valid_stamps
from robot_energy.timeline.streams import StreamRun, StreamSplitter

JOINT_FRICTION = "ros2_energy_msgs/msg/JointFriction"
ARRAYS = ("coulomb", "viscous", "viscous_fallback", "motor_temperature_degc")
DEVIATIONS = ("viscous_std", "viscous_fallback_std")


class FrictionWriter:
    """Serialises friction blocks, one message per row.

    Args:
        model: The robot's model.
    """

    def __init__(self, model: RobotModel) -> None:
        n_joints = len(model.joints)
        self._certainty = FrictionCertainty(model)
        self._encoder = Encoder(
            JOINT_FRICTION,
            {
                "model_id": model.model_id,
                "joint_names": model.joint_names,
                "stale_after": model.temperature.stale_after,
                "fallback_temperature_degc": model.temperature.fallback_degc,
            },
            dict.fromkeys(
                (*ARRAYS, *DEVIATIONS, "temperature_stamp", "temperature_source"), n_joints
            ),
        )

    def encode(self, block: FrictionBlock) -> NDArray[np.uint8]:
        """Return one serialised message per row, shape (N, size)."""
        measured = ~np.isnan(block.motor_temperature_degc)
        source = np.where(measured, TemperatureOrigin.MEASURED, TemperatureOrigin.FALLBACK)
        columns = {name: getattr(block, name) for name in ARRAYS}
        return self._encoder.encode(
            {
                **stamp_columns(block.stamp_ns),
                **stamp_columns(block.temperature_stamp_ns, "temperature_stamp"),
                "quality": block.quality,
                "temperature_source": source.astype(np.uint8),
                "viscous_std": self._certainty.std(block),
                "viscous_fallback_std": np.tile(self._certainty.fallback_std, (len(block), 1)),
                **columns,
            },
            len(block),
        )


class FrictionReader:
    """Reads friction messages of the same model back into blocks, without stray stamps.

    Args:
        model: The robot's model; messages of another model are rejected.

    Attributes:
        account: Received, accepted and rejected messages.
        epochs: Jumps and outliers of the stamps.
    """

    def __init__(self, model: RobotModel) -> None:
        self.account = RejectionLog()
        reach = slow_reach(round(model.temperature.stale_after / NANOSECOND))
        self._continuity = StreamSplitter[FrictionBlock](reach, FrictionBlock.concatenate)
        self.epochs = self._continuity.epochs
        self._identity = (model.joint_names, model.model_id)
        self._decoder = Decoder(
            JOINT_FRICTION,
            (
                "header.stamp.sec",
                "header.stamp.nanosec",
                "model_id",
                "quality",
                "joint_names",
                "temperature_stamp.sec",
                "temperature_stamp.nanosec",
                *ARRAYS,
            ),
        )

    def restart(self) -> None:
        """Drop what waits, as after an error. The account is left alone."""
        self._continuity.restart()

    def decode(self, batch: RawBatch) -> FrictionBlock | None:
        """Return the rows of a batch in order of arrival, or None if there are none."""
        self.account.received += len(batch)
        decoded = self._decoder.decode(batch)
        self.account.reject("malformed", len(decoded.malformed))
        blocks: list[FrictionBlock] = []
        rows: list[NDArray[np.int64]] = []
        n_joints = len(self._identity[0])
        for run in decoded.runs:
            arrays = {name: run.array(name) for name in ARRAYS}
            arrays["temperature_stamp_ns"] = stamp_ns(run, "temperature_stamp")
            if (run.columns["joint_names"], run.columns["model_id"]) != self._identity:
                self.account.reject("other_model", len(run.rows))
            elif any(array.shape[1] != n_joints for array in arrays.values()):
                self.account.reject("wrong_length", len(run.rows))
            else:
                valid = valid_stamps(stamp_ns(run))
                valid &= valid_stamps(arrays["temperature_stamp_ns"]).all(axis=1)
                self.account.reject(BAD_STAMP, int((~valid).sum()))
                rows.append(run.rows[valid])
                blocks.append(
                    FrictionBlock(
                        stamp_ns=stamp_ns(run),
                        quality=run.array("quality").astype(np.uint32),
                        **arrays,
                    )[valid]
                )
        if not any(map(len, blocks)):
            return None
        block = FrictionBlock.concatenate(blocks)
        if len(blocks) > 1:
            block = block[np.argsort(np.concatenate(rows))]
        dated = block.stamp_ns != 0  # zero: what holds before any temperature
        first = block[~dated]
        self.account.accepted += len(first)
        stretches = self._continuity.step(block[dated]) if dated.any() else []
        return self._taken(first, stretches)

    def flush(self) -> FrictionBlock | None:
        """Return what still waits and is no outlier, as at the end."""
        return self._taken(None, self._continuity.flush())

    def _taken(
        self, first: FrictionBlock | None, stretches: list[StreamRun[FrictionBlock]]
    ) -> FrictionBlock | None:
        """Bring the account up to date."""
        self.account.accepted += sum(len(stretch.block) for stretch in stretches)
        self.account.reject(STRAY_STAMP, self.epochs.strays - self.account.rejected[STRAY_STAMP])
        self.account.waiting = self._continuity.waiting
        blocks = [stretch.block for stretch in stretches]
        if first is not None and len(first):
            blocks.insert(0, first)
        return FrictionBlock.concatenate(blocks) if blocks else None
