"""Records that leave the rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from robot_energy.foundation.described import Described
from robot_energy.timeline.blocks import Block, Float, MeterBlock, TemperatureBlock


@dataclass(frozen=True)
class RigJoints(Block):
    """Joint states as the controller reports them.

    Attributes:
        joint_position: Joint side, shape (N, n). [rad]
        joint_velocity: Joint side, shape (N, n). [rad/s]
        measured_motor_torque: Motor side, from current and name-plate torque constant,
            shape (N, n). [N m]
        measured_drive_power: Electrical input of each drive, as it reports, shape (N, n). [W]
    """

    joint_position: Float
    joint_velocity: Float
    measured_motor_torque: Float
    measured_drive_power: Float


@dataclass(frozen=True)
class Truth(Block):
    """What really happens in the plant, at the true instants of the samples.

    ``grid_power = sum_i(rigid_power + friction_power + iron_loss + copper_loss
    + inverter_loss)_i + loss_dc + loss_grid + rectifier_loss + brake_power
    + capacitor_power`` at every sample.

    Attributes:
        joint_position: Shape (N, n). [rad]
        joint_velocity: Shape (N, n). [rad/s]
        joint_acceleration: Shape (N, n). [rad/s^2]
        motor_velocity: Shape (N, n). [rad/s]
        motor_torque: At the shaft, shape (N, n). [N m]
        motor_torque_friction: Shape (N, n). [N m]
        motor_temperature_degc: Winding and magnets, shape (N, n). [degC]
        gear_temperature_degc: Oil, shape (N, n). [degC]
        rigid_power: Shape (N, n). [W]
        friction_power: Below 0 only where presliding gives back, shape (N, n). [W]
        iron_loss: Shape (N, n). [W]
        copper_loss: Shape (N, n). [W]
        inverter_loss: Shape (N, n). [W]
        loss_dc: Shape (N,). [W]
        loss_grid: Shape (N,). [W]
        rectifier_loss: Shape (N,). [W]
        brake_power: Shape (N,). [W]
        capacitor_power: Signed, shape (N,). [W]
        bus_voltage: Shape (N,). [V]
        grid_power: Shape (N,). [W]
    """

    joint_position: Float
    joint_velocity: Float
    joint_acceleration: Float
    motor_velocity: Float
    motor_torque: Float
    motor_torque_friction: Float
    motor_temperature_degc: Float
    gear_temperature_degc: Float
    rigid_power: Float
    friction_power: Float
    iron_loss: Float
    copper_loss: Float
    inverter_loss: Float
    loss_dc: Float
    loss_grid: Float
    rectifier_loss: Float
    brake_power: Float
    capacitor_power: Float
    bus_voltage: Float
    grid_power: Float

    @property
    def shaft_power(self) -> Float:
        """Rigid and friction power of each axis, shape (N, n). [W]"""
        return self.rigid_power + self.friction_power

    @property
    def drive_power(self) -> Float:
        """Electrical input of each drive, shape (N, n). [W]"""
        return self.shaft_power + self.iron_loss + self.copper_loss + self.inverter_loss


class RigOutput(Described):
    """What one step of the rig gave."""

    joints: Annotated[RigJoints, "Joint states."]
    temperatures: Annotated[TemperatureBlock | None, "Motor temperatures, None if none was due."]
    meter: Annotated[MeterBlock | None, "Readings of the grid meter, None if none was due."]
    truth: Annotated[Truth, "For tests and studies; a monitor never sees it."]

    @classmethod
    def concatenate(cls, outputs: Sequence[RigOutput]) -> RigOutput:
        """Return at least one output as one with all samples and readings, in the order given."""
        temperatures = [o.temperatures for o in outputs if o.temperatures is not None]
        meters = [o.meter for o in outputs if o.meter is not None]
        return cls(
            RigJoints.concatenate([o.joints for o in outputs]),
            TemperatureBlock.concatenate(temperatures) if temperatures else None,
            MeterBlock.concatenate(meters) if meters else None,
            Truth.concatenate([o.truth for o in outputs]),
        )
