"""Texts that are kept: names and reasons that a service or a file brings, within bounds."""

from __future__ import annotations

from robot_energy.foundation.errors import RobotEnergyError
from robot_energy.foundation.shown_text import shown

MAX_NAME = 100  # characters of an interval's name
MAX_REASON = 200  # characters of the reason of a reset
MAX_LINK = 200  # characters of the name of a link
MAX_TEXT = 500  # characters of an entry of the trace


def require_plain_text(what: str, text: str, limit: int, error: type[RobotEnergyError]) -> str:
    """Return a text that can be kept, published and logged as it is."""
    if not text.strip() or len(text) > limit:
        raise error(f"{what} of {len(text)} characters", f"1 to {limit}, not all blank")
    if not text.isprintable():
        raise error(f"{what} '{shown(text)}'", "characters that can be printed, on one line")
    return text
