"""Replay the bags of a fleet, on Dask or one after the other, into a dataset."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

from robot_energy.foundation.described import documented
from robot_energy.foundation.errors import ParameterError
from robot_energy.foundation.shown_text import shown
from robot_energy_fleet.bag_list import FleetBag
from robot_energy_fleet.bag_row import BagRow, refused, replay_bag
from robot_energy_fleet.dataset import Bag, Dataset
from robot_energy_fleet.results.fleet import DamagedBag, FleetRunReport, RefusedBag
from robot_energy_fleet.workers import MAX_SCRATCH, Models, Replays, Source, on_dask
from robot_energy_history.store import HistoryStore

MAX_WORKERS = 1024  # of one host
MIN_MEMORY = 500_000_000  # of a worker [bytes]


@contextmanager
def open_history(folder: str | Path | None) -> Generator[HistoryStore | None]:
    """Yield the store of the history that a run writes to; None without one."""
    if folder is None:
        yield None
        return
    store = HistoryStore(Path(folder).expanduser())
    store.open()
    try:
        yield store
        store.write(time.time_ns())
    finally:
        store.close()


@documented
@dataclass
class FleetRun:
    """What a run has done."""

    bags: int = 0
    there: Annotated[int, "Of them, that the dataset held already, unchanged."] = 0
    read: int = 0
    refused: Annotated[
        dict[Bag, RefusedBag], "Those that could not be used, by robot and address."
    ] = field(default_factory=dict[Bag, RefusedBag])
    damaged: Annotated[
        dict[Bag, DamagedBag], "Those replayed that were read in part, by robot and address."
    ] = field(default_factory=dict[Bag, DamagedBag])
    jobs_left_out: Annotated[int, "Jobs of which a bag replayed holds a part only."] = 0
    observed_time: Annotated[float, "Predicted, of the bags replayed. [s]"] = 0.0
    written: Annotated[int, "Size of their rows. [bytes]"] = 0
    peak_memory: Annotated[int, "Most memory that one worker has held. [bytes]"] = 0
    done_size: Annotated[int, "Size of the bags that are done. [bytes]"] = 0
    overlap_ns: Annotated[
        int, "Time of the bags replayed that the history had from others. [ns]"
    ] = 0
    begun: float = field(default_factory=time.monotonic)

    def report(self, dataset: Dataset) -> FleetRunReport:
        """Return what was done until now."""
        elapsed = time.monotonic() - self.begun
        return FleetRunReport(
            str(dataset.folder), self.bags, self.there, self.read, tuple(self.refused.values()),
            tuple(self.damaged.values()), self.jobs_left_out, self.observed_time, elapsed,
            self.written, self.peak_memory,
        )  # fmt: skip


def run_fleet(
    bags: Iterable[FleetBag],
    models: Models,
    dataset: Dataset,
    replays: Replays,
    done: FleetRun | None = None,
    progress: Callable[[FleetRun], None] = lambda done: None,
    history: HistoryStore | None = None,
) -> FleetRun:
    """Return what a run has done, which replays what the dataset does not hold yet.

    Args:
        history: An open history, into which what each robot used is put as well; bags that it
            lacks are replayed.
    """
    done = done or FleetRun()
    unusable: list[FleetBag] = []

    def missing() -> Iterator[FleetBag]:
        for bag in bags:
            done.bags += 1
            if bag.place.problem is not None:
                unusable.append(bag)
            elif dataset.has(bag.name) and (history is None or history.has_bag(bag.name)):
                dataset.remove(bag.parts)
                dataset.remove(bag.missed, unread=True)
                done.there += 1
                done.done_size += bag.place.size
                progress(done)
            else:
                yield bag if history is None else replace(bag, with_history=True)

    for bag, row in replays(missing(), models):
        _keep(bag, row, dataset, done)
        if history is not None and row.history is not None:
            done.overlap_ns += history.add_bag(row.history)
        progress(done)
    for bag in unusable:
        _keep(bag, refused(bag, bag.place.problem or ValueError()), dataset, done)
        progress(done)
    return done


def _keep(bag: FleetBag, row: BagRow, dataset: Dataset, done: FleetRun) -> None:
    dataset.add(row.key, row.date, row.data)
    if not row.key.is_unread:
        dataset.remove(bag.parts)
    dataset.remove(bag.missed, unread=True)
    address = bag.place.address
    own = row.key.robot, address
    done.refused.pop(own, None)
    done.damaged.pop(own, None)
    if row.key.reason:
        done.refused[own] = RefusedBag(address, row.key.robot, row.key.reason)
    else:
        done.read += 1
    if row.problems:
        done.damaged[own] = DamagedBag(address, row.key.robot, row.problems)
    done.jobs_left_out += row.jobs_left_out
    done.observed_time += row.observed_time
    done.written += len(row.data)
    done.peak_memory = max(done.peak_memory, row.peak_memory)
    done.done_size += bag.place.size


def in_turn(max_scratch: int = MAX_SCRATCH) -> Replays:
    """Return how bags are replayed one after the other in this process.

    Args:
        max_scratch: Size up to which a remote bag is copied. [bytes]
    """

    def replays(bags: Iterator[FleetBag], models: Models) -> Source:
        for bag in bags:
            yield bag, replay_bag(bag, models[bag.model_digest], max_scratch)

    return replays


def where_asked(
    scheduler: str | None = None,
    workers: int | None = None,
    memory: str = "2GB",
    max_scratch: int = MAX_SCRATCH,
) -> AbstractContextManager[Replays]:
    """Return where bags are replayed, as asked for.

    Args:
        workers: Processes to start; None: one for each core; 0 without a scheduler: in this
            process, one bag after the other.
    """
    from dask.utils import parse_bytes

    if workers is not None and not 0 <= workers <= MAX_WORKERS:
        raise ParameterError(f"the number of workers is {workers}", f"0 to {MAX_WORKERS}")
    try:
        size = parse_bytes(memory)
    except ValueError:
        size = 0
    if size < MIN_MEMORY:
        raise ParameterError(
            f"the memory of a worker is '{shown(memory)}'", "a size such as 2GB, 500MB or more"
        )
    if workers == 0 and scheduler is None:
        return nullcontext(in_turn(max_scratch))
    return on_dask(scheduler, workers or len(os.sched_getaffinity(0)), memory, max_scratch)


def why_refused(refused: Iterable[RefusedBag]) -> list[tuple[str, int]]:
    """Return the reasons of refused bags without their addresses, the most frequent first."""
    reasons = Counter(one.reason.replace(one.bag, "BAG") for one in refused)
    return reasons.most_common()
