"""Range of time stamps: what an input may carry and an output can still publish.

``builtin_interfaces/Time`` holds seconds as int32 and nanoseconds as uint32, so a message
can carry stamps that no message can carry again: nanoseconds beyond one second, and
seconds so late that the next period ends after 2038-01-19. A stamp outside the range is
refused where it enters, so that nothing behind the entry has to test it again.
"""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.units import SECOND_NS

MIN_STAMP_NS = 0  # 1970-01-01; zero itself means "not set" and has its own reason
# A day before the int32 seconds of builtin_interfaces/Time end: deadlines and periods that
# begin at an accepted stamp can still be published. [ns]
MAX_STAMP_NS = (2**31 - 1 - 86_400) * SECOND_NS

MIN_DATE = 946_684_800  # 2000-01-01: an earlier stamp is of simulated time [s]
INVALID_STAMP_NS = -1  # what a Time that is not well formed decodes to

RANGE = "from 1970 to 2038, with nanoseconds below one second"  # for the text of errors
BAD_STAMP = "bad_stamp"  # the reason under which such messages are counted


def valid_stamps(stamp_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which stamps are from ``MIN_STAMP_NS`` to ``MAX_STAMP_NS``, same shape.

    Args:
        stamp_ns: Any shape. [ns]
    """
    return (stamp_ns >= MIN_STAMP_NS) & (stamp_ns <= MAX_STAMP_NS)


def bounded(stamp_ns: int) -> int:
    """Return the nearest stamp within the range, for an output whose stamp is derived. [ns]"""
    return min(max(stamp_ns, MIN_STAMP_NS), MAX_STAMP_NS)


def is_valid_time(seconds: int, nanoseconds: int) -> bool:
    """Return whether a ``builtin_interfaces/Time`` is well formed and within the range.

    Args:
        nanoseconds: Field ``nanosec``, below one second. [ns]
    """
    well_formed = 0 <= nanoseconds < SECOND_NS
    return well_formed and MIN_STAMP_NS <= seconds * SECOND_NS + nanoseconds <= MAX_STAMP_NS


def readable_time(stamp_ns: int) -> str:
    """Return a stamp for people: date and time in UTC, or seconds in simulated time."""
    seconds, rest = divmod(stamp_ns, SECOND_NS)
    if seconds < MIN_DATE:
        return f"{stamp_ns / SECOND_NS:.3f} s"
    date = datetime.fromtimestamp(seconds, UTC)
    return f"{date:%Y-%m-%d %H:%M:%S}.{rest // 1_000_000:03d} UTC"
