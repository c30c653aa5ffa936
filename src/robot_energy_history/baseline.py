"""Energy against a baseline, as ISO 50006: what days would have used, and what was saved.

Baseline days give ``E = c0 + sum(c_j x_j)`` [kWh] by least squares, x_j being what explains energy,
such as parts. A saving over reported days is the sum of what they were expected to use less what
they did. Its variance over k days with the sum u of their rows [1, x] is
``s^2 g (k + u' (X'X)^-1 u)``: scatter of these days and of the coefficients. s^2 is the variance of
the residuals, ``g = (1 + r) / (1 - r)`` their likeness from day to day (r, lag one), as ASHRAE
guideline 14 has it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import HistoryError

Float = NDArray[np.float64]
BAND, CLAIM = 0.90, 0.998  # shares of truths within the band, and within that of a claim [-]
MIN_DEGREES = 7  # days more than coefficients, so that the scatter is known
INDEPENDENT = 1e-4  # share of a column that the others must leave, so that it counts
MAX_LIKENESS = 0.9  # of residuals a day apart [-]


class EnergyBaseline(Described):
    """What explains the energy of a day, and how well."""

    names: Annotated[
        tuple[str, ...], "Of the explaining quantities; the first is the constant part."
    ]
    values: Annotated[Float, "Coefficients. [kWh per unit]"]
    inverse: Annotated[Float, "``(X'X)^-1``, shape (P, P)."]
    deviation: Annotated[float, "Standard deviation of the residuals. [kWh]"]
    likeness: Annotated[float, "Correlation of residuals of days that follow each other. [-]"]
    cv_rmse: Annotated[float, "Deviation over mean energy. [-]"]
    days: Annotated[int, "How many were used."]
    ranges: Annotated[dict[str, tuple[float, float]], "Least and greatest value of each, by name."]
    left_out: Annotated[tuple[str, ...], "Quantities that are constant, or that others explain."]

    @property
    def growth(self) -> float:
        """By what factor likeness makes the variance of a sum larger. [-]"""
        return (1.0 + self.likeness) / (1.0 - self.likeness)

    @property
    def degrees(self) -> float:
        """Degrees of freedom of the deviation. [-]"""
        return max(self.days / self.growth - len(self.names), 2.0)

    @property
    def std(self) -> Float:
        """Standard deviations of the coefficients, shape (P,). [kWh per unit]"""
        return np.sqrt(np.diag(self.inverse) * self.growth) * self.deviation

    def half_width(self, share: float) -> float:
        """Return how many deviations a band has on each side. [-]

        Args:
            share: Of the truths that lie within it. [-]
        """
        from scipy.special import stdtrit  # heavy to import

        return float(stdtrit(self.degrees, 0.5 + 0.5 * share))


class CumulatedSaving(Described):
    """What reported days have saved up to each of them (CUSUM), shape (N,) each."""

    expected: Annotated[Float, "What each day would have used. [kWh]"]
    saved: Annotated[Float, "Expected less used, added up. [kWh]"]
    band: Annotated[Float, "Half width of the 90 % band of ``saved``. [kWh]"]
    claimed: Annotated[
        bool, "Whether a saving at the end is certain: its 99.8 % band lies above zero."
    ]
    outside: Annotated[int, "Days with a quantity outside the range of the baseline."]


def fit_baseline(energy: Float, drivers: Mapping[str, Float]) -> EnergyBaseline:
    """Return the baseline of days.

    Args:
        energy: Of each day, shape (N,). [kWh]
        drivers: What explains it, by name, shape (N,) each. [its own unit]
    """
    kept, left_out = [np.ones_like(energy)], list[str]()
    names = ["constant"]
    for name, column in drivers.items():
        known = np.stack(kept, axis=1)
        rest = column - known @ np.linalg.lstsq(known, column, rcond=None)[0]
        if np.linalg.norm(rest) > INDEPENDENT * np.linalg.norm(column):
            kept.append(column)
            names.append(name)
        else:
            left_out.append(name)
    rows = np.stack(kept, axis=1)
    least = rows.shape[1] + MIN_DEGREES
    if len(energy) < least or not np.mean(energy) > 0.0:
        raise HistoryError(
            f"a baseline of {len(energy)} days with {np.sum(energy):.3f} kWh",
            f"at least {least} days on which the robot used energy",
            "name a longer baseline, or fewer of what explains the energy (--drivers)",
        )
    scale: Float = np.linalg.norm(rows, axis=0)
    inverse: Float = np.linalg.inv((rows / scale).T @ (rows / scale)) / np.outer(scale, scale)
    values: Float = inverse @ (rows.T @ energy)
    residual: Float = energy - rows @ values
    square = float(residual @ residual)
    likeness = float(residual[1:] @ residual[:-1]) / square if square > 0.0 else 0.0
    deviation = np.sqrt(square / (len(energy) - rows.shape[1]))
    return EnergyBaseline(
        tuple(names), values, inverse, float(deviation), float(np.clip(likeness, 0, MAX_LIKENESS)),
        float(deviation / np.mean(energy)), len(energy),
        {name: (float(one.min()), float(one.max())) for name, one in drivers.items()},
        tuple(left_out),
    )  # fmt: skip


def compare(
    baseline: EnergyBaseline, energy: Float, drivers: Mapping[str, Float]
) -> CumulatedSaving:
    """Return what reported days have saved.

    Args:
        energy: Of each day, shape (N,). [kWh]
        drivers: Of each day, as those of the baseline, shape (N,) each. [its own unit]
    """
    columns = [np.ones_like(energy), *(drivers[name] for name in baseline.names[1:])]
    rows = np.stack(columns, axis=1)
    expected = rows @ baseline.values
    saved = np.cumsum(expected - energy)
    sums = np.cumsum(rows, axis=0)
    spread = np.einsum("ki,ij,kj->k", sums, baseline.inverse, sums)
    count = np.arange(1, len(energy) + 1)
    deviation = baseline.deviation * np.sqrt(baseline.growth * (count + spread))
    outside = np.zeros(len(energy), dtype=bool)
    for name, (least, most) in baseline.ranges.items():
        outside |= (drivers[name] < least) | (drivers[name] > most)
    claimed = len(saved) > 0 and saved[-1] > baseline.half_width(CLAIM) * deviation[-1]
    return CumulatedSaving(
        expected, saved, baseline.half_width(BAND) * deviation, bool(claimed), int(outside.sum())
    )
