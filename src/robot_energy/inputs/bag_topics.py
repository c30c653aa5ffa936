"""Which topics of a bag are which input: named by sources, or found by type."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from robot_energy.bag import BagReader
from robot_energy.foundation.errors import MissingTopicError
from robot_energy.inputs.auxiliary import AuxiliaryInputs, LoadTopics
from robot_energy.inputs.joint_states.decode import JOINT_STATE
from robot_energy.inputs.meter.kinds import meter_kind
from robot_energy.inputs.meter.source import MeterSource
from robot_energy.inputs.sources import TemperatureSource
from robot_energy.inputs.temperatures.kinds import TEMPERATURE_KINDS
from robot_energy.model.auxiliary import AuxiliaryLoad

S = TypeVar("S", MeterSource, TemperatureSource)
LOADS = "/auxiliary/"  # in names of topics that are those of auxiliary loads


def resolve(bag: BagReader, name: str) -> str | None:
    """Return the topic that a node would read under a name; None if the bag has no such topic.

    Names of parameters are relative, those of a bag have the namespace of the recording.
    """
    plain = name.removeprefix("~/")
    for exact in (plain, f"/{plain}"):
        if exact in bag.topics:
            return exact
    if name.startswith("/"):
        return None
    found = [topic for topic in bag.topics if topic.endswith(f"/{plain}")]
    if len(found) > 1:
        raise MissingTopicError(
            f"{bag.path} has several topics {plain}: {', '.join(found)}",
            "one",
            "give its full name in the inputs",
        )
    return found[0] if found else None


def topics_of_other_robots(bag: BagReader, joint_states: Collection[str]) -> frozenset[str]:
    """Return the topics in namespaces of joint states that are not used and hold no used topic."""
    present = (topic for topic, info in bag.topics.items() if info.msgtype == JOINT_STATE)
    used, foreign = (
        {topic[: topic.rfind("/") + 1] for topic in topics} for topics in (joint_states, present)
    )
    foreign = {space for space in foreign if not any(one.startswith(space) for one in used)}
    return frozenset(t for t in bag.topics if any(t.startswith(space) for space in foreign))


def temperatures_by_type() -> tuple[str, ...]:
    """Return the types of temperatures that need no settings."""
    return tuple(name for name, kind in TEMPERATURE_KINDS.items() if kind.found_by_type)


def find_temperatures(
    bag: BagReader,
    topics: Sequence[str] | None,
    sources: Mapping[str, TemperatureSource] | None,
    foreign: Collection[str] = (),
) -> tuple[dict[str, TemperatureSource], list[str]]:
    """Return the sources of motor temperatures in a bag by name, and what the user should know.

    Args:
        topics: Their topics as the user named them; None to go by the sources, or by type.
        sources: Those of the node that the bag is to be read like; None to go by type.
        foreign: Topics of other robots, which are not found by type.
    """
    held: dict[str, TemperatureSource] = {}
    notes: list[str] = []
    known = temperatures_by_type()
    by_type = sorted(topic for topic, info in bag.topics.items() if info.msgtype in known)
    if sources is not None and topics is None:
        for name, source in sources.items():
            found, lacks = _in_bag(bag, source)
            if found is not None:
                held[name] = found
            else:
                notes.append(f"the bag has no {lacks}: the temperature source '{name}' is not used")
        if sources and not held:
            notes += [_instead(topic, "--temperatures") for topic in by_type]
        return held, notes
    for topic in [one for one in by_type if one not in foreign] if topics is None else topics:
        info = bag.topics.get(topic)
        if info is not None and info.msgtype in TEMPERATURE_KINDS and info.msgtype not in known:
            raise MissingTopicError(
                f"{bag.path} has {topic} as {info.msgtype}, which does not state joints and unit "
                "by itself",
                f"type {' or '.join(known)}",
                "say what it means in a parameter file and name that with --inputs",
            )
        bag.require(topic, known)
        held[topic] = TemperatureSource(topic=topic, type=bag.topics[topic].msgtype)
    if not held and topics is None:
        notes = [_not_used(topic, "--temperatures") for topic in by_type]
        for topic, info in sorted(bag.topics.items()):
            kind = TEMPERATURE_KINDS.get(info.msgtype)
            if kind and not kind.found_by_type and kind.topic_word in topic.lower():
                notes.append(
                    f"{topic} ({info.msgtype}) may hold motor temperatures; say what it means in "
                    "a parameter file and name that with --inputs"
                )
    return held, notes


def find_meter(
    bag: BagReader,
    topic: str | None,
    source: MeterSource | None,
    others: Collection[str] = (),
    foreign: Collection[str] = (),
) -> tuple[MeterSource | None, list[str]]:
    """Return the power meter of a bag, None if there is none, and what the user should know.

    Args:
        topic: Its topic as the user named it; None to go by the source, or by type.
        source: The meter of the node that the bag is to be read like; None to go by type.
        foreign: Topics of other robots, which are not found by type.
    """
    if topic is not None:
        other = source if source is not None and not source.pair else MeterSource()
        info = bag.topics.get(topic)
        if info and info.msgtype != other.type and meter_kind(info.msgtype).found_by_type:
            other = MeterSource(type=info.msgtype)
        bag.require(topic, other.type)
        return replace(other, topic=topic), []
    open_topics = sorted(
        item for item in bag.topics.items() if item[0] not in others and LOADS not in item[0]
    )
    by_type = [name for name, info in open_topics if meter_kind(info.msgtype).found_by_type]
    if source is not None and source != MeterSource():
        found, lacks = _in_bag(bag, source)
        if not lacks:
            return found, []
        own = [_instead(name, "--meter") for name in by_type]
        return None, [f"the bag has no {lacks}: the meter is not read", *own]
    meters = [name for name in by_type if name not in foreign]
    if len(meters) > 1:
        raise MissingTopicError(
            f"{bag.path} has several topics of a power meter: {', '.join(meters)}",
            "one",
            "name it with --meter",
        )
    if meters:
        return MeterSource(topic=meters[0], type=bag.topics[meters[0]].msgtype), []
    left_out = [_not_used(name, "--meter") for name in by_type]
    possible = [
        f"{name} ({info.msgtype}) may be a power meter; say what it means in a parameter file "
        "and name that with --inputs"
        for name, info in open_topics
        if any(word in name.lower() for word in meter_kind(info.msgtype).topic_words)
    ]
    return None, left_out + possible


def find_auxiliary(
    bag: BagReader, loads: Sequence[AuxiliaryLoad], inputs: AuxiliaryInputs | None
) -> tuple[dict[str, LoadTopics], list[str]]:
    """Return topics of every load by its name, and a sentence for what is missing or names none."""
    inputs = inputs or AuxiliaryInputs()
    found: dict[str, LoadTopics] = {}
    notes: list[str] = []
    for load in loads:
        wanted, state = inputs.meter_of(load), inputs.state_of(load)
        meter = None if wanted is None else _in_bag(bag, wanted)[0]
        if wanted is not None and meter is None:
            topics = " and ".join(wanted.topics)
            notes.append(f"the bag has no {topics}: the power of {load.name} is not known")
        found[load.name] = LoadTopics(meter, _in_bag(bag, state.source)[0], state.stale_after)
    return found, [*notes, *inputs.unknown_loads(loads)]


def _in_bag(bag: BagReader, source: S) -> tuple[S | None, str]:
    """The source with the full names of its topics; None where some are missing, and which."""
    full = {name: resolve(bag, name) for name in source.topics}
    lacks = " and ".join(name for name, found in full.items() if found is None)
    if lacks:
        return None, lacks
    held = source.resolved(lambda name: full[name] or name)
    for name, kind in held.topics.items():
        bag.require(name, kind)
    return held, ""


def _instead(topic: str, option: str) -> str:
    return f"{topic} is not read, as the inputs name others; name it with {option} to read it"


def _not_used(topic: str, option: str) -> str:
    return (
        f"{topic} is not used: other joint states have its namespace; name it with {option} if it "
        "is this robot's"
    )
