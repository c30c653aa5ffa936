# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Numbers in JSON documents that meters answer with or send."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from typing import Annotated, Any, cast

from pydantic import Field

from robot_energy.foundation.errors import MeterAnswerError
from ros2_energy_monitor.meters.link import MAX_ANSWER
from ros2_energy_monitor.meters.profile import MAX_TERMS, NumberEntry, ProfileEntry
from ros2_energy_monitor.meters.reading import MeterTerm

EACH = "*"  # at the end of a path: every number of a list, as of three phases
NUMBER = re.compile(r"[+-]?(\d{1,30}(\.\d{0,30})?|\.\d{1,30})([eE][+-]?\d{1,3})?", re.ASCII)

JsonPath = Annotated[tuple[str | int, ...], Field(min_length=1, max_length=20)]


class JsonNumber(NumberEntry):
    """A number in a document.

    Attributes:
        path: Keys and positions that lead to it. ``*`` at the end: a list of numbers that add up,
            or one number.
    """

    path: JsonPath


class JsonFlag(ProfileEntry):
    """A list of faults in a document."""

    path: JsonPath
    without: str


def parse(text: str, whose: str) -> Any:
    """Return the plain values of a document."""
    if len(text) > MAX_ANSWER:
        raise MeterAnswerError(
            f"{whose} answers with {len(text)} characters", f"at most {MAX_ANSWER}"
        )
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise MeterAnswerError(f"{whose} answers with no JSON", "a JSON document") from error


def terms_at(
    document: Any, numbers: Sequence[JsonNumber], whose: str, *, good: bool
) -> tuple[MeterTerm, ...]:
    """Return the numbers that entries name; NaN where the document says null or is not good."""
    return tuple(
        MeterTerm(value * number.factor if good else math.nan, number.wraps_at_joule)
        for number in numbers
        for value in _values_at(document, number, whose)
    )


def _values_at(document: Any, number: JsonNumber, whose: str) -> list[float]:
    *path, last = number.path
    each = last == EACH
    found, missing = at(document, path if each else number.path)
    where = ".".join(map(str, number.path))
    if each and isinstance(found, list):
        phases = cast("list[Any]", found)
        if not 1 <= len(phases) <= MAX_TERMS:
            raise MeterAnswerError(
                f"{whose} sends a list of {len(phases)} at {where}", f"1 to {MAX_TERMS} numbers"
            )
        return [_value(phase, whose, where) for phase in phases]
    if isinstance(found, list):
        raise MeterAnswerError(
            f"{whose} sends a list at {where}",
            "a number",
            f'end the path with a position, as 0, or with "{EACH}" to add all up',
        )
    if missing:
        raise MeterAnswerError(
            f"{whose} sends no number at {where}", "one there, or another profile"
        )
    return [_value(found, whose, where)]


def _value(found: Any, whose: str, where: str) -> float:
    if found is None:
        return math.nan
    if isinstance(found, str) and NUMBER.fullmatch(found.strip()):
        return float(found)
    if isinstance(found, str):
        raise MeterAnswerError(
            f"{whose} sends the text '{found[:40]}' at {where}",
            "a number, with a decimal point and nothing else",
        )
    if isinstance(found, bool) or not isinstance(found, int | float):
        raise MeterAnswerError(
            f"{whose} sends no number at {where}", "one there, or another profile"
        )
    try:
        return float(found)
    except OverflowError:
        return math.inf


def is_good(document: Any, flags: Sequence[JsonFlag]) -> bool:
    """Return whether a document states none of the faults."""
    lists = ((at(document, flag.path)[0], flag.without) for flag in flags)
    return not any(isinstance(found, list) and fault in found for found, fault in lists)


def at(document: Any, path: Sequence[str | int]) -> tuple[Any, bool]:
    """Return what stands at a path, and whether nothing does."""
    here = document
    for step in path:
        if isinstance(here, dict) and step in here:
            here = cast("dict[Any, Any]", here)[step]
        elif isinstance(here, list) and isinstance(step, int) and 0 <= step < len(here):
            here = cast("list[Any]", here)[step]
        else:
            return None, True
    return here, False
