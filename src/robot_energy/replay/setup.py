"""A replay as it is set up, by options of verbs or by the library; which topics it reads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, TypeVar

from robot_energy.accounting.record import Calibrated
from robot_energy.bag import BagReader
from robot_energy.bag.reader import TimeRange
from robot_energy.condition.learner import ConditionRecord
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import BagError, MissingTopicError, ParameterError
from robot_energy.inputs.bag_topics import resolve
from robot_energy.inputs.inputs_file import read_inputs
from robot_energy.inputs.joint_states.decode import JOINT_STATE
from robot_energy.inputs.sources import Inputs, JointStateSource
from robot_energy.messages.payload import PAYLOAD
from robot_energy.model import RobotModel, load
from robot_energy.pipeline import Settings
from robot_energy.presets import ROBOTS
from robot_energy.replay.options import NONE, ReplayOptions
from robot_energy.replay.recorded_jobs import Job, load_jobs
from robot_energy.timeline.blocks import EffortMeaning, Learning

Member = TypeVar("Member", bound=StrEnum)
ModelName = str | Path | RobotModel  # a model, its file, or the name of a shipped one


def model_of(model: ModelName) -> RobotModel:
    return model if isinstance(model, RobotModel) else load(model)


def effort_meaning(effort: str) -> EffortMeaning:
    return member_named(EffortMeaning, "effort", effort)


def member_named(kind: type[Member], what: str, name: str) -> Member:
    if name not in tuple(kind):
        raise ParameterError(f"{what} is '{name}'", f"one of {', '.join(kind)}")
    return kind(name)


def driver_inputs(path: str | Path | None, robot: str | None) -> tuple[Inputs | None, list[str]]:
    """Return the inputs of a robot in `ROBOTS`, those of a file over them, and misspelt names."""
    if robot is None:
        return (None, []) if path is None else read_inputs(path)
    preset = ROBOTS[robot]
    return read_inputs(preset.inputs) if path is None else read_inputs(path, preset)


class Topics(Described):
    """Which topics of a bag to use; None means to find them by their type."""

    joint_states: Annotated[
        tuple[str, ...] | None, "Topics of the joint states; several where each brings some joints."
    ] = None
    temperatures: Annotated[
        tuple[str, ...] | None, "Topics of motor temperatures; empty for none."
    ] = None
    meter: Annotated[str | None, "The topic of the power meter."] = None
    payload: Annotated[str | None, "The topic of payloads set at run time; empty for none."] = None


def find_topics(bag: BagReader, wanted: Topics, inputs: Inputs | None = None) -> Topics:
    """Return the topics to use in a bag; those of temperatures and meter stay as named."""
    if not bag.topics and bag.problems:
        raise BagError(
            f"{bag.path} holds no message that can be read: {bag.problems[0]}",
            "a whole bag",
            "copy it again; a recorder that is killed loses what it has not written yet",
        )
    joints = wanted.joint_states or ()
    if not joints and inputs is not None:
        full = [resolve(bag, topic) for topic in inputs.joint_states.topics]
        joints = tuple(topic for topic in full if topic is not None)
    for topic in joints:
        bag.require(topic, (JOINT_STATE,))
    option = "--joint-states, or as joint_states.topics in a parameter file (--inputs)"
    joints = joints or _found(bag, JOINT_STATE, "joint states", option)
    if not joints:
        raise MissingTopicError(
            f"{bag.path} has no topic of joint states",
            f"a topic of type {JOINT_STATE}",
            f"it has {', '.join(sorted(bag.topics)) or 'no topics'}",
        )
    payload = wanted.payload or None
    if payload is not None:
        bag.require(payload, (PAYLOAD,))
    elif wanted.payload is None:
        payload = next(iter(_found(bag, PAYLOAD, "payloads", "--payload")), None)
    return Topics(joints, wanted.temperatures, wanted.meter, payload)


def _found(bag: BagReader, msgtype: str, what: str, option: str) -> tuple[str, ...]:
    """The topic of a type; none where the bag has none."""
    found = sorted(topic for topic, info in bag.topics.items() if info.msgtype == msgtype)
    if len(found) > 1:
        raise MissingTopicError(
            f"{bag.path} has several topics of {what}: {', '.join(found)}",
            "one",
            f"name it with {option}",
        )
    return tuple(found)


GAPS = ("max_gap", "meter_max_gap")


@dataclass(frozen=True, kw_only=True)
class ReplaySetup:
    """What is read of a bag and how, and what is made of it; see `ReplayOptions` for the rest.

    Attributes:
        topics: Topics to use where they cannot be found by type.
        inputs: What the inputs of a live monitor are, to read the bag in the same way.
        states: What the joint states mean, instead of what ``inputs`` says of them.
        time_range: Part of the bag; None for all. Temperatures are read from as long before it as
            they stay in use, payloads from the beginning.
        calibration: Of the bands, from an earlier account of the same model and meter.
    """

    topics: Topics = field(default_factory=Topics)
    settings: Settings = field(default_factory=Settings)
    inputs: Inputs | None = None
    notes: tuple[str, ...] = ()
    states: JointStateSource | None = None
    time_range: TimeRange | None = None
    jobs: Sequence[Job] = ()
    learned: ConditionRecord | None = None
    calibration: Calibrated | None = None
    processes: int = 1
    out: str | Path | None = None
    overwrite: bool = False
    progress: Callable[[float], None] | None = None

    @classmethod
    def of(cls, options: ReplayOptions) -> ReplaySetup:
        """Return what options mean; without ``power_period`` there are no means unless needed."""
        given: dict[str, Any] = {key: one for key, one in options.items() if one is not None}

        def chosen(*names: str) -> dict[str, Any]:
            return {name: given[name] for name in names if name in given}

        inputs, notes = driver_inputs(given.get("inputs"), given.get("robot"))
        states = JointStateSource() if inputs is None else inputs.joint_states
        gaps = {} if inputs is None else {name: getattr(inputs, name) for name in GAPS}
        joints, heat = (_topics(given.get(name)) for name in ("joint_states", "temperatures"))
        payload = given.get("payload")
        return cls(
            topics=Topics(
                joint_states=joints or None,
                temperatures=heat and tuple(topic for topic in heat if topic != NONE),
                meter=given.get("meter"),
                payload="" if payload == NONE else payload,
            ),
            settings=Settings(
                power_period=given.get("power_period"),
                effort=effort_meaning(given.get("effort") or states.effort_meaning),
                learning=member_named(Learning, "learning", given.get("learning", "observe")),
                **{**gaps, **chosen("derivative_window", *GAPS)},
            ),
            inputs=inputs,
            notes=tuple(notes),
            states=replace(states, **chosen("stamp_source", "reorder_window")),
            time_range=TimeRange(given.get("start"), given.get("end")),
            jobs=load_jobs(given["jobs"]) if "jobs" in given else (),
            **chosen("learned", "processes", "out", "overwrite", "progress"),
        )


def _topics(names: str | Sequence[str] | None) -> tuple[str, ...] | None:
    return (names,) if isinstance(names, str) else None if names is None else tuple(names)
