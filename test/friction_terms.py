"""What each term of friction is worth on torque that no fit has seen.

Terms are fitted whether they show or not; `SHOWN` is what `identify friction` writes of them. Every
prediction has the offset of its fit, as the held-out errors of `identify friction` have.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.timeline.blocks import Float, Int
from robot_energy_identify.friction.friction import falling_torque, fit_friction, fit_laws
from robot_energy_identify.friction.further_terms import with_exponent
from robot_energy_identify.friction.laws import fit_law, law_torque
from robot_energy_identify.friction.samples import FrictionData
from robot_energy_identify.stats.cross_validation import predict_held_out, relative_error, rms_of

Predict = Callable[[FrictionData, FrictionData], Float]
SHOWN = "as identified"


@dataclass(frozen=True)
class TermErrors:
    """Errors of the friction torque of one axis, by the term that was added last.

    Attributes:
        torque: Root mean square of the friction torque. [N m]
        rms: Of the error; NaN where the samples do not determine the term. [N m]
        relative: That over the torque. [-]
        shown: Terms that `identify friction` finds in the samples of the fit.
    """

    torque: float
    rms: Mapping[str, float]
    relative: Mapping[str, float]
    shown: str


def _law(data: FrictionData) -> str:
    """The law over temperature that held-out temperatures prefer; a constant where none is."""
    try:
        return fit_laws(data).chosen
    except NotIdentifiableError:
        return "constant"


def _constant(train: FrictionData, seen: FrictionData) -> Float:
    return law_torque(*fit_law("constant", train), seen)


def _temperature(train: FrictionData, seen: FrictionData) -> Float:
    return law_torque(*fit_law(_law(train), train), seen)


def _load(train: FrictionData, seen: FrictionData) -> Float:
    if train.rigid is None:
        raise NotIdentifiableError(f"the bodies of {train.name} are not known", "a model")
    return law_torque(*fit_law(_law(train), train.by_load(np.inf)), seen.by_load(np.inf))


def _exponent(train: FrictionData, seen: FrictionData) -> Float:
    """With friction by load where bodies are known."""
    name = _law(train)
    if train.rigid is not None:
        train, seen = train.by_load(np.inf), seen.by_load(np.inf)
    bent, _ = with_exponent(fit_law(name, train)[0], train)
    power = {"exponent": bent.exponent, "exponent_velocity": bent.exponent_velocity}
    return law_torque(*fit_law(name, replace(train, **power)), replace(seen, **power))


def _identified(train: FrictionData, seen: FrictionData) -> Float:
    fit = fit_friction(train)
    if fit.stribeck is not None:
        return falling_torque(train, seen)
    if fit.load is not None:
        train, seen = train.by_load(fit.load[2]), seen.by_load(fit.load[2])
    if fit.exponent is not None:
        exponent, _, velocity = fit.exponent
        power = {"exponent": exponent, "exponent_velocity": velocity}
        train, seen = replace(train, **power), replace(seen, **power)
    return law_torque(*fit_law(fit.chosen, train), seen)


TERMS: dict[str, Predict] = {
    "constant": _constant,
    "temperature": _temperature,
    "+ load": _load,
    "+ exponent": _exponent,
    "Stribeck": falling_torque,
    SHOWN: _identified,
}
"""Each of the third and fourth adds to the one before; a Stribeck term is next to a constant."""


def shown_terms(data: FrictionData) -> str:
    """Return the law and the terms that `identify friction` finds, in words."""
    try:
        fit = fit_friction(data)
    except NotIdentifiableError:
        return "refused"
    terms = {
        "load": fit.load,
        f"exponent {fit.exponent[0]:.2f}" if fit.exponent else "": fit.exponent,
        "Stribeck": fit.stribeck,
    }
    return ", ".join([fit.chosen, *(name for name, term in terms.items() if term is not None)])


def term_errors(train: FrictionData, test: FrictionData) -> TermErrors:
    """Return the errors on samples of motions that the fits have not seen.

    Args:
        train: Samples in motion.
        test: Samples in motion.
    """
    return _errors(test.friction_torque, lambda predict: predict(train, test), shown_terms(train))


def held_out_terms(data: FrictionData, fold: Int) -> TermErrors:
    """Return the errors on folds, each predicted by fits to the others.

    Args:
        data: Samples in motion.
        fold: Of each sample, shape (N,).
    """

    def of(predict: Predict) -> Float:
        return predict_held_out(fold, lambda train, test: predict(data[train], data[test]))

    return _errors(data.friction_torque, of, shown_terms(data))


def _errors(target: Float, of: Callable[[Predict], Float], shown: str) -> TermErrors:
    rms, relative = dict[str, float](), dict[str, float]()
    for name, predict in TERMS.items():
        try:
            error = of(predict) - target
        except NotIdentifiableError:
            error = np.full(len(target), np.nan)
        rms[name], relative[name] = rms_of(error), relative_error(error, target)
    return TermErrors(rms_of(target), rms, relative, shown)
