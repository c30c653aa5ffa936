"""Replay of a bag through the same pipeline that runs live."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import closing, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.auxiliary import AuxiliaryAccount
from robot_energy.accounting.energy_curve import EnergyCurve, add_compared, add_means
from robot_energy.accounting.registers import MAX_ENERGY
from robot_energy.bag import BagReader
from robot_energy.bag.mcap_records import LogTimes
from robot_energy.bag.metadata import foreign_entries
from robot_energy.bag.reader import TimeRange
from robot_energy.certainty.prediction_errors import PowerErrorSums
from robot_energy.foundation.errors import BagError, UnknownJointError
from robot_energy.foundation.files.output_folder import check_folder
from robot_energy.foundation.units import SECOND_NS
from robot_energy.inputs.bag_topics import (
    find_auxiliary,
    find_meter,
    find_temperatures,
    topics_of_other_robots,
)
from robot_energy.inputs.joint_states.decode import RecordedTime
from robot_energy.inputs.joint_states.joint_states import JointStateIngest
from robot_energy.inputs.meter.meter import MeterIngest
from robot_energy.inputs.remedies import NO_REASON, REFUSED
from robot_energy.inputs.sources import JointStateSource, names_remedy
from robot_energy.inputs.temperatures.temperatures import TemperatureIngest
from robot_energy.messages.payload import PayloadReader
from robot_energy.model import RobotModel, load, shipped_models
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.torque_limits import TorqueLimitWatch
from robot_energy.pipeline import EnergyPipeline, Output, Settings
from robot_energy.pipeline.torque_stage import PayloadChange
from robot_energy.pipeline.work_sums import WorkSums
from robot_energy.replay.energy_bag import EnergyBagWriter
from robot_energy.replay.read_ahead import can_read_ahead, read_ahead
from robot_energy.replay.recorded_jobs import RecordedJobs
from robot_energy.replay.replay_steps import BagInputs, LoadIngest, read_steps, torque_steps
from robot_energy.replay.setup import ReplaySetup, Topics, find_topics
from robot_energy.timeline.blocks import NANOSECOND, EffortMeaning
from robot_energy.timeline.pieces import Compared

MAX_STRAY = 0.1  # share of the temperatures of another clock, beyond which friction is not known
LONGER_WINDOW = "lengthen derivative_window, or check units, payload and limits"
Progress = Callable[[float], None]


@dataclass
class Replay:
    """What a replay gave.

    Attributes:
        payload: Accounting of the payloads set at run time, and the changes.
        problems: What was wrong with the bag, one sentence each.
        notes: What a user should know of the inputs, one sentence each.
        predicted_curve: Predicted energy from the grid over time, where curves were asked for.
        compared_curve: Energy at the meter over time, likewise: measured, predicted as the meter
            shows it, and drawn; the sums of the first and the last are those of the comparison.
        power_error: Predicted minus measured power at the meter, from reading to reading.
        origin: Where the recording comes from, as its writer said; empty if it did not.
        auxiliary: Accounting of meters and states of auxiliary loads, by load.
        work: Path of the tool and work on the bodies.
    """

    bag: Path
    model: RobotModel
    topics: Topics
    joint_states: JointStateIngest
    temperatures: TemperatureIngest
    meter: MeterIngest
    payload: PayloadReader
    effort: EffortMeaning
    pipeline: EnergyPipeline
    work: WorkSums
    problems: list[str] = field(default_factory=list[str])
    notes: list[str] = field(default_factory=list[str])
    predicted_curve: EnergyCurve | None = None
    compared_curve: EnergyCurve | None = None
    power_error: PowerErrorSums = field(default_factory=PowerErrorSums)
    origin: str = ""
    jobs: RecordedJobs = field(default_factory=lambda: RecordedJobs(()))
    auxiliary: dict[str, LoadIngest] = field(default_factory=dict[str, LoadIngest])

    @property
    def account(self) -> EnergyAccount:
        return self.pipeline.account


def replay(
    path: str | Path,
    model: RobotModel,
    setup: ReplaySetup | None = None,
    *,
    on_output: Callable[[Output], None] | None = None,
    on_reading: Callable[[EnergyAccount, int], None] | None = None,
    keep_curves: bool = False,
    on_compared: Callable[[Compared], None] | None = None,
) -> Replay:
    """Return the energy account of a bag, and the rejection log of every input.

    Args:
        setup: What is read and how; None: all, found by its type.
        on_output: Called with what each step of the pipeline gave, for identification.
        on_reading: Called with the account, and the UTC minute up to which it has counted all
            samples or 0, as `EnergyAccount.on_reading`, and at the end.
        keep_curves: Whether to return energies over time for plots (in bounded memory).
        on_compared: Called with what became comparable with the meter, before `on_output` of the
            same step.
    """
    setup = setup or ReplaySetup()
    settings, inputs, processes = setup.settings, setup.inputs, setup.processes
    if setup.out is not None or keep_curves:  # which need means
        settings = replace(settings, power_period=settings.power_period or Settings.power_period)
    elif on_output is None:
        settings = replace(settings, power_period=None)  # nobody would see the means
    bag = BagReader(path)
    used = find_topics(bag, setup.topics, inputs)
    foreign = topics_of_other_robots(bag, used.joint_states or ())
    given = inputs.temperature_sources if inputs is not None else None
    sources, notes = find_temperatures(bag, used.temperatures, given, foreign)
    loads = model.auxiliary or ()
    loaded, unread = find_auxiliary(bag, loads, inputs)
    others = {topic for load in loaded.values() for topic in load.topics}
    stated = inputs.meter if inputs is not None else None
    source, more = find_meter(bag, used.meter, stated, others, foreign)
    meter = MeterIngest(source, bag.typestore)
    pipeline = EnergyPipeline(model, settings.with_meter(*meter.source.limits))
    if loads:
        pipeline.account.auxiliary = AuxiliaryAccount(loads, loaded, settings.meter_max_gap)
    if setup.learned is not None:
        pipeline.condition.restore(setup.learned)
    temperatures = TemperatureIngest(
        model.joint_names, sources, bag.typestore, model.temperature.stale_after
    )
    result = Replay(
        bag=Path(path),
        model=model,
        topics=replace(
            used,
            temperatures=tuple(temperatures.topics),
            meter=" and ".join(source.topics) if source else None,
        ),
        joint_states=JointStateIngest(
            model.joint_names,
            bag.typestore,
            limits=pipeline.torque.robot.limits,
            effort=settings.effort is not EffortMeaning.NONE,
            source=setup.states or (JointStateSource() if inputs is None else inputs.joint_states),
            max_gap=settings.max_gap,
            recorded=RecordedTime(),
        ),
        temperatures=temperatures,
        meter=meter,
        payload=PayloadReader(pipeline.torque.set_payload, bag.typestore),
        effort=settings.effort,
        pipeline=pipeline,
        work=WorkSums(pipeline.torque.robot),
        origin=bag.origin,
        notes=[*setup.notes, *notes, *more, *unread],
        jobs=RecordedJobs(setup.jobs),
        auxiliary={name: LoadIngest(load, bag.typestore) for name, load in loaded.items()},
    )
    if keep_curves:
        result.predicted_curve, result.compared_curve = EnergyCurve(1), EnergyCurve(3)

    def take(compared: Compared) -> None:
        result.power_error.step(compared)
        if on_compared is not None:
            on_compared(compared)
        if result.compared_curve is not None:
            add_compared(result.compared_curve, compared)

    limit_watch = TorqueLimitWatch(pipeline.torque.robot.limits, Drivetrain.from_model(model))
    pipeline.account.on_compared = take
    if setup.calibration is not None:
        pipeline.account.calibrate(setup.calibration)
    if on_reading is not None:
        pipeline.account.on_reading = partial(on_reading, pipeline.account)
    writer = None
    if setup.out is not None:
        check_folder(setup.out, foreign_entries, setup.overwrite, (path,), BagError)
        writer = EnergyBagWriter(setup.out, setup.overwrite, model, bag.origin, Path(path))
    if processes > 1 and not can_read_ahead():
        result.notes.append("this system cannot fork processes: the bag was read by one")
        processes = 1
    with writer or nullcontext():
        spans = _spans(bag, result, setup.time_range) if setup.time_range else {}
        changes: list[PayloadChange] = []
        with closing(
            _outputs(bag, result, spans, replace(setup, processes=processes), on_output is not None)
        ) as outputs:
            for output, more in outputs:
                result.jobs.step(pipeline.account)
                changes += more
                result.work.take(output)
                if output.torque is not None:
                    limit_watch.step(output.torque)
                if writer is not None:
                    writer.write(output, pipeline.account, changes)
                if result.predicted_curve is not None and output.means is not None:
                    add_means(result.predicted_curve, output.means)
                if on_output is not None:
                    on_output(output)
        result.jobs.finish(pipeline.account)
        pipeline.account.on_compared = None
        clocks = result.temperatures.clock_doubts(result.joint_states)
        used = pipeline.power.fallback_use
        torn = result.temperatures.refused_share > MAX_STRAY
        torn &= used.missing + used.stale > MAX_STRAY * used.samples
        (result.problems if torn else result.notes).extend(clocks)
        result.notes += result.temperatures.doubts
        result.notes += [refused] if (refused := pipeline.friction.refused) else []
        result.notes += [*result.meter.clock_doubts(), *pipeline.torque.effort_check.doubts()]
        result.notes += [f"{one}: {LONGER_WINDOW}" for one in limit_watch.sentences().values()]
        _require_samples(result)
        _require_prediction(result)
        if on_reading is not None:
            on_reading(pipeline.account, 0)
        _cover_recording(result)
    return result


def _outputs(
    bag: BagReader,
    result: Replay,
    spans: dict[str, LogTimes],
    setup: ReplaySetup,
    observed: bool,
) -> Generator[tuple[Output, tuple[PayloadChange, ...]]]:
    """Run the stages; yield what each step gave, and the payloads that were set in it."""
    pipeline, written = result.pipeline, setup.out is not None
    inputs = BagInputs(result.joint_states, result.temperatures, result.meter, [], result.auxiliary)
    steps = read_steps(bag, inputs, result.topics, spans, written, result.jobs)
    if setup.processes > 2:
        steps = read_ahead(steps)
    steps = torque_steps(steps, pipeline.torque, result.payload, written or observed)
    if setup.processes > 1:
        steps = read_ahead(steps)
    with closing(steps):
        for step in steps:
            if pipeline.account.auxiliary is not None:
                for name, (readings, states) in step.auxiliary.items():
                    pipeline.account.auxiliary.take(name, readings, states)
            if step.inputs is None or step.stages is None:
                output = pipeline.step(
                    torque=step.torque, temperatures=step.temperatures, meter=step.meter
                )
                yield output, step.changes
            else:  # as they are in the process that has read
                read = step.inputs
                result.joint_states, result.temperatures = read.joint_states, read.temperatures
                result.meter, result.problems = read.meter, read.problems
                result.auxiliary = read.auxiliary
                pipeline.torque, result.payload = step.stages
                yield pipeline.finish(step.torque), step.changes
            if setup.progress is not None and step.share is not None:
                setup.progress(step.share)


def _spans(bag: BagReader, result: Replay, time_range: TimeRange) -> dict[str, LogTimes]:
    """From when to when each topic is read; payloads are few, and hold until the next one."""
    first, last = time_range.span(bag)
    result.notes.append(time_range.sentence(bag))
    topics = result.topics
    earlier = first - round(result.model.temperature.stale_after * SECOND_NS)
    metered = result.meter.source.topics if topics.meter else ()
    loads = [
        (r.source.topics, 0 if r is load.state else first)
        for load in result.auxiliary.values()
        for r in load.readers
    ]
    return {
        **{topic: (since, last) for read, since in loads for topic in read},
        **dict.fromkeys((*(topics.joint_states or ()), *metered), (first, last)),
        **dict.fromkeys(topics.temperatures or (), (earlier, last)),
        **({topics.payload: (0, last)} if topics.payload else {}),
    }


def _require_samples(result: Replay) -> None:
    """Refuse to report on a bag that gave not one usable joint state."""
    ingest = result.joint_states
    if ingest.samples:
        return
    topic = ", ".join(result.topics.joint_states or ())
    if ingest.missing_joints:
        named = ingest.ignored_joints
        fitting = [name for name in shipped_models() if {*load(name).joint_names} <= {*named}]
        remedy = names_remedy(result.model.joint_names, named)
        if fitting:
            remedy = f"these are the joints of the shipped model {' and '.join(fitting)}: use it"
        raise UnknownJointError(
            f"no message of {topic} has the joint(s) {', '.join(sorted(ingest.missing_joints))}",
            f"the joints of the model, {' or '.join(', '.join(one) for one in ingest.known_names)}",
            f"the messages name {', '.join(sorted(named)) or 'fewer joints'}; {remedy}",
        )
    if not ingest.rejections.received:
        why = f"; {result.problems[0]}" if result.problems else ""
        raise BagError(f"{result.bag} holds no message of {topic}{why}", "a recording in motion")
    raise _unusable(result, f"none of the {ingest.rejections.received} messages of {topic}")


def _require_prediction(result: Replay) -> None:
    """Refuse to report on a bag without a stretch of time that is predicted: 0 J is a result."""
    ingest, account = result.joint_states, result.account
    if account.registers.time.observed_ns:
        return
    topic = ", ".join(result.topics.joint_states or ())
    received, samples = ingest.rejections.received, ingest.samples
    if samples == 1:
        raise _unusable(result, f"only one of the {received} messages of {topic}")
    if ingest.order.gaps + ingest.order.jumps >= samples - 1:
        if ingest.rejections.rejected.total() > samples:
            raise _unusable(result, f"only {samples} of the {received} messages of {topic}, apart,")
        raise BagError(
            f"a gap lies between all {samples} joint states of {topic}: nothing is predicted",
            f"steps of at most {ingest.order.longest_gap_ns * NANOSECOND:.3g} s",
            "check the unit of their times, or set max_gap",
        )
    raise BagError(
        f"no power is predicted: that of all {samples} joint states of {topic} is not finite, or "
        f"more than {MAX_ENERGY:.0e} J between two of them",
        "joint states and a model of one robot",
        "check the units of the joint states, and limits and figures of the model",
    )


def _cover_recording(result: Replay) -> None:
    """Let the account span all that was recorded: what was refused at either end is a gap."""
    time, ingest = result.account.registers.time, result.joint_states
    if time.start_ns is not None and time.end_ns is not None and ingest.recorded is not None:
        longest = ingest.order.longest_gap_ns
        ends = ingest.recorded.unused_ns(time.start_ns, time.end_ns)
        time.surround(*(unused if unused > longest else 0 for unused in ends))


def _unusable(result: Replay, which: str) -> BagError:
    """Return that so many messages only can be used, for what most of the others are refused."""
    counts = result.joint_states.rejections.rejected.most_common()
    reasons = ", ".join(f"{count} {name}" for name, count in counts)
    expected, remedy = REFUSED.get(counts[0][0] if counts else "", NO_REASON)
    return BagError(
        f"{which} can be used" + (f" ({reasons})" if reasons else ""),
        expected if counts else "at least two, without a gap between them",
        remedy if counts else "record longer",
    )
