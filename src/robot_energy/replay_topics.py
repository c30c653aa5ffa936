"""Which topics of a bag a replay reads."""

from __future__ import annotations

from dataclasses import dataclass

from robot_energy.bag import BagReader
from robot_energy.errors import BagError, MissingTopicError
from robot_energy.inputs.bag_topics import (
    named_sources,
    possible_temperatures,
    resolve,
    sources_by_type,
    topics_of_other_robots,
)
from robot_energy.inputs.joint_states.joint_states import JOINT_STATE
from robot_energy.inputs.sources import Inputs, TemperatureSource
from robot_energy.messages.payload import PAYLOAD


@dataclass(frozen=True)
class Topics:
    """Which topics of a bag to use; None means to find them by their type.

    Attributes:
        joint_states: Topics of the joint states; several where each brings some joints.
        temperatures: Topics of motor temperatures; empty for none.
        meter: The topic of the power meter.
        payload: The topic of payloads set at run time; empty for none.
    """

    joint_states: tuple[str, ...] | None = None
    temperatures: tuple[str, ...] | None = None
    meter: str | None = None
    payload: str | None = None


def find_topics(bag: BagReader, wanted: Topics, inputs: Inputs | None = None) -> Topics:
    """Find the topics to use in a bag.

    Args:
        bag: An open bag.
        wanted: What the user named.
        inputs: Inputs of the node that the bag is to be read like; None to go by types.

    Returns:
        The topics; ``payload`` stays None where there is none, and those of temperatures
        and meter are as the user named them.

    Raises:
        BagError: If the bag is damaged from its first message on.
        MissingTopicError: If a named topic is absent or of another type, or the joint
            states cannot be found without a name.
    """
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
    if not joints:
        found = _one(
            bag,
            None,
            (JOINT_STATE,),
            "joint states",
            "--joint-states, or as joint_states.topics in a parameter file (--inputs)",
        )
        joints = () if found is None else (found,)
    if not joints:
        raise MissingTopicError(
            f"{bag.path} has no topic of joint states",
            f"a topic of type {JOINT_STATE}",
            f"it has {', '.join(sorted(bag.topics)) or 'no topics'}",
        )
    payload = None
    if wanted.payload != "":
        payload = _one(bag, wanted.payload, (PAYLOAD,), "payloads", "--payload")
    return Topics(joints, wanted.temperatures, wanted.meter, payload)


def find_temperatures(
    bag: BagReader, wanted: Topics, inputs: Inputs | None
) -> tuple[dict[str, TemperatureSource], list[str]]:
    """Find the sources of motor temperatures in a bag.

    Args:
        bag: An open bag.
        wanted: What the user named.
        inputs: Inputs of the node that the bag is to be read like; None to go by types.

    Returns:
        The sources by name, and what the user should know of them.

    Raises:
        MissingTopicError: If a named topic is absent or of another type.
    """
    if inputs is not None and wanted.temperatures is None:
        return named_sources(bag, inputs.temperature_sources)
    foreign = topics_of_other_robots(bag, wanted.joint_states or ())
    sources = sources_by_type(bag, wanted.temperatures, foreign)
    if sources or wanted.temperatures is not None:
        return sources, []
    left_out = [
        f"{topic} is not used: other joint states have its namespace; name it with --temperatures "
        "if it is this robot's"
        for topic in sources_by_type(bag)
    ]
    return sources, [
        *left_out,
        *(
            f"{topic} ({bag.topics[topic].msgtype}) may hold motor temperatures; say what it means "
            "in a parameter file and name that with --inputs"
            for topic in possible_temperatures(bag)
        ),
    ]


def _one(
    bag: BagReader, name: str | None, types: tuple[str, ...], what: str, option: str
) -> str | None:
    if name is not None:
        bag.require(name, types)
        return name
    found = sorted(topic for topic, info in bag.topics.items() if info.msgtype in types)
    if len(found) > 1:
        raise MissingTopicError(
            f"{bag.path} has several topics of {what}: {', '.join(found)}",
            "one",
            f"name it with {option}",
        )
    return found[0] if found else None
