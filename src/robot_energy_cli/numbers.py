"""Numbers on the command line: finite, and of a size that can be meant."""

from __future__ import annotations

import math
from argparse import ArgumentTypeError
from collections.abc import Callable

from robot_energy.foundation.options import MAX_NUMBER


def number_type(
    what: str, low: float, high: float, open_low: bool = False, words: tuple[str, ...] = ()
) -> Callable[[str], float | str]:
    """Return a type of arguments.

    Args:
        low: Least value. [its unit]
        high: Greatest value. [its unit]
        words: That stand for a number and are returned as they are.
    """

    def read(text: str) -> float | str:
        if text in words:
            return text
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high or (open_low and value == low):
            raise ArgumentTypeError(f"'{text[:40]}' is not a {what}")
        return value

    return read


number = number_type(f"number from -{MAX_NUMBER:g} to {MAX_NUMBER:g}", -MAX_NUMBER, MAX_NUMBER)
positive = number_type("time in s (above 0)", 0.0, 1e6, open_low=True)
frequency = number_type("frequency in Hz (above 0)", 0.0, MAX_NUMBER, open_low=True)


def whole(text: str) -> int:
    """Return a whole number.

    Raises:
        ArgumentTypeError: If it is none, or beyond 1e9.
    """
    value = float(number(text))
    if value != int(value):
        raise ArgumentTypeError(f"'{text[:40]}' is not a whole number")
    return int(value)
