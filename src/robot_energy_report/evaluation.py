"""How good a model is on recordings: torque, shaft energy, power and energy at the meter."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from robot_energy_identify.results.evaluation import (
    FIXED,
    MODEL,
    ZERO,
    EvaluationReport,
    ModelScore,
    RecordingScore,
)
from robot_energy_report.document import Column, Document
from robot_energy_report.formats import (
    aligned,
    energy_text,
    fixed,
    percent,
    plus_minus,
    signed_percent,
    significant,
    tags_text,
)
from robot_energy_report.headline import LOCATION_NAMES

SEEN = {"held_out": "held out", "fitted": "used in the fit", "unknown": "not known"}
SIDES = {
    "motor_torque": "the motor torque that the driver reports x "
    "(1 - torque_constant_fall (T - 20))",
    "motor_current": "reported current x torque_constant of the model file x "
    "(1 - torque_constant_fall (T - 20))",
    "joint_torque": "reported joint torque through the gears",
}


def evaluation_document(report: EvaluationReport, page: Document) -> None:
    """Add all errors, the whole first."""
    model = report.model
    page.paragraph(verdict(report), "strong")
    page.paragraph(_seen(report))
    for one in report.recordings:
        for problem in one.problems:
            page.paragraph(f"{one.recording}: {problem}", "problem")
        page.notes([f"{one.recording}: {note}" for note in one.notes])
    page.paragraph()
    page.pairs(
        [
            ("model", f"{model.robot}, id {model.model_id}"),
            ("model file", model.source),
            ("its figures", tags_text(model.figures)),
        ]
    )
    _section(page, "Recordings")
    _recordings(report, page)
    metered = [one for one in report.recordings if one.measured_energy is not None]
    if metered:
        _section(page, "Energy and power at the meter")
        _meter(metered, report, page)
    if report.together[0].all_joints is not None:
        _section(page, "Torque and shaft energy")
        _torque(report, page)


def _section(page: Document, title: str) -> None:
    """A heading for pages; the tables of a terminal have titles enough."""
    with page.only("page"):
        page.heading(title)


def verdict(report: EvaluationReport) -> str:
    """Return the errors of the model over all recordings in one line."""
    parts = [_brief(report.together[0])]
    fixed_ = _named(report.together, FIXED)
    if fixed_ is not None:
        parts.append(f"with {fixed_.change}: {_brief(fixed_)}")
    return "; ".join(parts)


def _brief(score: ModelScore) -> str:
    parts: list[str] = []
    if score.energy_relative is not None and score.power_error_rms is not None:
        parts.append(
            f"energy at the meter {signed_percent(score.energy_relative)}, power "
            f"{significant(3)(score.power_error_rms)} W RMS"
        )
    whole = score.all_joints
    if whole is not None:
        parts.append(f"motor torque {percent(whole.torque_relative_moving)} off while moving")
        if whole.torque_relative_low_pass is not None:
            parts.append(f"{percent(whole.torque_relative_low_pass)} below 10 Hz")
    return ", ".join(parts)


def _seen(report: EvaluationReport) -> str:
    names: dict[str, list[str]] = {}
    for one in sorted(report.recordings, key=lambda one: [*SEEN].index(one.seen)):
        names.setdefault(one.seen, []).append(one.recording)
    match [*names]:
        case ["held_out"]:
            return "held out: no figure of the model was identified from these recordings"
        case ["fitted"]:
            return "not held out: figures of the model were identified from these recordings"
        case _:
            return "; ".join(f"{SEEN[kind]}: {', '.join(own)}" for kind, own in names.items())


def _recordings(report: EvaluationReport, page: Document) -> None:
    page.rows(
        "",
        [
            Column("", "recording"),
            Column("sha256", "sha256"),
            Column("predicted", "observed_time", fixed(1), "s"),
            Column("motors", _degc, unit="degC"),
            Column("figures are", lambda one: SEEN[one.seen]),
            Column("why", "reason"),
        ],
        report.recordings,
    )


def _degc(one: RecordingScore) -> str | None:
    if one.lowest_degc is None or one.highest_degc is None:
        return None
    return f"{one.lowest_degc:.0f} to {one.highest_degc:.0f}"


def _meter(metered: Sequence[RecordingScore], report: EvaluationReport, page: Document) -> None:
    places = {LOCATION_NAMES.get(one.meter_location or "", "the meter") for one in metered}
    place = places.pop() if len(places) == 1 else "the meter"
    labels = _labels(report.together)

    def errors(name: str) -> list[float | None]:
        return [_of(one, name, "energy_relative") for one in metered]

    page.rows(
        f"Energy at {place}, predicted minus measured",
        [
            Column("", "recording"),
            Column("compared", "compared_time", fixed(1), "s"),
            Column("measured", "measured_energy", energy_text),
            *(
                Column(
                    label,
                    lambda one, name=name: _of(one, name, "energy_relative"),
                    signed_percent,
                    total=lambda _, name=name: percent(
                        float(np.abs(np.array(errors(name), dtype=np.float64)).mean())
                    ),
                )
                for name, label in labels.items()
                if name != ZERO
            ),
            Column("90 % band", "band_relative", plus_minus),
        ],
        metered,
        "mean size" if len(metered) > 1 else "",
    )
    watt = aligned([_of(one, name, "power_error_rms") for one in metered for name in labels], 4)
    page.rows(
        f"Power at {place} from reading to reading, RMS error [W]",
        [
            Column("", "recording"),
            *(
                Column(label, lambda one, name=name: _of(one, name, "power_error_rms"), watt)
                for name, label in labels.items()
            ),
            Column("readings\nin the band", "band_inside", percent),
        ],
        metered,
    )


def _torque(report: EvaluationReport, page: Document) -> None:
    labels = _labels(report.together)
    joints = report.together[0].joints

    def of(name: str, value: str, place: int) -> float | None:
        score = _named(report.together, name)
        if score is None or score.all_joints is None:
            return None
        return getattr((*score.joints, score.all_joints)[place], value)

    def table(title: str, value: str, form: Callable[[float | None], str], total: bool) -> None:
        names = [joint.name for joint in joints]
        page.rows(
            title,
            [
                Column("", names.__getitem__),
                *(
                    Column(
                        label,
                        lambda place, name=name: of(name, value, place),
                        form,
                        total=lambda _, name=name: of(name, value, len(joints)),
                    )
                    for name, label in labels.items()
                    if name != ZERO or form is not percent
                ),
            ],
            range(len(joints)),
            "all joints" if total else "",
        )

    page.paragraph(f"Measured torque: {SIDES.get(report.effort, report.effort)}.")
    for what, suffix in (("while the joint moves", "_moving"), ("all samples", "")):
        rms, share = f"torque_rms{suffix}", f"torque_relative{suffix}"
        values = [of(name, rms, place) for name in labels for place in range(len(joints))]
        title = f"Motor torque, RMS error, {what} [N m]"
        table(title, rms, aligned(values, 4), total=False)
        table(f"The same over the measured torque, {what}", share, percent, total=True)
    table(
        "Joint torque below 10 Hz, as identify states it: error over the measured torque",
        "torque_relative_low_pass",
        percent,
        total=True,
    )
    shaft = "Shaft energy, predicted minus measured, over measured out + back"
    table(shaft, "shaft_energy_relative", signed_percent, total=True)
    samples = report.together[0].all_joints
    if samples is not None:
        page.paragraph(
            f"{samples.samples} torques of {len(joints)} joints, {samples.moving_samples} of them "
            "in motion. At rest friction is anything up to its Coulomb value, which no model "
            "predicts."
        )


def _labels(scores: Sequence[ModelScore]) -> dict[str, str]:
    names = {MODEL: "model", ZERO: "zero"}
    return {one.name: names.get(one.name) or (one.change or "fixed") for one in scores}


def _named(scores: Sequence[ModelScore], name: str) -> ModelScore | None:
    return next((one for one in scores if one.name == name), None)


def _of(one: RecordingScore, name: str, what: str) -> float | None:
    return getattr(one.score(name), what, None)
