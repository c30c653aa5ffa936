"""A replay: every figure that terminal, JSON and pages show of it."""

from dataclasses import replace
from typing import Annotated, Any

import numpy as np

from robot_energy.condition.learner import ConditionLearner
from robot_energy.messages.registers import interval_fields
from robot_energy.model import RobotModel
from robot_energy.physics.urdf.checks import parse
from robot_energy.physics.urdf.moving_joints import mimic_remarks
from robot_energy.pipeline.torque_stage import PayloadChange
from robot_energy.replay.bag_replay import Replay
from robot_energy.replay.setup import Topics
from robot_energy.results.auxiliary import (
    AuxiliaryReport,
    auxiliary_report,
    missing_sentences,
)
from robot_energy.results.base import Number, Result
from robot_energy.results.energy import (
    EnergyReport,
    MeterComparison,
    common_figures,
    comparison_of,
    normalised_energy,
    unbalanced,
)
from robot_energy.timeline.blocks import NANOSECOND, EffortMeaning


class LearnedJoint(Result):
    """Friction of one joint against the model file, from measured torque."""

    name: Annotated[str, "Name of the joint."]
    multiplier: Annotated[
        Number,
        "Measured over model friction, mean over speeds and temperatures, within its bounds; "
        "None where nothing is known. [-]",
    ]
    multiplier_raw: Annotated[Number, "Multiplier of the newest minute of motion. [-]"]
    valid: Annotated[bool, "Whether it can be used."]
    motion: Annotated[float, "Time in motion from which it was learned. [s]"]
    records: Annotated[int, "Records of motion that the test for wear keeps."]


class WearFinding(Result):
    """A lasting change of friction."""

    joint: Annotated[str, "Its name; empty for the whole robot, as one power meter sees it."]
    fell: Annotated[bool, "Whether friction has fallen, as after re-greasing; else it has risen."]
    change: Annotated[float, "Friction now over that of the first records, less 1. [-]"]
    change_std: Annotated[Number, "Its standard deviation. [-]"]
    since_ns: Annotated[int | None, "When the change began. [ns since 1970]"]
    certainty: Annotated[float, "Probability that it is not chance. [-]"]
    sentence: Annotated[str, "The same in words."]


class ConditionReport(Result):
    """Learned figures and lasting changes of friction."""

    learning: Annotated[
        str, "What was done with learned figures: ``off``, ``observe`` or ``apply``."
    ]
    joints: Annotated[tuple[LearnedJoint, ...], "Joints in model order."]
    friction_factor: Annotated[
        float, "On the friction of joints without torque, from the meter. [-]"
    ]
    loss_offset: Annotated[float, "Added to the constant losses, from the meter. [W]"]
    meter_valid: Annotated[bool, "Whether both can be used."]
    wear: Annotated[tuple[WearFinding, ...], "Lasting changes; empty while there are none."]


def condition_report(learner: ConditionLearner, model: RobotModel) -> ConditionReport:
    friction, factor = learner.friction, learner.meter.filtered
    time = friction.sums[2].sum(axis=(0, 2, 3)).tolist()
    columns = (friction.filtered.tolist(), friction.raw.tolist(), friction.valid.tolist(), time)
    records = [len(test.records) for test in learner.wear.joints]
    rows = zip(model.joint_names, *columns, records, strict=True)
    return ConditionReport(
        str(learner.learning),
        tuple(LearnedJoint(*row) for row in rows),
        *factor,
        learner.meter.valid,
        tuple(
            WearFinding(one.joint, d.fell, d.size, d.std, d.since_ns, one.sure, one.sentence)
            for one in learner.wear.alarms
            for d in (one.drift,)
        ),
    )


LITTLE = 0.5  # share of the recorded time, below which that is said [-]


