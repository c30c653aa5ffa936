"""Time zones by the names of the IANA database, such as Europe/Berlin."""

from __future__ import annotations

from difflib import get_close_matches
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError, available_timezones

MAX_NAME = 64


def time_zone(name: str) -> ZoneInfo:
    """Return the time zone of a name.

    Raises:
        ValueError: If there is no such zone, or no database; the text says what is expected.
    """
    try:
        return ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError):
        known = available_timezones()
        if not known:
            raise ValueError(
                "expected a database of time zones on this system: run `pip install tzdata`"
            ) from None
        near = get_close_matches(name[:MAX_NAME], known, 1) or ["Europe/Berlin"]
        raise ValueError(f"expected a time zone such as {near[0]}") from None
