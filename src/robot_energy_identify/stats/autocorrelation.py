"""Covariance of a regression by the autocorrelation of its residuals.

``(X'X)^-1 X' Omega X (X'X)^-1`` with Omega the autocovariance of the residuals.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_energy.timeline.blocks import Float, Int
from robot_energy_identify.stats.regression import Covariance, factor

MAX_LAG_SHARE = 0.25  # of a recording: longest autocorrelation taken into account


def autocorrelated(segment: Int) -> Covariance:
    """Return the covariance from the autocorrelation of each target's residuals.

    What comes before the autocorrelation first falls to zero is signal, the rest is chance
    (initial positive sequence).

    Args:
        segment: Number of the uninterrupted stretch of each row, shape (N,).
    """

    def covariance(columns: Float, residual: Float, weight: Float) -> tuple[Float, Float, float]:
        n_targets, n_values = residual.shape[1], columns.shape[2]
        triangle, _ = factor(columns, residual, weight)
        inverse = np.linalg.pinv(triangle)
        inverse = inverse @ inverse.T
        middle, independent = np.zeros((n_values, n_values)), np.zeros(n_targets)
        for joint in range(n_targets):
            rows = weight[:, joint] > 0.0
            count = int(rows.sum())
            if not count:
                continue
            rest = np.where(rows, weight[:, joint] * residual[:, joint], 0.0)
            own = columns[:, joint] * weight[:, joint, None]
            taken = float(((own @ inverse) * own).sum())  # leverage
            shares = _autocorrelation(rest, rows, segment)
            independent[joint] = count / (1.0 + 2.0 * float(shares[1:].sum()))
            # Parameters eat part of the residuals; of correlated ones, a larger part.
            left = max(independent[joint] - taken, 0.25 * independent[joint], 1.0)
            variance = float(rest @ rest) / count * independent[joint] / left
            middle += variance * _correlated(own, shares, segment)
        degrees = float(independent.sum()) - n_values
        return inverse @ middle @ inverse, independent, degrees

    return covariance


def _autocorrelation(rest: Float, rows: NDArray[np.bool_], segment: Int) -> Float:
    """Autocorrelation of one target's residuals from lag 0 to before it is first not positive."""
    shares = [1.0]
    size = float(rest @ rest) / max(int(rows.sum()), 1)
    same = [np.flatnonzero(segment == number) for number in np.unique(segment)]
    longest = int(MAX_LAG_SHARE * max(len(part) for part in same))
    for lag in range(1, longest + 1):
        total, pairs = 0.0, 0
        for part in same:
            if len(part) > lag:
                early, late = part[:-lag], part[lag:]
                total += float(rest[early] @ rest[late])
                pairs += int((rows[early] & rows[late]).sum())
        if not pairs or total <= 0.0 or size <= 0.0:
            break
        shares.append(min(total / pairs / size, 1.0))
    return np.array(shares)


def _correlated(columns: Float, shares: Float, segment: Int) -> Float:
    """``X' Omega X`` with Omega the autocorrelation within each segment, shape (P, P).

    Where the estimate of Omega is not a covariance, rows count for less by their number alone.
    """
    from scipy.signal import oaconvolve

    kernel = np.concatenate([shares[:0:-1], shares])[:, None]
    first = len(shares) - 1
    result = np.zeros((columns.shape[1], columns.shape[1]))
    for number in np.unique(segment):
        part = columns[segment == number]
        smeared = np.asarray(oaconvolve(part, kernel, mode="full", axes=0))
        result += part.T @ smeared[first : first + len(part)]
    result = 0.5 * (result + result.T)
    white = columns.T @ columns
    if float(np.linalg.eigvalsh(result)[0]) < -1e-9 * float(np.trace(white)):
        return white * (1.0 + 2.0 * float(shares[1:].sum()))
    return result
