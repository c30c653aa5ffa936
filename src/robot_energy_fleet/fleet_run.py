"""Replay the bags of a fleet into a dataset: on Dask, whose workers are replaced when they die."""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from itertools import islice
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Annotated, Any, cast

from robot_energy.foundation.described import documented
from robot_energy.foundation.errors import DatasetError, ParameterError
from robot_energy.foundation.extras import require
from robot_energy.foundation.files.temporary_folder import TemporaryFolder
from robot_energy.foundation.shown_text import shown
from robot_energy.model import RobotModel
from robot_energy_fleet.bag_list import FleetBag
from robot_energy_fleet.bag_row import BagRow, refused, replay_bag
from robot_energy_fleet.dataset import Bag, Dataset
from robot_energy_fleet.results.fleet import DamagedBag, FleetRunReport, RefusedBag
from robot_energy_history.store import HistoryStore

HTTP = "127.0.0.1:0"  # reachable from this machine alone
ALLOWED_FAILURES = 5  # deaths of workers that hold a bag, before it is tried alone
PER_THREAD = 32  # bags at the scheduler for each thread of its workers
MIN_WAITING = 64
BATCH = 16  # bags that are sent to the scheduler at once
AT_WORKER = 16  # bags that a worker holds, so that it has some while messages are on their way
REPORTED_EVERY = 0.25  # s; a worker says so often what it has finished, not after each bag
TOGETHER = 0.4  # s; rows that come within it are fetched by one message
LOST = "10s"  # after which a worker that is gone and does not come back is replaced
START_TIME = 5.0  # s; in which a worker gets ready
HEAL_EVERY = 2.0  # s; the workers are also counted so often
TIMEOUT = "30s"  # for the scheduler to answer
MAX_SCRATCH = 20_000_000_000  # bytes

Models = dict[str, RobotModel]
Source = Iterator[tuple[FleetBag, BagRow]]
Replays = Callable[[Iterator[FleetBag], Models], Source]


@contextmanager
def on_dask(
    scheduler: str | None = None,
    workers: int = 1,
    memory: str = "2GB",
    max_scratch: int = MAX_SCRATCH,
) -> Generator[Replays]:
    """Yield how bags are replayed by a scheduler, or by one that this process alone can reach.

    What is started talks by TLS with a key that lies in memory only: who lacks it, another user
    of this host among them, is refused by scheduler and workers.

    Args:
        memory: Of each at most; one that needs more is started again.
    """
    require("distributed", "a fleet")
    import dask.config
    from distributed import Client, LocalCluster
    from distributed.security import Security

    settings: dict[str, Any] = {
        "distributed.worker.profile.enabled": False,  # looks at the stack every 10 ms
        "distributed.admin.tick.interval": "1s",
        "distributed.worker.memory.monitor-interval": "500ms",  # a look takes 0.5 ms
        "distributed.scheduler.worker-saturation": AT_WORKER,
        "distributed.scheduler.active-memory-manager.start": False,
        "distributed.scheduler.allowed-failures": ALLOWED_FAILURES,
        "distributed.deploy.lost-worker-timeout": LOST,
        "distributed.scheduler.http.routes": [],  # pages that every user of this host could read
        "distributed.worker.http.routes": [],
    }
    logging.getLogger("tornado.application").setLevel(logging.CRITICAL)  # workers that died
    with dask.config.set(cast("Any", settings)), ExitStack() as ends:
        try:
            cluster = None
            if scheduler is None:
                scratch = ends.enter_context(TemporaryFolder()).path
                with _unheard():
                    cluster = LocalCluster(
                        n_workers=workers,
                        threads_per_worker=1,
                        memory_limit=memory,
                        local_directory=str(scratch),  # else it stays where the command ran
                        host="127.0.0.1",
                        dashboard_address=HTTP,  # of the scheduler: None would be any interface
                        worker_dashboard_address=HTTP,
                        silence_logs=logging.CRITICAL,  # what went wrong with a bag is its row
                        protocol="tls",
                        security=cast("Any", Security).temporary(),
                    )
                ends.callback(cluster.close)
                ends.enter_context(_kept(cluster, workers))
            client = Client(cluster or scheduler, timeout=TIMEOUT)
            ends.callback(cast("Any", client).close)
            if cluster is not None:  # workers of others are left as they are
                cast("Any", client).register_worker_callbacks(_report_seldom)
                ends.callback(_wait_for, client, workers)
        except (OSError, ValueError) as error:
            raise DatasetError(
                f"the scheduler {scheduler or 'of this host'} does not answer ({error})",
                "a running dask scheduler",
                "start one with `dask scheduler`",
            ) from error
        yield lambda bags, models: _on_client(client, bags, models, max_scratch)


@contextmanager
def _unheard() -> Generator[None]:
    """Keep Ctrl-C and the end of the terminal from processes that are started: we end them."""
    resource_tracker.ensure_running()  # else started by a thread of Dask, which then hears both
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGHUP))
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _report_seldom(dask_worker: Any) -> None:
    """Make a worker send what it has finished in few messages: each costs both ends time."""
    dask_worker.batched_stream.interval = REPORTED_EVERY


