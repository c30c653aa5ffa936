"""Covariance of losses and friction behind one meter: sums are known, their shares much less.

A reading is the power of the bodies, plus friction, plus losses. With the error ``x_k`` of figure k
and the power ``X_k`` that one unit of it adds, K readings are

    y = X x + noise,        C = E[(x - chosen) (x - chosen)'] + M M'

x has the constant [W], copper [W/(N m)^2], linear [W s/rad] and quadratic loss [W s^2/rad^2] of n
joints and, where the torque is that of the model, their Coulomb torques [N m] and viscous friction,
that in deviations of its law [-]: 1 + 5 n figures. ``chosen`` is what the model file says, where
axes may share figures. M is what constant errors of the sensors do to x: readings never show them.

Before the readings, figures are those of the given model. A figure with a deviation of its own
errs by that. One without has a prior ``s_k``, which is a judgement: an error common to all joints,
and one of each, ``size s_k``. The size is not known. Before the readings it has a half-Cauchy
distribution of median 1 (Gelman 2006, Bayesian Analysis 1(3), 515-534); readings weigh each size by
their likelihood. So axes of which the readings say nothing are as sure as the others turned out to
be. Readings have the weights that they have in the fit; of K, ``f K`` count as independent.
"""

from __future__ import annotations

import numpy as np

from robot_energy.certainty.priors import SPREAD, figure_std
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.model.schema import FRICTION_TERMS, LOSS_TERMS, Covariance
from robot_energy.physics.friction import FrictionModel
from robot_energy.timeline.blocks import Float, MeterLocation
from robot_energy_identify.drives.total_power import TotalFit, constant_errors, fit_structure
from robot_energy_identify.drives.total_sums import Sums
from robot_energy_identify.stats.regression import SCATTER, Fit

LEAST = 1e-3  # of the greatest prior of a term: no figure is known exactly before
UNKNOWN = 1e3  # over the prior, where readings alone say what joints have in common
DIGITS = 8  # of the numbers in a model file: correlations near 1 stay below it
COUNT = 16
SIZES = np.tan(0.5 * np.pi * (np.arange(COUNT) + 0.5) / COUNT)
"""Of the errors over their priors: as many quantiles of the half-Cauchy distribution. [-]"""


def total_covariance(
    data: Sums,
    fit: TotalFit,
    model: RobotModel | None,
    given: RobotModel | None,
    source: str = "",
) -> Covariance | None:
    """Return the covariance of all losses and friction; None where the fit says nothing of them.

    Args:
        model: That the losses were written into; None of a log, with a meter at the DC bus.
        given: The model before; None of a log.
    """
    losses = fit.losses.fit
    if losses is None:
        return None
    columns = np.column_stack([np.ones(len(data)), data.terms.reshape(len(data), -1)])
    weighted, residual = columns * losses.weight[:, None], losses.residual * losses.weight
    free, _, rank, _ = np.linalg.lstsq(weighted, residual, rcond=None)
    rest = residual - weighted @ free
    noise = float(rest @ rest) / max(len(data) - int(rank), 1)
    if not noise > 0:
        return None
    of_fit = weighted @ _figures_of_parameters(fit, len(data.names))
    weight = losses.weight * np.sqrt(_independent(losses, residual, of_fit) / noise)
    names = ["loss_dc", *(f"{term} of {name}" for term in LOSS_TERMS for name in data.names)]
    if data.viscous is not None:
        columns = np.hstack([columns, data.terms[:, LOSS_TERMS.index("linear")], data.viscous])
        names += [f"{term} of {name}" for term in FRICTION_TERMS for name in data.names]
    covariance = _second_moments(data, fit, given, columns, weight)
    if model is not None and data.location is MeterLocation.GRID:
        covariance = _with_grid_side(covariance, figure_std(model.cabinet.loss_grid, "loss_grid"))
        names.append("loss_grid")
    covariance = 0.5 * (covariance + covariance.T)
    digits = [[float(f"{value:.{DIGITS}g}") for value in row] for row in covariance.tolist()]
    return Covariance(figures=tuple(names), matrix=tuple(map(tuple, digits)), source=source)


