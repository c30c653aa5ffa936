"""A drive model of one constant efficiency, in one file as a user writes it."""

import numpy as np

from robot_energy.model.drive_models import DriveModel, register_drive_model
from robot_energy.model.figure import ModelEntry, PositiveFigure


class ConstantEfficiency(ModelEntry):
    """P_el = P_mech / eta while motoring, P_mech eta while generating."""

    efficiency: PositiveFigure


class ConstantEfficiencies:
    """The drives of all joints."""

    def __init__(self, entries):
        self._efficiency = np.asarray([entry.efficiency.value for entry in entries])

    def input_power(self, shaft_power, motor_velocity, motor_torque, motor_temperature_degc):
        driving = shaft_power > 0
        factor = np.where(driving, 1 / self._efficiency, self._efficiency)
        return shaft_power * factor, None


KIND = register_drive_model(
    DriveModel(
        name="constant_efficiency",
        label="one efficiency",
        line="shaft power over one efficiency at every speed and torque",
        key="constant_efficiency",
        entry=ConstantEfficiency,
        physics=ConstantEfficiencies,
        figures=(("efficiency", "efficiency", "-"),),
    )
)
