"""Topics that a bag holds one behind the other, brought together by their log times."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from robot_energy.bag.cdr.batch import RawBatch
from robot_energy.foundation.units import SECOND_NS

MAX_OVERLAP_NS = SECOND_NS
"""By which chunks and files of a bag may overlap: several publishers are not in step. [ns]"""


def rises(batches: Iterable[RawBatch]) -> bool:
    """Return whether the log times of a topic order its messages."""
    newest: int | None = None
    for batch in batches:
        times = batch.log_time_ns
        if bool((np.diff(times) < 0).any()):
            return False
        if newest is not None and int(times[0]) < newest - MAX_OVERLAP_NS:
            return False
        newest = int(times[-1])
    return True


def merged(topics: Sequence[Iterator[RawBatch]]) -> Iterator[dict[str, RawBatch]]:
    """Yield the messages of several topics, none ahead of another by more than a batch.

    Args:
        topics: The messages of each, whose log times rise.
    """
    held: list[RawBatch | None] = [next(topic, None) for topic in topics]
    while ends := [int(batch.log_time_ns[-1]) for batch in held if batch is not None]:
        until = min(ends)
        part: dict[str, RawBatch] = {}
        for number, batch in enumerate(held):
            if batch is None:
                continue
            count = int(np.searchsorted(batch.log_time_ns, until, side="right"))
            if count:
                part[batch.topic] = batch[slice(count)]
            held[number] = (
                batch[slice(count, None)] if count < len(batch) else next(topics[number], None)
            )
        yield part
