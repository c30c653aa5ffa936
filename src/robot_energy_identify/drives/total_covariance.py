"""Covariance of losses behind one meter: their sum is known, and their shares much less.

Before the readings, each loss errs for itself, with the prior ``S`` of its size. Readings
``y = X e + noise`` of variance ``s^2`` then leave (Gaussian conditioning)

    C = (S^-1 + f X' X / s^2)^-1 + b b' + M M'

X has a column for the constant and for each term of each joint; f is the share of the readings
that are independent. b is by how much the most likely figures differ from those that were chosen,
of which axes may share some; M what constant errors of the sensors do to the figures.
"""

from __future__ import annotations

import numpy as np

from robot_energy.certainty.priors import SPREAD, figure_std
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.model.schema import Covariance
from robot_energy.timeline.blocks import Float, MeterLocation
from robot_energy_identify.drives.total_power import TotalFit, fit_structure
from robot_energy_identify.drives.total_sums import COEFFICIENTS, Sums
from robot_energy_identify.stats.regression import SCATTER, Fit

LEAST = 1e-3  # of the greatest prior of a term: no figure is known exactly before
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
    losses = fit.losses.fit
    if losses is None:
        return None
    n_joints = len(data.names)
    columns = np.column_stack([np.ones(len(data)), data.terms.reshape(len(data), -1)])
    figures = _figures_of_parameters(fit, n_joints)
    free, _, rank, _ = np.linalg.lstsq(columns, losses.residual, rcond=None)
    rest = losses.residual - columns @ free
    noise = float(rest @ rest) / max(len(data) - int(rank), 1)
    if not noise > 0:
        return None
    share = _independent(losses, figures.T @ (columns.T @ columns) @ figures)
    prior = _prior(data, fit)
    scaled = columns * prior  # per deviation of the prior
    left = np.linalg.inv(np.eye(len(prior)) + share / noise * scaled.T @ scaled)
    missed = share / noise * left @ (scaled.T @ losses.residual)
    left += np.outer(missed, missed)
    every = list(losses.moves.values())
    moves = figures @ np.hstack(every) if every else np.zeros((len(figures), 1))
    covariance = left * np.outer(prior, prior) + moves @ moves.T
    names = ["loss_dc", *(f"{term} of {name}" for term in COEFFICIENTS for name in data.names)]
    if data.location is MeterLocation.GRID:
        covariance = _with_grid_side(covariance, figure_std(model.cabinet.loss_grid, "loss_grid"))
        names.append("loss_grid")
    covariance = 0.5 * (covariance + covariance.T)
    digits = [[float(f"{value:.{DIGITS}g}") for value in row] for row in covariance.tolist()]
    return Covariance(figures=tuple(names), matrix=tuple(map(tuple, digits)), source=source)


def _prior(data: Sums, fit: TotalFit) -> Float:
    """Deviations before the readings: of the constant, then of each term of each joint."""
    size = np.abs(fit.coefficients)
    try:
        size = np.maximum(size, np.abs(fit_structure(data, "shared").coefficients))
    except NotIdentifiableError:
        pass
    spread = np.array([SPREAD[term] for term in COEFFICIENTS])[:, None]
    deviation = spread * np.maximum(size, LEAST * size.max(axis=1, keepdims=True))
    constant = SPREAD["constant"] * abs(fit.constant)
    return np.maximum(np.concatenate([[constant], deviation.ravel()]), 1e-12)


def _figures_of_parameters(fit: TotalFit, n_joints: int) -> Float:
    """Constant and terms of the joints per parameter of the fit, shape (1 + 3 n, P)."""
    assert fit.losses.fit is not None
    names = fit.losses.fit.names
    figures = np.zeros((1 + 3 * n_joints, len(names)))
    figures[0, [place for place, name in enumerate(names) if name == "constant"]] = 1.0
    figures[1:] = fit.spread.reshape(3 * n_joints, len(names))
    return figures


def _independent(losses: Fit, squares: Float) -> float:
    """Share of the readings that are independent: by how much blocks scatter more than they."""
    seen = np.square(losses.errors()[SCATTER]).sum(axis=1)
    if not np.isfinite(squares).all() or np.linalg.cond(squares) > 1e15:
        return 1.0
    variance = float(losses.residual @ losses.residual) / max(len(losses.residual) - len(seen), 1)
    expected = variance * np.diagonal(np.linalg.inv(squares))
    return float(1.0 / max(np.median(seen / expected), 1.0))


def _with_grid_side(covariance: Float, std: float) -> Float:
    """Split the constant: the DC side is what the grid side leaves of it."""
    size = len(covariance)
    whole = np.zeros((size + 1, size + 1))
    whole[:size, :size] = covariance
    whole[0, 0] += std**2
    whole[size, size] = std**2
    whole[0, size] = whole[size, 0] = -(std**2)
    return whole
