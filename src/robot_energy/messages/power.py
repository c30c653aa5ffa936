"""Means of the power chain -> ``ros2_energy_msgs/PowerState``."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from robot_energy.accounting.averaging import MeanBlock
from robot_energy.accounting.load_curve import COLUMNS
from robot_energy.bag.cdr.decode import Encoder, stamp_columns
from robot_energy.certainty.deviation import power_std
from robot_energy.model.auxiliary import AuxiliaryLoad
from robot_energy.timeline.blocks import MeterLocation, known_part, sum_over_joints

POWER_STATE = "ros2_energy_msgs/msg/PowerState"
LOADS = tuple(f"auxiliary.{name}" for name in COLUMNS)
LOAD_KINDS = {"auxiliary.state": np.int16, "auxiliary.remarks": np.uint8}  # not float64


class PowerStateWriter:
    """Serialises means, one message per period; parts that the model lacks are NaN."""

    def __init__(
        self,
        joint_names: Sequence[str],
        model_id: str,
        loads: Sequence[AuxiliaryLoad] = (),
        unmodelled: Collection[str] = (),
    ) -> None:
        self._unmodelled = unmodelled
        self._encoder = Encoder(
            POWER_STATE,
            {
                "model_id": model_id,
                "joints.name": tuple(joint_names),
                "auxiliary.name": tuple(load.name for load in loads),
                "auxiliary.states": tuple(load.state_names for load in loads),
            },
        )

    def encode(self, block: MeanBlock, location: MeterLocation) -> NDArray[np.uint8]:
        """Return one serialised message per period, shape (W, size)."""
        power = block.powers
        rigid, friction, loss = power["rigid"], power["friction"], power["drive_loss"]
        shaft, lacking = rigid + friction, self._unmodelled
        shown_loss = known_part("drive_loss", loss, lacking)
        predicted = power["grid_import"] - power["grid_return"]
        loads = dict(zip(LOADS, np.moveaxis(block.loads, 2, 0), strict=True))
        for name, kind in LOAD_KINDS.items():
            loads[name] = loads[name].astype(kind)
        return self._encoder.encode(
            {
                **stamp_columns(block.stamp_ns),
                "quality": block.quality,
                "phase": block.phase.astype(np.uint8),
                "period": block.period,
                "coverage": block.coverage,
                "predicted_grid_power": predicted,
                "predicted_power_std": power_std(block.deviation),
                "predicted_power_lower": predicted - block.band_half,
                "predicted_power_upper": predicted + block.band_half,
                "band": block.band.astype(np.uint8),
                "measured_power": block.measured_power,
                "predicted_power_at_meter": block.predicted_power_at_meter,
                "residual_power": block.predicted_power_at_meter - block.measured_power,
                "comparison_coverage": block.comparison_coverage,
                "measurement_age": block.measurement_age,
                "meter_location": np.uint8(location),
                "bus_power": sum_over_joints(shaft + loss),
                "rigid_power": sum_over_joints(rigid),
                "friction_power": sum_over_joints(friction),
                "drive_loss": sum_over_joints(shown_loss),
                "loss_dc": power["loss_dc"],
                "loss_grid": power["loss_grid"],
                "brake_power": power["brake"],
                "capacitor_power": known_part("capacitor", power["capacitor"], lacking),
                "returned_power": power["grid_return"],
                "payload_mass": block.payload_mass,
                "outlet_power": predicted + loads["auxiliary.power"].sum(axis=1),
                "joints.motor_velocity": block.motor_velocity,
                "joints.motor_torque": block.motor_torque,
                "joints.motor_torque_measured": block.motor_torque_measured,
                "joints.shaft_power": shaft,
                "joints.shaft_power_measured": block.shaft_power_measured,
                "joints.rigid_power": rigid,
                "joints.friction_power": friction,
                "joints.drive_loss": shown_loss,
                "joints.drive_power": shaft + loss,
                "joints.motor_temperature_degc": block.motor_temperature_degc,
                "joints.coulomb": block.coulomb,
                "joints.viscous": block.viscous,
                **loads,
            },
            len(block),
        )
