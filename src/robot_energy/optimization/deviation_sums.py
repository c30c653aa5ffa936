"""Columns of `EnergyDeviations` over what a pipeline gave: how sure a difference of energies is."""

from __future__ import annotations

import numpy as np

from robot_energy.blocks import Float
from robot_energy.model import RobotModel
from robot_energy.optimization.deviations import EnergyDeviations
from robot_energy.physics.drivetrain import motor_standstill
from robot_energy.pipeline import Output
from robot_energy.pipeline.consecutive import ConsecutiveBlocks


class DeviationSums:
    """Integrates the columns of one motion.

    Args:
        model: The robot's model, with the payload that it carries.
    """

    def __init__(self, model: RobotModel) -> None:
        self._deviations = EnergyDeviations(model)
        returned = model.cabinet.regeneration_efficiency
        self._returned = 0.0 if returned is None else returned.value
        self._standstill = motor_standstill(model)
        self._blocks = ConsecutiveBlocks()
        self._sum: Float | None = None
        self._brake: Float | None = None

    @property
    def energy(self) -> Float:
        """Change of the energy from the grid with the error of each figure, shape (K,). [J]"""
        return np.zeros(1) if self._sum is None else self._sum

    @property
    def brake(self) -> Float:
        """The same of the energy into the brake resistor, shape (K,). [J]"""
        return np.zeros(1) if self._brake is None else self._brake

    def take(self, output: Output) -> None:
        """Take what a step of the pipeline gave.

        Args:
            output: In time order.
        """
        if output.power is None:
            return
        block, time = self._blocks.joined(output.power)
        weight = 0.5 * (np.append(time, 0.0) + np.append(0.0, time))
        braking = block.brake_power > 0.0
        excess = braking | (block.grid_power < block.loss_grid)
        fed_back = np.maximum(block.brake_power, np.where(excess, -block.bus_power, 0.0))
        speed = np.where(
            np.abs(block.motor_velocity) <= self._standstill, 0.0, block.motor_velocity
        )
        rows = self._deviations.columns(
            speed,
            block.motor_torque,
            block.rigid_power,
            block.friction_power,
            block.drive_loss,
            _mean_known(block.motor_temperature_degc),
            np.ones(len(block)),
            fed_back,
        )
        rows = np.nan_to_num(rows) * weight[:, None]
        reaches = np.where(braking, 0.0, np.where(excess, self._returned, 1.0))
        total, lost = rows.copy(), rows * braking[:, None]
        total[:, 3:] *= reaches[:, None]  # the first three are of the cabinet
        lost[:, :2] = 0.0
        self._sum = self.energy + total.sum(axis=0)
        self._brake = self.brake + lost.sum(axis=0)


def _mean_known(values: Float) -> Float:
    """Mean of each column; NaN, which stands for the fallback, where nothing is known."""
    known = np.isfinite(values)
    count = known.sum(axis=0)
    total = np.where(known, values, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
