"""A small plant whose physics can be worked out by hand."""

import numpy as np

import robots
from robot_energy.model import save
from robot_energy.timeline.blocks import JointBlock
from robot_energy_plan.motion import MotionLimits, Program
from robot_energy_rig import Lubricant, PlantProfile, RigJoints, SupplyProfile

TRANSMISSION = np.array([[100.0, 0.0], [10.0, -50.0]])
ROTOR = np.array([1e-4, 2e-5])
LIMITS = MotionLimits(np.full(2, -2.0), np.full(2, 2.0), np.array([2.0, 3.0]), np.array([6.0, 9.0]))
PROGRAM = Program(np.array([[0.3, -1.0], [1.4, 0.8], [-0.6, 1.2]]), LIMITS, dwell=0.15)


def joint_block(joints: RigJoints) -> JointBlock:
    """Joint states of a rig as the pipeline takes them: one segment of good samples."""
    rows, unknown = len(joints), np.full_like(joints.joint_velocity, np.nan)
    return JointBlock(
        stamp_ns=joints.stamp_ns,
        segment=np.zeros(rows, dtype=np.int64),
        quality=np.zeros(rows, dtype=np.uint32),
        joint_position=joints.joint_position,
        joint_velocity=joints.joint_velocity,
        joint_acceleration=unknown,
        joint_effort=unknown,
    )


def two_link_profile(folder, **changes) -> PlantProfile:
    """The two-link arm as a plant; figures of its model file are not those of the plant."""
    body = folder / "two_link.yaml"
    save(robots.two_link(), body)
    pair = {
        "coulomb": [0.02, 0.01],
        "load_coulomb": [0.05, 0.05],
        "stribeck": [0.006, 0.004],
        "stribeck_velocity": [8.0, 8.0],
        "viscous_40": [6e-5, 3e-5],
        "torque_constant": [0.2, 0.1],
        "torque_constant_fall": [1e-3, 1e-3],
        "resistance": [0.5, 1.0],
        "resistance_rise": [4e-3, 4e-3],
        "hysteresis_torque": [5e-3, 3e-3],
        "eddy_viscous": [2e-5, 1e-5],
        "inverter_linear": [1.5, 1.5],
        "inverter_square": [0.04, 0.04],
        "motor_capacity": [400.0, 200.0],
        "gear_capacity": [900.0, 500.0],
        "motor_conductance": [2.0, 1.0],
        "gear_conductance": [0.8, 0.5],
        "friction_to_motor": [0.1, 0.1],
        "acceleration": [6.0, 9.0],
    }
    supply = SupplyProfile(3.0, 30.0, 0.98, 2e-4, 300.0, 380.0, 370.0, 60.0)
    arrays = {name: np.array(values) for name, values in {**pair, **changes}.items()}
    return PlantProfile(str(body), (Lubricant(150.0, 21.0),) * 2, supply=supply, **arrays)
