"""All checks of a recording, in the order in which their causes act."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from robot_energy.blocks import EffortMeaning
from robot_energy.check.coverage import check_excitation, check_temperatures
from robot_energy.check.evidence import Evidence, gather
from robot_energy.check.finding import SEVERITIES, WARNING, CheckResult, Finding
from robot_energy.check.meter import check_meter
from robot_energy.check.motion import check_motion
from robot_energy.check.torque import check_torque
from robot_energy.inputs.sources import Inputs
from robot_energy.model import RobotModel

Check = Callable[[Evidence], tuple[list[Finding], str]]
CHECKS: dict[str, Check] = {
    "positions and velocities": check_motion,
    "torque": check_torque,
    "power meter": check_meter,
    "temperatures": check_temperatures,
    "excitation": check_excitation,
}


def check(
    path: str | Path,
    model: RobotModel,
    effort: EffortMeaning = EffortMeaning.NONE,
    inputs: Inputs | None = None,
) -> CheckResult:
    """Say whether a recording fits a model, and what is wrong if it does not.

    Args:
        path: MCAP file or rosbag2 folder.
        model: The model.
        effort: What the effort in the joint states means.
        inputs: What the inputs of a live monitor are, to read the bag in the same way.

    Returns:
        The findings, errors first.

    Raises:
        RobotEnergyError: If the bag cannot be read, or gives no sample with this model.
    """
    evidence = gather(path, model, effort, inputs)
    findings = [
        Finding("bag", WARNING, ("bag",), text, float("nan"), float("nan"))
        for text in (evidence.replay.problems if evidence.replay else ())
    ]
    done: list[str] = []
    skipped: dict[str, str] = {}
    for name, one in CHECKS.items():
        degrees = any(entry.cause == "degrees" for entry in findings)
        if degrees and one in (check_torque, check_meter):
            found, why = [], "the positions are in degrees"
        else:
            found, why = one(evidence)
        findings += found
        if why:
            skipped[name] = why
        else:
            done.append(name)
    findings.sort(key=lambda entry: SEVERITIES.index(entry.severity))
    return CheckResult(
        str(path), f"{model.robot.type}, id {model.model_id}", tuple(findings), tuple(done), skipped
    )
