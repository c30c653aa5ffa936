"""Do intervals from more recordings meet those from fewer? Counted on drawn plants of the rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from robot_energy.identify.run_all import identify_everything
from robot_energy.uncertainty.band import Z95
from robot_energy_papers.interval_coverage import (
    Judged,
    given_model,
    judged,
    plant,
    record_plant,
)


@dataclass(frozen=True)
class MoreRecordings:
    """Intervals of one plant from some recordings and from one more.

    Attributes:
        robot: Name of the model whose bodies the plant has.
        seed: Of the plant.
        recordings: How many there were before.
        figures: That both identified.
        disjoint: Names of those whose intervals do not meet.
    """

    robot: str
    seed: int
    recordings: int
    figures: int
    disjoint: tuple[str, ...]


def more_recordings(robot: str, seed: int, hard: bool, folder: Path) -> list[MoreRecordings]:
    """Return one entry for each recording that is added to the first two of a plant.

    Args:
        robot: Name of a shipped model, for the bodies.
        seed: Of everything that is drawn.
        hard: As of `plant`.
        folder: For the bags.
    """
    profile, config = plant(robot, seed, hard)
    bags, given = record_plant(profile, config, seed, folder), given_model(robot, seed)
    found = [
        judged(identify_everything(bags[:count], given, strict=False), profile, config)
        for count in range(2, len(bags) + 1)
    ]
    return [
        MoreRecordings(robot, seed, number + 2, *disjoint(fewer, more))
        for number, (fewer, more) in enumerate(pairwise(found))
    ]


def disjoint(fewer: Sequence[Judged], more: Sequence[Judged]) -> tuple[int, tuple[str, ...]]:
    """Return how many figures two identifications share, and whose intervals do not meet.

    Args:
        fewer: From some recordings.
        more: From these and others.
    """
    known = {(entry.group, entry.name): entry for entry in fewer if entry.std > 0.0}
    pairs = [
        (known[key], entry)
        for entry in more
        if (key := (entry.group, entry.name)) in known and entry.std > 0.0
    ]
    apart = [
        f"{one.group} {one.name}"
        for one, other in pairs
        if abs(one.value - other.value) > Z95 * (one.std + other.std)
    ]
    return len(pairs), tuple(apart)
