"""Motor temperatures of any number of sources -> temperature blocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated

import numpy as np

from robot_energy.bag.cdr.decode import RawBatch
from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.inputs.sources import TemperatureSource
from robot_energy.inputs.temperatures.reader import TemperatureReader, TemperatureReadings
from robot_energy.timeline.blocks import NANOSECOND, Int, TemperatureBlock
from robot_energy.timeline.stamps import (
    BACKWARD_JUMP_NS,
    SLOW_NS,
    EpochRun,
    newest_by_epoch,
    sentence_of,
    slow_reach,
)
from robot_energy.timeline.streams import STRAY_STAMP, EpochSplitter, StreamSplitter, joined

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

    from robot_energy.inputs.joint_states.joint_states import JointStateIngest


class _Arrived(TemperatureBlock):
    """Readings of all sources in order of arrival."""

    source: Annotated[Int, "Number of the reader of each, shape (N,)."]


class TemperatureIngest:
    """Turns temperature messages of all sources into blocks in model joint order, in degC.

    All sources together are one stream of stamps: see `Epochs`. So of two clocks only one is
    believed, and a single wrong stamp changes nothing.

    Args:
        sources: The sources by name, with the full names of their topics; by default the
            topic ``/motor_temperatures`` of MotorTemperatures.
        typestore: Message definitions of the source; those known here by default.
        stale_after: Age at which a temperature is not used any more. [s]

    Attributes:
        readers: One per source, with the account of its messages.
    """

    def __init__(
        self,
        joint_names: Sequence[str],
        sources: Mapping[str, TemperatureSource] | None = None,
        typestore: Typestore | None = None,
        stale_after: float = 60.0,
    ) -> None:
        reach = slow_reach(round(stale_after / NANOSECOND))
        self._stream = StreamSplitter[_Arrived](reach)
        self.epochs = self._stream.epochs
        if sources is None:
            sources = {"motors": TemperatureSource().resolved(lambda topic: f"/{topic}")}
        self.readers = [
            TemperatureReader(name, source, joint_names, typestore)
            for name, source in sources.items()
        ]
        self._names = tuple(joint_names)
        self._met = np.zeros((len(self.readers), len(self._names)), dtype=np.bool_)

    @property
    def topics(self) -> dict[str, str]:
        """Type of the messages of each topic."""
        return {t: kind for reader in self.readers for t, kind in reader.source.topics.items()}

    @property
    def rejections(self) -> RejectionLog:
        """Messages of values of all sources together; one that two read counts twice."""
        total = RejectionLog()
        for reader in self.readers:
            total.received += reader.rejections.received
            total.accepted += reader.rejections.accepted
            total.rejected.update(reader.rejections.rejected)
            total.waiting += reader.rejections.waiting
        return total

    @property
    def ignored_joints(self) -> set[str]:
        """Names met that no source takes for a joint of the model."""
        return set[str]().union(*(reader.ignored_joints for reader in self.readers))

    @property
    def doubts(self) -> list[str]:
        """One sentence for each source whose readings look like another unit, and for several.

        Several are doubtful where they bring readings of the same joint, as of two robots.
        """
        found = [reader.doubt for reader in self.readers if reader.doubt]
        twice = np.flatnonzero(self._met.sum(axis=0) > 1).tolist()
        if twice:
            sources = np.flatnonzero(np.logical_or.reduce(self._met[:, twice], axis=1)).tolist()
            topics = " and ".join(self.readers[number].source.topic for number in sources)
            joints = ", ".join(self._names[joint] for joint in twice)
            found.append(f"{topics} all bring temperatures of {joints}: name those of this robot")
        return found

    def ahead_ns(self, states: JointStateIngest) -> int | None:
        """Return how far stamps are ahead of the joint states on arrival; None if unknown. [ns]"""
        own, other = self._stream.lag_ns, states.lag_ns
        return None if own is None or other is None else own - other

    @property
    def refused_share(self) -> float:
        """Share of the messages that are stamped by another clock than the others. [-]"""
        total = self.rejections
        return total.rejected[STRAY_STAMP] / total.received if total.received else 0.0

    def clock_doubts(
        self, states: JointStateIngest | None, within: float | None = None
    ) -> list[str]:
        """Return what the stamps say of the thermometers' clocks, one sentence each.

        Args:
            states: The joint states; None where they are not known.
            within: Only what concerns so much of the newest time; None for all. [s]
        """
        strays = [each for each in self.readers if each.rejections.rejected[STRAY_STAMP]]
        topics = ", ".join(reader.source.topic for reader in strays or self.readers)
        found = [sentence_of(self.epochs, f"temperatures on {topics}", within=within)]
        if states is not None:
            ahead_ns = self.ahead_ns(states)
            found.append(_apart_sentence(self.epochs, states.newest_ns, ahead_ns))
        return list(filter(None, found))

    def account_of(self, topic: str) -> RejectionLog:
        """Return the account of the first source that reads values from a topic."""
        return next(each.rejections for each in self.readers if topic == each.source.topic)

    def arrivals(self, batches: Sequence[RawBatch]) -> list[tuple[RejectionLog, int]]:
        """Return every account, with how many messages of some batches belong to it."""
        counts = {batch.topic: len(batch) for batch in batches}
        pairs = [(each.rejections, each.source.topic) for each in self.readers]
        pairs += [(each.keys_account, each.keys_topic) for each in self.readers]
        return [(rejections, counts.get(topic, 0)) for rejections, topic in pairs]

    def restart(self) -> None:
        """Drop what waits, as after an error. The accounts are left alone."""
        self._stream.restart()

    def step(self, batches: Sequence[RawBatch]) -> TemperatureBlock | None:
        """Take messages of any number of topics.

        Returns:
            Readings in order of arrival; those that arrived together in the order of their
            stamps, each topic's own order kept. None if there are none.
        """
        by_topic = {batch.topic: batch for batch in batches}
        read = [each.read(by_topic) for each in self.readers]
        parts = [(number, part) for number, part in enumerate(read) if part is not None]
        if not parts:
            return None
        arrived: list[_Arrived] = []
        for number, part in parts:
            stamp_ns, degc = part.block.stamp_ns, part.block.motor_temperature_degc
            self._met[number] |= np.logical_or.reduce(np.isfinite(degc), axis=0)
            source = np.full(len(stamp_ns), number, dtype=np.int64)
            arrived.append(_Arrived(stamp_ns, degc, source))
        block = _Arrived.concatenate(arrived)
        if len(parts) > 1:
            keys = [_order(part) for _, part in parts]
            block = block[np.lexsort([np.concatenate(key) for key in zip(*keys, strict=True)])]
        arrival_ns = max(int(part.arrival_ns[-1]) for _, part in parts)
        return self._taken(self._stream.step(block, arrival_ns))

    def flush(self) -> TemperatureBlock | None:
        """Return what still waits and is not an outlier, as at the end of a bag."""
        return self._taken(self._stream.flush())

    def _taken(self, runs: list[tuple[_Arrived, EpochRun]]) -> TemperatureBlock | None:
        """Bring the accounts up to date."""
        held, refused = self._stream.held, self._stream.refused
        for number, reader in enumerate(self.readers):
            rejections = reader.rejections
            strays = 0 if refused is None else int((refused.source == number).sum())
            waiting = 0 if held is None else int((held.source == number).sum())
            rejections.reject(STRAY_STAMP, strays)
            rejections.accepted += rejections.waiting - waiting - strays
            rejections.waiting = waiting
        whole = joined(runs)
        if whole is None:
            return None
        return TemperatureBlock(whole.stamp_ns, whole.motor_temperature_degc)


def _order(readings: TemperatureReadings) -> tuple[Int, Int, Int]:
    """Sort keys, the last one first: arrival, epoch of the source, stamp within it.

    Stamps are made to rise, so that no sorting changes the order of one source.
    """
    stamp = readings.block.stamp_ns
    epoch = np.append(0, np.cumsum(np.diff(stamp) < -BACKWARD_JUMP_NS))
    return newest_by_epoch(stamp, epoch), epoch, readings.arrival_ns


def _apart_sentence(epochs: EpochSplitter, newest_ns: int | None, ahead_ns: int | None) -> str:
    """Return that temperatures are of another time than the joint states; empty if not.

    A stream that has stopped is not a clock: its stamps were right when they arrived.
    """
    if epochs.newest_ns is None or newest_ns is None or ahead_ns is None:
        return ""
    bound = SLOW_NS + 3 * epochs.period_ns
    apart = epochs.newest_ns - newest_ns
    if abs(apart) <= bound or abs(ahead_ns) <= bound:
        return ""
    way = "after" if ahead_ns > 0 else "before"
    return (
        f"the newest temperature is stamped {abs(ahead_ns) * NANOSECOND:.1f} s {way} the joint "
        "states that arrived with it: synchronise the clocks"
    )
