"""Losses of the drives from one power meter for all of them.

``P = C + sum_i (P_mech + c1 |w| + c2 w^2 + k (1 + alpha (T - 20)) tau^2)_i`` over the same
time as each reading. The constants of drives, DC side and, for a meter at the grid, grid
side show as one sum. How much of the rest can be distinguished is tried from little to much;
the simplest structure that no other beats on blocks it has not seen is taken.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import field, replace
from itertools import combinations
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.model.drive_models import LossDrive
from robot_energy.model.figure import PositiveFigure
from robot_energy.timeline.blocks import Float, Int, MeterLocation
from robot_energy_identify.blas_threads import one_thread
from robot_energy_identify.bounds import NO_INFORMATION, at_bound, identified, only_the_sum
from robot_energy_identify.drives.losses import COPPER_COEFFICIENT, Losses, fit_losses
from robot_energy_identify.drives.total_sums import COEFFICIENTS, Sums
from robot_energy_identify.stats.cross_validation import (
    FOLDS,
    EnergyScore,
    Kind,
    contiguous_folds,
    energy_score,
    predict_held_out,
    recordings_or_blocks,
    rms_of,
    simplest,
)
from robot_energy_identify.stats.systematic import (
    BODIES,
    METER,
    THERMOMETER,
    TORQUE,
    Changes,
    total,
)

Structure = Literal["constant", "shaft", "shared", "axis_copper", "axis"]
FAN = "fan"
BY_LEVELS = "levels of recordings: "  # before the source of a fan that these show
STRUCTURES: tuple[Structure, ...] = ("shaft", "shared", "axis_copper", "axis")

NO_BETTER = PositiveFigure(
    value=0.0, tag="assumed", source="losses predict held-out readings no better than 0"
)


class TotalFit(Described):
    """Losses behind the readings of one meter."""

    structure: Structure
    constant: Annotated[float, "C. [W]"]
    constant_std: Annotated[float, "[W]"]
    losses: Annotated[Losses, "The regression behind it; its columns are named by joint and term."]
    coefficients: Annotated[
        Float, "Copper, linear and quadratic coefficient of every joint, shape (3, n)."
    ]
    deviations: Annotated[
        Float, "Standard deviations of them; NaN where not determined, shape (3, n)."
    ]
    spread: Annotated[Float, "Coefficients per parameter of the regression, shape (3, n, P)."] = (
        field(default_factory=lambda: np.zeros((3, 0, 0)), repr=False)
    )
    predicted: Annotated[
        dict[Structure, Float],
        "Readings of each of five contiguous folds by every structure, fitted to the others, "
        "shape (K,). [W]",
    ] = field(default_factory=dict[Structure, Float], repr=False)


@one_thread
def fit_total(data: Sums) -> TotalFit:
    """Return the fit of the simplest structure that no other beats on blocks it has not seen."""
    predicted: dict[Structure, Float] = {}
    fold = contiguous_folds(len(data))
    for structure in STRUCTURES:
        with suppress(NotIdentifiableError):
            predicted[structure] = _held_out(
                data, fold, lambda part, what=structure: fit_structure(part, what)
            )
    errors: dict[Structure, float] = {
        name: rms_of(values - data.measured) for name, values in predicted.items()
    }
    chosen = simplest(errors) if errors else STRUCTURES[0]
    return replace(fit_structure(data, chosen), predicted=predicted)


def _held_out(data: Sums, fold: Int, fit: Callable[[Sums], TotalFit]) -> Float:
    """Predict every fold as the fit of the others does."""
    rest = replace(data, deviations=False)
    return predict_held_out(fold, lambda train, test: predict(data[test], fit(rest[train])))


def fit_structure(data: Sums, structure: Structure) -> TotalFit:
    """Return the fit of one structure."""
    n_joints = len(data.names)
    columns, names, place = _columns(data, structure)
    shaft = 0.0 if structure == "constant" else data.shaft

    def spread(values: dict[str, float]) -> Float:
        """Coefficients of every joint, shape (3, n)."""
        found = np.zeros((3, n_joints))
        for name, (row, joint) in zip(names[1:], place[1:], strict=True):
            if joint < 0:
                found[row] = values[name] * data.scale[row]
            else:
                found[row, joint] = values[name]
        return found

    losses = fit_losses(
        np.column_stack(columns),
        data.measured - shaft,
        data.block,
        names,
        "the meter's readings",
        lambda values: _changes(data, spread(values), structure),
        data.deviations,
    )
    coefficients, deviations = spread(losses.values), spread(losses.std)
    none, known = dict.fromkeys(names, 0.0), () if losses.fit is None else losses.fit.names
    return TotalFit(
        structure,
        losses.values["constant"],
        losses.std["constant"],
        losses,
        coefficients,
        deviations,
        np.stack([spread({**none, name: 1.0}) for name in known], axis=-1),
    )


def _columns(
    data: Sums, structure: Structure
) -> tuple[list[Float], list[str], list[tuple[int, int]]]:
    """Columns of a structure, shape (K,) each, their names, and term and joint, -1 for all."""
    columns: list[Float] = [np.ones(len(data))]
    names, place = ["constant"], [(-1, -1)]
    for row, term in enumerate(COEFFICIENTS):
        apart = structure == "axis" or (structure == "axis_copper" and row == 0)
        if apart:
            columns += [data.terms[:, row, k] for k in range(len(data.names))]
            names += [f"{term} of {name}" for name in data.names]
            place += [(row, k) for k in range(len(data.names))]
        elif structure in ("shared", "axis_copper"):
            columns.append(data.terms[:, row] @ data.scale[row])
            names.append(f"{term} of all axes")
            place.append((row, -1))
    return columns, names, place


def _changes(data: Sums, coefficients: Float, structure: Structure) -> Changes:
    """What constant errors of meter, torque constants and thermometers do to the target."""
    sensors = data.sensors.std
    causes: dict[str, list[Float]] = {METER: [sensors.meter * data.measured]}
    if structure == "constant":
        return causes
    heat = data.terms[:, 0] * coefficients[0]
    torque = sensors.torque * (data.shares + 2.0 * heat)
    given = sensors.bodies * (data.shaft - data.shares.sum(axis=1))
    cold = sensors.thermometer * COPPER_COEFFICIENT * heat
    causes[TORQUE], causes[BODIES] = list(-torque.T), [-given]
    causes[THERMOMETER] = list(-cold.T)
    return causes


def fan_share(data: Sums, structure: Structure) -> float:
    """Return the power of the fan by all readings, over that which was taken off them. [-]

    Args:
        data: Pieces between readings, with a fan.
        structure: Of the losses that are fitted with it.
    """
    assert data.fan is not None
    columns, names, _ = _columns(data, structure)
    shaft = 0.0 if structure == "constant" else data.shaft
    whole = data.measured + data.fan - shaft
    fit = fit_losses(
        np.column_stack([*columns, data.fan]), whole, data.block, [*names, FAN],
        "the meter's readings", deviations=False,
    )  # fmt: skip
    return 1.0 if FAN in fit.undetermined else fit.values[FAN]


def constant_errors(data: Sums, fit: TotalFit) -> list[Float]:
    """Return what one deviation of each constant error of a sensor adds, shape (K,) each. [W]"""
    changes = _changes(data, fit.coefficients, fit.structure)
    return [change for own in changes.values() for change in own]


def predict(data: Sums, fit: TotalFit) -> Float:
    """Return what the meter would read, shape (K,). [W]"""
    shaft = 0.0 if fit.structure == "constant" else data.shaft
    return shaft + fit.constant + np.einsum("krj,rj->k", data.terms, fit.coefficients)


class HeldOutPowers(Described):
    """What the meter would read, each fold predicted from the others."""

    kind: Kind
    fold: Annotated[Int, "Of each reading, shape (K,)."]
    ways: Annotated[dict[str, Float], "With the fan, by way, shape (K,). [W]"]
    measured: Annotated[Float, "Shape (K,). [W]"]
    duration: Annotated[Float, "Shape (K,). [s]"]

    def scores(self) -> dict[str, EnergyScore]:
        """Return the score of each way."""
        shown = ("constant", "shaft", "given", *STRUCTURES[1:], "identified", "drives_measured")
        return {name: self.score(name) for name in shown if name in self.ways}

    def score(self, name: str, rows: slice | NDArray[np.bool_] = slice(None)) -> EnergyScore:
        """Return the score of one way.

        Args:
            rows: Readings that count, shape (K,).
        """
        measured, duration = self.measured[rows], self.duration[rows]
        return energy_score(self.ways[name][rows], measured, duration, self.fold[rows])


@one_thread
def held_out_powers(
    data: Sums, model: RobotModel | None, fit: TotalFit | None = None
) -> HeldOutPowers:
    """Predict whole recordings, or blocks of the only one, from the others.

    Args:
        fit: Of these data, which has predicted the blocks already; None: it is not known.
        model: Model whose prediction as given is among the ways; None for none.

    Returns:
        ``identified`` chooses its structure without the held-out data.
    """
    kind, fold = recordings_or_blocks(data.recording)
    predicted: dict[Structure, Float] = {}
    if fit is not None and kind == "blocks":
        predicted |= fit.predicted
    every: tuple[Structure, ...] = ("constant", *STRUCTURES)
    for structure in every:
        if structure not in predicted:
            with suppress(NotIdentifiableError):
                predicted[structure] = _held_out(
                    data, fold, lambda train, what=structure: fit_structure(train, what)
                )
    ways: dict[str, Float] = {}
    if model is not None:
        cabinet = model.cabinet.loss_dc.value
        cabinet += model.cabinet.loss_grid.value if data.location is MeterLocation.GRID else 0.0
        ways["given"] = data.given + cabinet
    ways.update(predicted.items())
    with suppress(NotIdentifiableError):
        ways["identified"] = _chosen_in_folds(data, fold, predicted)
    if np.isfinite(data.drives).all():  # with a constant: the best that a model of them can do
        rest = data.measured - data.drives
        ways["drives_measured"] = data.drives + predict_held_out(
            fold, lambda train, test: np.full(int(test.sum()), np.median(rest[train]))
        )
    fan = 0.0 if data.fan is None else data.fan  # scores are of the whole power
    whole = {name: power + fan for name, power in ways.items()}
    return HeldOutPowers(kind, fold, whole, data.measured + fan, data.duration)


def _chosen_in_folds(data: Sums, fold: Int, predicted: dict[Structure, Float]) -> Float:
    """Predict every fold by the structure that is chosen without it, shape (K,). [W]

    Of five folds or more, those other than the held-out one choose it: each is predicted by the
    fit without both, which serves the other way round, too. Fewer are cut into blocks.
    """
    names = np.unique(fold).tolist()
    if len(names) < FOLDS:
        return _held_out(data, fold, fit_total)
    squares: dict[Structure, Float] = {}
    for structure in STRUCTURES:
        if structure not in predicted:
            continue
        with suppress(NotIdentifiableError):
            squares[structure] = _squares_without_pairs(data, fold, names, structure)
    if not squares:
        return _held_out(data, fold, fit_total)
    found = np.empty(len(data))
    for place, name in enumerate(names):
        errors: dict[Structure, float] = {
            key: float(np.sqrt(own[place].sum())) for key, own in squares.items()
        }
        chosen = simplest(errors)
        found[fold == name] = predicted[chosen][fold == name]
    return found


def _squares_without_pairs(
    data: Sums, fold: Int, names: Sequence[int], structure: Structure
) -> Float:
    """Squared error of each fold (column) by a fit without it and another one (row). [W^2]"""
    squares = np.zeros((len(names), len(names)))
    rest = replace(data, deviations=False)
    for pair in combinations(range(len(names)), 2):
        tests = [fold == names[place] for place in pair]
        fit = fit_structure(rest[~(tests[0] | tests[1])], structure)
        for place, other, test in zip(pair, reversed(pair), tests, strict=True):
            error = predict(data[test], fit) - data.measured[test]
            squares[other, place] = error @ error
    return squares


def with_total(
    model: RobotModel, fit: TotalFit, place: MeterLocation, source: str, meter: float = 0.0
) -> tuple[RobotModel, list[str]]:
    """Return a model that predicts the meter as the fit does, and what no data decided.

    The constants are one sum: the drives get none, and the DC side all but what the model
    says of the grid side. Where that side is not identified, no side has a deviation of its own.

    Args:
        meter: Standard deviation of its gain. [-]
    """
    joints = [
        joint.model_copy(update={"losses": _entry(fit, k, source)})
        for k, joint in enumerate(model.joints)
    ]
    notes = ["the constants of drives and cabinet are one sum; the DC side of the cabinet takes it"]
    update: dict[str, PositiveFigure] = {}
    constant, std = fit.constant, fit.constant_std
    dc = identified(constant, std, source)
    if place is MeterLocation.GRID:
        side = model.cabinet.loss_grid
        grid = min(side.value, constant)
        notes[0] += f", less {grid:g} W of the grid side as before"
        update["loss_grid"] = side.model_copy(update={"value": grid})
        if side.tag == "identified" and side.std is not None:
            dc = identified(constant - grid, _less_grid(fit, side, meter), source)
        else:
            known = f"the constants of both sides, {constant:.4g} +- {std:.2g} W"
            dc = only_the_sum(constant - grid, known, source)
    update["loss_dc"] = dc
    cabinet = model.cabinet.model_copy(update=update)
    return model.changed(joints=joints, cabinet=cabinet, drive="loss_model"), notes


def _less_grid(fit: TotalFit, side: PositiveFigure, meter: float) -> float:
    """Deviation of the constant minus the grid side: both have the gain of one meter. [W]"""
    of_grid = meter * side.value
    parts = dict(fit.losses.parts.get("constant", {}))
    parts[METER] = abs(parts.get(METER, 0.0) - of_grid)
    parts["grid side"] = float(np.sqrt(max((side.std or 0.0) ** 2 - of_grid**2, 0.0)))
    return total(parts)


def _entry(fit: TotalFit, joint: int, source: str) -> LossDrive:
    entries = {
        "constant": PositiveFigure(
            value=0.0, tag="assumed", source="in the constant of the DC side, not distinguished"
        )
    }
    for row, name in enumerate(COEFFICIENTS):
        value, std = float(fit.coefficients[row, joint]), float(fit.deviations[row, joint])
        shared = f"{name} of all axes"
        if std == 0.0 and value == 0.0:
            entries[name] = at_bound(source) if fit.structure != "shaft" else NO_BETTER
        elif not np.isfinite(std):
            entries[name] = PositiveFigure(value=0.0, tag="assumed", source=NO_INFORMATION)
        elif shared in fit.losses.values and fit.coefficients.shape[1] > 1:
            known = f"{100.0 * std / value:.2g} %" if value else "0"
            entries[name] = only_the_sum(value, f"all axes, known to {known}", source)
        else:
            entries[name] = identified(value, std, source)
    return LossDrive(**entries)
