"""Numbers in JSON documents that meters answer with or send."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Annotated, Any, cast

from pydantic import Field

from robot_energy.errors import MeterAnswerError
from ros2_energy_monitor.meters.profile import NumberEntry, ProfileEntry
from ros2_energy_monitor.meters.reading import MeterTerm

MAX_ANSWER = 1_000_000  # characters of one document

JsonPath = Annotated[tuple[str | int, ...], Field(min_length=1, max_length=20)]


class JsonNumber(NumberEntry):
    """A number in a document.

    Attributes:
        path: Keys and positions that lead to it.
    """

    path: JsonPath


class JsonFlag(ProfileEntry):
    """A list of faults in a document.

    Attributes:
        path: Where the list is, if there is one.
        without: Fault that makes the numbers invalid.
    """

    path: JsonPath
    without: str


def parse(text: str, whose: str) -> Any:
    """Parse a document.

    Args:
        text: The document.
        whose: Who sent it, for the error text.

    Returns:
        Plain values.

    Raises:
        MeterAnswerError: If it is no JSON of bounded size.
    """
    if len(text) > MAX_ANSWER:
        raise MeterAnswerError(
            f"{whose} answers with {len(text)} characters", f"at most {MAX_ANSWER}"
        )
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise MeterAnswerError(f"{whose} answers with no JSON", "a JSON document") from error


def number_at(document: Any, number: JsonNumber, whose: str) -> MeterTerm:
    """Return the number that an entry names; NaN where the document says null.

    Args:
        document: As parsed.
        number: The entry.
        whose: Who sent it, for the error text.

    Raises:
        MeterAnswerError: If there is none.
    """
    found, missing = at(document, number.path)
    if missing or isinstance(found, bool) or not isinstance(found, int | float | None):
        raise MeterAnswerError(
            f"{whose} sends no number at {'.'.join(map(str, number.path))}",
            "one there, or another profile",
        )
    try:
        value = math.nan if found is None else float(found) * number.factor
    except OverflowError:
        value = math.inf
    return MeterTerm(value, number.wraps_at_joule)


def is_good(document: Any, flags: Sequence[JsonFlag]) -> bool:
    """Return whether a document states none of the faults.

    Args:
        document: As parsed.
        flags: The faults.
    """
    lists = ((at(document, flag.path)[0], flag.without) for flag in flags)
    return not any(isinstance(found, list) and fault in found for found, fault in lists)


def at(document: Any, path: Sequence[str | int]) -> tuple[Any, bool]:
    """Return what stands at a path, and whether nothing does.

    Args:
        document: As parsed.
        path: Keys of mappings and positions of lists.
    """
    here = document
    for step in path:
        if isinstance(here, dict) and step in here:
            here = cast("dict[Any, Any]", here)[step]
        elif isinstance(here, list) and isinstance(step, int) and 0 <= step < len(here):
            here = cast("list[Any]", here)[step]
        else:
            return None, True
    return here, False
