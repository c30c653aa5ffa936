"""Numbers on the command line: finite, and of a size that can be meant."""

from __future__ import annotations

import math
from argparse import ArgumentTypeError

MAX_NUMBER = 1e9  # larger than any figure of a robot, whatever its unit


def number(text: str) -> float:
    """Return a finite number.

    Args:
        text: An argument.

    Raises:
        ArgumentTypeError: If it is none, or beyond 1e9.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) <= MAX_NUMBER:
        raise ArgumentTypeError(
            f"'{text[:40]}' is no number from -{MAX_NUMBER:g} to {MAX_NUMBER:g}"
        )
    return value


def whole(text: str) -> int:
    """Return a whole number.

    Args:
        text: An argument.

    Raises:
        ArgumentTypeError: If it is none, or beyond 1e9.
    """
    value = number(text)
    if value != int(value):
        raise ArgumentTypeError(f"'{text[:40]}' is no whole number")
    return int(value)
