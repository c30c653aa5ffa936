"""All checks of a recording, in the order in which their causes act."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from robot_energy.bag_replay import replay
from robot_energy.blocks import EffortMeaning, MeterBlock, PowerBlock, TorqueBlock
from robot_energy.check.coverage import check_excitation, check_temperatures
from robot_energy.check.evidence import Evidence, Remarks, evidence_of, remarks_of
from robot_energy.check.finding import (
    ERROR,
    PARAMETERS,
    SEVERITIES,
    WARNING,
    CheckResult,
    Finding,
)
from robot_energy.check.meter import check_meter
from robot_energy.check.motion import check_motion
from robot_energy.check.torque import check_torque
from robot_energy.inputs.joint_states.decode import NO_REASON, REFUSED
from robot_energy.inputs.sources import Inputs
from robot_energy.model import RobotModel
from robot_energy.pipeline import Output, Settings

MAX_REFUSED = 0.05  # share of the joint states

Check = Callable[[Evidence], tuple[list[Finding], str]]
MOTION_CAUSES = (
    "degrees",
    "millimetres",
    "velocity_sign",
    "velocity_scale",
    "velocity_zero",
)  # that spoil all torques, and with them the prediction for the meter
AFTERWARDS = ("torque", "power meter")


def check(
    path: str | Path,
    model: RobotModel,
    effort: EffortMeaning = EffortMeaning.NONE,
    inputs: Inputs | None = None,
) -> CheckResult:
    """Return whether a recording fits a model, and what is wrong if not, errors first.

    Args:
        path: MCAP file or rosbag2 folder.
        model: The model.
        effort: What the effort in the joint states means.
        inputs: What the inputs of a live monitor are, to read the bag in the same way.

    Raises:
        RobotEnergyError: If the bag cannot be read, or gives no sample with this model.
    """
    outputs: list[Output] = []
    # Without a stated meaning the effort is read as well, to say which meaning would fit.
    read_as = EffortMeaning.MOTOR_TORQUE if effort is EffortMeaning.NONE else effort
    settings = Settings(effort=read_as, power_period=None)
    if inputs is not None:
        settings = replace(settings, meter_max_gap=inputs.meter_max_gap)
    result = replay(path, model, None, settings, inputs=inputs, on_output=outputs.append)
    power = [part.power for part in outputs if part.power is not None]
    meter = [part.meter for part in outputs if part.meter is not None]
    evidence = evidence_of(
        model,
        effort,
        TorqueBlock.concatenate([part.torque for part in outputs if part.torque is not None]),
        PowerBlock.concatenate(power) if power else None,
        MeterBlock.concatenate(meter) if meter else None,
        remarks_of(result),
        inputs,
        result.pipeline.torque.robot.payload,
    )
    findings, done, skipped = findings_of(evidence)
    return CheckResult(
        str(path), f"{model.robot.type}, id {model.model_id}", findings, done, skipped
    )


def findings_of(
    evidence: Evidence,
) -> tuple[tuple[Finding, ...], tuple[str, ...], dict[str, str]]:
    """Return findings, errors first; the checks made; those not made, with what they lack.

    Args:
        evidence: What was seen.
    """
    findings = [
        Finding("bag", WARNING, ("bag",), text, float("nan"), float("nan"))
        for text in evidence.remarks.problems
    ] + _stream(evidence.remarks)
    done: list[str] = []
    skipped: dict[str, str] = {}
    wrong: list[str] = []
    checks: dict[str, Check] = {
        "positions and velocities": check_motion,
        "torque": check_torque,
        "power meter": lambda evidence: check_meter(evidence, wrong),
        "temperatures": check_temperatures,
        "excitation": check_excitation,
    }
    for name, one in checks.items():
        spoilt = [cause for cause in wrong if cause in MOTION_CAUSES]
        if spoilt and name in AFTERWARDS:
            skipped[name] = f"mend {spoilt[0]} first"
            continue
        found, why = one(evidence)
        findings += found
        wrong += [entry.cause for entry in found if entry.severity == ERROR]
        if why:
            skipped[name] = why
        else:
            done.append(name)
    findings += _refused(evidence.remarks, wrong)
    findings.sort(key=lambda entry: SEVERITIES.index(entry.severity))
    return tuple(findings), tuple(done), skipped


def _stream(remarks: Remarks) -> list[Finding]:
    """Say what is wrong with stamps and publishers of the joint states."""
    return [
        Finding("joint_states", ERROR if one.everywhere else WARNING, ("joint_states",),
                one.sentence, float("nan"), float("nan"), one.setting,
                PARAMETERS if one.setting else "")
        for one in remarks.stream
    ]  # fmt: skip


def _refused(remarks: Remarks, wrong: Sequence[str]) -> list[Finding]:
    """Say that much was refused, unless a mistake of the velocities found explains it."""
    share, first = sum(remarks.refused.values()), next(iter(remarks.refused), "")
    if share <= MAX_REFUSED or (first == "impossible_velocity" and set(wrong) & set(MOTION_CAUSES)):
        return []
    reasons = ", ".join(f"{100 * one:.1f} % {reason}" for reason, one in remarks.refused.items())
    return [
        Finding("joint_states_refused", ERROR, ("joint_states",),
                f"{100 * share:.1f} % of the joint states were refused: {reasons}",
                share, float("nan"), REFUSED.get(first, NO_REASON)[1])
    ]  # fmt: skip
