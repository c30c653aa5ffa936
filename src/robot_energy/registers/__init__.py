"""Energy registers: exact, gap-aware sums of power over time that survive restarts."""

from robot_energy.registers.exact_sum import PER_JOULE, ExactSum
from robot_energy.registers.intervals import IntervalBook
from robot_energy.registers.timekeeping import NO_SEGMENT, Intervals, Timekeeping, Trapezoid
from robot_energy.registers.totals import (
    CABINET_REGISTERS,
    JOINT_REGISTERS,
    SHAFT_REGISTERS,
    Registers,
)

__all__ = [
    "CABINET_REGISTERS",
    "JOINT_REGISTERS",
    "NO_SEGMENT",
    "PER_JOULE",
    "SHAFT_REGISTERS",
    "ExactSum",
    "IntervalBook",
    "Intervals",
    "Registers",
    "Timekeeping",
    "Trapezoid",
]
