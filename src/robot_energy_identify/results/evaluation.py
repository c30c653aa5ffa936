"""How good a model is on recordings: torque, shaft energy, power and energy at the meter.

Identification passes both sides of its equation through one low-pass without delay, so the noise
of accelerations and of torque sensors counts on neither. The monitor has no such filter. Both
errors are of use; only figures behind the same filter F can be compared:

    e = |F (tau_predicted - tau_measured)| / |F tau_measured|, joint side, rows in motion

F and the rows are those of `robot_energy_identify.data.observations`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from robot_energy.certainty.prediction_errors import PowerErrorSums
from robot_energy.model import RobotModel
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.results.base import ModelUsed, Number, Result, Texts, tagged_entries
from robot_energy.results.replay import ReplayReport
from robot_energy.timeline.blocks import DOUBTFUL, NANOSECOND, Float, Int, PowerBlock
from robot_energy_identify.data.observations import Filters, usable
from robot_energy_plan.motion.sampled_motion import low_pass, uniform

PIECE = 60.0  # filtered at once, so that memory does not grow [s]
MIN_LENGTH = 1.0  # of a piece [s]
MAX_STEP = 0.1  # between samples of one stretch [s]


class TorqueErrorSums:
    """Error of the motor torque of each joint, over all samples and while the joint moves.

    A sample counts for a joint where its torque was measured and its acceleration comes from
    a full window. At rest friction is anything up to its Coulomb value, which no model can
    predict; therefore the moving samples count once more for themselves.

    Attributes:
        samples: How many counted, all and moving, shape (2, n).
        squares: Of error and of measured torque: over all samples, while moving, and joint side
            behind the low-pass while moving; shape (2, 3, n). [(N m)^2]
    """

    def __init__(self, model: RobotModel) -> None:
        self._filters = Filters()
        self._drivetrain = Drivetrain.from_model(model)
        self._standstill = np.array([joint.standstill_velocity for joint in model.joints])
        count = len(model.joints)
        self.samples: Int = np.zeros((2, count), dtype=np.int64)
        self.squares: Float = np.zeros((2, 3, count))
        self._stamp_ns = np.zeros(0, dtype=np.int64)
        self._waiting = np.zeros((0, 3, count))  # predicted, measured, velocity; joint side

    def step(self, block: PowerBlock) -> None:
        measured, sound = block.motor_torque_measured, (block.quality & np.uint32(DOUBTFUL)) == 0
        error = block.motor_torque - measured
        known = np.isfinite(error) & sound[:, None]
        speed = self._drivetrain.joint_velocity_from_motor(block.motor_velocity)
        for place, rows in enumerate((known, known & (np.abs(speed) > self._standstill))):
            self.samples[place] += rows.sum(axis=0)
            self._add(place, rows, error, measured)
        kept = known.all(axis=1)
        if not kept.any():
            return
        torque = np.stack([block.motor_torque[kept], measured[kept]], axis=1)
        joint = torque @ self._drivetrain.transmission
        fresh = np.concatenate([joint, speed[kept][:, None]], axis=1)
        self._stamp_ns = np.concatenate([self._stamp_ns, block.stamp_ns[kept]])
        self._waiting = np.concatenate([self._waiting, fresh])
        cuts = np.flatnonzero(np.diff(self._stamp_ns) > MAX_STEP / NANOSECOND) + 1
        for cut in np.diff(cuts, prepend=0).tolist():
            self._filter(cut)
        stamp = self._stamp_ns
        if len(stamp) and (stamp[-1] - stamp[0]) * NANOSECOND >= PIECE:
            self.finish()

    def finish(self) -> None:
        """Take what waits for the low-pass, as at the end of a recording."""
        self._filter(len(self._stamp_ns))

    def add(self, other: TorqueErrorSums) -> None:
        """Take all samples of another recording, which has ended."""
        self.samples += other.samples
        self.squares += other.squares

    @property
    def of_nothing(self) -> TorqueErrorSums:
        """The errors of a prediction of 0 N m."""
        found = copy(self)
        found.squares = self.squares[[1, 1]]
        return found

    @property
    def rms(self) -> Float:
        """Of predicted minus measured torque, all and moving, shape (2, n). [N m]"""
        count = np.where(self.samples > 0, self.samples, 1)
        return np.where(self.samples > 0, np.sqrt(self.squares[0, :2] / count), np.nan)

    @property
    def relative(self) -> Float:
        """Norm of the error over that of the measured torque, as of `squares`, shape (3, n). [-]"""
        return _roots(*self.squares)

    @property
    def relative_of_all(self) -> Float:
        """The same of all joints together, shape (3,). [-]"""
        return _roots(*self.squares.sum(axis=2))

    def _add(self, place: int, rows: NDArray[np.bool_], error: Float, measured: Float) -> None:
        for part, values in enumerate((error, measured)):
            self.squares[part, place] += (np.where(rows, values, 0.0) ** 2).sum(axis=0)

    def _filter(self, count: int) -> None:
        """Add the first rows that wait, behind the low-pass, and forget them."""
        stamp, values = self._stamp_ns[:count], self._waiting[:count]
        self._stamp_ns, self._waiting = self._stamp_ns[count:], self._waiting[count:]
        if count < 2 or (stamp[-1] - stamp[0]) * NANOSECOND < MIN_LENGTH:
            return
        rate = float(1.0 / (np.median(np.diff(stamp)) * NANOSECOND))
        if self._filters.cutoff >= 0.5 * rate:
            return
        even = uniform(stamp, values.reshape(count, -1), rate).reshape(-1, *values.shape[1:])
        predicted, measured = low_pass(even[:, :2], rate, self._filters.cutoff).swapaxes(0, 1)
        used, _ = usable(even[:, 2], rate, self._drivetrain.transmission, self._filters)
        self._add(2, used, predicted - measured, measured)


def _roots(error: Float, measured: Float) -> Float:
    known = measured > 0
    return np.where(known, np.sqrt(error / np.where(known, measured, 1.0)), np.nan)


Seen = Literal["held_out", "fitted", "unknown"]
MODEL, FIXED, ZERO = "model", "fixed_friction", "zero"
SHAFT = [
    f"shaft_energy_{side}_{kind}"
    for kind in ("measured", "compared")
    for side in ("positive", "negative")
]


class JointScore(Result):
    """Errors at one motor, predicted minus measured; None where torque was not measured."""

    name: Annotated[str, "Name of the joint, or ``all joints`` for the row of all."]
    samples: Annotated[int, "Number of samples that count."]
    moving_samples: Annotated[int, "Number of these in which the joint moved."]
    torque_rms: Annotated[Number, "RMS error of the motor torque; None for all joints. [N m]"]
    torque_rms_moving: Annotated[Number, "The same while the joint moved. [N m]"]
    torque_relative: Annotated[Number, "Norm of the error over that of the measured torque. [-]"]
    torque_relative_moving: Annotated[Number, "The same while the joint moved. [-]"]
    torque_relative_low_pass: Annotated[Number, "The same below 10 Hz, as of identification. [-]"]
    shaft_energy_error: Annotated[Number, "Error of the shaft energy. [J]"]
    shaft_energy_relative: Annotated[Number, "The same over the measured energy either way. [-]"]


class ModelScore(Result):
    """Errors of one prediction."""

    name: Annotated[
        str, "``model``, ``fixed_friction`` (at one temperature) or ``zero`` (no torque, no power)."
    ]
    change: Annotated[str | None, "What was changed about the model."]
    joints: Annotated[tuple[JointScore, ...], "In model order; empty where no torque was measured."]
    all_joints: Annotated[JointScore | None, "All together; None where no torque was measured."]
    predicted_energy: Annotated[Number, "Predicted energy at the meter over the compared time. [J]"]
    energy_error: Annotated[Number, "Predicted minus measured. [J]"]
    energy_relative: Annotated[Number, "The same over the measured energy. [-]"]
    power_error_rms: Annotated[Number, "RMS error of the mean power from reading to reading. [W]"]


class RecordingScore(Result):
    """The predictions on one recording."""

    recording: Annotated[str, "Its name."]
    sha256: Annotated[str, "First digits of the hash of its messages."]
    seen: Annotated[
        Seen,
        "``held_out``, ``fitted`` (figures are from it), ``unknown`` (the model does not say).",
    ]
    reason: Annotated[str, "Why, in one sentence."]
    origin: Annotated[str | None, "Where the recording comes from, as its writer said."]
    observed_time: Annotated[float, "Time that is predicted. [s]"]
    lowest_degc: Annotated[Number, "Lowest of all motor temperatures; None without any. [degC]"]
    highest_degc: Annotated[Number, "Highest of all motor temperatures. [degC]"]
    meter_location: Annotated[str | None, "``grid`` or ``dc_bus``; None without a meter."]
    compared_time: Annotated[float, "Time that prediction and meter cover. [s]"]
    measured_energy: Annotated[Number, "Measured energy at the meter over that time. [J]"]
    band_relative: Annotated[
        Number, "Half width of the 90 % band of energy, over it, by the figures of the model. [-]"
    ]
    band_inside: Annotated[
        Number, "Share of readings within the band of power, by the figures of the model. [-]"
    ]
    scores: Annotated[tuple[ModelScore, ...], "Of the model, of fixed friction if other, of zero."]
    problems: Annotated[Texts, "What makes the figures doubtful, one sentence each."]
    notes: Annotated[Texts, "What a reader should know, one sentence each."]

    def score(self, name: str) -> ModelScore | None:
        """Return one of the scores; None if there is none of this name."""
        return next((one for one in self.scores if one.name == name), None)


class EvaluationReport(Result, name="test"):
    """How good a model is on recordings."""

    model: Annotated[ModelUsed, "The model."]
    effort: Annotated[str, "What the effort in the joint states was taken for."]
    recordings: Annotated[tuple[RecordingScore, ...], "Scores of each recording."]
    together: Annotated[
        tuple[ModelScore, ...],
        "Scores over all recordings: sums of energies, RMS over all samples.",
    ]


@dataclass
class ScoreSums:
    """Sums behind the score of one prediction, of one recording or of several.

    Attributes:
        power: Errors of the power at the meter.
        shaft: Measured out, measured back, predicted out, predicted back, shape (4, n). [J]
        energy: Measured at the meter, NaN without one, and predicted, shape (2,). [J]
    """

    names: Sequence[str]
    torque: TorqueErrorSums
    power: PowerErrorSums
    change: str | None
    shaft: Float
    energy: Float

    @classmethod
    def of(cls, report: ReplayReport, torque: TorqueErrorSums, power: PowerErrorSums) -> ScoreSums:
        joints = report.shaft.joints if report.shaft is not None else ()
        parts = [[getattr(joint, name) for name in SHAFT] for joint in joints]
        meter = report.comparison
        return cls(
            [joint.name for joint in report.joints],
            torque,
            power,
            report.model.change,
            np.array(parts or [[np.nan] * 4] * len(report.joints), dtype=np.float64).T,
            np.array([meter.measured_energy, meter.predicted_energy_at_meter], dtype=np.float64),
        )

    def plus(self, other: ScoreSums) -> ScoreSums:
        """Return the sums of both; what only one of them has counts alone."""
        self.torque.add(other.torque)
        self.power.add(other.power)
        shaft, energy = _sum([self.shaft, other.shaft]), _sum([self.energy, other.energy])
        return replace(self, shaft=shaft, energy=energy)

    def zero(self) -> ModelScore:
        """Return the errors of a prediction of no torque and no power."""
        found = replace(
            self,
            torque=self.torque.of_nothing,
            change="no torque, no power",
            shaft=self.shaft * [[1.0], [1.0], [0.0], [0.0]],
            energy=self.energy[0] * np.array([1.0, 0.0]),
        ).score(ZERO)
        return replace(found, power_error_rms=self.power.measured_rms)

    def score(self, name: str) -> ModelScore:
        """Return the errors."""
        torque, samples = self.torque, self.torque.samples
        out, back, predicted_out, predicted_back = self.shaft
        error, turnover = predicted_out - predicted_back - (out - back), out + back
        columns = zip(
            self.names, *samples.tolist(), *torque.rms.tolist(), *torque.relative.tolist(),
            error.tolist(), map(_ratio, error.tolist(), turnover.tolist()), strict=True,
        )  # fmt: skip
        counted, total = samples.sum(axis=1).tolist(), float(_sum(error))
        whole: list[Any] = ["all joints", *counted, None, None, *torque.relative_of_all.tolist()]
        whole += [total, _ratio(total, float(_sum(turnover)))]
        known = counted[0] > 0
        measured, predicted = self.energy.tolist()
        return ModelScore(
            name,
            self.change,
            tuple(JointScore(*row) for row in columns) if known else (),
            JointScore(*whole) if known else None,
            predicted,
            predicted - measured,
            _ratio(predicted - measured, measured),
            self.power.rms,
        )


def seen_in_fit(model: RobotModel, name: str, sha256: str) -> tuple[Seen, str]:
    """Return whether figures of a model were identified from a recording, and why that is said."""
    bags = model.provenance.bags
    if any(f"sha256:{sha256}" in entry for entry in bags):
        return "fitted", "the model's provenance has the hash of this recording"
    entries = tagged_entries(model.model_dump(exclude_none=True))
    sources = [str(one.get("source", "")) for one in entries if one["tag"] == "identified"]
    if not sources and not bags:
        return "held_out", "no figure of the model was identified from a recording"
    stem = re.escape(Path(name).name)
    if any(re.search(rf"(?<![\w.-]){stem}(?![\w-])", text) for text in (*sources, *bags)):
        same = [entry for entry in bags if entry.startswith(f"{Path(name).name} sha256:")]
        if not same:
            return "fitted", "figures of the model name a recording of this name as their source"
    if bags and all("sha256:" in entry for entry in bags):
        return "held_out", "the model's provenance lists other recordings"
    return "unknown", "the model does not list the hashes of all recordings that it was made from"


def _sum(values: Sequence[Float] | Float) -> Float:
    """Sum along the first axis of what is known; NaN where nothing is."""
    known = np.isfinite(values)
    return np.where(known.any(axis=0), np.where(known, values, 0.0).sum(axis=0), np.nan)


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole > 0 else float("nan")
