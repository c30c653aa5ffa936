"""Most likely losses of each axis behind one meter, and their covariance.

Before the readings each figure is the one that all axes share, and errs for itself with the prior
``S`` of its size. Readings ``y = X (v + e) + noise`` then leave (Gaussian conditioning)

    e = f C X' W^2 (y - X v),  C = (S^-2 + f X' W^2 X)^-1

X has a column for the constant and for each term of each joint; f is the share of the readings that
are independent. W has the reciprocal deviations ``hypot(a, b p)`` of the readings, smaller at
outliers (Huber): what delays, gears and braking leave grows with the shaft power p that was moved
half a second around, so that readings at rest say most of constant and copper. Both are taken from
the residuals: a from the quarter with the least p, b from the others.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_energy.certainty.band import MEDIAN_TO_STD
from robot_energy.certainty.priors import SPREAD
from robot_energy.timeline.blocks import Float
from robot_energy_identify.drives.total_sums import COEFFICIENTS, Sums
from robot_energy_identify.stats.regression import HUBER, SCATTER, Fit

if TYPE_CHECKING:
    from robot_energy_identify.drives.total_power import TotalFit

QUIET = 0.25  # of the readings: those with the least shaft power
AT_REST = 0.01  # of the mean power: least deviation of a reading
LEAST = 1e-3  # of the greatest prior of a term: no figure is known exactly before
TINY = 1e-12  # of any figure or deviation: no prior and no noise is 0
ROUNDS = 6  # of weights, and of figures that come out negative


def likely_losses(data: Sums, shared: TotalFit) -> tuple[Float, Float]:
    """Return the most likely figures and their covariance without constant errors.

    No figure is below 0.

    Args:
        data: Pieces between readings.
        shared: Fit in which axes share their figures.

    Returns:
        Constant, then copper, linear and quadratic coefficient of every joint, shape
        (1 + 3 n,); their covariance.
    """
    fit = shared.losses.fit
    given = np.concatenate([[shared.constant], shared.coefficients.ravel()])
    prior = _prior(shared)
    columns = np.column_stack([np.ones(len(data)), data.terms.reshape(len(data), -1)])
    target = data.measured - data.shaft
    share = 1.0 if fit is None else _independent(fit, columns @ _figures_of_parameters(shared))
    values, free = given, np.ones(len(prior), dtype=np.bool_)
    left = np.eye(len(prior))
    for _ in range(ROUNDS):
        weight = _weight(data, target - columns @ values)
        scaled = columns * prior * free  # per deviation of the prior
        missed = target - columns @ np.where(free, given, 0.0)
        weighted = share * (scaled * weight[:, None]).T
        left = np.linalg.inv(np.eye(len(prior)) + weighted @ scaled)
        found = np.where(free, given + prior * (left @ (weighted @ missed)), 0.0)
        free &= found >= 0.0
        free[0] = True  # a constant below 0 is a fault of the meter, which is said elsewhere
        values = np.where(free, found, 0.0)
    return values, left * np.outer(prior, prior)


def _weight(data: Sums, rest: Float) -> Float:
    """Reciprocal variances of the readings, shape (K,). [1/W^2]"""
    size, moved = np.abs(rest), np.maximum(data.moved, TINY)
    quiet = data.moved <= np.quantile(data.moved, QUIET)
    least = max(AT_REST * float(np.abs(data.measured).mean()), TINY)
    at_rest = max(MEDIAN_TO_STD * float(np.median(size[quiet])), least)
    share = MEDIAN_TO_STD * float(np.median((size / moved)[~quiet])) if not quiet.all() else 0.0
    deviation = np.hypot(at_rest, share * data.moved)
    return np.minimum(1.0, HUBER * deviation / np.maximum(size, TINY)) / deviation**2


def _prior(shared: TotalFit) -> Float:
    """Deviations before the readings: of the constant, then of each term of each joint."""
    size = np.abs(shared.coefficients)
    spread = np.array([SPREAD[term] for term in COEFFICIENTS])[:, None]
    deviation = spread * np.maximum(size, LEAST * size.max(axis=1, keepdims=True))
    constant = SPREAD["constant"] * abs(shared.constant)
    return np.maximum(np.concatenate([[constant], deviation.ravel()]), TINY)


def _figures_of_parameters(shared: TotalFit) -> Float:
    """Constant and terms of the joints per parameter of the fit, shape (1 + 3 n, P)."""
    assert shared.losses.fit is not None
    names = shared.losses.fit.names
    figures = np.zeros((1 + shared.coefficients.size, len(names)))
    figures[0, [place for place, name in enumerate(names) if name == "constant"]] = 1.0
    figures[1:] = shared.spread.reshape(-1, len(names))
    return figures


def moves_of_figures(shared: TotalFit) -> Float:
    """Return by how much constant errors of the sensors move the figures, (1 + 3 n, errors).

    Args:
        shared: Fit in which axes share their figures.
    """
    every = [] if shared.losses.fit is None else list(shared.losses.fit.moves.values())
    if not every:
        return np.zeros((1 + shared.coefficients.size, 1))
    return _figures_of_parameters(shared) @ np.hstack(every)


def _independent(fit: Fit, columns: Float) -> float:
    """Share of the readings that are independent: by how much blocks scatter more than they."""
    seen = np.square(fit.errors()[SCATTER]).sum(axis=1)
    squares = columns.T @ columns
    if not np.isfinite(squares).all() or np.linalg.cond(squares) > 1e15:
        return 1.0
    variance = float(fit.residual @ fit.residual) / max(len(fit.residual) - len(seen), 1)
    expected = variance * np.diagonal(np.linalg.inv(squares))
    return float(1.0 / max(np.median(seen / expected), 1.0))
