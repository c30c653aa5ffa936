"""Thermal networks of motors, as they were identified."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from robot_energy.identify.thermal.network import ThermalFit
from robot_energy.results.base import Result


@dataclass(frozen=True)
class ThermalReport(Result):
    """Thermal networks of the motors of a robot."""

    NAME: ClassVar[str] = "thermal"

    heat: Annotated[
        str,
        "What was taken as heat: ``losses`` of the model, or of a log ``squared_current``, whose "
        "capacities are relative. [W] or [A^2]",
    ]
    ambient_degc: Annotated[float, "Temperature of the air that was taken. [degC]"]
    axes: Annotated[tuple[ThermalFit, ...], "One per motor that could be identified."]
    refused: Annotated[tuple[str, ...], "Why the others could not, one sentence each."]
