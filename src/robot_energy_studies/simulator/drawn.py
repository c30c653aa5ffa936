"""Robots of KR 16 class drawn at random: bodies, gears, lubricants, motors, heat, cabinet.

The URDF of the KR 16 is what a manufacturer publishes. A drawn robot has its geometry, but bodies
that are some per cent off, and hoses on its arm that the URDF lacks. Every other figure comes
from the distributions below; those of the virtual rig and of the model files do not take part.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path

import numpy as np

from robot_energy.timeline.blocks import Float
from robot_energy_studies.simulator.arm import Body, ElasticArm, limits_of_urdf, read_urdf
from robot_energy_studies.simulator.cabinet import DrawnCabinet
from robot_energy_studies.simulator.gear_friction import GearFriction
from robot_energy_studies.simulator.heat import HeatNetwork
from robot_energy_studies.simulator.motors import Motors

URDF = "kr16.urdf"
FLANGE = "flange"
LOAD_MASS, LOAD_CENTRE = 15.0, (0.12, 0.0, 0.0)  # kg, m in the frame of the flange: a test weight
LOAD_INERTIA = (0.10, 0.12, 0.12)  # kg m^2
CARRIER = (-1, 0, 1, 2, 2, 2)  # the wrist has its motors on the arm
RATIO = (125.0, 125.0, 125.0, 76.0, 76.0, 50.0)
ROTOR = (1e-3, 1.5e-3, 5e-4, 7e-5, 7e-5, 1e-4)  # kg m^2
WIND_UP = (3e-3, 3e-3, 3e-3, 1e-2, 1e-2, 1e-2)  # rad at the effort limit; the wrist is softer
RATED_SHARE = 0.5  # of the effort limit


@dataclass(frozen=True)
class DrawnRobot:
    """One robot with its cabinet."""

    arm: ElasticArm
    friction: GearFriction
    motors: Motors
    heat: HeatNetwork
    friction_to_housing: Float
    cabinet: DrawnCabinet
    acceleration: Float  # of its programs, shape (n,) [rad/s^2]
    plate_inertia: Float  # rotor inertias on the data sheet, shape (n,) [kg m^2]

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints in their order."""
        return tuple(body.joint for body in self.arm.bodies)


class _Draw:
    """Draws for every axis."""

    def __init__(self, seed: int, n_joints: int) -> None:
        self.random = np.random.default_rng([0x6D756A6F, seed])
        self._n = n_joints

    def near(self, median: Float | float, spread: float) -> Float:
        """Log-normal about a median."""
        return median * np.exp(spread * self.random.standard_normal(self._n))

    def between(self, low: float, high: float) -> Float:
        return self.random.uniform(low, high, self._n)


def urdf_path() -> Path:
    """Return the file of the manufacturer's bodies."""
    return Path(str(resources.files("robot_energy") / "models" / URDF))


def drawn_robot(seed: int) -> DrawnRobot:
    """Return a robot.

    Args:
        seed: The same seed gives the same robot; 0 or more.
    """
    bodies, frames = read_urdf(urdf_path())
    limits = limits_of_urdf(urdf_path())
    draw = _Draw(seed, len(bodies))
    ratio = np.array(RATIO) * draw.between(0.8, 1.25)
    torque, speed = RATED_SHARE * limits["effort"] / ratio, limits["velocity"] * ratio
    rotor = draw.near(np.array(ROTOR), 0.3)
    arm = ElasticArm(
        bodies=_bodies(bodies, frames, draw),
        gear_ratio=ratio,
        rotor_inertia=rotor,
        stiffness=limits["effort"] / (np.array(WIND_UP) * draw.between(0.6, 1.6)),
        damping=np.zeros(len(bodies)),
        carrier=CARRIER,
    )
    reflected = rotor * ratio**2
    arm = replace(arm, damping=2.0 * draw.between(0.03, 0.1) * np.sqrt(arm.stiffness * reflected))
    power = torque * speed
    return DrawnRobot(
        arm=arm,
        friction=_friction(draw, torque, speed),
        motors=_motors(draw, torque, speed),
        heat=_heat(draw, 0.05 * power),
        friction_to_housing=draw.between(0.05, 0.3),
        cabinet=_cabinet(draw.random, float(power.sum())),
        acceleration=limits["velocity"] / 0.4 * draw.between(0.8, 1.2),
        plate_inertia=rotor * draw.near(1.0, 0.1),
    )


