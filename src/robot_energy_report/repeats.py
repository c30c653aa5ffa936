"""Recordings that were given twice, or that overlap in time: what would count twice in a sum."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

from robot_energy.timeline.blocks import NANOSECOND
from robot_energy_report.formats import some_names

MIN_OVERLAP = 1.0  # s; bags that follow each other may share a moment
MAX_NAMES = 20  # of recordings that overlap


def given_once(names: Sequence[str], contents: Sequence[Hashable]) -> tuple[list[int], list[str]]:
    """Return the numbers of the recordings that count once, and a note on each of the others."""
    first: dict[Hashable, int] = {}
    again: dict[tuple[str, str], int] = {}
    for number, (name, content) in enumerate(zip(names, contents, strict=True)):
        if first.setdefault(content, number) != number:
            pair = name, names[first[content]]
            again[pair] = again.get(pair, 0) + 1
    notes = [
        f"{name} was given {'twice' if count == 1 else f'{count + 1} times'}: it counts once"
        if name == other
        else f"{name} is the same recording as {other}: they count once"
        for (name, other), count in again.items()
    ]
    return list(first.values()), notes


def overlaps(names: Sequence[str], spans: Sequence[tuple[int | None, int | None]]) -> list[str]:
    """Return a note on recordings of one robot whose spans [ns] overlap in time, or none."""
    known = [
        (start, end, name)
        for name, (start, end) in zip(names, spans, strict=True)
        if start is not None and end is not None
    ]
    met: dict[str, None] = {}
    twice = 0
    newest: tuple[int, str] | None = None
    for start, end, name in sorted(known):
        shared = 0 if newest is None else min(end, newest[0]) - start
        if newest is not None and shared > MIN_OVERLAP / NANOSECOND:
            met |= {newest[1]: None, name: None}
            twice += shared
        if newest is None or end > newest[0]:
            newest = end, name
    if not met:
        return []
    return [
        f"{some_names(met, MAX_NAMES)} overlap in time, by {twice * NANOSECOND:.1f} s in all: "
        "where they are of one robot, that time counts more than once; leave one of them out"
    ]
