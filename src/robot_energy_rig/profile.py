"""The plant's own parameters: what is independent of the monitored model.

A plant shares rigid bodies, gear ratios and rotor inertias with the model under test, nothing
else. Friction and losses have terms that the models do not have (Stribeck, load, lubricant,
iron, inverter), and where they share a term another value. Motor side throughout. The plants of
this package stand in ``profiles``. No figure of them was measured: they are assumed from
neighbouring robots, so a plant is of the class of a robot, not that robot.

A plant that is drawn at random (`random_profile`) has the scale of the limits of its URDF. Every
other figure comes from the distributions below, which do not use the friction and losses of the
model file or of the shipped plants. They are wide: the middle 90 % of a log-normal with a spread of
0.4 lie between 0.52 and 1.93 times its median.
"""

from __future__ import annotations

from dataclasses import replace
from importlib import resources
from math import log10
from typing import Annotated, Any

import numpy as np
import yaml

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import RigError
from robot_energy.model import load
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import Float
from robot_energy_plan.motion import MotionLimits

KELVIN = 273.15  # K at 0 degC
SHIFT = 0.7  # mm^2/s
MIN_DEGC, MAX_DEGC = -40.0, 200.0
POSITIVE = (
    "stribeck_velocity", "torque_constant", "motor_capacity", "gear_capacity",
    "motor_conductance", "gear_conductance", "acceleration",
)  # fmt: skip
"""Figures of a plant that are never 0."""


class Lubricant(Described):
    """One oil: its viscosity over temperature.

    Walther's law in the form of ASTM D341, ``log10 log10(nu + 0.7) = A - B log10(T)`` with
    the kinematic viscosity nu in mm^2/s and T in kelvin, fixed by the two figures of an
    oil's data sheet, nu at 40 and at 100 degC.
    """

    viscosity_40: Annotated[float, "Kinematic, at 40 degC: the ISO VG grade within 10 %. [mm^2/s]"]
    viscosity_100: Annotated[float, "At 100 degC. [mm^2/s]"]

    def __post_init__(self) -> None:
        if not 2.0 <= self.viscosity_100 < self.viscosity_40:
            raise RigError(
                f"an oil has {self.viscosity_40} mm^2/s at 40 degC and {self.viscosity_100} "
                "at 100 degC",
                "2 <= viscosity_100 < viscosity_40",
            )

    @property
    def constants(self) -> tuple[float, float]:
        """A and B of the law, for T in kelvin. [-]"""
        cold = log10(log10(self.viscosity_40 + SHIFT))
        hot = log10(log10(self.viscosity_100 + SHIFT))
        slope = (cold - hot) / (log10(KELVIN + 100) - log10(KELVIN + 40))
        return cold + slope * log10(KELVIN + 40), slope

    def viscosity(self, gear_temperature_degc: Float | float) -> Float:
        """Return the kinematic viscosity, same shape. [mm^2/s]

        Args:
            gear_temperature_degc: Oil, any shape; limited to -40 to 200 degC. [degC]
        """
        a, b = self.constants
        degc = np.clip(np.asarray(gear_temperature_degc), MIN_DEGC, MAX_DEGC)
        return 10.0 ** (10.0 ** (a - b * np.log10(degc + KELVIN))) - SHIFT

    def friction_factor(self, gear_temperature_degc: Float | float) -> Float:
        """Return viscous friction relative to 40 degC, ``sqrt(nu / nu_40)``. [-]

        The square root stands between churning (nu) and Coulomb-like contact (1): oil
        thins 12 to 15 times from 20 to 80 degC while measured friction falls 3 to 4 times.
        Argument as in `Lubricant.viscosity`.
        """
        return np.sqrt(self.viscosity(gear_temperature_degc) / self.viscosity_40)


OILS = {
    "vg150_mineral": Lubricant(150.0, 14.7),
    "vg220_synthetic": Lubricant(220.0, 25.8),
    "harmonic_gear_grease": Lubricant(180.0, 17.0),
}
"""Oils at catalogue level: viscosity index about 97 (mineral) and 150 (synthetic); base oil of a
harmonic gear's grease."""


JERK_TIME = 0.05  # s over which acceleration builds up


