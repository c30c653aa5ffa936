"""Which topics of a bag are which input: named by sources, or found by type."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from robot_energy.bag import BagReader
from robot_energy.errors import MissingTopicError
from robot_energy.inputs.auxiliary import AuxiliaryInputs, LoadTopics
from robot_energy.inputs.joint_states.decode import JOINT_STATE
from robot_energy.inputs.meter.kinds import meter_kind
from robot_energy.inputs.meter.source import MeterSource
from robot_energy.inputs.sources import TemperatureSource
from robot_energy.inputs.temperatures.kinds import TEMPERATURE_KINDS
from robot_energy.model.auxiliary import AuxiliaryLoad

LOADS = "/auxiliary/"  # in names of topics that are those of auxiliary loads


def resolve(bag: BagReader, name: str) -> str | None:
    """Find the topic that a node would read under a name.

    Names of parameters are relative, those of a bag have the namespace of the recording.

    Args:
        bag: An open bag.
        name: Name of a topic, as in the parameters of a node.

    Returns:
        The full name, or None if the bag has no such topic.

    Raises:
        MissingTopicError: If several namespaces have it.
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


def named_sources(
    bag: BagReader, sources: Mapping[str, TemperatureSource]
) -> tuple[dict[str, TemperatureSource], list[str]]:
    """Return the sources that a bag holds, with the full names of their topics.

    Args:
        bag: An open bag.
        sources: Sources as parameters name them.

    Returns:
        The sources whose topics are there, and one sentence for each that is not.

    Raises:
        MissingTopicError: If a topic is there with another type, or several times.
    """
    held: dict[str, TemperatureSource] = {}
    notes: list[str] = []
    for name, source in sources.items():
        full = {topic: resolve(bag, topic) for topic in source.topics}
        missing = [topic for topic, found in full.items() if found is None]
        if missing:
            lacks = " and ".join(missing)
            notes.append(f"the bag has no {lacks}: the temperature source '{name}' is not used")
            continue
        held[name] = source.resolved(lambda topic, full=full: full[topic] or topic)
        for topic, kind in held[name].topics.items():
            bag.require(topic, kind)
    return held, notes


def topics_of_other_robots(bag: BagReader, joint_states: Collection[str]) -> frozenset[str]:
    """Return the topics in namespaces of joint states that are not used.

    Args:
        bag: An open bag.
        joint_states: Topics of the joint states that are used.

    Returns:
        Full names; those of a namespace that holds a used topic as well are not among them.
    """
    used = {_namespace(topic) for topic in joint_states}
    present = (topic for topic, info in bag.topics.items() if info.msgtype == JOINT_STATE)
    foreign = {_namespace(topic) for topic in present} - used
    foreign -= {space for space in foreign if any(one.startswith(space) for one in used)}
    return frozenset(t for t in bag.topics if any(t.startswith(space) for space in foreign))


def _namespace(topic: str) -> str:
    """All up to the last slash and with it."""
    return topic[: topic.rfind("/") + 1]


def temperatures_by_type() -> tuple[str, ...]:
    """Return the types of temperatures that need no settings."""
    return tuple(name for name, kind in TEMPERATURE_KINDS.items() if kind.found_by_type)


def sources_by_type(
    bag: BagReader, topics: tuple[str, ...] | None = None, foreign: Collection[str] = ()
) -> dict[str, TemperatureSource]:
    """Return sources of the types that need no settings, named as their topics.

    Args:
        bag: An open bag.
        topics: The topics to use; None for all of these types.
        foreign: Topics of other robots, which are not found by type.

    Raises:
        MissingTopicError: If a topic is absent, or of a type that needs settings.
    """
    known = temperatures_by_type()
    if topics is None:
        found = (topic for topic, info in bag.topics.items() if info.msgtype in known)
        topics = tuple(sorted(set(found) - set(foreign)))
    for topic in topics:
        info = bag.topics.get(topic)
        if info is not None and info.msgtype in TEMPERATURE_KINDS and info.msgtype not in known:
            raise MissingTopicError(
                f"{bag.path} has {topic} as {info.msgtype}, which does not say all by itself",
                f"type {' or '.join(known)}",
                "say what it means in a parameter file and name that with --inputs",
            )
        bag.require(topic, known)
    return {
        topic: TemperatureSource(topic=topic, type=bag.topics[topic].msgtype) for topic in topics
    }