def _bodies(
    bodies: tuple[Body, ...], frames: dict[str, tuple[int, Float]], draw: _Draw
) -> tuple[Body, ...]:
    """Bodies as built, with hoses and load."""
    masses, shapes = draw.near(1.0, 0.04), draw.near(1.0, 0.08)
    shifts = draw.random.normal(0.0, 0.01, (len(bodies), 3))
    built = [
        replace(
            body,
            mass=body.mass * mass,
            centre=body.centre + shift,
            inertia=body.inertia * mass * shape,
        )
        for body, mass, shape, shift in zip(bodies, masses, shapes, shifts, strict=True)
    ]
    hoses, place = float(draw.random.uniform(0.0, 5.0)), np.array([0.1, 0.0, 0.15])
    built[2] = built[2].with_load(hoses, place, 0.02 * hoses * np.eye(3))
    index, flange = frames[FLANGE]
    centre = flange + np.array(LOAD_CENTRE)
    built[index] = built[index].with_load(LOAD_MASS, centre, np.diag(LOAD_INERTIA))
    return tuple(built)


def _friction(draw: _Draw, torque: Float, speed: Float) -> GearFriction:
    return GearFriction(
        boundary=draw.near(0.06 * torque, 0.4),
        boundary_fall=draw.between(0.0, 0.004),
        breakaway=draw.between(0.0, 0.5),
        film_speed=draw.between(3.0, 20.0),
        film_shape=draw.between(0.6, 1.4),
        teeth=draw.between(0.01, 0.06) * torque,
        teeth_exponent=draw.between(0.8, 1.1),
        film=draw.near(0.2 * torque, 0.4),
        film_exponent=draw.between(0.7, 1.0),
        viscosity_exponent=draw.between(0.45, 0.7),
        vogel_b=draw.between(800.0, 1000.0),
        vogel_c=draw.between(95.0, 125.0),
        bristle=draw.between(0.05, 0.4),
        rated_torque=torque,
        rated_speed=speed,
    )


def _motors(draw: _Draw, torque: Float, speed: Float) -> Motors:
    current = draw.near(3.0, 0.4)
    constant = torque / current
    power = torque * speed
    hysteresis = draw.between(0.005, 0.02) * torque
    return Motors(
        plate_constant=constant * draw.near(1.0, 0.015),
        torque_constant=constant,
        magnet_fall=draw.between(0.0005, 0.0015),
        saturation=draw.between(0.0, 0.03),
        rated_current=current,
        resistance=draw.between(0.02, 0.06) * power / (3.0 * current**2),
        skin=draw.between(0.0, 0.1),
        hysteresis=hysteresis,
        hysteresis_rise=draw.between(0.0, 0.3),
        eddy=hysteresis / speed * draw.between(0.2, 1.0),
        excess=hysteresis / np.sqrt(speed) * draw.between(0.1, 0.6),
        standby=draw.between(2.0, 8.0),
        conduction_linear=draw.between(1.0, 3.0),
        conduction_square=draw.between(0.02, 0.1),
        switching=draw.between(0.5, 3.0) / 560.0,
        rated_torque=torque,
        rated_speed=speed,
    )


def _heat(draw: _Draw, loss: Float) -> HeatNetwork:
    """Network in which a typical loss makes rises of a usual size. [W]"""
    winding, casting = loss / draw.between(5.0, 12.0), loss / draw.between(15.0, 30.0)
    oil, hall = loss / draw.between(10.0, 30.0), loss / draw.between(40.0, 70.0)
    capacity = [
        winding * draw.between(60.0, 180.0),
        casting * draw.between(600.0, 1500.0),
        oil * draw.between(600.0, 1500.0),
        hall * draw.between(2000.0, 5000.0),
    ]
    return HeatNetwork(
        capacity=np.array(capacity),
        winding_housing=winding,
        housing_casting=casting,
        housing_oil=loss / draw.between(30.0, 60.0),
        oil_casting=oil,
        neighbours=(loss / draw.between(30.0, 100.0))[1:],
        housing_hall=loss / draw.between(100.0, 200.0),
        casting_hall=hall,
    )


def _cabinet(random: np.random.Generator, power: float) -> DrawnCabinet:
    """Draw a cabinet for drives of this rated power in all. [W]"""
    opened = random.uniform(555.0, 590.0)
    chopper = opened * random.uniform(1.15, 1.3)
    fan_on = random.uniform(40.0, 60.0)
    return DrawnCabinet(
        capacitance=1e-3 * float(np.exp(0.4 * random.standard_normal())),
        open_voltage=opened,
        source_resistance=random.uniform(0.5, 1.5),
        real_share=random.uniform(0.2, 0.6),
        diode_voltage=random.uniform(1.6, 2.2),
        chopper_on=chopper,
        chopper_off=chopper - random.uniform(10.0, 30.0),
        brake_resistance=chopper**2 / (random.uniform(1.5, 3.0) * power),
        link_load=random.uniform(20.0, 120.0),
        grid_load=random.uniform(100.0, 300.0),
        fan=random.uniform(10.0, 40.0),
        fan_on_degc=fan_on,
        fan_off_degc=fan_on - random.uniform(3.0, 8.0),
    )
