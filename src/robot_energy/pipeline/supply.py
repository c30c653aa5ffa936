"""Shaft power -> power of the drives, the bus and the grid, and the phase of every sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from robot_energy.model import RobotModel
from robot_energy.physics.cabinet import CabinetStage
from robot_energy.physics.drive import drive_from_model
from robot_energy.physics.drivetrain import motor_standstill
from robot_energy.physics.equations import Balance
from robot_energy.physics.hold_torque import HoldTorque
from robot_energy.pipeline.settings import Settings
from robot_energy.timeline.blocks import (
    Bits,
    Float,
    Phase,
    PowerBlock,
    Quality,
    TorqueBlock,
    mark,
    sum_over_joints,
)

MAX_POWER = 1e6  # no robot draws a megawatt: the joint states are wrong [W]
OF_CABINET = ("loss_dc", "loss_grid", "brake_power", "capacitor_power", "grid_power")


class SupplyStage:
    """Drives and cabinet of a robot.

    Args:
        settings: What the effort is, which shows what motors hold at rest.
    """

    def __init__(self, model: RobotModel, settings: Settings) -> None:
        self.drive = drive_from_model(model)
        self.cabinet = CabinetStage(model.cabinet)
        self.hold = HoldTorque(model, settings.effort)
        self._standstill = motor_standstill(model)
        self._fallback_degc = model.temperature.fallback_degc

    def standing(self, motor_velocity: Float) -> NDArray[np.bool_]:
        """Return where motors stand, same shape.

        Args:
            motor_velocity: Shape (N, n). [rad/s]
        """
        return np.asarray(np.abs(motor_velocity) <= self._standstill)

    def winding(self, motor_temperature_degc: Float) -> Float:
        """Return the temperature of windings; where none is known, that of the model. [degC]

        Args:
            motor_temperature_degc: NaN where unknown, shape (N, n). [degC]
        """
        unknown = np.isnan(motor_temperature_degc)
        return np.where(unknown, self._fallback_degc, motor_temperature_degc)

    def drawn(
        self, shaft: Float, speed: Float, wound: Float, winding: Float, quality: Bits
    ) -> Float:
        """Return the input power of every drive, shape (N, n). [W]

        Args:
            shaft: Shaft power, shape (N, n). [W]
            speed: Motor velocity, same shape. [rad/s]
            wound: Torque in the windings, same shape. [N m]
            winding: Their temperature, same shape. [degC]
            quality: Marked in place where a drive is outside its map, shape (N,).
        """
        power, extrapolated = self.drive.input_power(shaft, speed, wound, winding)
        if extrapolated is not None:
            mark(quality, np.logical_or.reduce(extrapolated, axis=1), Quality.DRIVE_EXTRAPOLATED)
        return power

    def balance(
        self, block: TorqueBlock | PowerBlock, drawn: Float, standing: NDArray[np.bool_],
        quality: Bits,
    ) -> tuple[Float, Balance, NDArray[np.uint8]]:  # fmt: skip
        """Return the power of the bus [W], what the cabinet makes of it, and the phase, (N,) each.

        Args:
            block: Samples in time order, behind those before.
            drawn: By every drive, shape (N, n). [W]
            standing: Where motors stand, shape (N, n).
            quality: Marked in place where the power is not finite, shape (N,).
        """
        bus = sum_over_joints(drawn)
        bus[np.abs(bus) > MAX_POWER] = np.nan
        balance = self.cabinet.step(block.stamp_ns, block.segment, bus)
        finite = np.isfinite(balance.grid_power)
        mark(quality, ~finite, Quality.NOT_FINITE)
        phase = np.full(len(bus), Phase.MOTION, dtype=np.uint8)
        phase[standing.all(axis=1)] = Phase.HOLD
        phase[bus + balance.loss_dc < 0] = Phase.GENERATING
        phase[~finite] = Phase.UNKNOWN
        return bus, balance, phase

    @np.errstate(invalid="ignore", over="ignore")
    def again(self, power: PowerBlock) -> PowerBlock:
        """Return power as these drives and this cabinet make it; torque and friction stay.

        Args:
            power: Of a model that differs in nothing else; in time order.
        """
        speed, standing = power.motor_velocity, self.standing(power.motor_velocity)
        quality = power.quality & ~np.uint32(Quality.DRIVE_EXTRAPOLATED | Quality.NOT_FINITE)
        wound, _ = self.hold.in_winding(power.motor_torque, power.motor_torque_measured, standing)
        shaft = power.rigid_power + power.friction_power
        winding = self.winding(power.motor_temperature_degc)
        drawn = self.drawn(shaft, speed, wound, winding, quality)
        bus, balance, phase = self.balance(power, drawn, standing, quality)
        return replace(
            power,
            quality=quality,
            phase=phase,
            drive_loss=drawn - shaft,
            bus_power=bus,
            **{name: getattr(balance, name) for name in OF_CABINET},
        )
