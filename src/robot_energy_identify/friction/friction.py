"""Friction of one axis over motor temperature, from measured torque (paper A, eq. 8 to 10).

``measured - rigid = fc s(w) + fv(T) w + offset + nuisances``, motor side, in samples
where the axis moves. fc does not know temperature. fv is first left free: straight
between nodes on the temperature axis, every sample counting at its own temperature, so
that a drift during a measurement does no harm. Then the laws that a model file knows
compete on temperatures they have not seen.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal

import numpy as np

from robot_energy.foundation.blas_threads import one_thread
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.model.figure import PositiveFigure
from robot_energy.model.friction_laws import FRICTION_LAWS, ConstantLaw, LawEntry, TableLaw
from robot_energy.model.joint import JointFriction, Stribeck, ViscousExponent
from robot_energy.physics.friction import viscous_law
from robot_energy.timeline.blocks import Float, Int
from robot_energy_identify.bounds import identified
from robot_energy_identify.friction.laws import (
    MIN_RANGE,
    fit_falling,
    fit_law,
    fitted_laws,
    nuisance,
    one_speed,
    stribeck,
)
from robot_energy_identify.friction.samples import FrictionData, moving_samples
from robot_energy_identify.stats.cross_validation import (
    HeldOut,
    Mask,
    contiguous_folds,
    folds_by_value,
    held_out,
    rms_of,
    simplest,
)
from robot_energy_identify.stats.regression import Fit

MIN_NEGATIVE_STD = 4.0  # standard deviations below 0; they are up to half too small
MIN_NEGATIVE_SHARE = 0.1  # of the joint's torque, below which friction is but noise of the fit
MIN_STD = 3.0  # standard deviations of the share of the load above 0, of an exponent from 1
SATURATIONS = (0.75, 0.5)  # quantiles of the load that are tried
EXPONENTS = (0.2, 2.0)  # of the speed in viscous friction, at most
REFINED, MAX_REFINED = 1e-3, 20  # change of the exponent at which it has settled; rounds at most
HeldOutPart = Literal["temperatures", "blocks"]


@dataclass(frozen=True)
class Point:
    """Viscous coefficient at one temperature, before any law.

    Attributes:
        motor_temperature_degc: [degC]
        viscous: Motor side. [N m s/rad]
        std: [N m s/rad]
    """

    motor_temperature_degc: float
    viscous: float
    std: float


@dataclass(frozen=True)
class FrictionFit:
    """Friction of one axis.

    Attributes:
        name: Of the joint.
        coulomb: fc, motor side. [N m]
        coulomb_std: [N m]
        points: The free curve of fv.
        laws: Every law that could be fitted.
        errors: Of each law on what it has not seen.
        chosen: The law with the least held-out error.
        samples: Number of samples used.
        range_degc: Of the motor temperature in them, NaN where it is not known. [degC]
        residual: Root mean square of what remains of the chosen law, in sample. [N m]
        warnings: What the data cannot determine, one sentence each.
        viscous: fv of the constant law, also where it is negative. [N m s/rad]
        viscous_std: [N m s/rad]
        speed: Root mean square of the motor velocity. [rad/s]
        torque: Root mean square of the friction torque. [N m]
        parts: Of the deviations of ``coulomb`` and ``viscous``, by cause. [of the figure]
        held_out: What that was: ``temperatures``, or contiguous ``blocks`` in time at one
            temperature.
        stribeck: The term of friction that falls with speed, where it does.
        load: Of friction by load, where held-out torque shows it: share and its deviation [-],
            and saturation, infinite for none [N m].
        load_seen: Whether the load was known, so that friction without it is the whole.
        exponent: Of the speed in viscous friction, where held-out torque shows it: the exponent and
            its deviation [-], and the speed at which it changes nothing [rad/s].
    """

    name: str
    coulomb: float
    coulomb_std: float
    points: tuple[Point, ...]
    laws: dict[str, LawEntry]
    errors: dict[str, HeldOut]
    chosen: str
    samples: int
    range_degc: tuple[float, float]
    residual: float
    warnings: tuple[str, ...]
    viscous: float
    viscous_std: float
    speed: float
    torque: float
    parts: dict[str, dict[str, float]] = field(default_factory=dict[str, dict[str, float]])
    held_out: HeldOutPart = "temperatures"
    stribeck: Stribeck | None = None
    load: tuple[float, float, float] | None = None
    load_seen: bool = False
    exponent: tuple[float, float, float] | None = None

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
            source: Where the data come from.
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

    Args:
        source: Where they come from, for the model file.

    Raises:
        NotIdentifiableError: If the axis hardly moves, only in one direction or at one
            speed.
    """
    fit, moving = fit_laws(data, source), moving_samples(data)
    if fit.stribeck is not None:
        return fit
    if len(moving.load) and moving.load.any():
        saturation = _saturation(fit, moving)
        if saturation is not None:
            with_load = moving.by_load(saturation)
            loaded = _better(fit, _fit(with_load, source), "friction by load")
            fit, moving = loaded, moving if loaded is fit else with_load
    bent = _bent(fit, moving)
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


