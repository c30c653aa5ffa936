"""Plants whose friction, losses and constants are drawn at random.

A drawn plant shares bodies, gear ratios and rotor inertias with a model file, and the limits of
its URDF set the scale. Every other figure comes from the distributions below, which do not
use the friction and losses of that file or of the shipped plants. They are wide: the
middle 90 % of a log-normal with a spread of 0.4 lie between 0.52 and 1.93 times its median.
"""

from __future__ import annotations

import numpy as np

from robot_energy.foundation.errors import RigError
from robot_energy.model import load
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import Float
from robot_energy_rig.lubricant import OILS
from robot_energy_rig.profile import HardEffects, PlantProfile, SupplyProfile

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
