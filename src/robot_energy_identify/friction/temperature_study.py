"""Does friction that knows temperature predict temperatures it has not seen?

The laws are fitted at some temperatures and tested at others. With temperatures shuffled
between the runs the gain must vanish; what remains then is chance.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import Annotated, get_args

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model.friction_laws import FRICTION_LAWS, LawEntry, Outside
from robot_energy.physics.friction import viscous_law
from robot_energy.results.base import Number, Result
from robot_energy_identify.friction.laws import fit_law, fitted_laws, nuisance
from robot_energy_identify.friction.samples import FrictionData, moving_samples
from robot_energy_identify.stats.cross_validation import rms_of

SHUFFLES = 20


class Span(Described):
    """A range of motor temperatures."""

    low: Annotated[float, "Lower end. [degC]"] = -np.inf
    high: Annotated[float, "Upper end. [degC]"] = np.inf

    def __str__(self) -> str:
        if np.isinf(self.low):
            return f"<= {self.high:g} degC"
        if np.isinf(self.high):
            return f">= {self.low:g} degC"
        return f"{self.low:g} to {self.high:g} degC"


class FrictionStudyRow(Described):
    """One law, fitted at some temperatures and tested at others."""

    law: Annotated[str, "Which law."]
    beyond: Annotated[
        str, "What holds outside its fitted range, as the key ``outside`` of a model file says."
    ]
    rms: Annotated[float, "Of the torque error on the test samples, in the unit of the torque."]
    power_bias: Annotated[
        float, "Mean predicted friction power over mean measured one, less 1. [-]"
    ]
    coulomb: Annotated[float, "fc, in the unit of the torque."]
    viscous: Annotated[LawEntry, "The fitted law, as in a model file."]


class Study(Described):
    """Laws tested on temperatures that they have not seen."""

    train: Annotated[Span, "Temperatures of the fit."]
    test: Annotated[Span, "Temperatures of the test."]
    trained: Annotated[int, "Samples of the fit."]
    tested: Annotated[int, "Samples of the test."]
    rows: Annotated[tuple[FrictionStudyRow, ...], "One per law and way to go beyond its range."]
    refused: Annotated[
        tuple[str, ...], "Why the other laws could not be fitted, one sentence each."
    ] = ()

    def row(self, law: str, beyond: str = "hold") -> FrictionStudyRow:
        """Return one row."""
        for row in self.rows:
            if (row.law, row.beyond) == (law, beyond):
                return row
        raise NotIdentifiableError(f"no {law} law was fitted", "; ".join(self.refused))


class AxisStudy(Result):
    """Laws of one axis, tested on temperatures that their fits have not seen."""

    name: Annotated[str, "Name of the axis."]
    study: Annotated[Study, "The test."]
    gain: Annotated[Number, "RMS, exponential law over constant; None without it. [-]"]
    shuffles: Annotated[int, "How often the temperatures were shuffled between the runs."]
    median_gain: Annotated[Number, "The same ratio then: its median. [-]"]
    least_gain: Annotated[Number, "Its least value. [-]"]


class FrictionStudyReport(Result, name="friction_study"):
    """Friction at temperatures that were not seen."""

    studies: Annotated[tuple[AxisStudy, ...], "One per axis."]


def axis_study(data: FrictionData, train: Span, test: Span, shuffles: int = SHUFFLES) -> AxisStudy:
    """Return the test of one axis, and what remains of the gain with temperatures shuffled."""
    study = temperature_split(data, train, test)
    chance: list[float] = []
    for seed in range(shuffles):
        with suppress(NotIdentifiableError):
            chance.append(_gain(temperature_split(shuffled(data, seed), train, test)))
    known = (float(np.median(chance)), float(np.min(chance))) if chance else (None, None)
    gain = None
    with suppress(NotIdentifiableError):
        gain = _gain(study)
    return AxisStudy(data.name, study, gain, len(chance), *known)


def _gain(study: Study) -> float:
    """RMS of the exponential law over that of the constant."""
    return study.row("exponential", "extend").rms / study.row("constant").rms


def temperature_split(data: FrictionData, train: Span, test: Span) -> Study:
    """Return the errors of every law, fitted at some temperatures and tested at others."""
    moving = moving_samples(data)
    degc = moving.motor_temperature_degc
    fitted = moving[(degc >= train.low) & (degc <= train.high)]
    unseen = moving[(degc >= test.low) & (degc <= test.high)]
    for part, span in ((fitted, train), (unseen, test)):
        if len(part) < 100:
            raise NotIdentifiableError(
                f"{data.name} moves in {len(part)} samples at {span}", "at least 100"
            )
    rows: list[FrictionStudyRow] = []
    refused: list[str] = []
    for name in fitted_laws():
        try:
            law, fit = fit_law(name, fitted)
        except NotIdentifiableError as error:
            if not FRICTION_LAWS[name].follows_temperature:
                raise
            refused.append(f"{data.name}: no {name} law, because {error.found}")
            continue
        coulomb, speed = float(fit.values[0]), unseen.motor_velocity
        measured = unseen.friction_torque - nuisance(fit, unseen)
        power = float(np.mean(measured * speed))
        for beyond in get_args(Outside) if FRICTION_LAWS[name].beyond_range else ("hold",):
            curve = viscous_law(law.model_copy(update={"outside": beyond}))
            viscous = curve.viscous(unseen.motor_temperature_degc)
            torque = coulomb * unseen.sign + viscous * speed
            bias = float(np.mean(torque * speed)) / power - 1.0
            error = rms_of(torque - measured)
            rows.append(FrictionStudyRow(name, beyond, error, bias, coulomb, law))
    return Study(train, test, len(fitted), len(unseen), tuple(rows), tuple(refused))


def shuffled(data: FrictionData, seed: int) -> FrictionData:
    """Return the samples with temperatures of other runs, drawn at random."""
    runs = np.unique(data.run)
    order = np.random.default_rng(seed).permutation(runs)
    degc = data.motor_temperature_degc.copy()
    for run, other in zip(runs, order, strict=True):
        rows, source = (
            np.flatnonzero(data.run == run),
            data.motor_temperature_degc[data.run == other],
        )
        degc[rows] = source[np.arange(len(rows)) * len(source) // len(rows)]
    return replace(data, motor_temperature_degc=degc)
