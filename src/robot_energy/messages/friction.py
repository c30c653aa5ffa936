"""Friction blocks <-> ``ros2_energy_msgs/JointFriction``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_energy.blocks import FrictionBlock, TemperatureOrigin
from robot_energy.ingest.accounting import Accounting
from robot_energy.model_file import RobotModel
from robot_energy.pipeline.friction_certainty import FrictionCertainty
from robot_energy.wire.batch import RawBatch
from robot_energy.wire.layout import Decoder, Encoder, stamp_columns, stamp_ns

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
    """Reads friction messages of the same model back into blocks.

    Args:
        model: The robot's model; messages of another model are rejected.

    Attributes:
        account: Received, accepted and rejected messages.
    """

    def __init__(self, model: RobotModel) -> None:
        self.account = Accounting()
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

    def decode(self, batch: RawBatch) -> FrictionBlock | None:
        """Return the rows of a batch in order of arrival, or None if there are none."""
        self.account.received += len(batch)
        decoded = self._decoder.decode(batch)
        self.account.reject("malformed", len(decoded.malformed))
        blocks: list[FrictionBlock] = []
        n_joints = len(self._identity[0])
        for run in decoded.runs:
            arrays = {name: run.array(name) for name in ARRAYS}
            arrays["temperature_stamp_ns"] = stamp_ns(run, "temperature_stamp")
            if (run.columns["joint_names"], run.columns["model_id"]) != self._identity:
                self.account.reject("other_model", len(run.rows))
            elif any(array.shape[1] != n_joints for array in arrays.values()):
                self.account.reject("wrong_length", len(run.rows))
            else:
                self.account.accepted += len(run.rows)
                blocks.append(
                    FrictionBlock(
                        stamp_ns=stamp_ns(run),
                        quality=run.array("quality").astype(np.uint32),
                        **arrays,
                    )
                )
        return FrictionBlock.concatenate(blocks) if blocks else None
