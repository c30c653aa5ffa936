"""How good a fit is, on data it has not seen.

Held-out data are contiguous: neighbouring samples are alike, so a random split would test
on what it trained on. Energy errors of fitted data are zero by construction wherever a
viscous column is fitted, and are therefore never given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot_energy.blocks import NANOSECOND, Float, Int


@dataclass(frozen=True)
class HeldOut:
    """Errors on held-out data.

    Attributes:
        folds: Number of folds.
        rms: Root mean square of the error, in the unit of the target.
        relative: Norm of the error over the norm of the target. [-]
    """

    folds: int
    rms: float
    relative: float


def contiguous_blocks(stamp_ns: Int, segment: Int, length: float) -> Int:
    """Number blocks of at most a given length that never span two segments.

    Args:
        stamp_ns: Shape (N,). [ns]
        segment: Shape (N,).
        length: [s]

    Returns:
        Block of each sample, rising from 0 in order of first appearance, shape (N,).
    """
    if not len(stamp_ns):
        return np.empty(0, dtype=np.int64)
    starts = np.flatnonzero(np.diff(segment, prepend=segment[0] - 1) != 0)
    origin = stamp_ns[starts][np.searchsorted(starts, np.arange(len(stamp_ns)), side="right") - 1]
    within = (stamp_ns - origin) // round(length / NANOSECOND)
    change = (np.diff(segment, prepend=segment[0]) != 0) | (np.diff(within, prepend=0) != 0)
    return np.cumsum(change).astype(np.int64)


def folds_in_order(count: int, folds: int) -> Int:
    """Cut samples into contiguous folds of equal size.

    Args:
        count: Number of samples.
        folds: Number of folds.

    Returns:
        Fold of each sample, shape (count,).
    """
    return np.minimum(np.arange(count) * folds // max(count, 1), folds - 1).astype(np.int64)


def folds_by_value(values: Float, folds: int) -> Int:
    """Cut samples into folds of equal size by a quantity, such as the temperature.

    Args:
        values: Shape (N,), finite.
        folds: Number of folds; fewer where values repeat too often.

    Returns:
        Fold of each sample, rising with the value, shape (N,).
    """
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, folds + 1)[1:-1]))
    return np.searchsorted(edges, values, side="right").astype(np.int64)


def held_out(
    target: Float, fold: Int, predict: Callable[[NDArray[np.bool_], NDArray[np.bool_]], Float]
) -> HeldOut:
    """Predict every fold from the others.

    Args:
        target: Shape (N,) or (N, n).
        fold: Fold of each sample, shape (N,).
        predict: Called with the masks of the training and the test samples; returns the
            prediction of the test samples.

    Returns:
        The error over all folds.
    """
    error = np.empty_like(target)
    names = np.unique(fold)
    for name in names:
        test = fold == name
        error[test] = predict(~test, test) - target[test]
    scale = float(np.linalg.norm(target))
    size = float(np.linalg.norm(error))
    return HeldOut(
        len(names), size / np.sqrt(target.size), size / scale if scale > 0 else float("nan")
    )