class ObservedTime(Result):
    """What part of the recording is predicted: ``span = observed + gap``, exact."""

    start_ns: Annotated[int | None, "First joint state; None if there is none. [ns since 1970]"]
    end_ns: Annotated[int | None, "Last joint state. [ns since 1970]"]
    span_ns: Annotated[int, "From the first to the last joint state, used or not. [ns]"]
    observed_ns: Annotated[int, "Time that is predicted. [ns]"]
    gap_ns: Annotated[int, "Time that is not predicted. [ns]"]
    gap_count: Annotated[int, "Number of gaps."]
    backward_jumps: Annotated[int, "How often stamps jumped back."]
    coverage: Annotated[Number, "Observed share of the span. [-]"]
    observed_time: Annotated[float, "Time that is predicted. [s]"]


class JointShaft(Result):
    """Shaft energy of one joint, over the intervals in which its effort is known. [J]"""

    name: Annotated[str, "Name of the joint."]
    compared_time: Annotated[float, "Time over which both are known. [s]"]
    coverage: Annotated[Number, "Their share of the observed time. [-]"]
    shaft_energy_positive_measured: Annotated[Number, "Measured shaft energy given by the motor."]
    shaft_energy_negative_measured: Annotated[
        Number, "Measured shaft energy taken back by the motor."
    ]
    shaft_energy_positive_compared: Annotated[Number, "Predicted over the same time."]
    shaft_energy_negative_compared: Annotated[Number, "Predicted over the same time."]
    predicted_minus_measured_energy: Annotated[Number, "The error."]
    predicted_minus_measured_relative: Annotated[
        Number, "The error over the measured energy that went either way. [-]"
    ]


class ShaftComparison(Result):
    """Measured and predicted shaft energy."""

    effort: Annotated[str, "What the effort in the joint states was taken for."]
    joints: Annotated[tuple[JointShaft, ...], "In model order."]


class PayloadHistory(Result):
    """Payloads that the recording set at run time."""

    changes: Annotated[tuple[PayloadChange, ...], "In the order of time."]
    not_reached: Annotated[int, "Changes after the last sample."]
    last_mass: Annotated[float, "Payload of the robot at the end. [kg]"]


class InputAccount(Result):
    """Account of one input: received = accepted + sum of rejected."""

    received: Annotated[int, "Number received."]
    accepted: Annotated[int, "Number of these that were accepted."]
    rejected: Annotated[dict[str, int], "Number of these that were rejected, by reason."]
    balanced: Annotated[bool, "Whether accepted, rejected and waiting ones sum to those received."]


class JobFigures(Result):
    """Energy of one job or cycle; its bounds are stamps of counted samples."""

    name: Annotated[str, "Name of the job, the same for all of one kind."]
    start_ns: Annotated[int, "Stamp of its first sample. [ns since 1970]"]
    end_ns: Annotated[int, "Stamp of its last sample. [ns since 1970]"]
    time: Annotated[float, "Observed time. [s]"]
    gap_time: Annotated[float, "Time that was not observed. [s]"]
    energy: Annotated[float, "Predicted from the grid, less what was returned. [J]"]
    energy_band: Annotated[
        Number, "Half width of its band of 90 %; None where it is not known. [J]"
    ]
    peak_grid_power: Annotated[Number, "Highest predicted power. [W]"]
    predicted_energy_at_meter: Annotated[Number, "Predicted energy over the compared time. [J]"]
    measured_energy: Annotated[
        Number, "Over the compared time; None where nothing was measured. [J]"
    ]
    compared_time: Annotated[float, "Time that meter and prediction cover. [s]"]


