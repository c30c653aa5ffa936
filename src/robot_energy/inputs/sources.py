"""What the inputs are: topics, types, units and meanings, the same live and in replay.

A new kind of source is one dataclass here, one ``...Inputs`` class with a `group` or
`named_groups` field, and its name among the bases of `Inputs`; nodes then
declare its parameters, and the parameter file of the node serves replay.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import yaml

from robot_energy.foundation.errors import ParameterError
from robot_energy.inputs.auxiliary import AuxiliaryInputs
from robot_energy.inputs.joint_states.correction import JointCorrection
from robot_energy.inputs.meter.source import MeterInputs
from robot_energy.inputs.parameters import (
    HEADER,
    MESSAGES,
    POSITIONS,
    RECEIVE,
    group,
    named_groups,
    parameter,
    setting,
)
from robot_energy.inputs.temperatures.kinds import (
    MOTOR_TEMPERATURES,
    TEMPERATURE_KINDS,
    TemperatureKind,
)
from robot_energy.timeline.blocks import EffortMeaning
from robot_energy.timeline.stamps import BY_PERIOD, checked_max_gap

NO_JOINT = "-"  # a place of an array that is none of the model's joints


@dataclass(frozen=True, kw_only=True)
class JointStateSource:
    """The topics that bring joint states, and what the messages mean."""

    topics: tuple[str, ...] = setting("joint_states", ("joint_states",))
    joint_names: tuple[str, ...] = parameter(
        "What the messages call the joints of the model, in the order of the model. Empty: as "
        "the model does.",
        (),
    )
    stamp_source: str = setting("stamp_source", HEADER)
    velocity_source: str = parameter(
        "Where velocities come from: the messages, or the positions for drivers whose velocities "
        "stay 0 or step. They come from the positions anyway where messages have none.",
        MESSAGES,
        choices=(MESSAGES, POSITIONS),
    )
    reorder_window: float = setting("reorder_window", 0.0)
    max_velocity_ratio: float = parameter(
        "Joint states in which a joint is faster than this many times its velocity limit in the "
        "URDF are refused, unless its positions confirm the velocity [-].",
        3.0,
        (1.0, 1e6),
    )
    effort_meaning: str = setting("effort", str(EffortMeaning.NONE))
    position: JointCorrection = group(JointCorrection)
    velocity: JointCorrection = group(JointCorrection)
    effort: JointCorrection = group(JointCorrection)

    def __post_init__(self) -> None:
        if not self.topics:
            raise ParameterError("topics is empty", "at least one topic")
        if len(set(self.topics)) < len(self.topics):
            raise ParameterError("topics has a topic twice", "each topic once")
        if len(set(self.joint_names)) < len(self.joint_names):
            raise ParameterError("joint_names has a name twice", "each name once")

    def names_of(self, joints: Sequence[str]) -> tuple[str, ...]:
        """Return what the messages call the joints of a model."""
        if self.joint_names and len(self.joint_names) != len(joints):
            raise ParameterError(
                f"joint_states.joint_names has {len(self.joint_names)} names",
                f"{len(joints)}, one for each joint of the model: {', '.join(joints)}",
                "name all joints in the order of the model, or leave it empty",
            )
        return self.joint_names or tuple(joints)

    def corrections_of(self, joints: Sequence[str]) -> tuple[JointCorrection | None, ...]:
        """Return what corrects position, velocity and effort of a model's joints; None: nothing."""
        found = {"position": self.position, "velocity": self.velocity, "effort": self.effort}
        for name, correction in found.items():
            correction.check(joints, f"joint_states.{name}")
        nothing = JointCorrection()
        return tuple(None if each == nothing else each for each in found.values())


def fitting_names(joints: Sequence[str], met: Collection[str]) -> list[str]:
    """Return the names that end as the joints of a model, in its order; empty unless each has one.

    Args:
        joints: Those of the model.
        met: What messages name and the model does not know.
    """
    alike = [[name for name in met if name.endswith(joint)] for joint in joints]
    return [one[0] for one in alike] if all(len(one) == 1 for one in alike) else []


def names_remedy(joints: Sequence[str], met: Collection[str]) -> str:
    """Return what to do where messages lack joints of a model; arguments as of `fitting_names`."""
    names = fitting_names(joints, met)
    remedy = "use the model of this robot, or set joint_states.joint_names"
    line = yaml.safe_dump(names, default_flow_style=True, width=math.inf, allow_unicode=True)
    return f"{remedy} to {line.strip()}" if names else remedy


