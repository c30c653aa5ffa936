"""Covariance of losses behind one meter: their sum is known, and their shares much less.

What the readings leave of the priors (`likely_losses`), and in addition ``b b' + M M'``: b is by
how much the most likely figures differ from those that were chosen; M what constant errors of the
sensors do to the figures that axes share.
"""

from __future__ import annotations

import numpy as np

from robot_energy.certainty.priors import figure_std
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.model.schema import Covariance
from robot_energy.timeline.blocks import Float, MeterLocation
from robot_energy_identify.drives.likely_losses import likely_losses, moves_of_figures
from robot_energy_identify.drives.total_power import TotalFit, fit_structure
from robot_energy_identify.drives.total_sums import COEFFICIENTS, Sums

DIGITS = 6  # of the numbers in a model file


def total_covariance(
    data: Sums, fit: TotalFit, model: RobotModel, source: str = ""
) -> Covariance | None:
    """Return the covariance of all losses; None where the fit says nothing of them.

    Args:
        data: That was fitted.
        fit: Losses that were chosen.
        model: That the losses were written into.
        source: Where the data come from.
    """
    try:
        shared = fit if fit.structure == "shared" else fit_structure(data, "shared")
    except NotIdentifiableError:
        return None
    if shared.losses.fit is None:
        return None
    values, covariance = likely_losses(data, shared)
    missed = values - np.concatenate([[fit.constant], fit.coefficients.ravel()])
    moves = moves_of_figures(shared)
    covariance += np.outer(missed, missed) + moves @ moves.T
    names = ["loss_dc", *(f"{term} of {name}" for term in COEFFICIENTS for name in data.names)]
    if data.location is MeterLocation.GRID:
        covariance = _with_grid_side(covariance, figure_std(model.cabinet.loss_grid, "loss_grid"))
        names.append("loss_grid")
    covariance = 0.5 * (covariance + covariance.T)
    digits = [[float(f"{value:.{DIGITS}g}") for value in row] for row in covariance.tolist()]
    return Covariance(figures=tuple(names), matrix=tuple(map(tuple, digits)), source=source)


def _with_grid_side(covariance: Float, std: float) -> Float:
    """Split the constant: the DC side is what the grid side leaves of it."""
    size = len(covariance)
    whole = np.zeros((size + 1, size + 1))
    whole[:size, :size] = covariance
    whole[0, 0] += std**2
    whole[size, size] = std**2
    whole[0, size] = whole[size, 0] = -(std**2)
    return whole
