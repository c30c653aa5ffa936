"""Motions: synchronised point-to-point moves and programs made of them."""

from robot_energy.motion.program import Program, random_program, tool_above
from robot_energy.motion.ptp import MotionLimits, PointToPoint, Profile, Trajectory

__all__ = [
    "MotionLimits",
    "PointToPoint",
    "Profile",
    "Program",
    "Trajectory",
    "random_program",
    "tool_above",
]
