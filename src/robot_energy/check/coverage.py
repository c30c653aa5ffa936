"""What the recording covers: temperatures, and what could be identified from it."""

from __future__ import annotations

import numpy as np

from robot_energy.blocks import EffortMeaning
from robot_energy.check.evidence import Evidence
from robot_energy.check.finding import NOTE, WARNING, Finding

MIN_RANGE_DEGC = 10.0  # of temperature, for a law of viscous friction
MIN_SPEED_RATIO = 3.0  # of fastest to slowest motion, to separate Coulomb from viscous friction
MIN_MOVING = 10.0  # s of motion of a joint
MIN_REST = 1.0  # s of rest, for the constant losses


def check_temperatures(evidence: Evidence) -> tuple[list[Finding], str]:
    """Return which joints lack a sound temperature, and why that cannot be told.

    Args:
        evidence: The recording.
    """
    remarks = evidence.remarks
    if remarks.temperatures is None:
        return [], "the recording has no motor temperatures"
    findings = [
        Finding("temperature", WARNING, ("temperature",), note, float("nan"), float("nan"))
        for note in remarks.temperatures
    ]
    if remarks.stuck:
        findings.append(
            Finding(
                "temperature_stuck", WARNING, remarks.stuck,
                f"the motor temperature of {', '.join(remarks.stuck)} stands still although the "
                "losses must have warmed it",
                float(len(remarks.stuck)), float("nan"), "check these sensors",
            )
        )  # fmt: skip
    without = [
        name
        for name, degc in zip(evidence.names, evidence.temperature_degc.T, strict=True)
        if not np.isfinite(degc).any()
    ]
    if without:
        findings.append(
            Finding(
                "temperature_missing", WARNING, tuple(without),
                f"no motor temperature of {', '.join(without)}: friction is taken at "
                f"{evidence.model.temperature.fallback_degc:g} degC",
                float(len(without)), float("nan"), "add their source to temperature_sources",
            )
        )  # fmt: skip
    return findings, ""


def check_excitation(evidence: Evidence) -> tuple[list[Finding], str]:
    """Return what cannot be identified from the recording, as notes: that is no mistake.

    Args:
        evidence: The recording.
    """
    if len(evidence.stamp_ns) < 2:
        return [], "too few samples"
    period = float(np.median(np.diff(evidence.stamp_ns))) * 1e-9
    moving = evidence.moving
    findings: list[Finding] = []

    def note(cause: str, joints: list[str], sentence: str, remedy: str) -> None:
        findings.append(
            Finding(cause, NOTE, tuple(joints), sentence, float(len(joints)), float("nan"), remedy)
        )

    if evidence.effort is EffortMeaning.NONE or not np.isfinite(evidence.motor_torque).any():
        note(
            "no_torque", [], "no measured torque: friction and bodies cannot be identified",
            "record the effort, and state its meaning with --effort",
        )  # fmt: skip
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
    for cause, joints, what, remedy in (
        (
            "too_little_motion", short,
            f"less than {MIN_MOVING:.0f} s of motion, so that friction cannot be identified",
            "record longer motions of these joints",
        ),
        (
            "one_speed", slow,
            "nearly one speed, so that Coulomb and viscous friction cannot be separated",
            "record slow and fast motions",
        ),
        (
            "one_temperature", cold,
            f"less than {MIN_RANGE_DEGC:.0f} degC between coldest and warmest, so that no "
            "temperature law can be identified",
            "add recordings cold and warm",
        ),
    ):  # fmt: skip
        if joints:
            note(cause, joints, f"{what}: {', '.join(joints)}", remedy)
    rest = float((~moving.any(axis=1)).sum() * period)
    if evidence.meter is not None and rest < MIN_REST:
        note(
            "no_rest", [],
            f"{rest:.1f} s of rest, so that the constant losses cannot be identified",
            "record a few seconds of rest",
        )  # fmt: skip
    return findings, ""
