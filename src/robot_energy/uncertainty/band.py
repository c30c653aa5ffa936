"""Standard deviations and 90 % bands from deviations, for power and for energy."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from robot_energy.blocks import Float
from robot_energy.uncertainty.deviation import CABINET_DEVIATIONS

Z90 = 1.6448536269514722
"""Half width of the middle 90 % of a normal distribution, over its standard deviation."""
_FIRST = len(CABINET_DEVIATIONS)
LOSS_GRID, BUS = (CABINET_DEVIATIONS.index(name) for name in ("loss_grid", "bus"))
_RANDOM = CABINET_DEVIATIONS.index("random")
_SYSTEMATIC = [CABINET_DEVIATIONS.index(name) for name in ("bodies", "payload", "loss_dc")]


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
        kind: What the band rests on.
    """

    std: float
    half: float
    kind: BandKind


def power_std(deviation: Float, at_bus: bool = False) -> Float:
    """Return the standard deviation of the mean power of short periods.

    Args:
        deviation: Means of the deviations, shape (W, K). [W]
        at_bus: Whether the power is that on the DC bus.

    Returns:
        Shape (W,). [W]
    """
    if at_bus:
        return deviation[:, BUS]
    return np.hypot(deviation[:, BUS], deviation[:, LOSS_GRID])


def energy_variances(deviation: Float) -> Float:
    """Return the variance of an energy that each figure alone causes.

    Args:
        deviation: Integrals of the deviations, shape (..., K). [J]

    Returns:
        In the order of `robot_energy.uncertainty.deviation.names_of`, shape (..., K - 1). [J^2]
    """
    systematic = deviation[..., _SYSTEMATIC] ** 2
    grid, random = deviation[..., [LOSS_GRID]] ** 2, np.maximum(deviation[..., [_RANDOM]], 0.0)
    return np.concatenate([systematic, grid, random, deviation[..., _FIRST:] ** 2], axis=-1)


def energy_std(deviation: Float, at_bus: bool = False) -> Float:
    """Return the standard deviation of an energy.

    The errors of figures grow with time, what no figure explains with its root.

    Args:
        deviation: Integrals of the deviations, shape (..., K). [J]
        at_bus: Whether the energy is that of the DC bus.

    Returns:
        Shape (...). [J]
    """
    variances = energy_variances(deviation)
    total = variances.sum(axis=-1)
    if at_bus:
        total = total - variances[..., len(_SYSTEMATIC)]
    return np.sqrt(total)