def _bent(fit: FrictionFit, data: FrictionData) -> FrictionData | None:
    """Samples with the exponent of the speed in viscous friction; None if it does not show.

    It shows where it is surely not 1 and torque that no fit has seen is predicted better by `GAIN`,
    and whole recordings better; each fit to the rest refines it.
    """
    try:
        bent, std = with_exponent(fit.law, data)
        if not abs(bent.exponent - 1.0) > MIN_STD * std:
            return None
        error = held_out_law(partial(fit_law, fit.chosen), bent, folds_of_axis(data)[1]).rms
    except NotIdentifiableError:
        return None
    names = {"none": fit.errors[fit.chosen].rms, "exponent": error}
    shows = simplest(names) != "none" and _confirmed(fit.chosen, data, bent)
    return bent if shows else None


def _confirmed(law: str, plain: FrictionData, more: FrictionData) -> bool:
    """Whether what was found on other recordings predicts a recording better by a further term.

    Blocks of a recording are alike; temperatures that are held out are other recordings already.
    """
    if folds_of_axis(plain)[0] == "temperatures" or plain.run[0] == plain.run[-1]:
        return True
    run = np.unique(plain.run, return_inverse=True)[1]
    fold = contiguous_folds(int(run.max()) + 1)[run]
    try:
        without, found = (
            held_out_law(partial(fit_law, law), data, fold).rms for data in (plain, more)
        )
    except NotIdentifiableError:
        return False
    return found < without


def with_exponent(law: LawEntry, data: FrictionData) -> tuple[FrictionData, float]:
    """Return samples with the exponent of the speed that a law has in them, and its deviation. [-]

    It is refined until the fit no longer moves it.

    Args:
        law: As fitted without an exponent.

    Raises:
        NotIdentifiableError: If the motion does not show one in `EXPONENTS`.
    """
    exponent, degc = 1.0, np.nan_to_num(data.motor_temperature_degc)
    for _ in range(0 if one_speed(data) else MAX_REFINED):
        bent = data.by_exponent(exponent, viscous_law(law).viscous(degc))
        law, found = fit_law(law.law, replace(bent, deviations=False))
        step = float(found.values[-1])
        exponent += step
        if not EXPONENTS[0] < exponent < EXPONENTS[1]:
            break
        if abs(step) < REFINED:
            return bent, float(fit_law(law.law, bent)[1].std[-1])
    raise NotIdentifiableError(
        f"the motion of {data.name} shows no exponent of the speed in its viscous friction",
        "slow and fast motions, and an exponent between {:g} and {:g}".format(*EXPONENTS),
    )


def exponent_of(fit: Fit, data: FrictionData) -> tuple[float, float, float] | None:
    """Return the exponent of the speed, its deviation, and the speed at which it changes nothing.

    None where it was not fitted.
    """
    if not data.exponent_free:
        return None
    return data.exponent + float(fit.values[-1]), float(fit.std[-1]), data.exponent_velocity


def _saturation(plain: FrictionFit, data: FrictionData) -> float | None:
    """Load at which friction by load saturates, infinite for never; None if it does not show.

    It shows where its share is surely above 0 and torque that no fit has seen is predicted better
    by `GAIN`, with temperatures or blocks held out as for the laws, and whole recordings better.
    """
    whole, fold = data.by_load(np.inf), folds_of_axis(data)[1]
    try:
        found = load_of(fit_law(plain.chosen, whole)[1], whole)
        if found is None or not found[0] > MIN_STD * found[1]:
            return None
        tried = (np.inf, *np.quantile(data.load, SATURATIONS).tolist())
        errors = {
            limit: held_out_law(partial(fit_law, plain.chosen), data.by_load(limit), fold).rms
            for limit in tried
        }
    except NotIdentifiableError:
        return None
    names = {"none": plain.errors[plain.chosen].rms, **{str(k): v for k, v in errors.items()}}
    chosen = simplest(names)
    if chosen == "none" or not _confirmed(plain.chosen, data, data.by_load(float(chosen))):
        return None
    return float(chosen)


