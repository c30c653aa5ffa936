"""One shape of viscous friction over temperature for several axes, lent where an axis shows none.

An axis that was recorded at one temperature has a constant, and at one speed its Coulomb and
viscous friction look alike. Where lubricants are alike, the ratio ``g(T) = fv(T) / fv(T0)`` is,
too. So g is taken from the axes that show it,

``g(T) = h + (1 - h) exp(-(T - T0) / c)``,

and of the other axis only its size is fitted: ``torque = fc sgn(w) + fv(T0) g(T) w + offset``. This
is a prior, stated with its spread over the axes that it comes from; no law is lent unasked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model.figure import PositiveFigure
from robot_energy.model.friction_laws import ExponentialLaw
from robot_energy.physics.friction import viscous_law
from robot_energy.timeline.blocks import Float
from robot_energy_identify.friction.friction import FrictionFit
from robot_energy_identify.friction.further_terms import load_of
from robot_energy_identify.friction.laws import (
    MIN_RANGE,
    folds_of_axis,
    held_out_law,
    one_speed,
    regress_friction,
)
from robot_energy_identify.friction.samples import FrictionData, moving_samples
from robot_energy_identify.stats.cross_validation import GAIN, rms_of
from robot_energy_identify.stats.regression import Fit

MIN_LENDERS = 2  # axes: one has no spread
MIN_LENT_RANGE = 15.0  # K of motor temperature behind a shape that is lent
MAX_SPREAD = 0.25  # of g over its lenders: beyond it they have no common shape
GRID = 25


class TemperatureShape(Described):
    """The common shape of several axes."""

    hot: Annotated[float, "h, share of the hot limit in the friction at ``reference_degc``. [-]"]
    scale: Annotated[float, "c. [K]"]
    scale_std: Annotated[float, "Standard deviation of c over the axes. [K]"]
    ratio: Annotated[float, "a / b of the exponential law. [-]"]
    ratio_std: Annotated[float, "Standard deviation of a / b over the axes. [-]"]
    reference_degc: Annotated[float, "T0. [degC]"]
    range_degc: Annotated[tuple[float, float], "Temperatures behind it. [degC]"]
    spread: Annotated[float, "Root mean square by which the axes differ from g, relative. [-]"]
    lenders: tuple[str, ...]

    def at(self, degc: Float) -> Float:
        """Return g.

        Args:
            degc: Of the motor, any shape. [degC]
        """
        return _curve(self.hot, self.scale, degc - self.reference_degc)

    def __str__(self) -> str:
        return (
            f"the temperature shape of {', '.join(self.lenders)} (c {self.scale:.3g} +- "
            f"{self.scale_std:.1g} K, a/b {self.ratio:.2g} +- {self.ratio_std:.1g}; they differ "
            f"from it by {100 * self.spread:.0f} %)"
        )


def _curve(hot: float, scale: float, above: Float) -> Float:
    return hot + (1.0 - hot) * np.exp(-above / scale)


def common_shape(fits: Sequence[FrictionFit]) -> TemperatureShape:
    """Return the shape that axes with a law of their own have in common."""
    lent = {
        fit.name: fit.law
        for fit in fits
        if isinstance(fit.law, ExponentialLaw)
        and np.ptp(fit.law.fitted_degc) >= MIN_LENT_RANGE
        and fit.law.b.value > 0.0
    }
    if len(lent) < MIN_LENDERS:
        raise NotIdentifiableError(
            f"{len(lent)} of {len(fits)} axes show an exponential law over {MIN_LENT_RANGE:g} K",
            f"at least {MIN_LENDERS}, to give others their temperature shape with its spread",
            "record cold and warm",
        )
    laws = list(lent.values())
    degc = np.array([np.linspace(*law.fitted_degc, GRID) for law in laws])
    reference = float(degc.mean())
    curves = [viscous_law(law) for law in laws]
    sizes = np.array([float(curve.viscous(np.array(reference))) for curve in curves])
    values = np.array([curve.viscous(row) for curve, row in zip(curves, degc, strict=True)])
    relative = np.log(values / sizes[:, None])
    hot, scale = _fitted(degc - reference, relative)
    left = relative - np.log(_curve(hot, scale, degc - reference))
    spread = float(np.sqrt(np.mean(left**2) * len(laws) / (len(laws) - 1)))
    if spread > MAX_SPREAD:
        raise NotIdentifiableError(
            f"the temperature shapes of {', '.join(lent)} differ by {100 * spread:.0f} %",
            f"at most {100 * MAX_SPREAD:.0f} %, to give others one shape",
        )
    scales = np.array([law.c.value for law in laws])
    ratios = np.array([law.a.value / law.b.value for law in laws])
    return TemperatureShape(
        hot,
        scale,
        float(scales.std(ddof=1)),
        hot / ((1.0 - hot) * float(np.exp(reference / scale))),
        float(ratios.std(ddof=1)),
        reference,
        (float(degc.min()), float(degc.max())),
        spread,
        tuple(lent),
    )


def _fitted(above: Float, relative: Float) -> tuple[float, float]:
    """H and c of least squared error of ln g; every axis is 0 at the reference already."""
    from scipy.optimize import least_squares

    def error(x: Float) -> Float:
        return (np.log(_curve(float(x[0]), float(np.exp(x[1])), above)) - relative).ravel()

    found = least_squares(error, [0.2, np.log(20.0)], bounds=([0.0, np.log(2.0)], [0.99, 6.0]))
    return float(found.x[0]), float(np.exp(found.x[1]))


def fit_shared(
    data: FrictionData, shape: TemperatureShape, source: str = ""
) -> tuple[ExponentialLaw, Fit]:
    """Return a lent law whose size was fitted to an axis, and the regression behind it."""
    degc = data.motor_temperature_degc
    fit = regress_friction(data, shape.at(degc)[:, None], ["viscous"])
    size, std = float(fit.values[1]), float(fit.std[1])
    if not size > 0.0:
        raise NotIdentifiableError(f"the viscous friction of {data.name} is not above 0", "above")
    own = std / size if np.isfinite(std) else 0.0
    relative = float(np.hypot(own, shape.spread))
    lift = float(np.exp(shape.reference_degc / shape.scale))
    words = f"{shape}; size fitted: {source}" if source else f"{shape}; size fitted"

    def figure(value: float, deviation: float) -> PositiveFigure:
        return PositiveFigure(value=value, tag="derived", std=deviation, source=words)

    low = min(shape.range_degc[0], float(degc.min()))
    high = max(shape.range_degc[1], float(degc.max()))
    a, b = size * shape.hot, size * (1.0 - shape.hot) * lift
    law = ExponentialLaw(
        law="exponential",
        a=figure(a, relative * a),
        b=figure(b, relative * b),
        c=figure(shape.scale, shape.scale_std),
        fitted_degc=(low, high),
        std=relative * size * float(shape.at(np.array(low))),
    )
    return law, fit


def share_shape(
    fits: Sequence[FrictionFit], axes: Sequence[FrictionData], source: str = ""
) -> list[FrictionFit]:
    """Return fits, those of too small a range with a lent shape, or why not, in their warnings.

    Args:
        fits: Of the axes that could be identified.
    """
    samples = {axis.name: axis for axis in axes}
    poor: dict[str, FrictionData] = {}
    for fit in fits:
        data = moving_samples(samples[fit.name])
        degc = data.motor_temperature_degc
        if np.isfinite(degc).all() and (np.ptp(degc) < MIN_RANGE or one_speed(data)):
            data = data if fit.load is None else data.by_load(fit.load[2])
            if fit.exponent is not None:
                exponent, _, velocity = fit.exponent
                data = replace(data, exponent=exponent, exponent_velocity=velocity)
            poor[fit.name] = data
    if not poor:
        return list(fits)
    try:
        shape = common_shape([fit for fit in fits if fit.name not in poor])
    except NotIdentifiableError as error:
        return [_kept(fit, str(error)) if fit.name in poor else fit for fit in fits]
    return [
        _borrowed(fit, poor[fit.name], shape, source) if fit.name in poor else fit for fit in fits
    ]


def _kept(fit: FrictionFit, why: str) -> FrictionFit:
    note = f"{fit.name}: the shape of the others is not taken: {why}"
    return replace(fit, warnings=(*fit.warnings, note))


def _borrowed(
    fit: FrictionFit, data: FrictionData, shape: TemperatureShape, source: str
) -> FrictionFit:
    try:
        law, found = fit_shared(data, shape, source)
        fold = folds_of_axis(data)[1]
        error = held_out_law(lambda part: fit_shared(part, shape), data, fold)
    except NotIdentifiableError as problem:
        return _kept(fit, problem.found)
    if error.rms > fit.errors[fit.chosen].rms / GAIN:
        return _kept(fit, "it predicts held-out torque worse than the axis's own law")
    return replace(
        fit,
        coulomb=float(found.values[0]),
        coulomb_std=float(found.std[0]),
        parts={**fit.parts, "coulomb": found.parts_of(0)},
        laws={**fit.laws, "exponential": law},
        errors={**fit.errors, "exponential": error},
        chosen="exponential",
        residual=rms_of(found.residual),
        load=load_of(found, data),
        warnings=(f"{fit.name}: its own range is too small; its law has {shape}",),
    )
