"""Motor temperatures of any number of sources -> temperature blocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_energy.blocks import Int, TemperatureBlock
from robot_energy.ingest.accounting import Accounting
from robot_energy.ingest.order import BACKWARD_JUMP_NS
from robot_energy.ingest.sources import TemperatureSource
from robot_energy.ingest.temperature_reader import Readings, TemperatureReader
from robot_energy.wire.batch import RawBatch

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore


class TemperatureIngest:
    """Turns temperature messages of all sources into blocks in model joint order, in degC.

    Args:
        joint_names: Modelled joints in model order.
        sources: The sources by name, with the full names of their topics; by default the
            topic ``/motor_temperatures`` of MotorTemperatures.
        typestore: Message definitions of the source; those known here by default.

    Attributes:
        readers: One per source, with the account of its messages.

    Raises:
        ParameterError: If a source names a joint that the model lacks.
    """

    def __init__(
        self,
        joint_names: Sequence[str],
        sources: Mapping[str, TemperatureSource] | None = None,
        typestore: Typestore | None = None,
    ) -> None:
        if sources is None:
            sources = {"motors": TemperatureSource().resolved(lambda topic: f"/{topic}")}
        self.readers = [
            TemperatureReader(name, source, joint_names, typestore)
            for name, source in sources.items()
        ]

    @property
    def topics(self) -> dict[str, str]:
        """Type of the messages of each topic."""
        return {t: kind for reader in self.readers for t, kind in reader.source.topics.items()}

    @property
    def account(self) -> Accounting:
        """Messages of values of all sources together; one that two read counts twice."""
        total = Accounting()
        for reader in self.readers:
            total.received += reader.account.received
            total.accepted += reader.account.accepted
            total.rejected.update(reader.account.rejected)
        return total

    @property
    def ignored_joints(self) -> set[str]:
        """Names met that no source takes for a joint of the model."""
        met = [reader.ignored_joints for reader in self.readers]
        return set[str]().union(*met)

    @property
    def doubts(self) -> list[str]:
        """One sentence for each source whose readings look like another unit."""
        return [reader.doubt for reader in self.readers if reader.doubt]

    def account_of(self, topic: str) -> Accounting:
        """Return the account of the first source that reads values from a topic."""
        return next(each.account for each in self.readers if topic == each.source.topic)

    def step(self, batches: Sequence[RawBatch]) -> TemperatureBlock | None:
        """Take messages of any number of topics.

        Args:
            batches: Serialised messages, each topic in order of arrival.

        Returns:
            Readings in order of arrival; those that arrived together in the order of their
            stamps, each topic's own order kept. None if there are none.
        """
        by_topic = {batch.topic: batch for batch in batches}
        parts = [part for each in self.readers if (part := each.read(by_topic)) is not None]
        if not parts:
            return None
        block = TemperatureBlock.concatenate([part.block for part in parts])
        if len(parts) == 1:
            return block
        keys = [_order(part) for part in parts]
        return block[np.lexsort([np.concatenate(key) for key in zip(*keys, strict=True)])]


def _order(readings: Readings) -> tuple[Int, Int, Int]:
    """Sort keys, the last one first: arrival, epoch of the source, stamp within it.

    Stamps are made to rise, so that no sorting changes the order of one source.
    """
    stamp = readings.block.stamp_ns
    epoch = np.zeros(len(stamp), dtype=np.int64)
    if len(stamp) > 1:
        epoch[1:] = np.cumsum(np.diff(stamp) < -BACKWARD_JUMP_NS)
    rising = stamp.copy()
    for number in range(int(epoch[-1]) + 1 if len(epoch) else 0):
        rows = epoch == number
        rising[rows] = np.maximum.accumulate(stamp[rows])
    return rising, epoch, readings.arrival_ns
