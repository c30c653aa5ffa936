"""Local times, and time zones by the names of the IANA database, such as Europe/Berlin."""

from __future__ import annotations

from datetime import UTC, datetime, tzinfo
from difflib import get_close_matches
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError, available_timezones

from robot_energy.foundation.units import SECOND_NS

MAX_NAME = 64


def local_time(stamp_ns: int, zone: tzinfo = UTC) -> datetime:
    """Return the whole second of an instant, as the clocks of a zone show it."""
    return datetime.fromtimestamp(stamp_ns // SECOND_NS, zone)


def time_zone(name: str) -> ZoneInfo:
    """Return the time zone of a name.

    Raises:
        ValueError: If there is no such zone, or no database; the text says what is expected.
    """
    try:
        return ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError):
        known = available_timezones()
        near = get_close_matches(name[:MAX_NAME], known, 1) or ["Europe/Berlin"]
        expected = f"time zone such as {near[0]}"
        if not known:
            expected = "database of time zones on this system: run `pip install tzdata`"
        raise ValueError(f"expected a {expected}") from None
