"""Rows compressed to a triangle: the R of a QR decomposition, all that sums of squares need."""

from __future__ import annotations

import numpy as np

from robot_energy.blocks import Float


def triangle_of(rows: Float) -> Float:
    """Return R with ``R'R = rows' rows``, without squaring anything.

    Args:
        rows: Shape (M, P).

    Returns:
        Upper triangle, shape (min(M, P), P).
    """
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64)  # pyright: ignore