@dataclass(frozen=True, kw_only=True)
class TemperatureSource:
    """A topic, or a pair of topics, that brings motor temperatures."""

    topic: str = parameter("Topic of the messages.", "motor_temperatures")
    type: str = parameter("Type of the messages.", MOTOR_TEMPERATURES, choices=TEMPERATURE_KINDS)
    unit: str = parameter("Unit of the values.", "degc", choices=("degc", "kelvin", "fahrenheit"))
    scale: float = parameter(
        "Factor on the values, 0.1 for tenths of a degree [-].", 1.0, (1e-9, 1e9)
    )
    joints: tuple[str, ...] = parameter(
        "Joints of the model that the source is for. Float64MultiArray: in the order of its "
        "data, - for a place that is not a joint. Temperature: the one joint of the topic, or "
        "those of names. Empty: as the messages name them.",
        (),
    )
    names: tuple[str, ...] = parameter(
        "What the messages call these joints, in the same order: joint names, the frame ids "
        "of Temperature, the names of the statuses of DiagnosticArray (one for all or one for "
        "each; a * at the end stands for anything). Empty: as the model does.",
        (),
    )
    stamp_source: str = parameter(
        "Where the stamps come from: the header, or the receive time, which is all that "
        "Float64MultiArray has.",
        HEADER,
        choices=(HEADER, RECEIVE),
    )
    interface: str = parameter(
        "Interface of DynamicJointState, or the last part of the keys of Float64Values, "
        "that is a temperature.",
        "temperature",
    )
    names_topic: str = parameter(
        "Topic of the keys of Float64Values; empty for 'names' in the namespace of the topic.", ""
    )
    keys: tuple[str, ...] = parameter(
        "Keys of the values of DiagnosticArray: one for all joints, or one for each.",
        ("temperature",),
    )

    def __post_init__(self) -> None:
        if not self.topic:
            raise ParameterError("topic is empty", "the topic of the messages")
        joints = [name for name in self.joints if name != NO_JOINT]
        repeated = sorted({name for name in joints if joints.count(name) > 1})
        if repeated:
            raise ParameterError(f"joints has {', '.join(repeated)} twice", "each joint once")
        kind = self.reading
        if not self.joints and (self.names or kind.needs_joints):
            given = "names is given" if self.names else f"type is {kind.label}"
            raise ParameterError(
                f"{given} but joints is empty", "the joints of the model, in order"
            )
        if not kind.named and self.names:
            raise ParameterError(f"names is given for {kind.label}", "joints alone")
        if kind.single and len(self.joints) > 1 and not self.names:
            raise ParameterError(
                f"type is {kind.label} and joints names {len(self.joints)}",
                "one joint, or the frame id of each joint in names",
            )
        if kind.by_status:
            _fits("names", self.names or self.joints, self.joints, one_for_all=True)
            _fits("keys", self.keys, self.joints, one_for_all=True)
        elif self.names:
            _fits("names", self.names, self.joints, one_for_all=False)
            if len(set(self.names)) < len(self.names):
                raise ParameterError("names has a name twice", "each name once")

    @property
    def reading(self) -> TemperatureKind:
        """What the type of the messages says of them."""
        return TEMPERATURE_KINDS[self.type]

    @property
    def keys_topic(self) -> str:
        """Topic of the keys of Float64Values; empty for all other types."""
        if not self.reading.keys_type:
            return ""
        folder, slash, _ = self.topic.rpartition("/")
        return self.names_topic or f"{folder}{slash}names"

    @property
    def topics(self) -> dict[str, str]:
        """Type of the messages of each topic."""
        keys = {self.keys_topic: self.reading.keys_type} if self.keys_topic else {}
        return {**keys, self.topic: self.type}

    def resolved(self, resolve: Callable[[str], str]) -> TemperatureSource:
        """Return the source with the full names of its topics."""
        keys = resolve(self.keys_topic) if self.keys_topic else ""
        return replace(self, topic=resolve(self.topic), names_topic=keys)


def _fits(field: str, values: tuple[str, ...], joints: tuple[str, ...], one_for_all: bool) -> None:
    if len(values) == len(joints) or (one_for_all and len(values) == 1):
        return
    expected = f"{len(joints)}, one for each of joints"
    raise ParameterError(
        f"{field} has {len(values)} entries",
        f"1 for all, or {expected}" if one_for_all else expected,
    )


def _together(sources: Mapping[str, TemperatureSource]) -> None:
    """Refuse sources that read one topic as two types, or are the same twice."""
    types: dict[str, str] = {}
    for name, source in sources.items():
        for topic, kind in source.topics.items():
            if types.setdefault(topic, kind) != kind:
                raise ParameterError(
                    f"'{name}' reads {topic} as {kind}, another source as {types[topic]}",
                    "one type for each topic",
                )
    if len(set(sources.values())) < len(sources):
        raise ParameterError(
            f"two of the sources {', '.join(sources)} are the same",
            "sources that differ",
            "set the topic of each",
        )


@dataclass(frozen=True, kw_only=True)
class TemperatureInputs:
    """Parameters of the motor temperatures."""

    temperature_sources: Mapping[str, TemperatureSource] = named_groups(
        TemperatureSource,
        "Sources of motor temperatures: a name for each, which begins the names of its "
        "settings. Empty for none.",
        "motors",
        check=_together,
    )


@dataclass(frozen=True, kw_only=True)
class GapInputs:
    """How long the joint states may be silent, or the torques that follow from them."""

    max_gap: float = setting("max_gap", BY_PERIOD)

    def __post_init__(self) -> None:
        checked_max_gap(self.max_gap)


@dataclass(frozen=True, kw_only=True)
class JointStateInputs(GapInputs):
    """Parameters of the joint states."""

    joint_states: JointStateSource = group(JointStateSource)


@dataclass(frozen=True, kw_only=True)
class Inputs(TemperatureInputs, AuxiliaryInputs, MeterInputs, JointStateInputs):
    """All inputs of a monitor."""
