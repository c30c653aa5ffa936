"""Energy error of a model on recordings that it was not made from.

Whole recordings are held out, one group after the other, and everything is identified
again from the rest; recordings named for the test are used instead, and a single recording
is cut into contiguous blocks. Each step's model is run as the monitor runs it and compared
with the meter, over the time that both cover. Energies of the recordings that a model was
made from are never given: a fit makes them small by construction.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.certainty.prediction_errors import PowerErrorSums
from robot_energy.foundation.described import Described
from robot_energy.timeline.blocks import NANOSECOND, Float, Int, MeterLocation
from robot_energy.timeline.pieces import Compared
from robot_energy_identify.data.bags import (
    EVER,
    Bag,
    Fold,
    HeldOutKind,
    Span,
    read_all,
    temperature_ranges,
)
from robot_energy_identify.data.recordings import Recording
from robot_energy_identify.run_all import FullIdentification, identify_everything
from robot_energy_identify.stats.cross_validation import relative_error
from robot_energy_identify.steps import Subject

SHOWN = 10.0  # s of torque kept for a figure
OUTSIDE = 5.0  # K beyond the temperatures of the fit: friction is then that of the edge
GIVEN = "given"


class HeldOutPrediction(Described):
    """A model on one held-out recording."""

    compared: Annotated[
        tuple[Compared, ...], "Predicted and measured energy, in the order of time."
    ] = field(repr=False)
    energy: Annotated[float, "Predicted, where it was compared. [J]"]
    rms: Annotated[float, "Of predicted minus measured power, per reading. [W]"]
    shaft: Annotated[float, "Shaft energy of all axes from the model's torque. [J]"]
    torque_error: Annotated[
        float, "Norm of the motor torque error over that measured, at the shaft; NaN without. [-]"
    ]
    motor_torque: Annotated[Float, "Of the stretch that is shown, shape (K, n). [N m]"] = field(
        repr=False
    )


class OutsideFit(Described):
    """The joint of a held-out recording whose motor was farthest outside the fit."""

    joint: Annotated[str, "Its name."]
    met: Annotated[tuple[float, float], "Lowest and highest temperature in the recording. [degC]"]
    fitted: Annotated[tuple[float, float], "The same in the recordings of the fit. [degC]"]


class Tested(Described):
    """One held-out recording."""

    name: Annotated[str, "Of the recording, or of the block."]
    duration: Annotated[float, "Time that was compared with the meter. [s]"]
    measured: Annotated[float, "Energy that the meter saw in it; NaN without a meter. [J]"]
    shaft: Annotated[
        float,
        "Measured shaft energy of all axes, torque constants as in the last model; NaN without "
        "measured torque. [J]",
    ]
    shaft_either_way: Annotated[
        float, "What the motors gave and what they took back, added, by the same torque. [J]"
    ]
    predictions: Annotated[dict[str, HeldOutPrediction], "By ``given`` or subject, after its step."]
    start_ns: Annotated[int, "Of the recording. [ns]"]
    location: Annotated[MeterLocation | None, "Where the meter sits; None without one."]
    time: Annotated[Float, "Of the stretch that is shown, since the start, shape (K,). [s]"] = (
        field(repr=False)
    )
    motor_torque: Annotated[Float, "Measured in it, likewise, shape (K, n). [N m]"] = field(
        repr=False
    )
    taken: Annotated[tuple[Subject, ...], "Subjects of which this test's model has new figures."]
    beyond: Annotated[float, "How far a motor was outside of the fit, at most. [K]"]
    outside: Annotated[OutsideFit | None, "The joint that was it most; None if none was."] = None

    def error(self, stage: str) -> float:
        """Return predicted over measured energy minus 1; NaN without a meter."""
        return self.predictions[stage].energy / self.measured - 1.0

    def shaft_error(self, stage: str) -> float:
        """Return the error of shaft energy over that measured either way, NaN without torque.

        What bodies give back hardly counts in their sum, which may be near zero.
        """
        return (self.predictions[stage].shaft - self.shaft) / self.shaft_either_way


class HeldOutEnergy(Described):
    """The test of the whole."""

    kind: Annotated[HeldOutKind, "How data were held out."]
    stages: Annotated[tuple[str, ...], "``given``, then the subjects in the order of the steps."]
    tested: Annotated[tuple[Tested, ...], "One entry per held-out recording or block."]

    @property
    def metered(self) -> tuple[Tested, ...]:
        """Those that can be compared with a meter."""
        return tuple(entry for entry in self.tested if entry.measured > 0.0)

    @property
    def with_torque(self) -> tuple[Tested, ...]:
        """Those with measured shaft energy."""
        return tuple(entry for entry in self.tested if entry.shaft_either_way > 0.0)

    @property
    def within(self) -> tuple[Tested, ...]:
        """Those of `metered` at temperatures of their fit."""
        return tuple(entry for entry in self.metered if entry.beyond <= OUTSIDE)

    @property
    def beyond(self) -> tuple[Tested, ...]:
        """Those of `metered` at temperatures that their fit has not seen."""
        return tuple(entry for entry in self.metered if entry.beyond > OUTSIDE)

    def mean_error(self, stage: str, entries: Sequence[Tested] | None = None) -> float:
        """Return the mean size of the energy error at the meter, of some recordings or of all."""
        chosen = self.metered if entries is None else entries
        return float(np.mean([abs(entry.error(stage)) for entry in chosen]))

    @property
    def worst(self) -> Tested | None:
        """The recording of those `judged` with the greatest energy error of the final model."""
        last = self.stages[-1]
        return max(self.judged, key=lambda entry: abs(entry.error(last)), default=None)

    def mean_rms(self, stage: str, entries: Sequence[Tested]) -> float:
        """Return the mean RMS error of power from reading to reading. [W]"""
        return float(np.mean([entry.predictions[stage].rms for entry in entries]))

    def torque_error(self, stage: str) -> float:
        """Return the mean error of the motor torque over its size. [-]"""
        return float(np.mean([part.predictions[stage].torque_error for part in self.with_torque]))

    @property
    def judged(self) -> tuple[Tested, ...]:
        """What the models are judged by: recordings at temperatures of their fit, if any.

        The final model knows the temperatures of all recordings.
        """
        return self.within or self.metered

    @property
    def less_energy_error(self) -> bool:
        """Whether the final model's mean energy error is below that of the model as given."""
        last = self.mean_error(self.stages[-1], self.judged)
        return last < self.mean_error(GIVEN, self.judged)

    @property
    def less_power_error(self) -> bool:
        """The same of the power from reading to reading, which forgives nothing that cancels."""
        last = self.mean_rms(self.stages[-1], self.judged)
        return last < self.mean_rms(GIVEN, self.judged)