def _second_moments(
    data: Sums, fit: TotalFit, given: RobotModel | None, columns: Float, weight: Float
) -> Float:
    """Mean products of the errors of the chosen figures, shape (P, P).

    ``weight`` is one over the noise of each reading, shape (K,). [1/W]
    """
    centre, prior, stated, common = _before(data, fit, given)
    known, chosen = len(centre), np.concatenate([[fit.constant], fit.coefficients.ravel()])
    target = (data.measured - data.shaft - columns[:, :known] @ centre) * weight
    begin = np.zeros(columns.shape[1])
    begin[:known] = centre - chosen
    sensors = np.stack(constant_errors(data, fit), axis=1) * weight[:, None]
    columns = columns * weight[:, None]
    scores, moments = np.empty(COUNT), np.empty((COUNT, len(begin), len(begin)))
    for place, size in enumerate(SIZES):
        own = np.hypot(stated, size * prior)
        spread = np.hstack([np.diag(own), common])
        seen = columns @ spread  # per deviation
        # L L' = I + seen' seen; formed, exact readings would lose the I by rounding.
        root = np.linalg.qr(np.vstack([np.eye(seen.shape[1]), seen])).R.T
        inverse = np.linalg.inv(root)
        step = inverse @ (seen.T @ target)
        scores[place] = 0.5 * float(step @ step) - float(np.log(np.abs(np.diagonal(root))).sum())
        left = spread @ inverse.T  # what the readings leave open is left left'
        apart = [left, (left @ step + begin)[:, None], left @ inverse @ (seen.T @ sensors)]
        every = np.hstack(apart)
        moments[place] = every @ every.T
    weight = np.exp(scores - scores.max())
    return np.tensordot(weight / weight.sum(), moments, 1)


def _before(
    data: Sums, fit: TotalFit, given: RobotModel | None
) -> tuple[Float, Float, Float, Float]:
    """What is known before the readings.

    Returns:
        Constant and losses, shape (1 + 3 n,); of all figures the prior and the deviation that each
        states, shape (P,); what joints have in common, shape (P, kinds).
    """
    losses = _given_losses(given)
    known = losses is not None
    if losses is None:
        try:
            losses = fit_structure(data, "shared").coefficients
        except NotIdentifiableError:
            losses = fit.coefficients
    size = np.abs(losses)
    largest = np.maximum(size, np.abs(fit.coefficients)).max(axis=1, keepdims=True)
    size = np.maximum(size, LEAST * largest)
    spread = np.array([SPREAD[term] for term in LOSS_TERMS])[:, None]
    rows = [*(spread * size)]
    stated = [np.zeros_like(size[0])] * len(rows)
    if given is not None and data.viscous is not None:
        coulomb = [joint.friction.coulomb for joint in given.joints]
        own = np.array([figure.std is not None for figure in coulomb])
        std = np.array([figure_std(figure, "coulomb") for figure in coulomb])
        by_law = np.array(
            [law.deviation is not None for law in FrictionModel.from_model(given).laws]
        )
        rows += [np.where(own, 0.0, std), np.where(by_law, 0.0, 1.0)]
        stated += [np.where(own, std, 0.0), np.where(by_law, 1.0, 0.0)]
    constant = max(SPREAD["constant"] * abs(fit.constant), LEAST)
    prior = np.concatenate([[0.0], *rows])
    kinds = np.zeros((len(prior), len(rows)))
    for place, row in enumerate(rows):
        first = 1 + place * len(row)
        unknown = UNKNOWN if place < len(LOSS_TERMS) and not known else 1.0
        kinds[first : first + len(row), place] = unknown * row
    centre = np.concatenate([[fit.constant], losses.ravel()])
    return centre, prior, np.concatenate([[constant], *stated]), kinds


def _given_losses(model: RobotModel | None) -> Float | None:
    """Copper, linear and quadratic losses of a model, shape (3, n); None if it has not all.

    Those with a covariance come from a meter, perhaps from these readings, and do not count.
    """
    if model is None or model.covariance is not None:
        return None
    entries = [joint.losses for joint in model.joints]
    rows = [
        [0.0 if entry is None else getattr(entry, term).value for entry in entries]
        for term in LOSS_TERMS
    ]
    losses = np.array(rows)
    return losses if losses.max(axis=1).all() else None


def _figures_of_parameters(fit: TotalFit, n_joints: int) -> Float:
    """Constant and terms of the joints per parameter of the fit, shape (1 + 3 n, P)."""
    assert fit.losses.fit is not None
    names = fit.losses.fit.names
    figures = np.zeros((1 + 3 * n_joints, len(names)))
    figures[0, [place for place, name in enumerate(names) if name == "constant"]] = 1.0
    figures[1:] = fit.spread.reshape(3 * n_joints, len(names))
    return figures


def _independent(losses: Fit, residual: Float, columns: Float) -> float:
    """Share of the readings that are independent: by how much blocks scatter more than they."""
    seen, squares = np.square(losses.errors()[SCATTER]).sum(axis=1), columns.T @ columns
    if not np.isfinite(squares).all() or np.linalg.cond(squares) > 1e15:
        return 1.0
    variance = float(residual @ residual) / max(len(residual) - len(seen), 1)
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
