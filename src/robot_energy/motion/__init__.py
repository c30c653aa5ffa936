"""Motions: point-to-point moves, programs made of them, and Fourier series."""

from robot_energy.motion.fourier import FourierBasis, FourierMotion
from robot_energy.motion.program import Program, random_program, tool_above
from robot_energy.motion.ptp import JointMotion, MotionLimits, PointToPoint, Profile, Trajectory

__all__ = [
    "FourierBasis",
    "FourierMotion",
    "JointMotion",
    "MotionLimits",
    "PointToPoint",
    "Profile",
    "Program",
    "Trajectory",
    "random_program",
    "tool_above",
]
