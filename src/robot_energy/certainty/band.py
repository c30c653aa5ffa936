"""Standard deviations and 90 % bands from deviations, for power and for energy."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from robot_energy.certainty.deviation import CABINET_DEVIATIONS
from robot_energy.timeline.blocks import Float

Z90 = 1.6448536269514722
"""Half width of the middle 90 % of a normal distribution, over its standard deviation."""
Z95 = 1.959964
"""The same of the middle 95 %."""
MEDIAN_TO_STD = 1.4826
"""Standard deviation of a normal variable over the median of its absolute deviation."""
_FIRST = len(CABINET_DEVIATIONS)
LOSS_GRID, BUS, TEMPERATURE, FORM, _RANDOM = (
    CABINET_DEVIATIONS.index(name) for name in ("loss_grid", "bus", "temperature", "form", "random")
)
_SYSTEMATIC = [
    CABINET_DEVIATIONS.index(name) for name in ("bodies", "payload", "loss_dc", "together")
]


class BandKind(IntEnum):
    """What a 90 % band rests on."""

    NONE = 0
    """There is no band."""
    PARAMETRIC = 1
    """The standard deviations and priors of the model's figures."""
    CALIBRATED = 2
    """These, scaled so that 90 % of what the meter measured lay within."""


@dataclass(frozen=True)
class EnergyBand:
    """How sure a predicted energy is.

    Attributes:
        std: Standard deviation from the figures of the model. [J]
        half: Half width of the 90 % band. [J]
    """

    std: float
    half: float
    kind: BandKind


def half_width(
    rest: Float | float, temperature: Float | float, scale: Float | float = Z90
) -> Float:
    """Return half the width of a band, same shape and unit.

    Readings of the meter at known temperatures may show that the figures are better known than
    they say. They do not show that an unknown temperature is: that part is never made narrower.

    Args:
        rest: Standard deviation of all but the temperature, any shape (...). [W] or [J]
        temperature: Standard deviation from the temperature, same shape. [W] or [J]
        scale: Half width over standard deviation, one value or same shape. [-]
    """
    return np.hypot(scale * np.asarray(rest), np.maximum(scale, Z90) * np.asarray(temperature))


def scores(error: Float, rest: Float, temperature: Float) -> Float:
    """Return the scale with which a band would just hold each error, shape (N,). [-]

    Args:
        error: Without sign, shape (N,). [W] or [J]
        rest: As for `half_width`, > 0, shape (N,). [W] or [J]
        temperature: As for `half_width`, shape (N,). [W] or [J]
    """
    plain = error / np.hypot(rest, temperature)
    beyond = np.maximum(error**2 - (Z90 * temperature) ** 2, 0.0)
    return np.where(plain < Z90, np.sqrt(beyond) / rest, plain)


def power_std(deviation: Float) -> Float:
    """Return the standard deviation of the mean power of short periods from the grid, (W,). [W]

    Args:
        deviation: Means of the deviations, shape (W, K). [W]
    """
    rest = np.hypot(deviation[:, BUS], deviation[:, LOSS_GRID])
    return np.hypot(rest, deviation[:, TEMPERATURE])


def energy_variances(deviation: Float) -> Float:
    """Return the variance of an energy by each figure alone, by `names_of`, shape (K - 1,). [J^2]

    The errors of figures grow with time, what no figure explains with its root.

    Args:
        deviation: Integrals of the deviations, shape (K,). [J]
    """
    columns = [*_SYSTEMATIC, LOSS_GRID, TEMPERATURE, FORM]
    random = max(float(deviation[_RANDOM]), 0.0)
    return np.concatenate([deviation[columns] ** 2, [random], deviation[_FIRST:] ** 2])


def figures_of(deviation: Float) -> Float:
    """Return the columns of the figures, shape (K - 4,): all but temperature, form and random.

    Args:
        deviation: Deviations or their integrals, shape (K,). [W] or [J]
    """
    return np.concatenate([deviation[[*_SYSTEMATIC, LOSS_GRID]], deviation[_FIRST:]])


def energy_parts(
    deviation: Float, at_bus: bool = False, systematic: bool = False
) -> tuple[float, float]:
    """Return deviations of an energy by all but temperature and form, and by the temperature. [J]

    What the form leaves out a meter shows, and without one it is added.

    Args:
        deviation: Integrals of the deviations, shape (K,). [J]
        at_bus: Whether the energy is that of the DC bus.
        systematic: Whether to leave out what no figure explains.
    """
    variances = energy_variances(deviation)
    grid, temperature, form, random = variances[len(_SYSTEMATIC) :][:4].tolist()
    left_out = (temperature + form) + (grid if at_bus else 0.0) + (random if systematic else 0.0)
    rest = math.sqrt(max(float(variances.sum()) - left_out, 0.0))
    return rest, float(abs(deviation[TEMPERATURE]))


def energy_std(deviation: Float, at_bus: bool = False) -> float:
    """Return the standard deviation of an energy from the figures of the model. [J]

    Args:
        deviation: Integrals of the deviations, shape (K,). [J]
        at_bus: Whether the energy is that of the DC bus.
    """
    return math.hypot(*energy_parts(deviation, at_bus), float(deviation[FORM]))