class SupplyProfile(Described):
    """The cabinet."""

    loss_dc: Annotated[float, "Constant on the DC bus, without the drives' own losses. [W]"]
    loss_grid: Annotated[float, "Constant on the grid side. [W]"]
    rectifier_efficiency: Annotated[float, "In (0, 1]. [-]"]
    capacitance: Annotated[float, "Capacitance of the DC link. [F]"]
    rectified_voltage: Annotated[float, "Voltage of the DC link while the grid feeds it. [V]"]
    chopper_on_voltage: Annotated[float, "The brake chopper switches on here. [V]"]
    chopper_off_voltage: Annotated[float, "And off here. [V]"]
    brake_resistance: Annotated[float, "[ohm]"]

    def __post_init__(self) -> None:
        voltages = self.rectified_voltage, self.chopper_off_voltage, self.chopper_on_voltage
        if not (0 < voltages[0] < voltages[1] < voltages[2] < np.inf):
            raise RigError(
                "the link is rectified at {} V, the chopper switches off at {} V and on at {} "
                "V".format(*voltages),
                "rising voltages in this order",
            )
        efficiency, rest = self.rectifier_efficiency, (self.capacitance, self.brake_resistance)
        if not (0 < efficiency <= 1 and 0 < min(rest) and max(rest) < np.inf):
            raise RigError(
                f"efficiency, capacitance and brake resistance of the supply are {efficiency}, "
                f"{rest[0]} and {rest[1]}",
                "a share in (0, 1], and values > 0",
            )


class HardEffects(Described):
    """Figures of the effects that `RigConfig.hard` adds; the same for every axis."""

    elastic_deflection: Annotated[float, "At the effort limit. [rad] or [m]"] = 1.5e-3
    presliding_angle: Annotated[float, "Of the motor, for 63 % of a reversal. [rad]"] = 0.3
    coulomb_fall: Annotated[
        float, "Coulomb friction lost per kelvin above 40 degC, down to `MIN_COULOMB_SHARE`. [1/K]"
    ] = 0.003
    viscous_exponent: Annotated[float, "Of speed, in (0, 1]. [-]"] = 0.8
    viscous_speed: Annotated[float, "Where the exponent changes nothing. [rad/s]"] = 150.0
    fan_power: Annotated[float, "Of the fan, on the grid side. [W]"] = 25.0
    fan_on_degc: Annotated[float, "It starts when the warmest motor is above. [degC]"] = 45.0
    fan_off_degc: Annotated[float, "It stops below. [degC]"] = 40.0

    def __post_init__(self) -> None:
        sound = (
            self.elastic_deflection >= 0, self.presliding_angle > 0, self.coulomb_fall >= 0,
            0 < self.viscous_exponent <= 1, self.viscous_speed > 0, self.fan_power >= 0,
            self.fan_off_degc < self.fan_on_degc,
        )  # fmt: skip
        if not all(sound):
            raise RigError(
                f"effects of the rig are {vars(self)}",
                "an angle, an exponent and a speed > 0, the exponent at most 1, a fan that stops "
                "below its start, other figures >= 0",
            )


