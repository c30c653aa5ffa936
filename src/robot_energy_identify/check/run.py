"""All checks of a recording, in the order in which their causes act."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np

from robot_energy.bag.reader import TimeRange
from robot_energy.foundation.described import Described
from robot_energy.inputs.joint_states.partial_states import SAME_STAMP
from robot_energy.inputs.joint_states.publisher_conflicts import CONFLICTING
from robot_energy.inputs.remedies import NO_REASON, REFUSED
from robot_energy.inputs.sources import Inputs
from robot_energy.model import RobotModel
from robot_energy.pipeline import Settings
from robot_energy.replay.bag_replay import replay
from robot_energy.replay.setup import ReplaySetup
from robot_energy.timeline.blocks import EffortMeaning
from robot_energy_identify.blas_threads import one_thread
from robot_energy_identify.check.evidence import (
    Evidence,
    Remarks,
    Windows,
    evidence_of,
    joined,
    remarks_of,
)
from robot_energy_identify.check.finding import (
    EFFORT,
    ERROR,
    NOTE,
    PARAMETERS,
    SEVERITIES,
    WARNING,
    CheckResult,
    Finding,
)
from robot_energy_identify.check.meter import check_meter
from robot_energy_identify.check.motion import check_motion
from robot_energy_identify.check.torque import check_torque

MIN_RANGE_DEGC = 10.0  # of temperature, for a law of viscous friction
MIN_SPEED_RATIO = 3.0  # of fastest to slowest motion, to separate Coulomb from viscous friction
MIN_MOVING = 10.0  # s of motion of a joint
MIN_REST = 1.0  # s of rest, for the constant losses
MAX_REFUSED = 0.05  # share of the joint states
HOT_DEGC = 110.0  # motors of robots hardly work above; 43 degC in degrees Fahrenheit

Check = Callable[[Evidence], tuple[list[Finding], str]]
SPOILING = (
    "joint_states",
    "degrees",
    "millimetres",
    "velocity_sign",
    "velocity_scale",
    "velocity_zero",
    "velocity_held",
    "velocity_unrelated",
    "velocity_late",
    "velocity_apart",
    "position_held",
    "joint_states_refused",
)  # that spoil all torques, and with them the prediction for the meter
TORQUE, METER = "torque", "power meter"


class Checks(Described):
    """What the checks of a recording found."""

    findings: Annotated[dict[str, list[Finding]], "By name of the check, as causes act."]
    skipped: Annotated[dict[str, str], "Checks that were not made, with what they lack."]

    def result(self, recording: str, model: RobotModel) -> CheckResult:
        named = f"{model.robot.type}, id {model.model_id}"
        found = [one for group in self.findings.values() for one in group]
        found.sort(key=lambda entry: SEVERITIES.index(entry.severity))
        done = [name for name in CHECKS if name not in self.skipped]
        return CheckResult(recording, named, tuple(found), tuple(done), self.skipped)


def check(
    path: str | Path,
    model: RobotModel,
    effort: EffortMeaning = EffortMeaning.NONE,
    inputs: Inputs | None = None,
    time_range: TimeRange | None = None,
) -> CheckResult:
    """Return whether a recording of any length fits a model, and what is wrong, errors first."""
    return check_together([path], model, effort, inputs, time_range)[0]


@one_thread
def check_together(
    paths: Sequence[str | Path],
    model: RobotModel,
    effort: EffortMeaning = EffortMeaning.NONE,
    inputs: Inputs | None = None,
    time_range: TimeRange | None = None,
) -> tuple[CheckResult, ...]:
    """Return whether recordings of one robot fit a model; their torque is judged together."""
    checks: list[Checks] = []
    parts: dict[int, Evidence] = {}
    # Without a stated meaning the effort is read as well, to say which meaning would fit.
    read_as = EffortMeaning.MOTOR_TORQUE if effort is EffortMeaning.NONE else effort
    settings = Settings(effort=read_as, power_period=None)
    if inputs is not None:
        settings = replace(settings, meter_max_gap=inputs.meter_max_gap)
    setup = ReplaySetup(settings=settings, inputs=inputs, time_range=time_range)
    for place, path in enumerate(paths):
        windows = Windows(model)
        result = replay(path, model, setup, on_output=windows.take)
        evidence = evidence_of(
            model, effort, *windows.blocks(), remarks_of(result), inputs,
            result.pipeline.torque.robot.payload, windows.beyond,
        )  # fmt: skip
        del windows, result
        checks.append(checks_of(evidence))
        if TORQUE not in checks[-1].skipped and not evidence.of_effort:
            parts[place] = evidence.thinned()
    first = next(iter(parts.values()), None)
    alike = {
        place: part
        for place, part in parts.items()
        if first is not None and part.robot.payload == first.robot.payload
    }
    if len(alike) > 1:
        every = list(alike.values())
        together, _ = check_torque(joined(every), every)
        for place in alike:
            own = checks[place].findings
            own[TORQUE] = [*together, *_contradicted(own[TORQUE], together, len(alike))]
    return tuple(one.result(str(path), model) for one, path in zip(checks, paths, strict=True))


def _contradicted(own: list[Finding], together: list[Finding], count: int) -> list[Finding]:
    """What one recording shows and all together do not, as warnings without a remedy."""
    shown = {(one.cause, one.subject) for one in together}
    return [
        replace(
            one, severity=WARNING, remedy="", remedy_in="",
            sentence=f"{one.sentence}; the {count} recordings together do not show it",
        )
        for one in own
        if one.severity == ERROR and (one.cause, one.subject) not in shown
    ]  # fmt: skip


def checks_of(evidence: Evidence) -> Checks:
    """Return what is found; data that are spoiled blame nothing else."""
    remarks = evidence.remarks
    found: dict[str, list[Finding]] = {
        "bag": [
            Finding("bag", WARNING, ("bag",), text) for text in remarks.problems
        ],
        "joint states": [
            Finding("joint_states", ERROR if one.everywhere else WARNING, ("joint_states",),
                    one.sentence, remedy=one.setting,
                    remedy_in=PARAMETERS if one.setting else "")
            for one in remarks.stream
        ],
    }  # fmt: skip
    skipped: dict[str, str] = {}
    wrong = [one.cause for one in found["joint states"] if one.severity == ERROR]
    for name, one in CHECKS.items():
        spoilt = next((cause for cause in wrong if cause in SPOILING), "")
        if spoilt and name in (TORQUE, METER):
            skipped[name] = f"correct {spoilt} first"
            continue
        found[name], why = one(evidence) if name != METER else check_meter(evidence, wrong)
        wrong += [
            entry.cause
            for entry in found[name]
            if entry.severity == ERROR or entry.cause in SPOILING
        ]
        if why:
            skipped[name] = why
        if name == MOTION:
            found["joint states"] += _refused(remarks, wrong)
            wrong += [entry.cause for entry in found["joint states"] if entry.severity == ERROR]
    return Checks(found, skipped)


def _refused(remarks: Remarks, wrong: Sequence[str]) -> list[Finding]:
    """Say that much was refused, unless a mistake of the velocities found explains it."""
    share, first = sum(remarks.refused.values()), next(iter(remarks.refused), "")
    if share <= MAX_REFUSED or (first == "impossible_velocity" and set(wrong) & set(SPOILING)):
        return []
    reasons = ", ".join(f"{100 * one:.1f} % {reason}" for reason, one in remarks.refused.items())
    if first == CONFLICTING and SAME_STAMP in remarks.refused:
        first = SAME_STAMP  # for which the others are refused
    settings = [one.setting for one in remarks.stream if first == CONFLICTING and one.setting]
    remedy = settings[0] if settings else REFUSED.get(first, NO_REASON)[1]
    return [
        Finding("joint_states_refused", ERROR, ("joint_states",),
                f"{100 * share:.1f} % of the joint states were refused: {reasons}",
                share, remedy)
    ]  # fmt: skip


def _of_joints(severity: str, *kinds: tuple[str, Sequence[str], str, str]) -> list[Finding]:
    """Findings by cause, joints, sentence that names them, and remedy; none without joints."""
    return [
        Finding(cause, severity, tuple(joints), text.format(", ".join(joints)), remedy=remedy)
        for cause, joints, text, remedy in kinds
        if joints
    ]


def _temperatures(evidence: Evidence) -> tuple[list[Finding], str]:
    """Which joints lack a sound temperature, and why that is not known."""
    remarks, degc = evidence.remarks, evidence.temperature_degc
    if remarks.temperatures is None:
        return [], "the recording has no motor temperatures"
    names = np.array(evidence.names)
    hot = names[np.count_nonzero(degc > HOT_DEGC, axis=0) > 0.5 * len(degc)].tolist()
    without = names[~np.isfinite(degc).any(axis=0)].tolist()
    findings = [
        Finding("temperature", WARNING, ("temperature",), note) for note in remarks.temperatures
    ]
    findings += _of_joints(
        WARNING,
        ("temperature_stuck", remarks.stuck, "the motor temperature of {} does not change although "
         "the losses must have warmed it", "check these sensors"),
        ("temperature_hot", hot, f"the motor temperature of {{}} is above {HOT_DEGC:g} degC most "
         "of the time: is its unit degrees Fahrenheit?",
         "set unit: fahrenheit of their temperature source"),
        ("temperature_missing", without, "no motor temperature of {}: friction is taken at "
         f"{evidence.model.temperature.fallback_degc:g} degC",
         "add their source to temperature_sources"),
    )  # fmt: skip
    return findings, ""


def _excitation(evidence: Evidence) -> tuple[list[Finding], str]:
    """What cannot be identified from the recording, as notes: that is not a mistake."""
    if len(evidence.stamp_ns) < 2:
        return [], "too few samples"
    period = float(np.median(np.diff(evidence.stamp_ns))) * 1e-9
    moving = evidence.moving
    findings: list[Finding] = []
    if evidence.effort is EffortMeaning.NONE or not np.isfinite(evidence.motor_torque).any():
        what = "no measured torque: friction and bodies cannot be identified"
        remedy = f"record the effort, and set {EFFORT}"
        findings.append(Finding("no_torque", NOTE, (), what, remedy=remedy))
    short, slow, cold = list[str](), list[str](), list[str]()
    for j, name in enumerate(evidence.names):
        rows = moving[:, j]
        if rows.sum() * period < MIN_MOVING:
            short.append(name)
            continue
        speed = np.abs(evidence.velocity[rows, j])
        if np.quantile(speed, 0.95) < MIN_SPEED_RATIO * np.quantile(speed, 0.1):
            slow.append(name)
        degc = evidence.temperature_degc[:, j]
        if not np.isfinite(degc).any() or np.nanmax(degc) - np.nanmin(degc) < MIN_RANGE_DEGC:
            cold.append(name)
    findings += _of_joints(
        NOTE,
        ("too_little_motion", short, f"less than {MIN_MOVING:.0f} s of motion, so that friction "
         "cannot be identified: {}", "record longer motions of these joints"),
        ("one_speed", slow, "nearly one speed, so that Coulomb and viscous friction cannot be "
         "separated: {}", "record slow and fast motions"),
        ("one_temperature", cold, f"less than {MIN_RANGE_DEGC:.0f} degC between coldest and "
         "warmest, so that no temperature law can be identified: {}",
         "add recordings cold and warm"),
    )  # fmt: skip
    rest = float((~moving.any(axis=1)).sum() * period)
    if evidence.meter is not None and rest < MIN_REST:
        what = f"{rest:.1f} s of rest, so that the constant losses cannot be identified"
        findings.append(Finding("no_rest", NOTE, (), what, remedy="record a few seconds of rest"))
    return findings, ""


MOTION = "positions and velocities"
CHECKS: dict[str, Check] = {
    MOTION: check_motion,
    TORQUE: check_torque,
    METER: check_meter,
    "temperatures": _temperatures,
    "excitation": _excitation,
}
