"""Terms of friction that only some joints have: by load, and an exponent of the speed.

Each is one more column of the regression of a law, and is kept where its figure is surely there and
torque that no fit has seen is predicted better.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model.friction_laws import LawEntry
from robot_energy.physics.friction import viscous_law
from robot_energy_identify.friction.laws import fit_law, folds_of_axis, held_out_law, one_speed
from robot_energy_identify.friction.samples import FrictionData
from robot_energy_identify.stats.cross_validation import contiguous_folds, simplest
from robot_energy_identify.stats.regression import Fit

MIN_STD = 3.0  # standard deviations of the share of the load above 0, of an exponent from 1
SATURATIONS = (0.75, 0.5)  # quantiles of the load that are tried
EXPONENTS = (0.2, 2.0)  # of the speed in viscous friction, at most
REFINED, MAX_REFINED = 1e-3, 20  # change of the exponent at which it has settled; rounds at most


def exponent_that_shows(law: LawEntry, rms: float, data: FrictionData) -> FrictionData | None:
    """Return samples with the exponent of the speed in viscous friction; None if it does not show.

    It shows where it is surely not 1 and torque that no fit has seen is predicted better by `GAIN`,
    and whole recordings better; each fit to the rest refines it.

    Args:
        rms: Of its errors on what was held out. [N m]
    """
    try:
        bent, std = with_exponent(law, data)
        if not abs(bent.exponent - 1.0) > MIN_STD * std:
            return None
        error = held_out_law(partial(fit_law, law.law), bent, folds_of_axis(data)[1]).rms
    except NotIdentifiableError:
        return None
    names = {"none": rms, "exponent": error}
    shows = simplest(names) != "none" and _confirmed(law.law, data, bent)
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


def load_that_shows(law: str, rms: float, data: FrictionData) -> float | None:
    """Return the load at which friction by load saturates; None if it does not show. [N m]

    It shows where its share is surely above 0 and torque that no fit has seen is predicted better
    by `GAIN`, with temperatures or blocks held out as for the laws, and whole recordings better.

    Args:
        rms: Of its errors on what was held out. [N m]

    Returns:
        Infinite where it never does.
    """
    assert data.load is not None
    whole, fold = data.by_load(np.inf), folds_of_axis(data)[1]
    try:
        found = load_of(fit_law(law, whole)[1], whole)
        if found is None or not found[0] > MIN_STD * found[1]:
            return None
        tried = (np.inf, *np.quantile(data.load, SATURATIONS).tolist())
        errors = {
            limit: held_out_law(partial(fit_law, law), data.by_load(limit), fold).rms
            for limit in tried
        }
    except NotIdentifiableError:
        return None
    names = {"none": rms, **{str(k): v for k, v in errors.items()}}
    chosen = simplest(names)
    if chosen == "none" or not _confirmed(law, data, data.by_load(float(chosen))):
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
