"""Losses of the drives from one power meter for all of them.

``P = C + sum_i (P_mech + c1 |w| + c2 w^2 + k (1 + alpha (T - 20)) tau^2)_i`` over the same
time as each reading. The constants of drives, DC side and, for a meter at the grid, grid
side show as one sum. How much of the rest can be told apart is tried from little to much;
the simplest structure that no other beats on blocks it has not seen is taken.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from robot_energy.blocks import Float, Int, MeterLocation
from robot_energy.errors import NotIdentifiableError
from robot_energy.identify.losses import Losses, at_bound, fit_losses
from robot_energy.identify.quality import folds_in_order
from robot_energy.identify.total_sums import COEFFICIENTS, Sums
from robot_energy.model_file import RobotModel
from robot_energy.model_file.figure import PositiveFigure
from robot_energy.model_file.joint import LossDrive

Structure = Literal["constant", "shaft", "shared", "axis_copper", "axis"]
STRUCTURES: tuple[Structure, ...] = ("shaft", "shared", "axis_copper", "axis")
FOLDS = 5
GAIN = 0.98  # a structure with more parameters must be better by this factor

NO_BETTER = PositiveFigure(
    value=0.0, tag="assumed", source="losses predict held-out readings no better than 0"
)


@dataclass(frozen=True)
class TotalFit:
    """Losses behind the readings of one meter.

    Attributes:
        structure: What is told apart.
        constant: C. [W]
        constant_std: [W]
        losses: The regression behind it; its columns are named by joint and term.
        coefficients: Copper, linear and quadratic coefficient of every joint, shape (3, n).
        deviations: Standard deviations of them; NaN where not told, shape (3, n).
        errors: RMS on blocks not seen, of every structure that was tried. [W]
    """

    structure: Structure
    constant: float
    constant_std: float
    losses: Losses
    coefficients: Float
    deviations: Float
    errors: dict[Structure, float]


@dataclass(frozen=True)
class TotalScore:
    """One way to predict the meter, on held-out data.

    Attributes:
        rms: Over all held-out readings. [W]
        energy_error: Predicted over measured energy less 1, mean size over the folds. [-]
        worst: The greatest of them in size. [-]
    """

    rms: float
    energy_error: float
    worst: float


def fit_total(data: Sums) -> TotalFit:
    """Find out how much the readings tell apart, and fit that.

    Raises:
        NotIdentifiableError: If not even a constant can be fitted.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):  # the matrices are small: more threads only wait for each other
        return _fit_total(data)


def _fit_total(data: Sums) -> TotalFit:
    errors: dict[Structure, float] = {}
    chosen: Structure = "shaft"
    fold = folds_in_order(len(data), FOLDS)
    for structure in STRUCTURES:
        try:
            error = _error(data, fold, structure)
        except NotIdentifiableError:
            continue
        errors[structure] = error
        if chosen not in errors or error < GAIN * errors[chosen]:
            chosen = structure
    return fit_structure(data, chosen, errors)


def _error(data: Sums, fold: Int, structure: Structure) -> float:
    error = np.empty(len(data))
    for number in np.unique(fold):
        test = fold == number
        fit = fit_structure(data.rows(~test), structure)
        error[test] = predict(data.rows(test), fit) - data.measured[test]
    return float(np.sqrt(np.mean(error**2)))


def fit_structure(
    data: Sums, structure: Structure, errors: dict[Structure, float] | None = None
) -> TotalFit:
    """Fit one structure.

    Args:
        data: Pieces between readings.
        structure: What is told apart.
        errors: On blocks not seen, for the record.

    Raises:
        NotIdentifiableError: If the readings are too few.
    """
    n_joints = len(data.names)
    columns, names, place = [np.ones(len(data))], ["constant"], [(-1, -1)]
    for row, term in enumerate(COEFFICIENTS):
        apart = structure == "axis" or (structure == "axis_copper" and row == 0)
        if apart:
            columns += [data.terms[:, row, k] for k in range(n_joints)]
            names += [f"{term} of {name}" for name in data.names]
            place += [(row, k) for k in range(n_joints)]
        elif structure in ("shared", "axis_copper"):
            columns.append(data.terms[:, row] @ data.scale[row])
            names.append(f"{term} of all axes")
            place.append((row, -1))
    shaft = 0.0 if structure == "constant" else data.shaft
    losses = fit_losses(
        np.column_stack(columns), data.measured - shaft, data.block, names, "the meter's readings"
    )
    coefficients, deviations = np.zeros((3, n_joints)), np.zeros((3, n_joints))
    for name, (row, joint) in zip(names[1:], place[1:], strict=True):
        axes = slice(None) if joint < 0 else slice(joint, joint + 1)
        factor = data.scale[row] if joint < 0 else np.ones(1)
        coefficients[row, axes] = losses.values[name] * factor
        deviations[row, axes] = losses.std[name] * factor
    return TotalFit(
        structure,
        losses.values["constant"],
        losses.std["constant"],
        losses,
        coefficients,
        deviations,
        dict(errors or {}),
    )


