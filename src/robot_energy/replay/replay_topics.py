"""Which topics of a bag a replay reads."""

from __future__ import annotations

from typing import Annotated

from robot_energy.bag import BagReader
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import BagError, MissingTopicError
from robot_energy.inputs.bag_topics import resolve
from robot_energy.inputs.joint_states.decode import JOINT_STATE
from robot_energy.inputs.sources import Inputs
from robot_energy.messages.payload import PAYLOAD


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
