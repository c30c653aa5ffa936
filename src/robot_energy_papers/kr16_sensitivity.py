"""Why power at rest depends more on the pose than in paper A, and the rise of temperature less."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from robot_energy.timeline.blocks import Float
from robot_energy_papers.calibration import (
    HOLDING_DEGC,
    POSE_SHARE,
    Holding,
    carrying_power,
    random_poses,
)
from robot_energy_papers.experiment import MOVES, make_programs
from robot_energy_papers.sensitivity import SensitivityTable, Values, open_figures, sensitivity
from robot_energy_plan.motion import Program
from robot_energy_rig import PlantProfile, RigOutput, VirtualRig, load_profile
from robot_energy_rig.record import outputs

HOLD, RISE = "greatest deviation of the HOLD power from its mean over poses", "rise of temperature"
PUBLISHED_HOLD, PUBLISHED_RISE = 0.10, 2.0  # [-], [K]
COLD_DEGC = 20.0
RISE_IN_BOTH_FORMS = ("capacity", "share", "length", "reading")
HOLD_DRAWS = 500
ROUGH = 5e-3  # of the values that are sought, where each takes a run of the rig

ELECTRICAL = (
    ("resistance", "winding resistance, factor", "", 0.4, 1.0, 1.5,
     "0.3 to 1.2 ohm a phase for motors of 1.5 to 3 kW"),
    ("constant", "torque constant, factor", "", 0.8, 1.0, 1.25,
     "windings for 300 to 450 V at top speed, same resistance"),
)  # fmt: skip
HOLD_FIGURES = open_figures(
    *ELECTRICAL,
    ("ratio", "gear ratios, factor", "", 0.8, 1.0, 1.25,
     "motors of 3000 to 4500 rpm at the published top speed"),
    ("bodies", "weight of the links on the motors, factor", "", 0.8, 1.0, 1.1,
     "bodies are those of a related robot"),
    ("payload", "test weight off the flange", "m", 0.0, 0.12, 0.3,
     "15 kg published, its place is not; a bare disc up to a bracket"),
    ("stiction", "share of Coulomb friction that helps to carry", "", 0.0, 0.0, 1.0,
     "0: position control keeps the whole load on the motor; 1: the gears hold after a stop"),
    ("constant_loss", "constant losses: controller, fans, lifted brakes, drives ready", "W",
     200.0, 340.0, 750.0,
     "a cabinet of six drives; 800 W is the limit that the text implies"),
    ("degc", "windings", "degC", 20.0, HOLDING_DEGC, 80.0, "cold to hot; the pose test is not "
     "dated in the text"),
    ("poses", "share of the joint ranges that poses span", "", 0.4, POSE_SHARE, 1.0,
     "poses of a cell up to the ends of every axis"),
)  # fmt: skip
RISE_FIGURES = open_figures(
    ("capacity", "heat capacity of the motors, factor", "", 0.4, 1.0, 1.5,
     "winding alone up to the motor with its flange: the sensor sits in the winding"),
    ("friction", "viscous friction, factor", "", 0.6, 1.0, 1.6,
     "oils of one class differ by so much at 20 degC"),
    ("share", "share of the friction heat that reaches the motor", "", 0.0, 0.1, 0.5,
     "gear far from the motor up to a motor flanged into the gear"),
    *ELECTRICAL,
    ("conductance", "heat conductance from motor to gear, factor", "", 0.5, 1.0, 2.0,
     "a gasket or a metal flange"),
    ("acceleration", "accelerations, factor", "", 0.6, 1.0, 1.2,
     "those of a closely related robot"),
    ("length", "length of a set, factor", "", 0.7, 1.0, 4.0,
     "20 motions published, not their length and not whether a trace repeats them"),
    ("reading", "added by reading whole degrees", "K", 0.0, 0.0, 1.0,
     "the truth here; the paper reads the sensors of the motors, whose step is not stated"),
)  # fmt: skip


def holding_table(seed: int) -> dict[str, SensitivityTable]:
    """Return what the deviation of the power at rest over poses owes to open figures."""
    profile = load_profile("kr16")
    robot, drivetrain = profile.mechanics()
    (weight,) = robot.payload
    unloaded = robot.with_payload(())

    @cache
    def poses(share: float) -> Float:
        return random_poses(profile, seed, share)

    def deviation(values: Values) -> dict[str, float]:
        pose = poses(values["poses"])
        still = np.zeros_like(pose)
        _, y, z = weight.centre_of_mass
        moved = weight.model_copy(update={"centre_of_mass": (values["payload"], y, z)})
        links = unloaded.joint_torque(pose, still, still)
        joint = robot.with_payload([moved]).joint_torque(pose, still, still)
        joint += (values["bodies"] - 1.0) * links
        torque = drivetrain.motor_torque_from_joint(joint) / values["ratio"]
        helped = np.maximum(np.abs(torque) - values["stiction"] * profile.coulomb, 0.0)
        supply = profile.supply
        factor = values["constant_loss"] / (supply.loss_dc + supply.loss_grid)
        changed = replace(
            _electrical(profile, values),
            supply=replace(
                supply, loss_dc=supply.loss_dc * factor, loss_grid=supply.loss_grid * factor
            ),
        )
        return {HOLD: Holding.of(carrying_power(changed, helped, values["degc"])).deviation}

    return sensitivity(
        deviation, HOLD_FIGURES, {HOLD: PUBLISHED_HOLD}, draws=HOLD_DRAWS, seed=seed, slow=["poses"]
    )


def rise_table(seed: int, quick: bool) -> dict[str, SensitivityTable]:
    """Return what the rise of the motor that warms most in a cold set owes to open figures."""
    plain = load_profile("kr16")

    def read(given: Values) -> dict[str, float]:
        profile = replace(
            _electrical(plain, given),
            motor_capacity=plain.motor_capacity * given["capacity"],
            viscous_40=plain.viscous_40 * given["friction"],
            friction_to_motor=np.full_like(plain.friction_to_motor, given["share"]),
            motor_conductance=plain.motor_conductance * given["conductance"],
            acceleration=plain.acceleration * given["acceleration"],
        )
        program = make_programs(profile, seed, MOVES).train
        rise = _rise(profile, program, program.period * given["length"])
        return {RISE: rise + given["reading"]}

    only = RISE_IN_BOTH_FORMS if quick else None
    return sensitivity(read, RISE_FIGURES, {RISE: PUBLISHED_RISE}, ROUGH, only)


def _rise(profile: PlantProfile, program: Program, duration: float) -> float:
    """Rise of the motor that warms most, from 20 degC throughout. [K]"""
    rig = VirtualRig(profile, program, None, 0, COLD_DEGC, COLD_DEGC)
    motor = RigOutput.concatenate(list(outputs(rig, duration))).truth.motor_temperature_degc
    return float((motor[-1] - motor[0]).max())


def _electrical(profile: PlantProfile, values: Values) -> PlantProfile:
    return replace(
        profile,
        resistance=profile.resistance * values["resistance"],
        torque_constant=profile.torque_constant * values["constant"],
    )
