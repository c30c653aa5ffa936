"""Thermal networks of motors, as they were identified."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robot_energy.identify.thermal.network import ThermalFit
from robot_energy.results.base import Result


@dataclass(frozen=True)
class ThermalReport(Result):
    """Thermal networks of the motors of a robot.

    Attributes:
        heat: What was taken as heat: ``losses`` of the model, or of a log ``squared_current``,
            whose capacities are relative. [W] or [A^2]
        ambient_degc: Temperature of the air that was taken. [degC]
        axes: One per motor that could be identified.
        refused: Why the others could not, one sentence each.
    """

    NAME: ClassVar[str] = "thermal"

    heat: str
    ambient_degc: float
    axes: tuple[ThermalFit, ...]
    refused: tuple[str, ...]
