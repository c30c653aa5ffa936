"""Measures that save energy, one file each; importing the package registers them."""

from robot_energy.optimization.measures import (
    move_overrides,
    one_override,
    order,
    place,
    regenerative,
    rest_pose,
    rest_state,
    slack,
    time_law,
)
from robot_energy.optimization.measures.table import MEASURES, Measure, register_measure

__all__ = [
    "MEASURES",
    "Measure",
    "move_overrides",
    "one_override",
    "order",
    "place",
    "regenerative",
    "register_measure",
    "rest_pose",
    "rest_state",
    "slack",
    "time_law",
]