class PlantProfile(Described):
    """One robot of the rig, motor side, shape (n,) each."""

    body: Annotated[
        str, "A shipped model or model file: URDF, payload, gear ratios, rotor inertias of it."
    ]
    lubricant: Annotated[tuple[Lubricant, ...], "One oil per axis."]
    coulomb: Annotated[Float, "At no load. [N m]"]
    load_coulomb: Annotated[Float, "Per rigid-body motor torque. [-]"]
    stribeck: Annotated[Float, "At zero speed, ``exp(-(w/stribeck_velocity)^2)`` of it. [N m]"]
    stribeck_velocity: Annotated[Float, "[rad/s]"]
    viscous_40: Annotated[Float, "Viscous coefficient with the oil at 40 degC. [N m s/rad]"]
    torque_constant: Annotated[Float, "At 20 degC. [N m/A rms]"]
    torque_constant_fall: Annotated[Float, "Relative, per kelvin of magnet temperature. [1/K]"]
    resistance: Annotated[Float, "Resistance of a phase at 20 degC; copper loss is 3 R I^2. [ohm]"]
    resistance_rise: Annotated[Float, "Relative, per kelvin. [1/K]"]
    hysteresis_torque: Annotated[Float, "Iron loss that grows with speed. [N m]"]
    eddy_viscous: Annotated[Float, "Iron loss that grows with its square. [N m s/rad]"]
    inverter_linear: Annotated[Float, "Inverter loss per phase current. [W/A]"]
    inverter_square: Annotated[Float, "Per its square. [W/A^2]"]
    motor_capacity: Annotated[Float, "Heat capacity of the motor node. [J/K]"]
    gear_capacity: Annotated[Float, "Heat capacity of the gear and structure node. [J/K]"]
    motor_conductance: Annotated[Float, "Heat conductance from motor to gear. [W/K]"]
    gear_conductance: Annotated[Float, "Heat conductance from gear to ambient. [W/K]"]
    friction_to_motor: Annotated[Float, "Share of friction that heats the motor node. [-]"]
    acceleration: Annotated[Float, "For motion generation, joint side. [rad/s^2]"]
    supply: Annotated[SupplyProfile, "The cabinet."]
    hard: Annotated[HardEffects, "Figures of effects that are off by default."] = HardEffects()

    def __post_init__(self) -> None:
        each: dict[str, Any] = vars(self)
        arrays: dict[str, Float] = {k: v for k, v in each.items() if isinstance(v, np.ndarray)}
        for name, values in arrays.items():
            least = np.finfo(float).tiny if name in POSITIVE else 0.0
            sound = (values >= least) & np.isfinite(values)
            if values.shape != (self.n_joints,) or not sound.all():
                sign = ">" if least else ">="
                raise RigError(
                    f"the profile's {name} is {values.tolist()}",
                    f"a finite figure {sign} 0 for each of {self.n_joints} axes",
                )

    @property
    def n_joints(self) -> int:
        return len(self.lubricant)

    def mechanics(self) -> tuple[Robot, Drivetrain]:
        """Return the rigid bodies and the drivetrain, all that is shared with a model."""
        model = load(self.body)
        if len(model.joints) != self.n_joints:
            raise RigError(
                f"the model '{self.body}' has {len(model.joints)} joints",
                f"{self.n_joints}, as the profile",
            )
        return Robot.from_model(model), Drivetrain.from_model(model)

    def motion_limits(self, robot: Robot) -> MotionLimits:
        """Return limits for programs of this robot; joints without end stay within +-pi."""
        limits = MotionLimits.of_robot(robot, self.acceleration, JERK_TIME)
        turn = np.where(robot.limits.wraps, np.pi, np.inf)
        return replace(
            limits, lower=np.maximum(limits.lower, -turn), upper=np.minimum(limits.upper, turn)
        )


def load_profile(name: str) -> PlantProfile:
    """Return a plant of this package.

    In its file a figure is one value or one per axis, and viscous friction has targets at 20
    and 60 degC. Only its scale is free, the oil fixes its shape; so the curve passes both equally
    closely: the ratio to the target is ``r`` at one temperature and ``1/r`` at the other.

    Args:
        name: Name of the shipped model whose bodies it has, such as ``kr16``.
    """
    folder = resources.files("robot_energy_rig") / "profiles"
    files = {path.name.removesuffix(".yaml"): path for path in folder.iterdir()}
    if name not in files:
        raise RigError(f"there is no plant '{name}'", ", ".join(sorted(files)))
    data: dict[str, Any] = yaml.safe_load(files[name].read_text("utf-8"))
    body, supply = data.pop("body"), SupplyProfile(**data.pop("supply"))
    oils = tuple(OILS[oil] for oil in data.pop("lubricant"))
    figures: dict[str, Any] = {
        key: np.array(np.broadcast_to(value, len(oils)), dtype=np.float64)
        for key, value in data.items()
    }
    cold, hot = np.array([oil.friction_factor(np.array([20.0, 60.0])) for oil in oils]).T
    viscous = np.sqrt(figures.pop("viscous_20") * figures.pop("viscous_60") / (cold * hot))
    return PlantProfile(body=body, lubricant=oils, viscous_40=viscous, supply=supply, **figures)


RATED_SHARE = 1.0 / 3.0  # of the effort limit, which a drive gives for a short time only
SPREAD = 0.4  # of the log-normal draws