class ReplayReport(EnergyReport, name="replay"):
    """Where the energy of a recording went."""

    bag: Annotated[str, "The bag."]
    origin: Annotated[str | None, "Where the recording comes from, as its writer said."]
    topics: Annotated[Topics, "The topics read."]
    time: Annotated[ObservedTime, "What part of the recording is predicted."]
    comparison: Annotated[MeterComparison, "Predicted and measured over the same intervals."]
    shaft: Annotated[ShaftComparison | None, "Shaft energies; None where the effort was not used."]
    payload: Annotated[
        PayloadHistory | None, "Payloads set at run time; None where there is no such topic."
    ]
    inputs: Annotated[dict[str, InputAccount], "Account of every input by its name."]
    compared_with: Annotated[
        "ReplayReport | None", "A second replay of the same bag, with fixed friction."
    ] = None
    jobs: Annotated[tuple[JobFigures, ...], "Jobs and cycles, in order of time."] = ()
    condition: Annotated[
        ConditionReport | None, "What was learned; None if nothing is learned."
    ] = None
    auxiliary: Annotated[
        AuxiliaryReport | None, "Loads outside of the cabinet; None where the model has none."
    ] = None


def replay_report(
    result: Replay, change: str | None = None, compared_with: ReplayReport | None = None
) -> ReplayReport:
    account, topics = result.account, result.topics
    learner = result.pipeline.condition
    temperature = result.pipeline.friction.latest().motor_temperature_degc[0].tolist()
    gears = np.where(learner.thermal.gears, learner.thermal.friction_degc, np.nan).tolist()
    common = common_figures(account, result.model, temperature, change, gears)
    inputs, auxiliary = _inputs(result), auxiliary_report(result.account.auxiliary)
    names, calibration = result.model.joint_names, account.calibration
    jobs = tuple(_job(interval_fields(one, names, calibration)) for one in result.jobs.closed)
    time, torque = account.registers.time, result.pipeline.torque
    return ReplayReport(
        **common,
        normalised=normalised_energy(
            result.work, common["energy"].net, [(one.name, one.energy) for one in jobs]
        ),
        bag=str(result.bag),
        origin=result.origin or None,
        topics=replace(
            topics, joint_states=topics.joint_states or (), temperatures=topics.temperatures or ()
        ),
        time=ObservedTime(
            *(time.start_ns, time.end_ns, time.span_ns, time.observed_ns, time.gap_ns),
            *(time.gap_count, time.jumps, time.coverage, time.observed_ns * NANOSECOND),
        ),
        comparison=comparison_of(account, result.model, result.power_error),
        shaft=None if result.effort is EffortMeaning.NONE else _shaft(result),
        payload=PayloadHistory(
            tuple(result.payload.changes), len(torque.coming_payloads), torque.robot.payload_mass
        )
        if topics.payload
        else None,
        inputs=inputs,
        problems=(
            *result.problems,
            *unbalanced(common["energy"]),
            *(
                f"the account of {name.replace('_', ' ')} does not balance"
                for name, account_ in inputs.items()
                if not account_.balanced
            ),
            *missing_sentences(auxiliary),
        ),
        notes=(*result.notes, *_notes(result)),
        compared_with=compared_with,
        jobs=jobs,
        condition=condition_report(learner, result.model) if learner.learns else None,
        auxiliary=auxiliary,
    )


def _job(row: dict[str, Any]) -> JobFigures:
    row["energy"] = row["predicted_import_energy"] - row["predicted_return_energy"]
    keys = (
        *("name", "start_ns", "end_ns", "observed_time", "gap_time", "energy"),
        *("predicted_energy_band", "predicted_peak_power", "predicted_energy_at_meter"),
        *("measured_energy", "comparison_time"),
    )
    return JobFigures(*(row[key] for key in keys))


def _shaft(result: Replay) -> ShaftComparison:
    shaft, observed_ns = result.account.shaft, result.account.registers.time.observed_ns
    names = ("measured_positive", "measured_negative", "predicted_positive", "predicted_negative")
    rows = zip(*(shaft.joints(name).tolist() for name in names), strict=True)
    joints: list[JointShaft] = []
    for index, (name, row) in enumerate(zip(result.model.joint_names, rows, strict=True)):
        out, back, predicted_out, predicted_back = row
        compared_ns = int(shaft.compared_ns[index])
        error = (predicted_out - predicted_back) - (out - back)
        turnover = out + back  # a motor that returns what it took has no net energy to refer to
        joints.append(
            JointShaft(
                name,
                compared_ns * NANOSECOND,
                compared_ns / observed_ns if observed_ns else None,
                out,
                back,
                predicted_out,
                predicted_back,
                error,
                error / turnover if turnover > 0 else None,
            )
        )
    return ShaftComparison(str(result.effort), tuple(joints))


