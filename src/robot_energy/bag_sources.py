"""Which topics of a bag are which input: named by sources, or found by type."""

from __future__ import annotations

from collections.abc import Mapping

from robot_energy.bag import BagReader
from robot_energy.errors import MissingTopicError
from robot_energy.ingest.sources import (
    FLOAT_ARRAY,
    SELF_TOLD,
    TEMPERATURE_TYPES,
    TemperatureSource,
)


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


def sources_by_type(
    bag: BagReader, topics: tuple[str, ...] | None = None
) -> dict[str, TemperatureSource]:
    """Return sources of the types that need no settings, named as their topics.

    Args:
        bag: An open bag.
        topics: The topics to use; None for all of these types.

    Raises:
        MissingTopicError: If a topic is absent, or of a type that needs settings.
    """
    if topics is None:
        topics = tuple(t for t, info in sorted(bag.topics.items()) if info.msgtype in SELF_TOLD)
    for topic in topics:
        info = bag.topics.get(topic)
        if info is not None and info.msgtype in TEMPERATURE_TYPES and info.msgtype not in SELF_TOLD:
            raise MissingTopicError(
                f"{bag.path} has {topic} as {info.msgtype}, which does not say all by itself",
                f"type {' or '.join(SELF_TOLD)}",
                "say what it means in a parameter file and name that with --inputs",
            )
        bag.require(topic, SELF_TOLD)
    return {
        topic: TemperatureSource(topic=topic, type=bag.topics[topic].msgtype) for topic in topics
    }


def possible_temperatures(bag: BagReader) -> list[str]:
    """Return topics that may well hold temperatures, but do not say so by their type."""
    return [
        topic
        for topic, info in sorted(bag.topics.items())
        if info.msgtype in TEMPERATURE_TYPES
        and info.msgtype not in SELF_TOLD
        and (info.msgtype != FLOAT_ARRAY or "temp" in topic.lower())
    ]