def possible_temperatures(bag: BagReader) -> list[str]:
    """Return topics that may well hold temperatures, but do not say so by their type.

    Args:
        bag: The open bag.
    """
    return [
        topic
        for topic, info in sorted(bag.topics.items())
        if info.msgtype in TEMPERATURE_KINDS
        and not TEMPERATURE_KINDS[info.msgtype].found_by_type
        and TEMPERATURE_KINDS[info.msgtype].topic_word in topic.lower()
    ]


def find_meter(
    bag: BagReader,
    topic: str | None,
    source: MeterSource | None,
    others: Collection[str] = (),
    foreign: Collection[str] = (),
) -> tuple[MeterSource | None, list[str]]:
    """Find the power meter in a bag.

    Args:
        bag: An open bag.
        topic: Its topic as the user named it; None to go by the source, or by type.
        source: The meter of the node that the bag is to be read like; None to go by type.
        others: Topics that are known to be something else.
        foreign: Topics of other robots, which are not found by type.

    Returns:
        The meter with the full names of its topics, None if there is none, and what the
        user should know of it.

    Raises:
        MissingTopicError: If a topic is absent or of another type, or there are several.
    """
    if topic is not None:
        other = source if source is not None and not source.pair else MeterSource()
        info = bag.topics.get(topic)
        if other == MeterSource() and info is not None and meter_kind(info.msgtype).found_by_type:
            other = MeterSource(type=info.msgtype)
        bag.require(topic, other.type)
        return replace(other, topic=topic), []
    if source is not None and source != MeterSource():
        full = {name: resolve(bag, name) for name in source.topics}
        missing = [name for name, found in full.items() if found is None]
        if missing:
            return None, [f"the bag has no {' and '.join(missing)}: the meter is not read"]
        found = source.resolved(lambda name: full[name] or name)
        for name, kind in found.topics.items():
            bag.require(name, kind)
        return found, []
    open_topics = sorted(
        item for item in bag.topics.items() if item[0] not in others and LOADS not in item[0]
    )
    by_type = [name for name, info in open_topics if meter_kind(info.msgtype).found_by_type]
    meters = [name for name in by_type if name not in foreign]
    if len(meters) > 1:
        raise MissingTopicError(
            f"{bag.path} has several topics of a power meter: {', '.join(meters)}",
            "one",
            "name it with --meter",
        )
    if meters:
        return MeterSource(topic=meters[0], type=bag.topics[meters[0]].msgtype), []
    left_out = [
        f"{name} is not used: other joint states have its namespace; name it with --meter if it is "
        "this robot's"
        for name in by_type
    ]
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
    """Find meters and states of loads in a bag.

    Args:
        bag: An open bag.
        loads: Of the model file.
        inputs: Inputs of the node that the bag is to be read like; None: the usual topics.

    Returns:
        Topics of every load by its name, and one sentence for each meter that is missing and each
        entry that names no load.

    Raises:
        MissingTopicError: If a topic is there with another type, or several times.
    """
    inputs = inputs or AuxiliaryInputs()
    found: dict[str, LoadTopics] = {}
    notes: list[str] = []
    for load in loads:
        wanted, state = inputs.meter_of(load), inputs.state_of(load)
        meter = None if wanted is None else _in_bag(bag, wanted)
        if wanted is not None and meter is None:
            topics = " and ".join(wanted.topics)
            notes.append(f"the bag has no {topics}: the power of {load.name} is not known")
        found[load.name] = LoadTopics(meter, _in_bag(bag, state.source), state.stale_after)
    return found, [*notes, *inputs.unknown_loads(loads)]


def _in_bag(bag: BagReader, source: MeterSource) -> MeterSource | None:
    """The source with the full names of its topics; None where one is missing."""
    full = {name: resolve(bag, name) for name in source.topics}
    if None in full.values():
        return None
    held = source.resolved(lambda name: full[name] or name)
    for name, kind in held.topics.items():
        bag.require(name, kind)
    return held
