"""Powers of the states of auxiliary loads, as they were identified."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from robot_energy.identify.auxiliary.states import LoadsFit
from robot_energy.results.base import Result


@dataclass(frozen=True)
class LoadStatesReport(Result):
    """Powers of the states of auxiliary loads."""

    NAME: ClassVar[str] = "auxiliary"

    fits: Annotated[
        tuple[LoadsFit, ...],
        "One for each load with a meter of its own; one for all others together where the "
        "recordings have a meter of the outlet.",
    ]
    refused: Annotated[tuple[str, ...], "Why others could not be identified, one sentence each."]
