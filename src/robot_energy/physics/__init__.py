"""The power chain: pure functions over arrays, and the classes that take them from a model."""

from robot_energy.physics.drivetrain import motor_torque, motor_velocity, rotor_torque
from robot_energy.physics.equations import (
    Balance,
    constant_viscous,
    exponential_viscous,
    friction_torque,
    grid_balance,
    loss_model_power,
    shaft_power,
    table_viscous,
    trapezoid_energy,
)

__all__ = [
    "Balance",
    "constant_viscous",
    "exponential_viscous",
    "friction_torque",
    "grid_balance",
    "loss_model_power",
    "motor_torque",
    "motor_velocity",
    "rotor_torque",
    "shaft_power",
    "table_viscous",
    "trapezoid_energy",
]
