"""Causes that `robot-energy check` finds, for identification: what is refused before a fit.

A fit takes up a wrong scale or gear ratio in its bodies, so its own errors do not show it. The
checks compare with the bodies as given, which may be off as far as their tag says; without a tag,
as far as those of a public URDF. So their causes refuse a recording. Where the model file says that
its masses are assumed they are notes, and are named once a gate of
`robot_energy_identify.plausibility` has refused.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager

import numpy as np

from robot_energy.foundation.errors import ImplausibleIdentificationError
from robot_energy.model import RobotModel
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import EffortMeaning
from robot_energy_identify.blas_threads import one_thread
from robot_energy_identify.check.evidence import (
    Evidence,
    Remarks,
    evidence_of,
    joined,
    moving,
    remarks_of,
)
from robot_energy_identify.check.finding import ERROR, NOTE, Finding
from robot_energy_identify.check.meter import check_meter
from robot_energy_identify.check.torque import UNEXPLAINED, check_torque
from robot_energy_identify.data.recordings import Recording, spread
from robot_energy_identify.dynamics.dynamics import Dynamics
from robot_energy_identify.provenance import require_some

# What no identification can mend, whatever the bodies: others, such as a payload, are notes.
MISTAKES = (
    "torque_sign", "joint_sign", "joint_order", "torque_scale", "gear_ratio", "effort_meaning",
)  # fmt: skip
# A delay is estimated and undone; what the meter reads less than the prediction is the model's.
METER_MISTAKES = ("meter_sign", "meter_unit", "shafts_exceed_meter")
MASSES_ASSUMED = "if the masses of the URDF are but a guess, say so: urdf: tags: {masses: assumed}"


def bodies_known(model: RobotModel) -> bool:
    """Whether the model file does not say that its masses are but a guess."""
    return model.urdf.tags.get("masses") != "assumed"


def _evidence_of(recording: Recording, effort: EffortMeaning) -> Evidence:
    """What the checks need of a recording."""
    remarks = Remarks() if recording.replay is None else remarks_of(recording.replay)
    return evidence_of(
        recording.model, effort, recording.torque, recording.power, recording.meter, remarks
    )


def torque_evidence(recording: Recording, effort: EffortMeaning) -> Evidence:
    """Return the few samples of a recording that the checks of its torque need."""
    return _evidence_of(recording, effort).thinned()


def evidence_of_rows(result: Dynamics) -> Evidence:
    """Return what the checks need of rows that dynamics were identified from, with its rotors."""
    model, rows = result.model, result.observations
    inertia = Drivetrain.from_model(model).rotor_inertia.copy()
    squared = np.diagonal(result.torque_model.transmission) ** 2
    fitted = result.standard[result.torque_model.n_links :]
    for (column, owner, _), value in zip(result.torque_model.extra, fitted, strict=True):
        if column.kind == "rotor_inertia":
            inertia[owner] = max(float(value), 0.0) / squared[owner]
    drivetrain = Drivetrain(result.torque_model.transmission, inertia)
    stamps = np.round(np.arange(len(rows.segment)) / rows.rate * 1e9).astype(np.int64)
    return Evidence(
        model=model,
        robot=Robot.from_model(model),
        drivetrain=drivetrain,
        effort=EffortMeaning.MOTOR_TORQUE,
        stamp_ns=stamps,
        segment=rows.segment,
        position=rows.motion.joint_position,
        velocity=rows.motion.joint_velocity,
        acceleration=rows.motion.joint_acceleration,
        motor_torque=drivetrain.motor_torque_from_joint(rows.joint_torque),
        temperature_degc=np.full(rows.joint_torque.shape, np.nan),
        moving=moving(model, stamps, rows.motion.joint_velocity),
    )


@one_thread
def _torque_causes(parts: Sequence[Evidence]) -> tuple[Finding, ...]:
    """The causes that make the torque of recordings of one model differ from the model's."""
    found, _ = check_torque(joined([part.thinned() for part in parts]))
    return tuple(one for one in found if one.severity != NOTE and one.cause != UNEXPLAINED)


def _is_mistake(finding: Finding) -> bool:
    """Whether nothing but a mistake explains the torque; a gear that is a prior is none."""
    certain = finding.severity == ERROR or bool(finding.alternatives)
    return certain and {finding.cause, *finding.alternatives} <= {*MISTAKES}


def refuse_torque(parts: Sequence[Evidence]) -> tuple[str, ...]:
    """Refuse recordings whose torque has a cause that a fit would take up in its bodies.

    Args:
        parts: Of one model; nothing is refused where its masses are assumed.

    Returns:
        Other causes, one sentence each: they are for the user to look at.
    """
    require_some(parts)
    if not bodies_known(parts[0].model):
        return ()
    found = _torque_causes(parts)
    _refuse(
        [finding for finding in found if _is_mistake(finding)],
        "torque of the bodies in the model, whose masses "
        f"are {parts[0].model.urdf.tags.get('masses', 'not said to be assumed')}",
        MASSES_ASSUMED,
    )
    return tuple(_sentence(finding) for finding in found)


def notes_on_torque(parts: Sequence[Evidence], where: str = "") -> tuple[str, ...]:
    """Return what does not fit the model in recordings, one sentence each; nothing is refused.

    Args:
        parts: Of one model; empty for none.
        where: Begins each sentence.
    """
    return tuple(where + _sentence(finding) for finding in _torque_causes(parts)) if parts else ()


def refuse_meter(recordings: Sequence[Recording], effort: EffortMeaning) -> None:
    """Refuse a meter whose sign or unit is wrong, or that shows less than the shafts take.

    Args:
        recordings: With their meters; those without are passed over.
    """
    for recording in spread(recordings):
        if recording.meter is not None:
            found, _ = check_meter(_evidence_of(recording, effort))
            _refuse(
                [finding for finding in found if finding.cause in METER_MISTAKES],
                "power positive into the robot, in the unit of its parameters",
            )


@contextmanager
def cause_named(parts: Callable[[], Sequence[Evidence]]) -> Generator[None]:
    """Yield to work that may be refused; add the causes that the checks find to its refusal.

    Args:
        parts: Gives the recordings, if something is refused.
    """
    try:
        yield
    except ImplausibleIdentificationError as error:
        known = [part for part in parts() if np.isfinite(part.motor_torque).any()]
        found = _torque_causes(known) if known else ()
        if not found:
            raise
        causes = "; ".join(_sentence(finding) for finding in found)
        raise ImplausibleIdentificationError(
            f"{error.found}. The likeliest cause: {causes}", error.expected, error.remedy
        ) from error


def _sentence(finding: Finding) -> str:
    return f"{finding.sentence}: {finding.remedy}" if finding.remedy else finding.sentence


def _refuse(findings: Sequence[Finding], expected: str, otherwise: str = "") -> None:
    if not findings:
        return
    remedies = [*dict.fromkeys(one.remedy for one in findings if one.remedy), otherwise]
    raise ImplausibleIdentificationError(
        "; ".join(finding.sentence for finding in findings),
        expected,
        "; ".join(text for text in remedies if text),
    )
