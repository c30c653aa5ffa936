"""Friction of one axis over motor temperature, from measured torque (paper A, eq. 8 to 10).

``measured - rigid = fc s(w) + fv(T) w + offset + nuisances``, motor side, in samples
where the axis moves. fc does not know temperature. fv is first left free: straight
between nodes on the temperature axis, every sample counting at its own temperature, so
that a drift during a measurement does no harm. Then the laws that a model file knows
compete on temperatures they have not seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field, replace
from functools import partial
from typing import Annotated, Any

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.model.figure import PositiveFigure
from robot_energy.model.friction_laws import FRICTION_LAWS, ConstantLaw, LawEntry, TableLaw
from robot_energy.model.joint import JointFriction, Stribeck, ViscousExponent
from robot_energy.timeline.blocks import Float
from robot_energy_identify.blas_threads import one_thread
from robot_energy_identify.bounds import identified
from robot_energy_identify.friction.further_terms import (
    exponent_of,
    exponent_that_shows,
    load_of,
    load_that_shows,
)
from robot_energy_identify.friction.laws import (
    MIN_RANGE,
    HeldOutPart,
    fit_falling,
    fit_law,
    fitted_laws,
    folds_of_axis,
    held_out_law,
    nuisance,
    one_speed,
    stribeck,
)
from robot_energy_identify.friction.samples import FrictionData, moving_samples
from robot_energy_identify.stats.cross_validation import (
    HeldOut,
    held_out,
    rms_of,
    simplest,
)
from robot_energy_identify.stats.regression import Fit

MIN_NEGATIVE_STD = 4.0  # standard deviations below 0; they are up to half too small
MIN_NEGATIVE_SHARE = 0.1  # of the joint's torque, below which friction is but noise of the fit


class Point(Described):
    """Viscous coefficient at one temperature, before any law."""

    motor_temperature_degc: Annotated[float, "[degC]"]
    viscous: Annotated[float, "Motor side. [N m s/rad]"]
    std: Annotated[float, "[N m s/rad]"]


class FrictionFit(Described):
    """Friction of one axis."""

    name: Annotated[str, "Of the joint."]
    coulomb: Annotated[float, "fc, motor side. [N m]"]
    coulomb_std: Annotated[float, "[N m]"]
    points: Annotated[tuple[Point, ...], "The free curve of fv."]
    laws: Annotated[dict[str, LawEntry], "Every law that could be fitted."]
    errors: Annotated[dict[str, HeldOut], "Of each law on what it has not seen."]
    chosen: Annotated[str, "The law with the least held-out error."]
    samples: Annotated[int, "Number of samples used."]
    range_degc: Annotated[
        tuple[float, float], "Of the motor temperature in them, NaN where it is not known. [degC]"
    ]
    residual: Annotated[
        float, "Root mean square of what remains of the chosen law, in sample. [N m]"
    ]
    warnings: Annotated[tuple[str, ...], "What the data cannot determine, one sentence each."]
    viscous: Annotated[float, "fv of the constant law, also where it is negative. [N m s/rad]"]
    viscous_std: Annotated[float, "[N m s/rad]"]
    speed: Annotated[float, "Root mean square of the motor velocity. [rad/s]"]
    torque: Annotated[float, "Root mean square of the friction torque. [N m]"]
    parts: Annotated[
        dict[str, dict[str, float]],
        "Of the deviations of ``coulomb`` and ``viscous``, by cause. [of the figure]",
    ] = field(default_factory=dict[str, dict[str, float]])
    held_out: Annotated[
        HeldOutPart,
        "What that was: ``temperatures``, or contiguous ``blocks`` in time at one temperature.",
    ] = "temperatures"
    stribeck: Annotated[
        Stribeck | None, "The term of friction that falls with speed, where it does."
    ] = None
    load: Annotated[
        tuple[float, float, float] | None,
        "Of friction by load, where held-out torque shows it: share and its deviation [-], and "
        "saturation, infinite for none [N m].",
    ] = None
    load_seen: Annotated[
        bool, "Whether the load was known, so that friction without it is the whole."
    ] = False
    exponent: Annotated[
        tuple[float, float, float] | None,
        "Of the speed in viscous friction, where held-out torque shows it: the exponent and its "
        "deviation [-], and the speed at which it changes nothing [rad/s].",
    ] = None

    @property
    def law(self) -> LawEntry:
        """The chosen law."""
        return self.laws[self.chosen]

    def entry(self, before: JointFriction, source: str) -> JointFriction:
        """Return the friction of a model file with these figures.

        Args:
            before: What the file held. Its Stribeck term and its viscous exponent go, and its load
                terms where the load is known, since the fit holds the whole friction; other
                optional terms stay.
        """
        coulomb = identified(self.coulomb, self.coulomb_std, source)
        found: dict[str, Any] = {
            "coulomb": coulomb,
            "viscous": self.law,
            "stribeck": self.stribeck,
            "viscous_exponent": None,
        }
        if self.load_seen:
            found |= {"load_coulomb": None, "load_saturation": None}
        if self.load is not None:
            share, std, saturation = self.load
            found["load_coulomb"] = identified(share, std, source)
            if np.isfinite(saturation):
                limit = PositiveFigure(value=saturation, tag="identified", source=source)
                found["load_saturation"] = limit
        if self.exponent is not None:
            exponent, std, velocity = self.exponent
            found["viscous_exponent"] = ViscousExponent(
                exponent=identified(exponent, std, source),
                velocity=PositiveFigure(value=velocity, tag="identified", source=source),
            )
        return before.model_copy(update=found)


@one_thread
def fit_friction(data: FrictionData, source: str = "") -> FrictionFit:
    """Return the friction of one axis.

    Raises:
        NotIdentifiableError: If the axis hardly moves, only in one direction or at one
            speed.
    """
    fit, moving = fit_laws(data, source), moving_samples(data)
    if fit.stribeck is not None:
        return fit
    if moving.rigid is not None and moving.rigid.any():
        saturation = load_that_shows(fit.chosen, fit.errors[fit.chosen].rms, moving)
        if saturation is not None:
            with_load = moving.by_load(saturation)
            loaded = _better(fit, _fit(with_load, source), "friction by load")
            fit, moving = loaded, moving if loaded is fit else with_load
    bent = exponent_that_shows(fit.law, fit.errors[fit.chosen].rms, moving)
    if bent is None:
        return fit
    return _better(fit, _fit(bent, source), f"the viscous exponent {bent.exponent:.3g}")


def _better(plain: FrictionFit, fit: FrictionFit, term: str) -> FrictionFit:
    """The fit with one more term, unless its Coulomb torque is impossible."""
    if fit.coulomb < 0.0 <= plain.coulomb:
        return plain
    errors = (one.errors[one.chosen].rms for one in (fit, plain))
    note = "{}: with {} the held-out torque is off by {:.3g} instead of {:.3g} N m"
    return replace(fit, warnings=(*fit.warnings, note.format(fit.name, term, *errors)))


@one_thread
def fit_laws(data: FrictionData, source: str = "") -> FrictionFit:
    """Return the friction of one axis without a search for further terms; see `fit_friction`."""
    return _fit(moving_samples(data), source)


def _fit(moving: FrictionData, source: str) -> FrictionFit:
    degc = moving.motor_temperature_degc
    span = (float(degc.min()), float(degc.max()))
    warnings: list[str] = []
    names = fitted_laws()
    lumped = one_speed(moving)
    if lumped or not span[1] - span[0] >= MIN_RANGE:
        names = tuple(name for name in names if not FRICTION_LAWS[name].follows_temperature)
    if not span[1] - span[0] >= MIN_RANGE:
        warnings.append(
            f"{moving.name}: no motor temperature is known, so its friction is a constant, that of "
            "the temperatures at which it was recorded; name their topic with --inputs"
            if np.isnan(span[0])
            else f"{moving.name}: the range of its motor temperature is below {MIN_RANGE:g} K, so "
            "its friction is taken as constant; record it cold and warm, or give it the "
            "temperature shape of the other axes (--share-shape)"
        )
    laws: dict[str, LawEntry] = {}
    fits: dict[str, Fit] = {}
    errors: dict[str, HeldOut] = {}
    part, fold = folds_of_axis(moving)
    for name in names:
        try:
            laws[name], fits[name] = fit_law(name, moving, source)
            errors[name] = held_out_law(partial(fit_law, name), moving, fold)
        except NotIdentifiableError as error:
            if not FRICTION_LAWS[name].follows_temperature:
                raise
            warnings.append(f"{moving.name}: no {name} law, because {error.found}")
    shown = [name for name in errors if FRICTION_LAWS[name].follows_temperature]
    usable = shown if moving.follows_temperature and shown else list(errors)
    chosen = simplest({name: errors[name].rms for name in usable})
    term = None
    if falls(fits["constant"], moving):
        try:
            laws["constant"], fits["constant"], term = fit_falling(moving, source)
            plain = replace(moving, deviations=False)
            errors["constant"] = held_out(
                moving.friction_torque,
                fold,
                lambda train, test: falling_torque(plain[train], plain[test]),
            )
            chosen = "constant"
            warnings.append(
                f"{moving.name}: its friction falls with speed, so it has a Stribeck term and "
                "does not follow temperature; record faster motions as well"
            )
        except NotIdentifiableError as error:
            warnings.append(f"{moving.name}: no Stribeck term, because {error.found}")
    regression = fits[chosen]
    coulomb = float(regression.values[0])
    if lumped:
        warnings.append(
            f"{moving.name}: it moves at one speed, so that Coulomb and viscous friction cannot be "
            "separated: their sum is written as Coulomb torque, and holds at that speed alone; "
            "record slow and fast motions"
        )
    if coulomb < 0:
        warnings.append(
            f"{moving.name}: the Coulomb torque is at the bound 0, {coulomb:.3g} otherwise; "
            "check the sign and the meaning of the measured torque"
        )
    return FrictionFit(
        name=moving.name,
        coulomb=coulomb,
        coulomb_std=float(regression.std[0]),
        points=points_of(laws, span),
        laws=laws,
        errors=errors,
        chosen=chosen,
        samples=len(moving),
        range_degc=span,
        residual=rms_of(regression.residual),
        warnings=tuple(warnings),
        viscous=float(fits["constant"].values[1]),
        viscous_std=float(fits["constant"].std[1]),
        speed=rms_of(moving.motor_velocity),
        torque=rms_of(moving.friction_torque),
        parts={"coulomb": regression.parts_of(0), "viscous": fits["constant"].parts_of(1)},
        held_out=part,
        stribeck=term,
        load=load_of(regression, moving),
        load_seen=moving.rigid is not None,
        exponent=exponent_of(regression, moving),
    )


def falls(constant: Fit, data: FrictionData) -> bool:
    """Return whether friction falls with speed: a viscous coefficient that is surely negative."""
    viscous, std = float(constant.values[1]), float(constant.std[1])
    share = -viscous * rms_of(data.motor_velocity) / rms_of(data.friction_torque)
    return -viscous > MIN_NEGATIVE_STD * std and share > MIN_NEGATIVE_SHARE


def falling_torque(train: FrictionData, seen: FrictionData) -> Float:
    """Return the torque of friction with a Stribeck term, fitted to samples, at others. [N m]"""
    law, found, term = fit_falling(train, "")
    return (
        found.values[0] * seen.sign
        + law.viscous.value * seen.motor_velocity
        + term.torque.value * stribeck(seen, term.velocity.value)
        + nuisance(found, seen)
    )


def fit_axes(axes: Sequence[FrictionData], source: str = "") -> tuple[list[FrictionFit], list[str]]:
    """Return the friction of every axis that the data determine, and why not of the others."""
    fits: list[FrictionFit] = []
    refused: list[NotIdentifiableError] = []
    for axis in axes:
        try:
            fits.append(fit_friction(axis, source))
        except NotIdentifiableError as error:
            refused.append(error)
    if not fits:
        raise refused[0]
    return fits, [str(error) for error in refused]


def points_of(laws: dict[str, LawEntry], span: tuple[float, float]) -> tuple[Point, ...]:
    """Return the free curve: the table where there is one, else the constant.

    Args:
        span: Of the motor temperature. [degC]
    """
    table, constant = laws.get("table"), laws["constant"]
    if isinstance(table, TableLaw):
        return tuple(
            Point(degc, viscous, std)
            for degc, viscous, std in zip(
                table.motor_temperature_degc, table.viscous, table.std or [], strict=True
            )
        )
    if not isinstance(constant, ConstantLaw):
        return ()
    figure = constant.viscous
    return (Point(0.5 * (span[0] + span[1]), figure.value, figure.std or 0.0),)


def with_friction(model: RobotModel, fits: Sequence[FrictionFit], source: str) -> RobotModel:
    """Return a model with identified friction; axes that were not identified keep theirs."""
    before = {joint.name: joint.friction for joint in model.joints}
    found = {fit.name: fit.entry(before[fit.name], source) for fit in fits}
    return model.with_joints("friction", found)
