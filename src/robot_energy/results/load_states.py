"""Powers of the states of auxiliary loads, as they were identified."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robot_energy.identify.auxiliary.states import LoadsFit
from robot_energy.results.base import Result


@dataclass(frozen=True)
class LoadStatesReport(Result):
    """Powers of the states of auxiliary loads.

    Attributes:
        fits: One for each load with a meter of its own; one for all others together where the
            recordings have a meter of the outlet.
        refused: Why others could not be identified, one sentence each.
    """

    NAME: ClassVar[str] = "auxiliary"

    fits: tuple[LoadsFit, ...]
    refused: tuple[str, ...]
