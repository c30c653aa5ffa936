"""Energies that programs and robots can be compared by."""

import math
from collections.abc import Sequence
from typing import Annotated

from robot_energy.pipeline.work_sums import WorkSums
from robot_energy.results.base import Number, Result


class PartEnergy(Result):
    """Jobs, cycles or repetitions of one kind: what one part costs."""

    name: Annotated[str, "Of the job or cycle; of the program for its repetitions."]
    count: Annotated[int, "How many."]
    energy: Annotated[float, "Mean energy of one from the grid. [J]"]


class NormalisedEnergy(Result):
    """Energy from the grid over what was done with it."""

    tool_path: Annotated[
        Number, "Path of the frame ``tool0``; None for a robot without it. [m]"
    ]  # fmt: skip
    energy_per_metre: Annotated[Number, "Net energy from the grid over that path. [J/m]"]
    body_work: Annotated[float, "Work that lifted and accelerated the bodies, when it did. [J]"]
    body_work_share: Annotated[
        Number, "That work over the net energy from the grid; bodies give a part back. [-]"
    ]
    parts: Annotated[tuple[PartEnergy, ...], "Energy of one part, by its kind; empty if not known."]


def normalised_energy(
    work: WorkSums, net: float, parts: Sequence[tuple[str, float]] = ()
) -> NormalisedEnergy:
    """Return what the energy comes to per metre, and per part.

    Args:
        net: From the grid, less what was returned. [J]
        parts: Name and energy of each. [J]
    """
    kinds: dict[str, list[float]] = {}
    for name, energy in parts:
        kinds.setdefault(name, []).append(energy)
    return NormalisedEnergy(
        tool_path=work.tool_path,
        energy_per_metre=net / work.tool_path if work.tool_path > 0 else math.nan,
        body_work=work.body_work,
        body_work_share=work.body_work / net if net > 0 else math.nan,
        parts=tuple(
            PartEnergy(name, len(found), math.fsum(found) / len(found))
            for name, found in kinds.items()
        ),
    )
