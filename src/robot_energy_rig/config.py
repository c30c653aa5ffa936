"""What a rig is asked for: effects and sensors; what it gives: joint states, readings, truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field, replace
from math import isfinite
from typing import Annotated

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import RigError
from robot_energy.timeline.blocks import Block, Float, MeterBlock, MeterMeaning, TemperatureBlock

HARD = (
    "elastic_joints", "presliding", "coulomb_temperature", "viscous_exponent", "fan",
    "velocity_filter", "meter_filter", "temperature_error",
)  # fmt: skip
"""Effects that no model file has a term for; the identification undoes the low pass of a meter."""
POSITIVE = ("encoder_counts", "temperature_rate", "temperature_resolution", "meter_rate")


class Sensors(Described):
    """Figures of the sensors."""

    encoder_counts: Annotated[int, "Per motor turn. [1]"] = 16384
    velocity_noise: Annotated[float, "Standard deviation, motor side. [rad/s]"] = 0.05
    torque_noise: Annotated[float, "Standard deviation of the reported motor torque. [N m]"] = 0.02
    torque_constant_error: Annotated[
        float, "Standard deviation of the torque constants on the name plates, drawn once. [-]"
    ] = 0.0
    stamp_jitter: Annotated[float, "Standard deviation of stamps, cut at 3 of them. [s]"] = 5e-5
    temperature_rate: Annotated[float, "Readings of the motor temperatures. [Hz]"] = 1.0
    temperature_resolution: Annotated[float, "Step of the readings. [K]"] = 1.0
    temperature_noise: Annotated[float, "Standard deviation before rounding. [K]"] = 0.2
    meter_rate: Annotated[float, "Readings of the grid meter. [Hz]"] = 10.0
    meter_meaning: Annotated[MeterMeaning, "Any but UNKNOWN."] = MeterMeaning.MEAN_OVER_INTERVAL
    meter_class: Annotated[float, "Gain error is drawn within +- this share. [-]"] = 0.005
    meter_noise: Annotated[float, "Standard deviation of one reading, share of it. [-]"] = 0.002
    drive_power_class: Annotated[float, "As `meter_class`, of each drive's power. [-]"] = 0.01
    drive_power_noise: Annotated[float, "Standard deviation of one reading. [W]"] = 0.5
    velocity_filter: Annotated[float, "Time constant of that of the velocities. [s]"] = 0.01
    meter_filter: Annotated[float, "Time constant of the low pass in the power meter. [s]"] = 0.3
    temperature_lag: Annotated[float, "Time constant of the motor temperature sensors. [s]"] = 60.0
    temperature_offset: Annotated[float, "Standard deviation of their constant errors. [K]"] = 2.0

    def __post_init__(self) -> None:
        for name, value in self.__dict__.items():
            low = "> 0" if name in POSITIVE else ">= 0"
            if not (0 <= value < float("inf") and (value > 0 or name not in POSITIVE)):
                raise RigError(f"the sensors' {name} is {value}", f"a value {low}")
        if self.meter_meaning is MeterMeaning.UNKNOWN:
            raise RigError("the meter's meaning is UNKNOWN", "a known meaning")


class RigConfig(Described):
    """Effects beyond rigid bodies, Coulomb and viscous friction; those of `HARD` are off."""

    stribeck: Annotated[bool, "Friction rises towards standstill."] = True
    load_friction: Annotated[bool, "Coulomb friction grows with the load."] = True
    lubricant_temperature: Annotated[bool, "Oil thins as it warms; off: it is at 60 degC."] = True
    copper: Annotated[bool, "Copper loss, holding against gravity included."] = True
    copper_temperature: Annotated[bool, "Winding resistance rises with temperature."] = True
    iron: Annotated[bool, "Iron loss, a drag on the motor."] = True
    inverter: Annotated[bool, "Inverter loss."] = True
    demagnetisation: Annotated[
        bool, "Warm magnets are weaker: the same torque needs more current, and reads too high."
    ] = True
    capacitor: Annotated[bool, "DC link stores energy; off: excess is braked at once."] = True
    rectifier: Annotated[bool, "Rectifier loss."] = True
    warming: Annotated[bool, "Losses and ambient change temperatures; off: they stay."] = True
    encoder: Annotated[bool, "Positions are quantised."] = True
    velocity_noise: Annotated[bool, "On or off."] = True
    torque_noise: Annotated[bool, "On or off."] = True
    stamp_jitter: Annotated[bool, "On or off."] = True
    temperature_sensor: Annotated[bool, "Temperature readings are noisy and rounded."] = True
    meter_error: Annotated[bool, "Meter has gain error and noise."] = True
    drive_power_error: Annotated[bool, "So have the power readings of the drives."] = True
    elastic_joints: Annotated[bool, "Gears are springs; encoders see the motors."] = False
    presliding: Annotated[bool, "Coulomb friction reverses over a distance (Dahl)."] = False
    creep: Annotated[bool, "With presliding: at rest friction slowly takes over load."] = False
    coulomb_temperature: Annotated[bool, "Coulomb friction falls as the gear warms."] = False
    viscous_exponent: Annotated[bool, "Viscous friction bends with speed."] = False
    fan: Annotated[bool, "A fan of the cabinet switches with the warmest motor."] = False
    velocity_filter: Annotated[bool, "The reported velocities are low-passed."] = False
    meter_filter: Annotated[bool, "So is the power of the meter; its counter is not."] = False
    temperature_error: Annotated[bool, "Thermometers lag and have constant errors."] = False
    thermal_speedup: Annotated[float, "Factor on speed of temperatures, lag of sensors. [-]"] = 1.0
    sensors: Annotated[Sensors, "Figures of the sensors."] = field(default_factory=Sensors)

    def __post_init__(self) -> None:
        if not (self.thermal_speedup > 0 and isfinite(self.thermal_speedup)):
            raise RigError(f"thermal_speedup is {self.thermal_speedup}", "a factor > 0")

    @classmethod
    def hard(cls) -> RigConfig:
        """Every effect on, those of `HARD` too."""
        return cls().having(*HARD)

    @classmethod
    def plain(cls) -> RigConfig:
        """Everything off: rigid bodies, Coulomb and constant viscous friction, true sensors."""
        return cls().without(*cls()._switches)

    @property
    def _switches(self) -> list[str]:
        return [name for name, value in self.__dict__.items() if isinstance(value, bool)]

    def having(self, *effects: str) -> RigConfig:
        """Return a copy with the named effects on."""
        return self._switched(effects, True)

    def without(self, *effects: str) -> RigConfig:
        """Return a copy with the named effects off."""
        return self._switched(effects, False)

    def _switched(self, effects: Sequence[str], on: bool) -> RigConfig:
        for effect in effects:
            if effect not in self._switches:
                raise RigError(f"the rig has no effect '{effect}'", ", ".join(self._switches))
        return replace(self, **dict.fromkeys(effects, on))


class RigJoints(Block):
    """Joint states as the controller reports them."""

    joint_position: Annotated[Float, "Joint side, shape (N, n). [rad]"]
    joint_velocity: Annotated[Float, "Joint side, shape (N, n). [rad/s]"]
    measured_motor_torque: Annotated[Float, "From current and name plate, shape (N, n). [N m]"]
    measured_drive_power: Annotated[Float, "Input that each drive reports, shape (N, n). [W]"]


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
