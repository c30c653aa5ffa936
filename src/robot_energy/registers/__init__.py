"""Energy registers: exact, gap-aware sums of power over time that survive restarts."""

from robot_energy.registers.exact_sum import PER_JOULE, ExactSum
from robot_energy.registers.timekeeping import Intervals, Timekeeping, Trapezoid
from robot_energy.registers.totals import CABINET_REGISTERS, JOINT_REGISTERS, Registers

__all__ = [
    "CABINET_REGISTERS",
    "JOINT_REGISTERS",
    "PER_JOULE",
    "ExactSum",
    "Intervals",
    "Registers",
    "Timekeeping",
    "Trapezoid",
]