def _inputs(result: Replay) -> dict[str, InputAccount]:
    accounts = {
        "joint_state_messages": result.joint_states.rejections,
        "temperature_messages": result.temperatures.rejections,
        "temperature_values": result.pipeline.friction.rejections,
        "meter_messages": result.meter.rejections,
        "meter_readings": result.account.comparison.curve.rejections,
    }
    if result.topics.payload:
        accounts["payload_messages"] = result.payload.rejections
    for name, load in result.auxiliary.items():
        for what, reader in (("meter", load.meter), ("state", load.state)):
            if reader is not None:
                accounts[f"{name}_{what}_messages"] = reader.rejections
    found: dict[str, InputAccount] = {}
    for name, account in accounts.items():
        rejected = {reason: count for reason, count in sorted(account.rejected.items()) if count}
        balanced = account.received == account.accepted + sum(rejected.values())
        found[name] = InputAccount(account.received, account.accepted, rejected, balanced)
    return found


def _notes(result: Replay) -> list[str]:
    notes: list[str] = []
    account, topics = result.account, result.topics
    if not topics.meter:
        notes.append("no power meter was read: nothing was measured")
    elif not account.comparison.compared_ns:
        notes.append("no reading of the power meter covers any of the predicted time")
    notes += [result.meter.refused] if result.meter.refused else []
    notes += account.judgement.findings(account.comparison, ended=True)
    lag = account.comparison.response.sentence
    notes += [lag] if lag else []
    learned = float(account.counts.learned_energy_sum.joule[0])
    if learned > 0.0:
        share = learned / account.registers.cabinet("grid_import")
        notes.append(
            f"{share:.0%} of the predicted energy was corrected by what was learned of the meter, "
            "or of torque (learning: apply): its errors are not those of the model file"
        )
    counter = account.comparison.curve.counter
    if counter.resets:
        notes.append(
            f"the counter of the meter was reset {counter.resets} times, last at stamp "
            f"{(counter.reset_ns or 0) * NANOSECOND:.3f}; nothing counts across a reset"
        )
    if not topics.temperatures:
        notes.append(
            "no motor temperatures: friction at the model's fallback of "
            f"{result.model.temperature.fallback_degc:g} degC"
        )
    else:
        ahead_ns = result.temperatures.ahead_ns(result.joint_states)
        fallback = result.pipeline.power.fallback_use.sentence(ahead_ns)
        notes += [fallback] if fallback else []
    if result.payload.refused:
        notes.append(f"a payload of the bag was refused: {result.payload.refused}")
    notes += result.jobs.notes(account.registers.time.start_ns)
    ignored = result.joint_states.ignored_joints
    if ignored:
        notes.append(f"joints that the model does not know: {', '.join(sorted(ignored))}")
    foreign = result.temperatures.ignored_joints - ignored
    if foreign:
        notes.append(f"temperatures of unknown joints: {', '.join(sorted(foreign))}")
    notes += mimic_remarks(parse(result.model.urdf_xml))
    notes += [finding.sentence for finding in result.joint_states.findings()]
    covered = account.registers.time.coverage
    if covered < LITTLE:
        notes.append(
            f"only {covered:.2%} of the recorded time is predicted: the inputs say what was refused"
        )
    jumps = account.registers.time.jumps
    if jumps:
        notes.append(f"stamps jumped back {jumps} times; no energy counts across a jump")
    return notes