def predict(data: Sums, fit: TotalFit) -> Float:
    """Return what the meter would read, shape (K,). [W]"""
    shaft = 0.0 if fit.structure == "constant" else data.shaft
    return shaft + fit.constant + np.einsum("krj,rj->k", data.terms, fit.coefficients)


def compare_total(data: Sums, model: RobotModel | None) -> tuple[str, dict[str, TotalScore]]:
    """Predict whole recordings, or blocks of the only one, from the others.

    Args:
        data: Pieces between readings.
        model: Model whose prediction as given is among the ways; None for none.

    Returns:
        ``recordings`` or ``blocks``, and the scores by way. ``identified`` chooses its
        structure without the held-out data.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        return _compare(data, model)


def _compare(data: Sums, model: RobotModel | None) -> tuple[str, dict[str, TotalScore]]:
    several = len(np.unique(data.recording)) > 1
    fold = data.recording if several else folds_in_order(len(data), FOLDS)
    fits: dict[str, Callable[[Sums], Callable[[Sums], Float]]] = {
        "constant": lambda train: _ready(fit_structure(train, "constant")),
        "shaft": lambda train: _ready(fit_structure(train, "shaft")),
    }
    if model is not None:
        cabinet = model.cabinet.loss_dc.value
        cabinet += model.cabinet.loss_grid.value if data.location is MeterLocation.GRID else 0.0
        fits["given"] = lambda _train: lambda test: test.given + cabinet
    fits["shared"] = lambda train: _ready(fit_structure(train, "shared"))
    fits["axis_copper"] = lambda train: _ready(fit_structure(train, "axis_copper"))
    fits["axis"] = lambda train: _ready(fit_structure(train, "axis"))
    fits["identified"] = lambda train: _ready(_fit_total(train))
    if np.isfinite(data.drives).all():
        fits["drives_measured"] = lambda train: _offset(train)
    scores: dict[str, TotalScore] = {}
    for name, make in fits.items():
        predicted = np.empty(len(data))
        try:
            for number in np.unique(fold):
                test = fold == number
                predicted[test] = make(data.rows(~test))(data.rows(test))
        except NotIdentifiableError:
            continue
        scores[name] = _score(data, predicted, fold)
    return ("recordings" if several else "blocks"), scores


def _ready(fit: TotalFit) -> Callable[[Sums], Float]:
    return lambda test: predict(test, fit)


def _offset(train: Sums) -> Callable[[Sums], Float]:
    """Measured power of the drives and a constant: the best that a model of them can do."""
    constant = float(np.median(train.measured - train.drives))
    return lambda test: test.drives + constant


def _score(data: Sums, predicted: Float, fold: Int) -> TotalScore:
    error = predicted - data.measured
    ratios = [
        float(
            np.sum((error * data.duration)[fold == k])
            / np.sum((data.measured * data.duration)[fold == k])
        )
        for k in np.unique(fold)
    ]
    size = np.abs(ratios)
    return TotalScore(
        float(np.sqrt(np.mean(error**2))), float(size.mean()), ratios[int(np.argmax(size))]
    )


def with_total(
    model: RobotModel, fit: TotalFit, place: MeterLocation, source: str
) -> tuple[RobotModel, list[str]]:
    """Return a model that predicts the meter as the fit does.

    The constants are one sum: the drives get none, and the DC side all but what the model
    says of the grid side.

    Args:
        model: Any model of the same robot.
        fit: What was identified.
        place: Where the meter sits.
        source: Where the data come from.

    Returns:
        The model, and what was decided without data, one sentence each.
    """
    joints = [
        joint.model_copy(update={"losses": _entry(fit, k, source)})
        for k, joint in enumerate(model.joints)
    ]
    notes = ["the constants of drives and cabinet are one sum; the DC side of the cabinet takes it"]
    update: dict[str, PositiveFigure] = {}
    constant = fit.constant
    if place is MeterLocation.GRID:
        grid = min(model.cabinet.loss_grid.value, constant)
        notes[0] += f", less {grid:g} W of the grid side as before"
        constant -= grid
        update["loss_grid"] = model.cabinet.loss_grid.model_copy(update={"value": grid})
    std = fit.constant_std if np.isfinite(fit.constant_std) else None
    update["loss_dc"] = PositiveFigure(value=constant, tag="identified", std=std, source=source)
    cabinet = model.cabinet.model_copy(update=update)
    changed = model.model_copy(update={"joints": joints, "cabinet": cabinet, "drive": "loss_model"})
    return changed.with_urdf(model.urdf_xml, model.source), notes


def _entry(fit: TotalFit, joint: int, source: str) -> LossDrive:
    entries = {
        "constant": PositiveFigure(
            value=0.0, tag="assumed", source="in the constant of the DC side, not told apart"
        )
    }
    for row, name in enumerate(COEFFICIENTS):
        std = float(fit.deviations[row, joint])
        if std == 0.0 and fit.coefficients[row, joint] == 0.0:
            entries[name] = at_bound(source) if fit.structure != "shaft" else NO_BETTER
            continue
        told = np.isfinite(std)
        entries[name] = PositiveFigure(
            value=float(fit.coefficients[row, joint]),
            tag="identified" if told else "assumed",
            std=std if told else None,
            source=source if told else "not told by the recordings, taken as 0",
        )
    return LossDrive(**entries)