def held_out_energy(
    kind: HeldOutKind,
    folds: Sequence[Fold],
    whole: FullIdentification,
    skip: Sequence[Subject] = (),
    progress: Callable[[float], None] = lambda share: None,
) -> HeldOutEnergy:
    """Return the test of the whole; a step that a fold does not allow keeps the model before it.

    Args:
        progress: Called with the share done. [-]
    """
    stages = (GIVEN, *(step.subject for step in whole.steps))
    tested: list[tuple[int, Tested]] = []  # with the place among the bags
    for number, fold in enumerate(folds):
        progress(number / len(folds))
        # every choice is made again without the held-out data
        # a part of the recordings may be too little for a plausible step
        fitted = (
            whole
            if kind == "test"
            else identify_everything(
                fold.train,
                whole.given,
                (*skip, "thermal"),  # of no effect where temperatures are measured
                strict=False,
                share_shape=whole.share_shape,
            )
        )
        seen = temperature_ranges(read_all(fold.train, whole.given))
        tested += [
            (number + place * len(folds), _test(bag, fitted, kind, number, seen))
            for place, bag in enumerate(fold.test)
        ]
    tested.sort(key=lambda entry: entry[0])
    return HeldOutEnergy(kind, stages, tuple(entry for _, entry in tested))


def _test(
    bag: Bag, fitted: FullIdentification, kind: HeldOutKind, number: int, seen: Float
) -> Tested:
    bag = bag.with_meter_undone(fitted.meter_time_constant, fitted.meter_delay)  # the same meter
    models = {GIVEN: fitted.given, **{step.subject: step.model for step in fitted.steps}}
    (span,) = bag.spans
    first, final = bag.whole(fitted.given), bag.whole(fitted.model)
    at_shaft = final.power.motor_torque_measured
    done: dict[int, HeldOutPrediction] = {id(fitted.model): _prediction(final, span)}
    for model in reversed(models.values()):  # the last one is the nearest to what was seen before
        if id(model) not in done:
            done[id(model)] = _prediction(bag.whole(model), span)
    predictions = {stage: done[id(model)] for stage, model in models.items()}
    compared = predictions[GIVEN].compared
    seen_by_meter = float(sum(part.measured.sum() for part in compared))
    shaft, either_way = _shaft(final, at_shaft, span)
    rows, met = _shown(first, span), temperature_ranges([first.between(*span)])
    off = np.maximum(seen[0] - met[0], met[1] - seen[1])
    stamp = first.torque.stamp_ns
    beyond = np.where(np.isfinite(off), off, 0.0)
    worst = int(np.argmax(beyond))
    outside = OutsideFit(
        first.model.joint_names[worst],
        (float(met[0, worst]), float(met[1, worst])),
        (float(seen[0, worst]), float(seen[1, worst])),
    )
    return Tested(
        name=f"{bag.name}, block {number + 1}" if kind == "blocks" else bag.name,
        duration=sum(int(part.duration_ns.sum()) for part in compared) * NANOSECOND,
        measured=seen_by_meter if compared else float("nan"),
        shaft=shaft,
        shaft_either_way=either_way,
        predictions=predictions,
        start_ns=int(stamp[0]),
        location=None if first.meter is None else first.meter.location,
        time=(stamp[rows] - stamp[0]) * NANOSECOND,
        motor_torque=at_shaft[rows],
        taken=fitted.taken,
        beyond=max(0.0, float(beyond[worst])),
        outside=outside if beyond[worst] > 0.0 else None,
    )


