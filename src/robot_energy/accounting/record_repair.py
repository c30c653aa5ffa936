"""Brings what earlier releases let grow beyond its limits in a state file back to them."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from pydantic import AfterValidator, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from robot_energy.foundation.shown_text import shown

MAX_NAMED = 3  # fields of a record that are named


def one_line(limit: int) -> AfterValidator:
    """Return a validator that refuses a text that is too long or cannot be printed on one line."""

    def check(text: str) -> str:
        if len(text) > limit or not text.isprintable():
            raise PydanticCustomError(
                "one_line", "a text of at most {limit} printable characters", {"limit": limit}
            )
        return text

    return AfterValidator(check)


def repaired(text: bytes, error: ValidationError) -> tuple[bytes, tuple[str, ...]]:
    """Return the JSON of a record with every value that broke a limit at that limit.

    Returns:
        The JSON, and what was changed; the text as it is and nothing if something else
        is wrong as well.
    """
    found = error.errors(include_url=False)
    if not all(map(_grew, found)):
        return text, ()
    data = json.loads(text)
    for one in found:
        *path, last = one["loc"]
        place = data
        for key in path:
            place = place[key]
        place[last] = _LIMITED[one["type"]](one)
    named = [".".join(map(str, one["loc"])) for one in found[:MAX_NAMED]]
    more = f" and {len(found) - MAX_NAMED} more" if len(found) > MAX_NAMED else ""
    return json.dumps(data).encode(), (f"{shown(', '.join(named))}{more}",)


def _grew(one: ErrorDetails) -> bool:
    """Whether a value broke a limit as it may in time; no count falls below zero."""
    negative = one["type"] == "greater_than_equal" and one.get("ctx", {})["ge"] == 0
    return one["type"] in _LIMITED and not (negative and not str(one["loc"][-1]).endswith("_ns"))


def _shortened(one: ErrorDetails) -> str:
    return shown(str(one["input"]), _at("limit")(one))


def _at(limit: str) -> Callable[[ErrorDetails], Any]:
    def value(one: ErrorDetails) -> Any:
        return one.get("ctx", {})[limit]

    return value


def _unknown(one: ErrorDetails) -> None:
    """A power that is not a number is not known."""


_LIMITED: dict[str, Callable[[ErrorDetails], Any]] = {
    "less_than_equal": _at("le"),
    "greater_than_equal": _at("ge"),
    "one_line": _shortened,
    "finite_number": _unknown,
}
