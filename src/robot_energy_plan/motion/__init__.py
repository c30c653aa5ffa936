"""Motions: point-to-point moves, programs made of them, Fourier series, inverse kinematics."""

from robot_energy_plan.motion.fourier import FourierBasis, FourierMotion
from robot_energy_plan.motion.inverse_kinematics import InverseKinematics
from robot_energy_plan.motion.ptp import (
    JointMotion,
    MotionLimits,
    Profile,
    Program,
    Trajectory,
    random_program,
    tool_above,
)

__all__ = [
    "FourierBasis",
    "FourierMotion",
    "InverseKinematics",
    "JointMotion",
    "MotionLimits",
    "Profile",
    "Program",
    "Trajectory",
    "random_program",
    "tool_above",
]