def load_of(fit: Fit, data: FrictionData) -> tuple[float, float, float] | None:
    """Return the share of the load in the friction, its deviation, and where it saturates.

    None where it was not fitted.
    """
    if not data.loaded:
        return None
    place = -data.nuisance.shape[1]
    return float(fit.values[place]), float(fit.std[place]), data.saturation


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
    chosen = simplest({name: error.rms for name, error in errors.items()})
    term = None
    if falls(fits["constant"], moving):
        try:
            laws["constant"], fits["constant"], term = fit_falling(moving, source)
            errors["constant"], chosen = _held_out_falling(moving, fold), "constant"
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
        load_seen=len(moving.load) > 0,
        exponent=exponent_of(regression, moving),
    )


def falls(constant: Fit, data: FrictionData) -> bool:
    """Return whether friction falls with speed: a viscous coefficient that is surely negative.

    Args:
        constant: Fit of the constant law.
    """
    viscous, std = float(constant.values[1]), float(constant.std[1])
    share = -viscous * rms_of(data.motor_velocity) / rms_of(data.friction_torque)
    return -viscous > MIN_NEGATIVE_STD * std and share > MIN_NEGATIVE_SHARE


def _held_out_falling(data: FrictionData, fold: Int) -> HeldOut:
    data = replace(data, deviations=False)

    def predict(train: Mask, test: Mask) -> Float:
        return falling_torque(data.rows(train), data.rows(test))

    return held_out(data.friction_torque, fold, predict)


def falling_torque(train: FrictionData, seen: FrictionData) -> Float:
    """Return the torque that friction with a Stribeck term, fitted to samples, has at others. [N m]

    Raises:
        NotIdentifiableError: As `fit_falling`.
    """
    law, found, term = fit_falling(train, "")
    return (
        found.values[0] * seen.sign
        + law.viscous.value * seen.motor_velocity
        + term.torque.value * stribeck(seen, term.velocity.value)
        + nuisance(found, seen)
    )


def fit_axes(axes: Sequence[FrictionData], source: str = "") -> tuple[list[FrictionFit], list[str]]:
    """Return the friction of every axis that the data determine, and why not of the others.

    Args:
        axes: Samples, one entry per axis.
        source: Where they come from, for the model file.

    Raises:
        NotIdentifiableError: If not one axis can be identified.
    """
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
        laws: Every law that could be fitted.
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


def held_out_law(
    fit: Callable[[FrictionData], tuple[LawEntry, Fit]], data: FrictionData, fold: Int
) -> HeldOut:
    """Return the error of a law on folds that its fit has not seen.

    The nuisances and the offset of the test samples come from the training samples too.

    Args:
        fold: Of each sample, shape (N,).
    """
    data = replace(data, deviations=False)

    def predict(train: Mask, test: Mask) -> Float:
        return law_torque(*fit(data.rows(train)), data.rows(test))

    return held_out(data.friction_torque, fold, predict)


def law_torque(law: LawEntry, fit: Fit, seen: FrictionData) -> Float:
    """Return the torque of a fitted law at other samples, shape (N,). [N m]

    Args:
        fit: The regression behind it.
    """
    degc = np.nan_to_num(seen.motor_temperature_degc)  # without any, the law is a constant
    viscous = viscous_law(law).viscous(degc)
    return fit.values[0] * seen.sign + viscous * seen.turning + nuisance(fit, seen)


def folds_of_axis(data: FrictionData) -> tuple[HeldOutPart, Int]:
    """Return what is held out (temperatures or blocks in time) and each sample's fold, (N,)."""
    degc = data.motor_temperature_degc
    fold = folds_by_value(degc)
    if len(np.unique(fold)) < 2 or not float(np.ptp(degc)) >= MIN_RANGE:
        # One thermal state: a fold by temperature would be a few motions, perhaps all one way.
        number = np.unique(data.block, return_inverse=True)[1]
        return "blocks", contiguous_folds(int(number.max()) + 1)[number]
    return "temperatures", fold


def with_friction(model: RobotModel, fits: Sequence[FrictionFit], source: str) -> RobotModel:
    """Return a model with identified friction; axes that were not identified keep theirs.

    Args:
        model: Any model of the same robot.
        fits: One per identified axis.
        source: Where the data come from.
    """
    found = {fit.name: fit for fit in fits}
    joints = [
        joint.model_copy(update={"friction": found[joint.name].entry(joint.friction, source)})
        if joint.name in found
        else joint
        for joint in model.joints
    ]
    return model.changed(joints=joints)