def random_profile(body: str, seed: int) -> PlantProfile:
    """Return a plant drawn for the bodies of a model, motor side.

    The scale is the rated motor torque (a third of the effort limit of the URDF over the gear
    ratio) and the motor speed at the velocity limit; their product is the rated power.

    Args:
        body: Name of a shipped model, or path of a model file.
        seed: The same seed gives the same plant.
    """
    if seed < 0:
        raise RigError(f"the seed of the plant is {seed}", "a whole number from 0 on")
    model = load(body)
    limits = Robot.from_model(model).limits
    if not (np.isfinite(limits.effort) & np.isfinite(limits.velocity)).all():
        raise RigError(
            f"the URDF of '{body}' lacks effort or velocity limits of some joints",
            "both of every joint: they set the scale of the drawn figures",
        )
    ratio = np.abs([joint.gear_ratio.value for joint in model.joints])
    torque, speed = RATED_SHARE * limits.effort / ratio, limits.velocity * ratio
    power = torque * speed
    random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0x706C616E,)))
    n_joints = len(ratio)

    def normal(median: float | Float, spread: float = SPREAD) -> Float:
        return median * np.exp(spread * random.standard_normal(n_joints))

    def uniform(low: float, high: float) -> Float:
        return random.uniform(low, high, n_joints)

    oils = tuple(OILS[name] for name in random.choice(list(OILS), n_joints))
    dry, striction = normal(0.10 * torque), uniform(0.0, 0.4)
    cold = np.array([float(oil.friction_factor(20.0)) for oil in oils])
    current = normal(3.0)
    hysteresis = torque * uniform(0.005, 0.02)
    loss = 0.05 * power  # typical heat of an axis at work, for the thermal figures
    inner, outer = loss / uniform(5.0, 15.0), loss / uniform(10.0, 30.0)
    return PlantProfile(
        body=body,
        lubricant=oils,
        coulomb=dry * (1.0 - striction),
        load_coulomb=uniform(0.01, 0.08),
        stribeck=dry * striction,
        stribeck_velocity=uniform(5.0, 30.0),
        viscous_40=normal(0.35 * torque / speed) / cold,
        torque_constant=torque / current,
        torque_constant_fall=uniform(0.0005, 0.0015),
        resistance=uniform(0.03, 0.08) * power / (3.0 * current**2),
        resistance_rise=np.full(n_joints, 0.0039),
        hysteresis_torque=hysteresis,
        eddy_viscous=hysteresis / speed * uniform(0.3, 2.0),
        inverter_linear=uniform(1.0, 4.0),
        inverter_square=uniform(0.02, 0.1),
        motor_capacity=inner * uniform(500.0, 1500.0),
        gear_capacity=(inner + outer) * uniform(2000.0, 5000.0),
        motor_conductance=inner,
        gear_conductance=outer,
        friction_to_motor=uniform(0.05, 0.3),
        acceleration=limits.velocity / 0.3 * uniform(0.8, 1.2),
        supply=_supply(random, float(power.sum())),
        hard=_hard(random, float(speed.max())),
    )


def _supply(random: np.random.Generator, power: float) -> SupplyProfile:
    """Draw a cabinet for drives of this rated power in all. [W]"""
    scale = np.exp(SPREAD * random.standard_normal(3))
    rectified = random.uniform(540.0, 580.0)
    switched_on = rectified * random.uniform(1.15, 1.3)
    return SupplyProfile(
        loss_dc=(20.0 + 0.01 * power) * float(scale[0]),
        loss_grid=(40.0 + 0.02 * power) * float(scale[1]),
        rectifier_efficiency=random.uniform(0.97, 0.995),
        capacitance=1e-3 * float(scale[2]),
        rectified_voltage=rectified,
        chopper_on_voltage=switched_on,
        chopper_off_voltage=switched_on - random.uniform(10.0, 30.0),
        brake_resistance=switched_on**2 / (random.uniform(1.5, 3.0) * max(power, 500.0)),
    )


def _hard(random: np.random.Generator, speed: float) -> HardEffects:
    """Draw the effects without a term in models; motors reach this speed. [rad/s]"""
    fan_on = random.uniform(35.0, 55.0)
    return HardEffects(
        elastic_deflection=random.uniform(0.5e-3, 3e-3),
        presliding_angle=random.uniform(0.1, 0.6),
        coulomb_fall=random.uniform(0.0, 0.005),
        viscous_exponent=random.uniform(0.7, 1.0),
        viscous_speed=random.uniform(0.3, 0.6) * speed,
        fan_power=random.uniform(10.0, 40.0),
        fan_on_degc=fan_on,
        fan_off_degc=fan_on - random.uniform(3.0, 8.0),
    )
