"""Causes that `robot-energy check` finds, for identification: what is refused before a fit.

A fit takes up a wrong scale or gear ratio in its bodies, so its own errors do not show it. The
checks compare with the bodies as given, which may be off as far as their tag says; without a tag,
as far as those of a public URDF. So their causes refuse a recording. Where the model file says that
its masses are assumed they are notes, and are named once a gate of
`robot_energy_identify.plausibility` has refused.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from robot_energy.foundation.errors import BagError, ImplausibleIdentificationError
from robot_energy.model import RobotModel
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import NANOSECOND, EffortMeaning, Float, Int, MeterMeaning
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
from robot_energy_identify.check.meter import check_meter, lag_of, readings_once
from robot_energy_identify.check.meter_step import drift_of, step_of
from robot_energy_identify.check.motion import STAMPS_UNEVEN, check_motion
from robot_energy_identify.check.torque import UNEXPLAINED, check_torque
from robot_energy_identify.data.recordings import Recording, spread, undone
from robot_energy_identify.dynamics.dynamics import Dynamics
from robot_energy_identify.provenance import require_some

# What no identification can mend, whatever the bodies: others, such as a payload, are notes.
MISTAKES = (
    "torque_sign", "joint_sign", "joint_order", "torque_scale", "gear_ratio", "effort_meaning",
    "other_robot",
)  # fmt: skip
# All torques and powers follow from positions and velocities.
MOTION_MISTAKES = (
    "degrees", "millimetres", "velocity_scale", "velocity_sign", "velocity_zero", "velocity_late",
    "velocity_apart", "position_held",
)  # fmt: skip
# A delay is estimated and undone; what the meter reads less than the prediction is the model's.
METER_MISTAKES = ("meter_sign", "meter_unit", "shafts_exceed_meter")
UNLIKE = 0.1  # of the size of torque: sound recordings of one robot differ by 0.02
MAX_LATE = 0.6  # s: delay and low pass that are found together make a meter less late
SAME_CLOCK = 0.1  # s by which lags of one meter differ: what a model leaves out makes 0.02
LAG_SCATTER = 2.0  # s over the root of the readings: with 40, sound lags differ by up to 0.26 s
MIN_SHARED, SHARED = 20, 0.5  # changes at one stamp, and share of them that are equal
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
    return replace(_evidence_of(recording, effort).thinned(), name=recording.path.name)


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
    """The causes that make the torque of recordings of one model differ from the model's.

    A cause in one of them hardly shows in all together, so one whose torque has another size than
    that of the others is looked at by itself.
    """
    found = _causes(joined([part.thinned() for part in parts]), parts)
    common = [one.cause for one in found]
    for part in _unlike(parts):
        if not part.motor_torque[np.isfinite(part.motor_torque)].any():
            found.append(
                Finding(
                    "torque_scale", ERROR, part.names, f"{part.name}: its torque is 0 throughout",
                    0.0, "leave this recording out, or record torque",
                )
            )  # fmt: skip
            continue
        found += [
            replace(one, sentence=f"{part.name}: {one.sentence}")
            for one in _causes(part)
            if one.cause not in common
        ]
    return tuple(found)


def _causes(evidence: Evidence, parts: Sequence[Evidence] = ()) -> list[Finding]:
    found, _ = check_torque(evidence, parts)
    return [one for one in found if one.severity != NOTE and one.cause != UNEXPLAINED]


def _unlike(parts: Sequence[Evidence]) -> list[Evidence]:
    """Recordings with measured over body torque apart from the median of all."""
    unknown = (np.nan, np.nan)
    factors = np.array([part.remarks.effort_factors.get(part.effort, unknown)[0] for part in parts])
    known = np.flatnonzero(np.isfinite(factors))
    usual = float(np.median(factors[known])) if len(known) else 0.0
    return [parts[k] for k in known.tolist() if abs(factors[k] - usual) > UNLIKE * abs(usual)]


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


def refuse_motion(recording: Recording, effort: EffortMeaning) -> tuple[str, ...]:
    """Refuse joint states whose fields do not fit each other, or are in another unit.

    Returns:
        What else is wrong with joint states and meter, one sentence each.
    """
    evidence = _evidence_of(recording, effort)
    found, _ = check_motion(evidence)
    wrong = [one for one in found if one.cause in MOTION_MISTAKES] or evidence.of_effort
    _refuse(
        [replace(one, sentence=f"{recording.path.name}: {one.sentence}") for one in wrong],
        "positions in rad or m, their change as velocity, and the effort of the same instant",
    )
    problems = [_sentence(one) for one in found if one.cause == STAMPS_UNEVEN]
    if (result := recording.replay) is not None:
        problems += [one.sentence for one in result.joint_states.findings()]
        problems += [result.meter.refused, *remarks_of(result).meter]
        problems.append(result.pipeline.friction.refused)
    return tuple(f"{recording.path.name}: {one}" for one in problems if one)


def refuse_shared(recordings: Sequence[Recording]) -> None:
    """Refuse two recordings that hold the same moments, as parts of one that overlap do."""
    for first, second in combinations(recordings, 2):
        (ours, torque), (theirs, other) = _measured(first), _measured(second)
        stamps, mine, its = np.intersect1d(ours, theirs, return_indices=True)
        if len(stamps) < MIN_SHARED or torque.shape[1] != other.shape[1]:
            continue
        same = (torque[mine] == other[its]).all(axis=1)
        if same.mean() > SHARED:
            span = float(np.ptp(stamps[same])) * NANOSECOND
            raise BagError(
                f"{first.path.name} and {second.path.name} hold the same {span:.0f} s",
                "every moment once",
                "leave one of them out, or cut it: what is fitted and tested counts twice",
            )


def _measured(recording: Recording) -> tuple[Int, Float]:
    """Stamps [ns] and torques that change, or readings of the meter where too few torques do."""
    torque, meter = recording.torque, recording.meter
    changes = _changes(torque.stamp_ns, torque.motor_torque_measured)
    if meter is None or len(changes[0]) >= MIN_SHARED:
        return changes
    return _changes(meter.stamp_ns, np.stack([meter.power, meter.energy], axis=1))


def _changes(stamps: Int, values: Float) -> tuple[Int, Float]:
    """Return rows of known values that differ from the row before.

    A column that is never known is 0. Drives that are off repeat their torque, those of every day.
    """
    values = np.where(np.isfinite(values).any(axis=0), values, 0.0)
    known = np.isfinite(values).all(axis=1)
    stamps, values = stamps[known], values[known]
    changed = (np.diff(values, axis=0, prepend=np.nan) != 0.0).any(axis=1)
    return stamps[changed], values[changed]


def refuse_meter(recordings: Sequence[Recording], effort: EffortMeaning) -> None:
    """Refuse a meter whose sign, unit or clock is wrong, or that shows less than the shafts take.

    Args:
        recordings: With their meters; those without are passed over.
    """
    for recording in spread(recordings):
        if recording.meter is not None:
            found, _ = check_meter(_evidence_of(recording, effort))
            _refuse(
                [finding for finding in found if _spoils(finding)],
                "power positive into the robot, in the unit of its parameters, in time",
            )


def _spoils(finding: Finding) -> bool:
    """Whether a finding of the meter is a mistake that no step undoes."""
    off = finding.cause == "meter_clock" and abs(finding.evidence) > MAX_LATE
    return off or finding.cause in METER_MISTAKES


def stepping_meters(recordings: Iterable[Recording]) -> tuple[str, ...]:
    """Return those whose meter steps or drifts where their model does not, one sentence each."""
    found = (
        (part.path.name, step_of(compared, part.span_ns[0]) or drift_of(compared))
        for part in recordings
        for compared in part.compared
    )
    return tuple(f"{name}: {_sentence(step)}" for name, step in found if step is not None)


def on_one_clock(recordings: Sequence[Recording]) -> tuple[list[Recording], tuple[str, ...]]:
    """Return recordings whose meters are equally late, and what was moved, one sentence each.

    One delay is identified for all recordings, so clocks that differ would count as a low pass. The
    lag that most recordings have stays: it is the meter's. Few readings do not show a lag well. A
    counter is compared with counters, as it has no low pass. Readings that are repeated count once.
    """
    recordings, notes = list(recordings), list[str]()
    for number, part in enumerate(recordings):
        meter, held = (None, "") if part.meter is None else readings_once(part.meter)
        if held:
            recordings[number] = replace(part, meter=meter, known=None)
            notes.append(f"{part.path.name}: {held}, so each counted once; record each once")
    lags: dict[int, _Clock] = {}
    counts = [
        part.meter is not None and part.meter.meaning is MeterMeaning.CUMULATIVE
        for part in recordings
    ]
    for number, part in enumerate(spread(recordings) if len(recordings) > 1 else ()):
        known = part.meter is not None and part.in_order
        found = lag_of(_evidence_of(part, EffortMeaning.NONE)) if known else ""
        if not isinstance(found, str):
            assert part.meter is not None
            within = max(SAME_CLOCK, LAG_SCATTER / len(part.meter) ** 0.5)
            lags[number] = _Clock(found.lag, within)
    moved = list(recordings)
    for number, lag in lags.items():
        same = [other for place, other in lags.items() if counts[place] == counts[number]]
        usual = max(same, key=lambda one: (_alike(one, same), -abs(one.lag)))
        if _alike(lag, (usual,)):
            continue
        late, part = lag.lag - usual.lag, recordings[number]
        assert part.meter is not None
        moved[number] = replace(part, meter=undone(part.meter, late), known=None)
        where = "behind" if late > 0 else "ahead of"
        notes.append(
            f"{part.path.name}: its meter is {abs(late):.2f} s {where} those of the other "
            "recordings, so its readings were moved by as much; synchronise the clock of the meter"
        )
    return moved, tuple(notes)


class _Clock(NamedTuple):
    """How far a meter is behind the joint states, and within what its readings show it. [s]"""

    lag: float
    within: float


def _alike(one: _Clock, others: Iterable[_Clock]) -> int:
    return sum(abs(one.lag - other.lag) <= max(one.within, other.within) for other in others)


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


def option_of(finding: Finding) -> str:
    """Return the option of a command that stands for the line of YAML and counts before it."""
    meaning = re.search(r"effort_meaning: (\w+)", finding.remedy)
    return f", or --effort {meaning[1]}" if meaning else ""


def _sentence(finding: Finding) -> str:
    return f"{finding.sentence}: {finding.remedy}" if finding.remedy else finding.sentence


def _refuse(findings: Sequence[Finding], expected: str, otherwise: str = "") -> None:
    if not findings:
        return
    remedies = [
        *dict.fromkeys(one.remedy + option_of(one) for one in findings if one.remedy),
        otherwise,
    ]
    raise ImplausibleIdentificationError(
        "; ".join(finding.sentence for finding in findings),
        expected,
        "; ".join(text for text in remedies if text),
    )
