"""Friction blocks <-> ``ros2_energy_msgs/JointFriction``."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from robot_energy.bag.cdr.decode import Encoder, RawBatch, Run, stamp_columns, stamp_ns
from robot_energy.messages.model_messages import ModelMessageReader
from robot_energy.model import RobotModel
from robot_energy.timeline.blocks import NANOSECOND, FrictionBlock, TemperatureOrigin
from robot_energy.timeline.stamps import EpochRun, slow_reach, valid_stamps
from robot_energy.timeline.streams import joined

JOINT_FRICTION = "ros2_energy_msgs/msg/JointFriction"
ARRAYS = (
    "coulomb", "viscous", "viscous_std", "viscous_shared_std", "viscous_fallback",
    "viscous_fallback_std", "motor_temperature_degc",
)  # fmt: skip


class FrictionWriter:
    """Serialises friction blocks, one message per row."""

    def __init__(self, model: RobotModel) -> None:
        n_joints = len(model.joints)
        self._encoder = Encoder(
            JOINT_FRICTION,
            {
                "model_id": model.model_id,
                "joint_names": model.joint_names,
                "stale_after": model.temperature.stale_after,
                "fallback_temperature_degc": model.temperature.fallback_degc,
            },
            dict.fromkeys((*ARRAYS, "temperature_stamp", "temperature_source"), n_joints),
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
                **columns,
            },
            len(block),
        )


class FrictionReader(ModelMessageReader[FrictionBlock]):
    """Reads friction messages of the same model back into blocks, without outliers."""

    def __init__(self, model: RobotModel) -> None:
        fields = ("temperature_stamp.sec", "temperature_stamp.nanosec")
        reach = slow_reach(round(model.temperature.stale_after / NANOSECOND))
        super().__init__(JOINT_FRICTION, model.joint_names, model.model_id, ARRAYS, fields, reach)

    def decode(self, batch: RawBatch) -> FrictionBlock | None:
        """Return the rows of a batch in order of arrival, or None if there are none."""
        block = self._read(batch)
        if block is None:
            return None
        dated = block.stamp_ns != 0  # zero: what holds before any temperature
        runs = self._stream.step(block[dated]) if dated.any() else []
        return self._taken(block[~dated], runs)

    def flush(self) -> FrictionBlock | None:
        """Return what still waits and is not an outlier, as at the end."""
        return self._taken(None, self._stream.flush())

    def _block(self, run: Run, arrays: dict[str, Any]) -> tuple[FrictionBlock, NDArray[np.bool_]]:
        seen = stamp_ns(run, "temperature_stamp")
        block = FrictionBlock(
            stamp_ns=stamp_ns(run),
            quality=run.array("quality").astype(np.uint32),
            temperature_stamp_ns=seen,
            **arrays,
        )
        return block, valid_stamps(block.stamp_ns) & valid_stamps(seen).all(axis=1)

    def _taken(
        self, first: FrictionBlock | None, runs: list[tuple[FrictionBlock, EpochRun]]
    ) -> FrictionBlock | None:
        """Bring the account up to date."""
        found = [block for block in (first, joined(runs)) if block is not None and len(block)]
        self.rejections.accepted += sum(map(len, found))
        self.rejections.waiting = self._stream.waiting
        return FrictionBlock.concatenate(found) if found else None
