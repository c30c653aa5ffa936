"""How good a model is on recordings: torque, shaft energy, power and energy at the meter."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from robot_energy.certainty.prediction_errors import PowerErrorSums
from robot_energy.model import RobotModel
from robot_energy.results.base import ModelUsed, Number, Result, Texts, tagged_entries
from robot_energy.results.replay import JointShaft, ReplayReport
from robot_energy.timeline.blocks import Float
from robot_energy_identify.stats.torque_errors import LowPassTorqueError, TorqueErrorSums

Seen = Literal["held_out", "fitted", "unknown"]
MODEL, FIXED, ZERO = "model", "fixed_friction", "zero"


class JointScore(Result):
    """Errors at one motor, predicted minus measured; None where torque was not measured."""

    name: Annotated[str, "Name of the joint, or ``all joints`` for the row of all."]
    samples: Annotated[int, "Number of samples that count."]
    moving_samples: Annotated[int, "Number of these in which the joint moved."]
    torque_rms: Annotated[Number, "RMS error of the motor torque; None for all joints. [N m]"]
    torque_rms_moving: Annotated[Number, "The same while the joint moved. [N m]"]
    torque_relative: Annotated[Number, "Norm of the error over that of the measured torque. [-]"]
    torque_relative_moving: Annotated[Number, "The same while the joint moved. [-]"]
    torque_relative_low_pass: Annotated[
        Number,
        "The same of the joint torque, both sides below 10 Hz, as identification states it. [-]",
    ]
    shaft_energy_error: Annotated[Number, "Error of the shaft energy. [J]"]
    shaft_energy_relative: Annotated[
        Number, "The same over the measured energy that went either way. [-]"
    ]


class ModelScore(Result):
    """Errors of one prediction."""

    name: Annotated[
        str,
        "``model``; ``fixed_friction``, the same with friction at one temperature; or ``zero``, "
        "which predicts no torque and no power.",
    ]
    change: Annotated[str | None, "What was changed about the model."]
    joints: Annotated[tuple[JointScore, ...], "In model order; empty where no torque was measured."]
    all_joints: Annotated[
        JointScore | None, "All of them together; None where no torque was measured."
    ]
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
        "``held_out`` if no figure of the model was identified from it, ``fitted`` if some were, "
        "``unknown`` if the model does not say what its figures come from.",
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
        Number,
        "Half width of the 90 % band of the predicted energy at the meter, over that energy, from "
        "the figures of the model. [-]",
    ]
    band_inside: Annotated[
        Number, "Share of the readings of the meter within the band of power. [-]"
    ]
    scores: Annotated[
        tuple[ModelScore, ...], "Of the model, of fixed friction if that differs, and of zero."
    ]
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
        "The scores over all recordings: sums of energies, RMS over all samples.",
    ]


@dataclass
class ScoreSums:
    """Sums behind the score of one prediction, of one recording or of several.

    Attributes:
        power: Errors of the power at the meter.
        low_pass: Errors of the torque below 10 Hz.
        shaft: Measured out, measured back, predicted out, predicted back, shape (4, n). [J]
        measured: Energy at the meter; NaN without one. [J]
        predicted: The same, predicted. [J]
    """

    names: Sequence[str]
    torque: TorqueErrorSums
    power: PowerErrorSums
    low_pass: LowPassTorqueError
    change: str | None = None
    shaft: Float = field(default_factory=lambda: np.full((4, 0), np.nan))
    measured: float = float("nan")
    predicted: float = float("nan")

    @classmethod
    def of(
        cls,
        report: ReplayReport,
        torque: TorqueErrorSums,
        power: PowerErrorSums,
        low_pass: LowPassTorqueError,
    ) -> "ScoreSums":
        """Return the sums of a replay."""
        joints = report.shaft.joints if report.shaft is not None else ()
        rows = [_parts(joint) for joint in joints] or [[np.nan] * 4] * len(report.joints)
        meter = report.comparison
        return cls(
            [joint.name for joint in report.joints],
            torque,
            power,
            low_pass,
            report.model.change,
            np.array(rows).T,
            _number(meter.measured_energy),
            _number(meter.predicted_energy_at_meter),
        )

    def plus(self, other: "ScoreSums") -> "ScoreSums":
        """Return the sums of both; what only one of them has counts alone."""
        self.torque.add(other.torque)
        self.power.add(other.power)
        self.low_pass.add(other.low_pass)
        measured, predicted = (
            float(_sum(np.array([getattr(self, name), getattr(other, name)])))
            for name in ("measured", "predicted")
        )
        shaft = _sum(np.stack([self.shaft, other.shaft]))
        return replace(self, shaft=shaft, measured=measured, predicted=predicted)

    def score(self, name: str) -> ModelScore:
        """Return the errors."""
        torque, low = self.torque, self.low_pass
        below = np.append(low.relative, low.relative_of_all)
        return self._score(
            name, self.change, torque.rms, torque.relative, torque.relative_of_all, below
        )

    def zero(self) -> ModelScore:
        """Return the errors of a prediction of no torque and no power."""
        torque = self.torque
        known = torque.measured_rms > 0
        empty = replace(
            self,
            shaft=np.where([[True], [True], [False], [False]], self.shaft, 0.0 * self.shaft),
            predicted=0.0 * self.measured,
        )
        one = np.where(known, 1.0, np.nan)
        of_all = np.where(known.any(axis=1), 1.0, np.nan)
        below = np.append(self.low_pass.relative, self.low_pass.relative_of_all)
        below = np.where(np.isfinite(below), 1.0, np.nan)
        found = empty._score(ZERO, "no torque, no power", torque.measured_rms, one, of_all, below)
        return replace(found, power_error_rms=self.power.measured_rms)

    def _score(
        self,
        name: str,
        change: str | None,
        rms: Float,
        relative: Float,
        of_all: Float,
        low_pass: Float,
    ) -> ModelScore:
        samples = self.torque.samples
        out, back, predicted_out, predicted_back = self.shaft
        error, turnover = predicted_out - predicted_back - (out - back), out + back
        rows = [
            JointScore(
                joint, int(samples[0, j]), int(samples[1, j]), float(rms[0, j]), float(rms[1, j]),
                float(relative[0, j]), float(relative[1, j]),
                float(low_pass[j]), float(error[j]),
                _ratio(float(error[j]), float(turnover[j])),
            )
            for j, joint in enumerate(self.names)
        ]  # fmt: skip
        total, counted = float(_sum(error)), samples.sum(axis=1)
        whole = JointScore(
            "all joints", int(counted[0]), int(counted[1]), None, None, float(of_all[0]),
            float(of_all[1]), float(low_pass[-1]), total, _ratio(total, float(_sum(turnover))),
        )  # fmt: skip
        known = bool(counted[0])
        off = self.predicted - self.measured
        return ModelScore(
            name,
            change,
            tuple(rows) if known else (),
            whole if known else None,
            self.predicted,
            off,
            _ratio(off, self.measured),
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


def _parts(joint: JointShaft) -> list[float]:
    return [
        _number(getattr(joint, f"shaft_energy_{side}_{kind}"))
        for kind in ("measured", "compared")
        for side in ("positive", "negative")
    ]


def _number(value: Number) -> float:
    return float("nan") if value is None else value


def _sum(values: Float) -> Float:
    """Sum along the first axis of what is known; NaN where nothing is."""
    known = np.isfinite(values)
    return np.where(known.any(axis=0), np.where(known, values, 0.0).sum(axis=0), np.nan)


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole > 0 else float("nan")
