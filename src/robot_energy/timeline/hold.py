"""Zero-order hold: a value counts from its stamp on, until the next one or until it is too old."""

from __future__ import annotations

import numpy as np

from robot_energy.timeline.blocks import Int


def held_rows(times_ns: Int, at_ns: Int, max_age_ns: int | None = None) -> Int:
    """Return the row of the value that holds at each instant, shape of ``at_ns``; -1 for none.

    Args:
        times_ns: Stamps of the values, rising, shape (M,). [ns]
        at_ns: The instants, any shape. [ns]
        max_age_ns: Age beyond which a value does not hold any more; None: it never ends. [ns]
    """
    row = np.asarray(np.searchsorted(times_ns, at_ns, side="right") - 1, dtype=np.int64)
    if max_age_ns is None or not len(times_ns):
        return row
    return np.where(at_ns - times_ns[row] <= max_age_ns, row, -1)


def first_needed(times_ns: Int, oldest_ns: int) -> int:
    """Return the first value that holds at an instant or later; earlier ones can be forgotten.

    Args:
        times_ns: Stamps of the values, rising, shape (M,). [ns]
        oldest_ns: The earliest instant that may still be asked for. [ns]
    """
    return max(int(np.searchsorted(times_ns, oldest_ns, side="right")) - 1, 0)
