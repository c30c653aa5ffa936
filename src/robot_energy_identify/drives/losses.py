"""Loss model of one drive: ``P_el - P_mech = c0 + c1 |w| + c2 w^2 + k (1 + alpha (T - 20)) tau^2``.

No loss is negative, so a coefficient that comes out negative is set to 0 and the rest
fitted again. A column that the others explain is left out by name.

A loss map has no assumed form: ``P_el - P_mech = L(|w|, |tau|)``, bilinear between knots, fitted by
least squares under ``L >= 0``, ``dL/d|w| >= 0`` and ``dL/d|tau| >= 0``: iron loss rises with speed,
copper and inverter loss with current, whatever their form. At rest nothing is divided, so it is as
well defined there as anywhere. A weak penalty on curvature carries it into corners without samples.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Annotated, cast

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model.drive_models import LossDrive, LossMap
from robot_energy.model.figure import PositiveFigure
from robot_energy.physics.drives_and_cabinet import equal_heat_torque, knot_cells
from robot_energy.physics.equations import REFERENCE_DEGC
from robot_energy.timeline.blocks import Float, Int
from robot_energy_identify.bounds import NO_INFORMATION, identified
from robot_energy_identify.stats.cross_validation import rms_of
from robot_energy_identify.stats.regression import Fit, independent, regress
from robot_energy_identify.stats.systematic import Changes, with_systematic

if TYPE_CHECKING:
    from robot_energy_identify.drives.drives import AxisFit, AxisSamples

COPPER_COEFFICIENT = 0.0039  # 1/K, usual textbook figure
TERMS = ("constant", "copper", "linear", "quadratic")
MIN_SHARE = 0.05  # of a column that the columns before it do not explain
MIN_SAMPLES = 30
KNOTS = 7  # along speed and along torque
MIN_WINDOWS = 2 * KNOTS**2
CURVATURE = 5e-3  # weight against the RMS error: sixths of a parabola of 100 W cost 0.16 W
SLOPE = 1e-5  # the same, where nothing else says anything


class Losses(Described):
    """Coefficients that are not negative."""

    values: Annotated[dict[str, float], "By name; 0 where negative or not determined."]
    std: Annotated[
        dict[str, float],
        "By name; 0 where the value was set to 0, which a model file does not repeat. NaN where "
        "not determined.",
    ]
    negative: Annotated[
        tuple[str, ...], "Names of those that came out negative, and are at the bound 0."
    ]
    undetermined: Annotated[
        tuple[str, ...], "Names of those that the data do not distinguish from the ones before."
    ]
    samples: Annotated[int, "Number of samples."]
    rms: Annotated[float, "What remains, in sample. [W]"]
    confidence: Annotated[dict[str, float], "Half widths of the 95 % intervals, by name."]
    parts: Annotated[
        dict[str, dict[str, float]], "Of the standard deviations, by name and cause."
    ] = field(default_factory=dict[str, dict[str, float]])
    fit: Annotated[Fit | None, "The regression behind it."] = field(
        default=None, repr=False, compare=False
    )

    def figure(self, name: str, source: str, scale: float = 1.0) -> PositiveFigure:
        """Return one coefficient for a model file.

        Args:
            scale: By which it is multiplied. [-]
        """
        if name in self.undetermined:
            return PositiveFigure(value=0.0, tag="assumed", source=NO_INFORMATION)
        return identified(self.values[name] * scale, self.std[name] * scale, source)

    def entry(self, source: str = "") -> LossDrive:
        """Return the losses of one drive for a model file."""
        return LossDrive(**{name: self.figure(name, source) for name in TERMS})  # pyright: ignore


def loss_columns(velocity: Float, torque: Float, degc: Float) -> Float:
    """Return the columns of the loss model in the order of `TERMS`, shape (N, 4) or (N, n, 4).

    Args:
        velocity: Motor side, shape (N,) or (N, n). [rad/s]
        torque: Motor side, same shape. [N m]
        degc: Of the winding, same shape. [degC]
    """
    speed = np.abs(velocity)
    resistance = 1.0 + COPPER_COEFFICIENT * (degc - REFERENCE_DEGC)  # over that at 20 degC
    heat = resistance * torque * torque
    return np.stack([np.ones_like(speed), heat, speed, speed * speed], axis=-1)


def fit_losses(
    columns: Float,
    target: Float,
    block: Int,
    names: Sequence[str],
    what: str,
    changes: Callable[[dict[str, float]], Changes] | None = None,
    deviations: bool = True,
) -> Losses:
    """Return coefficients that are not negative, with deviations from blocks.

    Args:
        columns: Shape (N, P), those that matter most first. [W/coefficient]
        target: Shape (N,). [W]
        block: Contiguous block of each sample, shape (N,).
        changes: What constant errors do to the target, of the coefficients by name.
        deviations: Whether they are wanted; else they are NaN.
    """
    if len(target) < max(MIN_SAMPLES, 2 * columns.shape[1]):
        raise NotIdentifiableError(
            f"{what} have {len(target)} samples with power, torque and speed",
            f"at least {max(MIN_SAMPLES, 2 * columns.shape[1])}",
            "record longer, with power and joint states",
        )
    found = np.zeros(columns.shape[1], dtype=np.bool_)
    base, triangle = np.linalg.qr(columns)
    found[independent(triangle, MIN_SHARE * _size(columns))] = True
    if not found.any():
        raise NotIdentifiableError(f"{what} are all zero", "motion under load")
    used: list[int] = np.flatnonzero(found).tolist()
    negative: list[int] = []

    def fitted(deviations: bool) -> Fit:
        own, (turn, kept) = [names[k] for k in used], np.linalg.qr(triangle[:, used])
        known = base @ turn, kept
        return regress(columns[:, used], target, block, own, "irls", what, deviations, known)

    while True:
        fit = fitted(False)
        worst = int(np.argmin(fit.values * _size(columns[:, used])))
        if fit.values[worst] >= 0.0 or len(used) == 1:
            break
        negative.append(used.pop(worst))
    if deviations:
        fit = fitted(True)
    if deviations and changes is not None:
        known = dict.fromkeys(names, 0.0) | dict(zip(fit.names, fit.values.tolist(), strict=True))
        fit = with_systematic(fit, columns[:, used], changes(known))
    width = fit.interval()
    values = dict.fromkeys(names, 0.0)
    std = {name: 0.0 if known else float("nan") for name, known in zip(names, found, strict=True)}
    confidence = dict(std)
    for place, k in enumerate(used):
        values[names[k]] = max(float(fit.values[place]), 0.0)
        std[names[k]] = float(fit.std[place])
        confidence[names[k]] = float(width[place])
    below = [*negative, *(k for k in used if values[names[k]] == 0.0)]
    return Losses(
        values,
        std,
        tuple(names[k] for k in below),
        tuple(name for name, known in zip(names, found, strict=True) if not known),
        len(fit.residual),
        rms_of(fit.residual),
        confidence,
        {names[k]: fit.parts_of(place) for place, k in enumerate(used)},
        fit,
    )


def _size(columns: Float) -> Float:
    return np.linalg.norm(columns, axis=0)


def fitted_losses(axis: AxisFit, source: str) -> object:
    """Return the entry of the loss model; None where the data do not determine it."""
    return None if axis.losses is None else axis.losses.entry(source)


def fit_loss_map(seen: AxisSamples, source: str = "") -> LossMap:
    """Return the loss map of one drive, motor side."""
    velocity, torque = seen.motor_velocity, seen.motor_torque
    speed = np.abs(velocity)
    degc = seen.motor_temperature_degc
    heating = torque if seen.constants is None else torque / seen.constants.left(degc)
    load = equal_heat_torque(heating, degc, COPPER_COEFFICIENT)
    row = np.unique(seen.window, return_inverse=True)[1]
    count = int(row.max()) + 1 if len(row) else 0
    if count < MIN_WINDOWS or not (speed.any() and load.any()):
        raise NotIdentifiableError(
            f"a loss map has {count} averages over 0.1 s",
            f"at least {MIN_WINDOWS}, in motion under load",
            "record longer, at several speeds and loads",
        )
    share = np.linspace(0.0, 1.0, KNOTS)
    speeds = float(speed.max()) * share**2  # fine near rest, where programs of work are
    loads = float(load.max()) * share
    size = np.bincount(row)
    columns = np.zeros((count, KNOTS * KNOTS))
    (i, x), (j, y) = knot_cells(speeds, speed), knot_cells(loads, load)
    for di, wx in ((0, 1.0 - x), (1, x)):
        for dj, wy in ((0, 1.0 - y), (1, y)):
            place = row * columns.shape[1] + (i + di) * KNOTS + j + dj
            columns += np.bincount(place, wx * wy, columns.size).reshape(columns.shape)
    target = np.bincount(row, seen.drive_power - velocity * torque) / size
    found = _monotone(columns / size[:, None], target, speeds, loads)
    return LossMap(
        motor_velocity=[float(f"{value:.6g}") for value in speeds],
        motor_torque=[float(f"{value:.6g}") for value in loads],
        loss=np.round(found, 4).tolist(),
        tag="identified",
        source=source,
    )


def _monotone(columns: Float, target: Float, speeds: Float, loads: Float) -> Float:
    """Least squares under ``L >= 0`` and rises along both axes, shape (KNOTS, KNOTS). [W]

    ``min |A x - b|, G x >= 0`` is a least distance problem in ``y = R x - Q' b``, which its dual,
    a fit with coefficients >= 0, solves exactly (Lawson and Hanson 1974, chapter 23).
    """
    from scipy.linalg import solve_triangular
    from scipy.optimize import nnls

    eye = np.eye(KNOTS)
    rises = [np.kron(np.diff(eye, axis=0), eye), np.kron(eye, np.diff(eye, axis=0))]
    bends = [np.kron(_bend(speeds), eye), np.kron(eye, _bend(loads))]
    scale = len(target) ** 0.5
    rows = [columns / scale, *(CURVATURE * part for part in bends)]
    rows += [SLOPE * part for part in rises]
    rows.append(SLOPE * np.eye(1, KNOTS * KNOTS))
    given = np.concatenate([target / scale, np.zeros(sum(len(part) for part in rows[1:]))])
    q, r = np.linalg.qr(np.vstack(rows))
    start = cast(Float, solve_triangular(r, q.T @ given))
    bounds = np.vstack([np.eye(1, KNOTS * KNOTS), *rises])
    inverse = solve_triangular(r, bounds.T, trans="T").T
    dual = np.vstack([inverse.T, -(bounds @ start)[None, :]])
    goal = np.append(np.zeros(len(dual) - 1), 1.0)
    away = dual @ nnls(dual, goal)[0] - goal
    moved = cast(Float, solve_triangular(r, -away[:-1] / away[-1]))
    found = (start + moved).reshape(KNOTS, KNOTS)
    # rounding leaves 1e-12 of the bounds open
    return np.maximum.accumulate(np.maximum.accumulate(np.maximum(found, 0.0), axis=0), axis=1)


def _bend(knots: Float) -> Float:
    """Change of slope at every inner knot times the mean width of its cells, (KNOTS - 2, KNOTS)."""
    width = np.diff(knots)
    slope = np.diff(np.eye(len(knots)), axis=0) / width[:, None]
    return np.diff(slope, axis=0) * (0.5 * (width[1:] + width[:-1]))[:, None]


def fitted_loss_map(axis: AxisFit, source: str) -> LossMap | None:
    """Return the entry of the loss map; None where the data do not determine it."""
    return None if axis.samples is None else fit_loss_map(axis.samples, source)
