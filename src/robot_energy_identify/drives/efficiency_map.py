"""Reduced efficiency maps of drives in four quadrants (paper B, section 6).

``eta = P_mech / P_el`` in every quadrant, from raw samples. A drive is in motor mode where
torque and speed have the same sign, else in generator mode; there eta is above 1 where it
feeds back less than its shaft gives, and negative where it still draws power. Values
further than three scaled median absolute deviations from the median are removed, the gaps
filled by straight lines, and a Butterworth low-pass runs forward and backward.

At rest there is no efficiency (0 / 0), and the paper's excitation never rests: slower
samples than 2 % of the greatest speed count as missing. Else the median of a robot that
mostly waits would be an efficiency of 0, and all motion an outlier.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.certainty.deviation import MEDIAN_TO_STD
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model.drive_models import EfficiencyMap
from robot_energy.timeline.blocks import Float, Int
from robot_energy_identify.drives.drive_data import DriveData

if TYPE_CHECKING:
    from robot_energy_identify.drives.drives import AxisFit

DEVIATIONS = 3.0  # scaled median absolute deviations
ORDER = 4  # of the Butterworth low-pass, before it runs the second time
CUTOFF = 5.0  # Hz
MAX_CUTOFF_SHARE = 0.9  # of the Nyquist frequency
MIN_EFFICIENCY = 0.02  # smaller ones are held here: an efficiency of 0 gives no power
POINTS = 500  # of one map in a model file
MIN_SAMPLES = 100
SLOW = 0.02  # of the greatest speed: no efficiency below it
MAX_QUANTILE = 0.999  # quantile that stands for the greatest speed or torque
FIRST_CELL, GROWTH = 0.05, 1.15  # standard deviations; of the cells that thin a map out
REACH = 2.0  # cells, beyond which a point of work counts as extrapolated


class ReducedMap(Described):
    """Map of one drive."""

    entry: Annotated[EfficiencyMap, "As in a model file."]
    samples: Annotated[int, "Samples behind it."]
    removed: Annotated[float, "Share of them that was removed as outliers. [-]"]
    motor_efficiency: Annotated[float, "Median in motor mode, NaN if never in it. [-]"]
    generator_efficiency: Annotated[float, "Median in generator mode, NaN if never in it. [-]"]


def without_outliers(values: Float) -> Float:
    """Return values with NaN where they are over three scaled MADs off the median.

    Args:
        values: NaN where missing, shape (N,). [any unit]
    """
    known = values[np.isfinite(values)]
    if not len(known):
        return values
    middle = np.median(known)
    scale = MEDIAN_TO_STD * float(np.median(np.abs(known - middle)))
    with np.errstate(invalid="ignore"):
        far = np.abs(values - middle) > DEVIATIONS * scale
    return np.where(far | ~np.isfinite(values), np.nan, values)


def smooth(values: Float, stretch: Int, period: Float | float, cutoff: float) -> Float:
    """Fill gaps by straight lines and filter without phase shift, stretch by stretch.

    Args:
        values: NaN where missing, shape (N,); beyond the last known value it is held. [any unit]
        stretch: Number of the uninterrupted stretch of each sample, shape (N,).
        period: Between samples, the same throughout a stretch, shape () or (N,). [s]
        cutoff: Of the low-pass; at most 90 % of the Nyquist frequency is used. [Hz]

    Returns:
        Shape (N,), NaN in stretches without any value.
    """
    from scipy.signal import butter, sosfiltfilt

    periods = np.broadcast_to(period, values.shape)
    result = np.full_like(values, np.nan)
    for rows in np.split(np.arange(len(values)), np.flatnonzero(np.diff(stretch)) + 1):
        part = values[rows]
        known = np.flatnonzero(np.isfinite(part))
        if not len(known):
            continue
        share = min(2.0 * cutoff * float(periods[rows[0]]), MAX_CUTOFF_SHARE)
        sections = butter(ORDER, share, output="sos")
        filled = np.interp(np.arange(len(part)), known, part[known])
        pad = min(3 * (2 * len(sections) + 1), len(part) - 1)
        result[rows] = sosfiltfilt(sections, filled, padlen=pad)
    return result


def processed(values: Float, stretch: Int, period: Float | float, cutoff: float) -> Float:
    """Return values after both steps of the paper's processing, of efficiencies or of power.

    Args:
        values: Shape (N,). [any unit]
        stretch: Number of the uninterrupted stretch of each sample, shape (N,).
        period: Between samples, the same throughout a stretch, shape () or (N,). [s]
        cutoff: Of the low-pass. [Hz]
    """
    return smooth(without_outliers(values), stretch, period, cutoff)


def reduced_map(
    data: DriveData,
    joint: int,
    rows: NDArray[np.bool_],
    cutoff: float = CUTOFF,
    points: int = POINTS,
    source: str = "",
) -> ReducedMap:
    """Return the reduced efficiency map of one drive.

    The processed samples are thinned out to what a model file carries: cells of equal
    size in standardised torque and speed, each inside one quadrant, give one point each,
    with their mean torque and speed and median efficiency; cells are as small as the
    wanted number of points allows.

    Args:
        rows: Samples to use, shape (N,); the others count as missing.
        cutoff: Of the low-pass. [Hz]
        source: Where the data come from, for the model file.
    """
    torque, velocity = data.motor_torque[:, joint], data.motor_velocity[:, joint]
    electrical = data.drive_power[:, joint]
    shaft = torque * velocity
    with np.errstate(divide="ignore", invalid="ignore"):
        raw = np.where(rows & (electrical != 0.0), shaft / electrical, np.nan)
    speed = np.where(np.isfinite(raw), np.abs(velocity), np.nan)
    fastest = float(np.nanquantile(speed, MAX_QUANTILE)) if np.isfinite(speed).any() else 0.0
    with np.errstate(invalid="ignore"):
        moving = speed > SLOW * fastest
    raw[~moving] = np.nan
    known = int(moving.sum())
    if known < MIN_SAMPLES:
        raise NotIdentifiableError(
            f"{data.names[joint]} moves in {known} samples with power, torque and speed",
            f"at least {MIN_SAMPLES}",
        )
    kept = without_outliers(raw)
    eta = smooth(kept, data.stretch, data.periods, cutoff)
    used = moving & np.isfinite(eta)
    at, values, cell = _thinned(torque[used], velocity[used], eta[used], points)
    sign = np.where(values < 0, -1.0, 1.0)
    values = sign * np.maximum(np.abs(values), MIN_EFFICIENCY)
    motor = used & (shaft >= 0)
    generator = used & (shaft < 0)
    entry = EfficiencyMap(
        motor_torque=[float(f"{value:.5g}") for value in at[:, 0]],
        motor_velocity=[float(f"{value:.5g}") for value in at[:, 1]],
        efficiency=[float(f"{value:.4g}") for value in values],
        reach=round(REACH * cell, 3),
        tag="identified",
        source=source,
    )
    return ReducedMap(
        entry,
        int(used.sum()),
        1.0 - int(np.isfinite(kept).sum()) / known,
        float(np.median(eta[motor])) if motor.any() else float("nan"),
        float(np.median(eta[generator])) if generator.any() else float("nan"),
    )


def _thinned(torque: Float, velocity: Float, eta: Float, points: int) -> tuple[Float, Float, float]:
    """One point per cell: torque and speed (K, 2), efficiency (K,), size of the cells."""
    at = np.column_stack([torque, velocity])
    scale = at.std(axis=0, ddof=1)
    scale = np.where(scale > 0, scale, 1.0)
    size = FIRST_CELL
    while True:  # cells end at 0, so that no cell holds two quadrants
        cell = np.floor(at / (scale * size)).astype(np.int64)
        cell -= cell.min(axis=0)
        _, index = np.unique(cell[:, 0] * (cell[:, 1].max() + 1) + cell[:, 1], return_inverse=True)
        if int(index.max()) < points:
            break
        size *= GROWTH
    amount = np.bincount(index)
    mean = np.column_stack([np.bincount(index, at[:, k]) / amount for k in (0, 1)])
    ranked = eta[np.lexsort((eta, index))]
    first = np.cumsum(amount) - amount
    median = 0.5 * (ranked[first + (amount - 1) // 2] + ranked[first + amount // 2])
    return mean, median, size


def at_efficiency(shaft: Float, efficiency: float) -> Float:
    """Return the electrical power of drives of constant efficiency, both ways. [W]

    Args:
        shaft: Shaft power, shape (N,) or (N, n). [W]
        efficiency: Above 0, at most 1. [-]
    """
    return np.where(shaft > 0, shaft / efficiency, shaft * efficiency)


def fitted_efficiency(shaft: Float, power: Float) -> float:
    """Return the constant efficiency of least squared error of the electrical power. [-]

    Args:
        shaft: Shaft power of one or several drives, shape (N,). [W]
        power: Measured electrical power, shape (N,). [W]
    """
    from scipy.optimize import minimize_scalar

    def cost(efficiency: float) -> float:
        return float(np.sum((at_efficiency(shaft, efficiency) - power) ** 2))

    return float(minimize_scalar(cost, bounds=(MIN_EFFICIENCY, 1.0), method="bounded").x)


def fitted_map(axis: AxisFit, source: str) -> object:
    """Return the entry of the efficiency map; None where the data do not determine it."""
    return None if axis.map is None else axis.map.entry
