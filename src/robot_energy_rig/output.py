"""Records that leave the rig."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from robot_energy.foundation.described import Described
from robot_energy.timeline.blocks import Block, Float, MeterBlock, TemperatureBlock


class RigJoints(Block):
    """Joint states as the controller reports them."""

    joint_position: Annotated[Float, "Joint side, shape (N, n). [rad]"]
    joint_velocity: Annotated[Float, "Joint side, shape (N, n). [rad/s]"]
    measured_motor_torque: Annotated[
        Float, "Motor side, from current and name-plate torque constant, shape (N, n). [N m]"
    ]
    measured_drive_power: Annotated[
        Float, "Electrical input of each drive, as it reports, shape (N, n). [W]"
    ]


class Truth(Block):
    """What really happens in the plant, at the true instants of the samples.

    ``grid_power = sum_i(rigid_power + friction_power + iron_loss + copper_loss
    + inverter_loss)_i + loss_dc + loss_grid + rectifier_loss + brake_power
    + capacitor_power`` at every sample.
    """

    joint_position: Annotated[Float, "Shape (N, n). [rad]"]
    joint_velocity: Annotated[Float, "Shape (N, n). [rad/s]"]
    joint_acceleration: Annotated[Float, "Shape (N, n). [rad/s^2]"]
    motor_velocity: Annotated[Float, "Shape (N, n). [rad/s]"]
    motor_torque: Annotated[Float, "At the shaft, shape (N, n). [N m]"]
    motor_torque_friction: Annotated[Float, "Shape (N, n). [N m]"]
    motor_temperature_degc: Annotated[Float, "Winding and magnets, shape (N, n). [degC]"]
    gear_temperature_degc: Annotated[Float, "Oil, shape (N, n). [degC]"]
    rigid_power: Annotated[Float, "Shape (N, n). [W]"]
    friction_power: Annotated[Float, "Below 0 only where presliding gives back, shape (N, n). [W]"]
    iron_loss: Annotated[Float, "Shape (N, n). [W]"]
    copper_loss: Annotated[Float, "Shape (N, n). [W]"]
    inverter_loss: Annotated[Float, "Shape (N, n). [W]"]
    loss_dc: Annotated[Float, "Shape (N,). [W]"]
    loss_grid: Annotated[Float, "Shape (N,). [W]"]
    rectifier_loss: Annotated[Float, "Shape (N,). [W]"]
    brake_power: Annotated[Float, "Shape (N,). [W]"]
    capacitor_power: Annotated[Float, "Signed, shape (N,). [W]"]
    bus_voltage: Annotated[Float, "Shape (N,). [V]"]
    grid_power: Annotated[Float, "Shape (N,). [W]"]

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
