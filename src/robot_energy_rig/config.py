"""What the rig does: effects to switch, and its sensors."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from math import isfinite

from robot_energy.foundation.errors import RigError
from robot_energy.timeline.blocks import MeterMeaning

HARD = (
    "elastic_joints", "presliding", "coulomb_temperature", "viscous_exponent", "fan",
    "velocity_filter", "meter_filter", "temperature_error",
)  # fmt: skip
"""Effects that no model file has a term for; the identification undoes the low pass of a meter."""
POSITIVE = ("encoder_counts", "temperature_rate", "temperature_resolution", "meter_rate")


@dataclass(frozen=True)
class Sensors:
    """Figures of the sensors.

    Attributes:
        encoder_counts: Per motor turn. [1]
        velocity_noise: Standard deviation, motor side. [rad/s]
        torque_noise: Standard deviation of the reported motor torque. [N m]
        torque_constant_error: Standard deviation of the torque constants on the name plates,
            share of them; drawn once. [-]
        stamp_jitter: Standard deviation of the stamps, cut at 3 of them. [s]
        temperature_rate: Readings of the motor temperatures. [Hz]
        temperature_resolution: Step of the readings. [K]
        temperature_noise: Standard deviation before rounding. [K]
        meter_rate: Readings of the grid meter. [Hz]
        meter_meaning: MEAN_OVER_INTERVAL, INSTANTANEOUS or CUMULATIVE.
        meter_class: Gain error is drawn once within +- this share (class 0.5: 0.005). [-]
        meter_noise: Standard deviation of one reading, share of it. [-]
        drive_power_class: Gain error of each drive's own power, drawn once within +- this
            share. [-]
        drive_power_noise: Standard deviation of one reading. [W]
        velocity_filter: Time constant of the low pass behind the velocities. [s]
        meter_filter: Time constant of the low pass in the power meter. [s]
        temperature_lag: Time constant of the motor temperature sensors. [s]
        temperature_offset: Standard deviation of their constant errors. [K]
    """

    encoder_counts: int = 16384
    velocity_noise: float = 0.05
    torque_noise: float = 0.02
    torque_constant_error: float = 0.0
    stamp_jitter: float = 50e-6
    temperature_rate: float = 1.0
    temperature_resolution: float = 1.0
    temperature_noise: float = 0.2
    meter_rate: float = 10.0
    meter_meaning: MeterMeaning = MeterMeaning.MEAN_OVER_INTERVAL
    meter_class: float = 0.005
    meter_noise: float = 0.002
    drive_power_class: float = 0.01
    drive_power_noise: float = 0.5
    velocity_filter: float = 0.01
    meter_filter: float = 0.3
    temperature_lag: float = 60.0
    temperature_offset: float = 2.0

    def __post_init__(self) -> None:
        for name, value in self.__dict__.items():
            low = "> 0" if name in POSITIVE else ">= 0"
            if not (0 <= value < float("inf") and (value > 0 or name not in POSITIVE)):
                raise RigError(f"the sensors' {name} is {value}", f"a value {low}")
        if self.meter_meaning is MeterMeaning.UNKNOWN:
            raise RigError("the meter's meaning is UNKNOWN", "a known meaning")


@dataclass(frozen=True)
class RigConfig:
    """Every effect beyond rigid bodies, Coulomb and viscous friction, on or off.

    The effects of `HARD` are off by default. No model file has a term for them.

    Attributes:
        stribeck: Friction rises towards standstill.
        load_friction: Coulomb friction grows with the load.
        lubricant_temperature: Viscous friction follows the oil; off: oil at 60 degC.
        copper: Copper loss, holding against gravity included.
        copper_temperature: Winding resistance rises with temperature.
        iron: Iron loss, a drag on the motor.
        inverter: Inverter loss.
        demagnetisation: Warm magnets are weaker: more current for the same torque, and
            the reported torque reads too high.
        capacitor: DC link stores energy, the chopper has hysteresis; off: excess is
            braked at once.
        rectifier: Rectifier loss.
        warming: Losses and ambient change the temperatures; off: they stay as started.
        encoder: Positions are quantised.
        velocity_noise: On or off.
        torque_noise: On or off.
        stamp_jitter: On or off.
        temperature_sensor: Temperature readings are noisy and rounded.
        meter_error: Meter has gain error and noise.
        drive_power_error: So have the power readings of the drives.
        elastic_joints: Gears are springs; encoders and drives see the motors.
        presliding: Coulomb friction reverses over a distance, as a spring that slides
            (Dahl); at rest it holds.
        creep: With presliding: at rest friction takes over of the load what it can carry, slowly.
        coulomb_temperature: Coulomb friction falls with the temperature of the gear.
        viscous_exponent: Viscous friction grows with less than the first power of speed.
        fan: A fan of the cabinet switches with the warmest motor.
        velocity_filter: The reported velocities are low-passed.
        meter_filter: So is the power that the meter shows; its energy counter is not.
        temperature_error: Motor temperature sensors lag and have constant errors.
        thermal_speedup: Factor on the speed of the temperatures, and of the lag of their
            sensors; motion stays in real time. For warming up fast. [-]
        sensors: Figures of the sensors.
    """

    stribeck: bool = True
    load_friction: bool = True
    lubricant_temperature: bool = True
    copper: bool = True
    copper_temperature: bool = True
    iron: bool = True
    inverter: bool = True
    demagnetisation: bool = True
    capacitor: bool = True
    rectifier: bool = True
    warming: bool = True
    encoder: bool = True
    velocity_noise: bool = True
    torque_noise: bool = True
    stamp_jitter: bool = True
    temperature_sensor: bool = True
    meter_error: bool = True
    drive_power_error: bool = True
    elastic_joints: bool = False
    presliding: bool = False
    creep: bool = False
    coulomb_temperature: bool = False
    viscous_exponent: bool = False
    fan: bool = False
    velocity_filter: bool = False
    meter_filter: bool = False
    temperature_error: bool = False
    thermal_speedup: float = 1.0
    sensors: Sensors = field(default_factory=Sensors)

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
        return cls().without(*(f.name for f in fields(cls) if f.type == "bool"))

    def without(self, *effects: str) -> RigConfig:
        """Return a copy with the named effects off.

        Args:
            effects: Names of switches.
        """
        return self._switched(effects, on=False)

    def having(self, *effects: str) -> RigConfig:
        """Return a copy with the named effects on; arguments as in `RigConfig.without`."""
        return self._switched(effects, on=True)

    def _switched(self, effects: tuple[str, ...], *, on: bool) -> RigConfig:
        switches = [f.name for f in fields(self) if f.type == "bool"]
        for effect in effects:
            if effect not in switches:
                raise RigError(f"the rig has no effect '{effect}'", ", ".join(switches))
        return replace(self, **dict.fromkeys(effects, on))
