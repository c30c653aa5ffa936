"""Loss model of one drive: ``P_el - P_mech = c0 + c1 |w| + c2 w^2 + k (1 + alpha (T - 20)) tau^2``.

No loss is negative, so a coefficient that comes out negative is set to 0 and the rest
fitted again. A column that the others explain is left out by name.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model.drive_models import LossDrive
from robot_energy.model.figure import PositiveFigure
from robot_energy.physics.equations import REFERENCE_DEGC
from robot_energy.timeline.blocks import Float, Int
from robot_energy_identify.bounds import NO_INFORMATION, identified
from robot_energy_identify.stats.cross_validation import rms_of
from robot_energy_identify.stats.regression import Fit, independent, regress
from robot_energy_identify.stats.systematic import Changes, with_systematic

if TYPE_CHECKING:
    from robot_energy_identify.drives.drives import AxisFit

COPPER_COEFFICIENT = 0.0039  # 1/K, usual textbook figure
TERMS = ("constant", "copper", "linear", "quadratic")
MIN_SHARE = 0.05  # of a column that the columns before it do not explain
MIN_SAMPLES = 30


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
