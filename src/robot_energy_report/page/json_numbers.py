"""Figures as JSON, which has neither NaN nor infinity: unknown is null."""

from __future__ import annotations

import json
import math
from typing import Any


def json_number(value: float | None, digits: int | None = None) -> float | None:
    """Return a number that JSON has: None for NaN and infinity, rounded to some digits.

    Args:
        value: A number or None, in any unit. [-]
    """
    if value is None or not math.isfinite(value):
        return None
    return float(value) if digits is None else float(f"{value:.{digits}g}")


def json_text(values: Any) -> str:
    """Return compact JSON; a number that JSON lacks is an error of this package."""
    return json.dumps(values, allow_nan=False, separators=(",", ":"))