def _wait_for(client: Any, workers: int) -> None:
    """Let new workers get ready: one that is closed before that prints tracebacks."""
    with suppress(OSError):  # time is up, or the scheduler is gone
        client.wait_for_workers(workers, timeout=START_TIME)


@contextmanager
def _kept(cluster: Any, workers: int) -> Generator[None]:
    """Replace workers that died before they were ready, which Dask leaves dead."""
    from distributed.core import Status

    ended = threading.Event()

    def keep() -> None:
        while not ended.wait(HEAL_EVERY):
            for name, worker in list(cluster.workers.items()):
                if worker.status in (Status.failed, Status.closed):
                    cluster.workers.pop(name, None)
            cluster.scale(workers)
            _spread([worker.pid for worker in list(cluster.workers.values()) if worker.pid])

    thread = threading.Thread(target=keep, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()  # a cluster that closes is not asked for workers


def _spread(workers: list[int]) -> None:
    """Keep each worker on a core of its own, whose caches then hold its data.

    Where there are more or fewer workers than cores, the system may move them.
    """
    free = os.sched_getaffinity(0)
    if len(workers) != len(free):
        return
    for pid in workers:
        with suppress(OSError):  # it may have ended since
            if len(own := os.sched_getaffinity(pid)) == 1:
                free -= own
                workers = [one for one in workers if one != pid]
    for pid, core in zip(workers, free, strict=False):
        with suppress(OSError):
            for thread in os.listdir(f"/proc/{pid}/task"):
                os.sched_setaffinity(int(thread), {core})


def _on_client(client: Any, bags: Iterator[FleetBag], models: Models, max_scratch: int) -> Source:
    """Rows of bags, until all are there or the scheduler is lost."""
    from distributed.client import FutureCancelledError

    try:
        yield from _as_they_come(client, bags, models, max_scratch)
    except (FutureCancelledError, asyncio.CancelledError, OSError) as error:
        if client.status == "running":
            raise
        raise DatasetError(
            "the scheduler was lost",
            "one that runs until the end",
            "run the command again: what the dataset holds is not done twice",
        ) from error


def _as_they_come(
    client: Any, bags: Iterator[FleetBag], models: Models, max_scratch: int
) -> Source:
    """Few bags at a time are at the scheduler, however many there are."""
    from distributed import as_completed
    from distributed.scheduler import KilledWorker

    kept: dict[str, Any] = {}
    asked: dict[str, FleetBag] = {}
    suspected: list[FleetBag] = []  # one of them kills workers, the others were there, too
    waiting = cast("Any", as_completed())

    def next_rows(pause: float = 0.0) -> Source:
        """The next row, and by the same message those that follow within a pause."""
        futures = [next(waiting)]
        time.sleep(pause)
        futures += waiting.next_batch(block=False)
        rows = client.gather({one.key: one for one in futures}, errors="skip")
        for future in futures:
            bag = asked.pop(future.key)
            try:
                yield bag, cast("BagRow", rows.get(future.key) or future.result())
            except KilledWorker:
                suspected.append(bag)

    room, checked = 0, float("-inf")
    while batch := list(islice(bags, BATCH)):
        now = time.monotonic()
        if now - checked > HEAL_EVERY:
            checked = now
            room = max(MIN_WAITING, PER_THREAD * sum(client.nthreads().values()))
        while len(asked) + len(batch) > room:
            yield from next_rows(TOGETHER)
        for own in {bag.model_digest for bag in batch} - kept.keys():
            # as a task, which another worker can repeat if one dies
            kept[own] = client.submit(_same, models[own], key=f"model-{own}")
        new = {f"bag-{bag.name}": bag for bag in batch}
        new = {key: bag for key, bag in new.items() if key not in asked}  # one may be named twice
        asked.update(new)
        if new:
            theirs = [kept[bag.model_digest] for bag in new.values()]
            waiting.update(
                client.map(replay_bag, new.values(), theirs, max_scratch=max_scratch, key=[*new])
            )
    while asked:
        yield from next_rows()
    for bag in suspected:
        model, key = kept[bag.model_digest], f"alone-{bag.name}"
        future = client.submit(replay_bag, bag, model, max_scratch=max_scratch, key=key)
        try:
            row = future.result()
        except KilledWorker:
            died = DatasetError(
                f"every worker that replayed {bag.place.address} alone died",
                "workers with enough memory",
                "raise --memory, or split the bag",
            )
            row = refused(bag, died)
        yield bag, cast("BagRow", row)


def _same(model: RobotModel) -> RobotModel:
    return model


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
    overlap_ns: Annotated[int, "Time of replayed bags that the history had from others. [ns]"] = 0
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
    """Return how bags are replayed one after the other in this process."""

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
