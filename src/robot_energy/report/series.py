"""Curves of power and energy over time, thinned for plots without losing energy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from robot_energy.blocks import NANOSECOND, Float, Int
from robot_energy.comparison import Compared
from robot_energy.replay import Replay

MAX_POINTS = 2000
BREAK = 1.5  # in lengths of a point: a longer step in time breaks the curve

Role = Literal["measured", "predicted", "fixed"]


@dataclass(frozen=True)
class Series:
    """One curve.

    Attributes:
        label: For the legend.
        role: Decides the colour: measured, predicted, or predicted with fixed friction.
        time: Middle of each point, since the start of the recording; NaN breaks the
            curve, shape (K,). [s]
        power: Mean of each point, shape (K,). [W]
        energy_time: Ends of the points, shape (L,). [s]
        energy: Counted from the start, level where nothing is known, shape (L,). [J]
    """

    label: str
    role: Role
    time: Float
    power: Float
    energy_time: Float
    energy: Float


def compared_series(
    result: Replay, label: str = "predicted", role: Role = "predicted"
) -> tuple[Series, Series] | None:
    """Return measured and predicted power at the meter, over what both cover.

    Args:
        result: A replay that kept its means.
        label: Of the prediction.
        role: Of the prediction.

    Returns:
        Measured and predicted, or None where nothing was compared. Their last energies
        are those of the comparison.
    """
    start_ns = result.ledger.registers.time.start_ns
    return None if start_ns is None else series_of(result.compared, start_ns, label, role)


def series_of(
    compared: Sequence[Compared], start_ns: int, label: str = "predicted", role: Role = "predicted"
) -> tuple[Series, Series] | None:
    """Return measured and predicted power at the meter.

    Args:
        compared: What was compared, in the order of time.
        start_ns: Where the axis of time begins. [ns]
        label: Of the prediction.
        role: Of the prediction.

    Returns:
        Measured and predicted, or None where nothing was compared.
    """
    parts = [part for part in compared if len(part.duration_ns)]
    if not parts:
        return None
    stamp = np.concatenate([part.available_ns for part in parts])
    duration = np.concatenate([part.duration_ns for part in parts])
    measured = np.concatenate([part.measured for part in parts])
    predicted = np.concatenate([part.predicted for part in parts])
    edges = np.flatnonzero(np.diff(stamp, prepend=stamp[0] - 1))  # one group per reading
    table = np.add.reduceat(np.stack([measured, predicted], axis=1), edges, axis=0)
    groups = np.add.reduceat(duration, edges)
    end_ns = stamp[edges] - start_ns
    first = _series("measured", "measured", end_ns, groups, table[:, 0])
    second = _series(label, role, end_ns, groups, table[:, 1])
    return first, second


def predicted_series(
    result: Replay, label: str = "predicted", role: Role = "predicted"
) -> Series | None:
    """Return the predicted power from the grid, for bags without a meter.

    Args:
        result: A replay that kept its means.
        label: For the legend.
        role: Decides the colour.

    Returns:
        The curve, or None where there is nothing to show.
    """
    means, start_ns = result.means, result.ledger.registers.time.start_ns
    if means is None or start_ns is None:
        return None
    power = means.mean("grid_import") - means.mean("grid_return")
    known = np.isfinite(power) & (means.period > 0)
    if not known.any():
        return None
    duration = np.rint(means.period[known] / NANOSECOND).astype(np.int64)
    energy = power[known] * means.period[known]
    return _series(label, role, means.stamp_ns[known] - start_ns, duration, energy)


def _series(label: str, role: Role, end_ns: Int, duration_ns: Int, energy: Float) -> Series:
    """Merge neighbours until few enough are left; points stand in their middle."""
    every = -(-len(end_ns) // MAX_POINTS)
    firsts = np.arange(0, len(end_ns), every)
    lasts = np.minimum(firsts + every, len(end_ns)) - 1
    begin = _seconds(end_ns[firsts] - duration_ns[firsts])
    end = _seconds(end_ns[lasts])
    width = _seconds(np.add.reduceat(duration_ns, firsts))
    joule = np.add.reduceat(energy, firsts)
    total = np.cumsum(joule)
    step = begin[1:] - end[:-1]
    cuts = np.flatnonzero((step > BREAK * np.median(width)) | (step < 0)) + 1
    return Series(
        label,
        role,
        np.insert(0.5 * (begin + end), cuts, np.nan),
        np.insert(joule / width, cuts, np.nan),
        np.asarray(np.insert(end, np.append(0, cuts), begin[np.append(0, cuts)]), np.float64),
        np.insert(total, np.append(0, cuts), np.append(0.0, total[cuts - 1])),
    )


def _seconds(time_ns: Int) -> Float:
    return np.asarray(time_ns * NANOSECOND, dtype=np.float64)
