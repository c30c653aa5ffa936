"""Predictions: every figure that terminal, JSON and pages show of them."""

from typing import Annotated

import numpy as np

from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.model.payload import Payload
from robot_energy.results.auxiliary import (
    AuxiliaryReport,
    auxiliary_report,
    missing_sentences,
)
from robot_energy.results.base import Number, Result, Texts, count_tags
from robot_energy.results.energy import (
    EnergyBreakdown,
    EnergyReport,
    common_figures,
    normalised_energy,
    unbalanced,
)
from robot_energy.timeline.blocks import NANOSECOND, Quality
from robot_energy_plan.motion.load_motion import LoadedMotion
from robot_energy_plan.prediction import Prediction

SLOW = 0.005  # of the speed limits: hardly a program


class PredictedTime(Result):
    """Time of a prediction."""

    duration: Annotated[float, "Time of all repetitions. [s]"]
    predicted_time: Annotated[float, "Part of it for which the energy is known. [s]"]
    gap_ns: Annotated[int, "Part of it for which the energy is not known. [ns]"]


class ToolPathReport(Result):
    """Path of the tool, of all repetitions."""

    length: Annotated[float, "[m]"]
    printed_length: Annotated[Number, "Length on which material is laid; None: nothing is. [m]"]
    stops: Annotated[int | None, "Stops of one repetition."]
    full_speed_share: Annotated[Number, "Share of the length at the programmed speed. [-]"]
    energy_per_printed_metre: Annotated[Number, "Energy from the grid per printed metre. [J/m]"]


class JointLimitUse(Result):
    """Greatest use of the limits of the URDF by one joint."""

    name: Annotated[str, "Name of the joint."]
    speed_use: Annotated[Number, "Greatest share of the speed limit. [-]"]
    torque_use: Annotated[Number, "Greatest share of the torque limit; None without one. [-]"]


class FrictionReach(Result):
    """Joints whose friction law does not determine the assumed temperature."""

    extrapolated_joints: Annotated[Texts, "Joints extrapolated to that temperature."]
    one_temperature_joints: Annotated[Texts, "Joints with the same friction at every temperature."]


class PredictionReport(EnergyReport):
    """The energy of a motion that has not been made."""

    __repr__ = Result.__repr__  # all figures fill a page

    program: Annotated[str, "Name of the motion."]
    repeat: Annotated[int, "How often it is made."]
    motor_temperature_degc: Annotated[dict[str, float], "Assumed and held, by joint. [degC]"]
    payload: Annotated[
        tuple[Payload, ...],
        "Given: it replaces what the model has on the same link and adds to what it has on others.",
    ]
    time: Annotated[PredictedTime, "Time of the motion."]
    tool: Annotated[ToolPathReport | None, "Path of the tool; None where it is not known."]
    limits: Annotated[tuple[JointLimitUse, ...], "Use of the limits of the URDF, in model order."]
    friction: Annotated[FrictionReach, "Joints whose law does not hold for that temperature."]
    auxiliary: Annotated[
        AuxiliaryReport | None, "Loads outside of the cabinet; None where the model has none."
    ] = None


class PredictionsReport(Result, name="prediction"):
    """All programs by all robots at all temperatures."""

    runs: Annotated[tuple[PredictionReport, ...], "One for each program, robot and temperature."]


def prediction_report(result: Prediction, motion: LoadedMotion | None = None) -> PredictionReport:
    """Return all figures of a prediction."""
    model, account = result.model, result.account
    temperature = result.motor_temperature_degc.tolist()
    common = common_figures(account, model, temperature, None)
    time, auxiliary = account.registers.time, auxiliary_report(account.auxiliary)
    net = common["energy"].net
    repeats = [(result.program, net / result.repeat)] * result.repeat
    return PredictionReport(
        **common,
        normalised=normalised_energy(result.work, net, repeats),
        program=result.program,
        repeat=result.repeat,
        motor_temperature_degc=dict(zip(model.joint_names, temperature, strict=True)),
        payload=tuple(result.payload),
        time=PredictedTime(result.duration, time.observed_ns * NANOSECOND, time.gap_ns),
        tool=_tool(motion, result.repeat, common["energy"].net),
        limits=tuple(
            JointLimitUse(*row)
            for row in zip(
                model.joint_names,
                result.limits.speed.tolist(),
                result.limits.torque.tolist(),
                strict=True,
            )
        ),
        friction=FrictionReach(tuple(result.extrapolated), tuple(result.one_temperature)),
        auxiliary=auxiliary,
        problems=(*_problems(result, common["energy"]), *missing_sentences(auxiliary)),
        notes=(*result.notes, *_notes(result)),
    )


def _tool(motion: LoadedMotion | None, repeat: int, net: float) -> ToolPathReport | None:
    if motion is None or motion.length is None:
        return None
    printed = motion.printed_length * repeat if motion.printed_length else None
    return ToolPathReport(
        length=motion.length * repeat,
        printed_length=printed,
        stops=motion.stops,
        full_speed_share=motion.full_speed_share,
        energy_per_printed_metre=net / printed if printed else None,
    )


def _problems(result: Prediction, energy: EnergyBreakdown) -> list[str]:
    problems = [*unbalanced(energy), *result.limits.sentences()]
    gap_ns = result.account.registers.time.gap_ns
    if gap_ns:
        problems.append(
            f"{gap_ns * NANOSECOND:.3f} s of the motion are not predicted and not counted"
        )
    return problems


def _notes(result: Prediction) -> list[str]:
    notes: list[str] = []
    if result.extrapolated:
        notes.append(
            f"EXTRAPOLATED: the friction of {', '.join(result.extrapolated)} was never fitted at "
            "that temperature; where its law has a key `outside`, that says what holds there"
        )
    if result.one_temperature:
        notes.append(
            f"the friction of {', '.join(result.one_temperature)} is the same at every "
            "temperature in this model"
        )
    speeds = result.limits.speed
    fastest = float(np.max(speeds, initial=0.0, where=np.isfinite(speeds)))
    if 0.0 < fastest < SLOW:
        notes.append(
            f"no joint is faster than {100 * fastest:.2g} % of its speed limit: are the times of "
            "the motion in seconds?"
        )
    if fastest == 0.0 and np.isfinite(speeds).any():
        notes.append("no joint moves: this is the energy of holding one pose")
    samples, counts = result.account.counts.samples, result.account.counts.quality
    share = counts[int(Quality.DRIVE_EXTRAPOLATED)] / samples if samples else 0.0
    if share:
        notes.append(
            f"DRIVE_EXTRAPOLATED: a drive runs outside its efficiency map in {100 * share:.1f} % "
            "of the samples; the nearest point was used"
        )
    if DRIVE_MODELS[result.model.drive].lossless:
        notes.append("the model has no drive losses: they are missing from the energy")
    tags = count_tags(result.model)
    if assumed := tags.get("assumed", 0):
        notes.append(f"{assumed} of {sum(tags.values())} figures of the model are assumed")
    return notes
