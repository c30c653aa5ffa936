"""Curves of power and energy over time, thinned for plots without losing energy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np

from robot_energy.accounting.energy_curve import EnergyCurve, EnergyRows, add_compared
from robot_energy.foundation.described import Described
from robot_energy.replay.bag_replay import Replay
from robot_energy.timeline.blocks import NANOSECOND, Float, Int
from robot_energy.timeline.pieces import Compared

MAX_POINTS = 2000
BREAK = 1.5  # in lengths of a point: a longer step in time breaks the curve

Role = Literal["measured", "predicted", "fixed"]


class Series(Described):
    """One curve."""

    label: str
    role: Role
    time: Annotated[
        Float,
        "Middle of each point, since the start of the recording; NaN breaks the curve, shape "
        "(K,). [s]",
    ]
    power: Annotated[Float, "Mean of each point, shape (K,). [W]"]
    energy_time: Annotated[Float, "Ends of the points, shape (L,). [s]"]
    energy: Annotated[
        Float, "Counted from the start, level where nothing is known, shape (L,). [J]"
    ]
    energy_half: Annotated[
        float, "Half width of the 90 % band of the last energy; NaN for none. [J]"
    ] = float("nan")


def compared_series(
    result: Replay, label: str = "predicted", role: Role = "predicted"
) -> tuple[Series, Series] | None:
    """Return measured and predicted power at the meter, over what both cover.

    Returns:
        Measured and predicted, or None where nothing was compared. Their last energies
        are those of the comparison.
    """
    curve, start_ns = result.compared_curve, result.account.registers.time.start_ns
    return None if start_ns is None or curve is None else _pair(curve, start_ns, label, role)


def series_of(
    compared: Sequence[Compared], start_ns: int, label: str = "predicted", role: Role = "predicted"
) -> tuple[Series, Series] | None:
    """Return measured and predicted power at the meter; None where nothing was compared."""
    curve = EnergyCurve(3)
    for part in compared:
        add_compared(curve, part)
    return _pair(curve, start_ns, label, role)


def _pair(
    curve: EnergyCurve, start_ns: int, label: str, role: Role
) -> tuple[Series, Series] | None:
    rows = curve.rows()
    if not len(rows.stamp_ns):
        return None
    first = _series("measured", "measured", rows, start_ns, 0, 0)
    return first, _series(label, role, rows, start_ns, 1, 2)


def predicted_series(
    result: Replay, label: str = "predicted", role: Role = "predicted"
) -> Series | None:
    """Return the predicted power from the grid, for bags without a meter.

    Arguments as in `compared_series`; None where there is nothing to show.
    """
    curve, start_ns = result.predicted_curve, result.account.registers.time.start_ns
    rows = None if curve is None else curve.rows()
    if rows is None or start_ns is None or not len(rows.stamp_ns):
        return None
    return _series(label, role, rows, start_ns, 0, 0)


def curves_of(results: Sequence[Replay], changes: Sequence[str | None]) -> list[Series]:
    """Return the curves of one or two replays of a bag, the measured one first.

    Args:
        changes: What was changed about the model of each; None for nothing.
    """
    curves: list[Series] = []
    for result, change in zip(results, changes, strict=True):
        label = "predicted, friction by temperature" if len(results) > 1 else "predicted"
        label, role = (f"predicted, {change}", "fixed") if change else (label, "predicted")
        pair = compared_series(result, label, role)
        if pair is not None:
            curves += [*pair[:1], _with_band(pair[1], result)][1 if curves else 0 :]
        elif (curve := predicted_series(result, label, role)) is not None:
            curves.append(_with_band(curve, result))
    return curves


def _with_band(curve: Series, result: Replay) -> Series:
    """The curve with the band of the replay's energy, by the share of it that is shown."""
    registers = result.account.registers
    net = registers.cabinet("grid_import") - registers.cabinet("grid_return")
    shown = abs(float(curve.energy[-1]) / net) if net else float("nan")
    return replace(curve, energy_half=result.account.energy_band.half * shown)


def _series(
    label: str, role: Role, rows: EnergyRows, start_ns: int, power: int, energy: int
) -> Series:
    """Merge neighbours until few enough are left; points stand in their middle."""
    begin_ns, end_ns = rows.begin_ns - start_ns, rows.stamp_ns - start_ns
    every = -(-len(end_ns) // MAX_POINTS)
    firsts = np.arange(0, len(end_ns), every)
    lasts = np.minimum(firsts + every, len(end_ns)) - 1
    begin = _seconds(begin_ns[firsts])
    end = _seconds(end_ns[lasts])
    width = _seconds(np.add.reduceat(rows.duration_ns, firsts))
    joule = np.add.reduceat(rows.energy[:, power], firsts)
    total = np.cumsum(np.add.reduceat(rows.energy[:, energy], firsts))
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
