"""When the live figures of a robot are old, on the page as on the console."""

from __future__ import annotations

STALE_AFTER = 2.0  # without power states all live figures are stale [s]
STALE_PERIODS = 3.0  # the same, where a power state covers more time [periods]


def is_stale(silence: float, period: float) -> bool:
    """Return whether live figures are old.

    Args:
        silence: Since the newest power state. [s]
        period: Time that a power state covers. [s]
    """
    return silence > max(STALE_AFTER, STALE_PERIODS * period)