def _prediction(recording: Recording, span: Span) -> HeldOutPrediction:
    compared: list[Compared] = []  # readings that lie wholly inside the span
    sums = PowerErrorSums()  # of the mean power between readings, each weighted by its time
    for part in recording.compared:
        inside = (part.stamp_ns - part.duration_ns >= span[0]) & (part.stamp_ns <= span[1])
        if inside.any():
            compared.append(part[inside])
            sums.step(compared[-1])
    rows, predicted = _known_torque(recording, span), recording.power.motor_torque
    measured = recording.power.motor_torque_measured[rows]
    return HeldOutPrediction(
        tuple(compared),
        float(sum(part.drawn.sum() for part in compared)),
        sums.rms,
        _shaft(recording, predicted, span)[0],
        relative_error(predicted[rows] - measured, measured),
        predicted[_shown(recording, span)],
    )


def _shaft(recording: Recording, motor_torque: Float, span: Span) -> tuple[float, float]:
    """Shaft energy of all axes where the torque was measured, and the same either way. [J]

    NaN if it never was.
    """
    block, known = recording.torque, _known_torque(recording, span)
    known[:-1] &= known[1:] & (np.diff(block.segment) == 0)
    known[-1] = False
    if not known.any():
        return float("nan"), float("nan")
    rows = np.flatnonzero(known)
    step = (block.stamp_ns[rows + 1] - block.stamp_ns[rows]) * NANOSECOND
    power = motor_torque * block.motor_velocity
    of_axes = (power.sum(axis=1), np.abs(power).sum(axis=1))
    net, either_way = (float(step @ (one[rows] + one[rows + 1]) / 2.0) for one in of_axes)
    return net, either_way


def _known_torque(recording: Recording, span: Span) -> NDArray[np.bool_]:
    """Samples of a span whose torque was measured and predicted, of every joint."""
    block = recording.torque
    known = np.isfinite(block.motor_torque_measured).all(axis=1) & recording.sound
    known &= np.isfinite(recording.power.motor_torque).all(axis=1)
    return known & (block.stamp_ns >= span[0]) & (block.stamp_ns < span[1])


def _shown(recording: Recording, span: Span) -> Int:
    """Rows in the middle of what was held out."""
    stamp = recording.torque.stamp_ns
    start, end = (int(stamp[0]), int(stamp[-1])) if span == EVER else span
    half = min(round(0.5 * SHOWN / NANOSECOND), (end - start) // 2)
    middle = (start + end) // 2
    return np.flatnonzero((stamp >= middle - half) & (stamp <= middle + half))
