"""Independent jobs of a study, in other processes or one after the other, with their progress."""

from __future__ import annotations

import itertools
import signal
import threading
from collections.abc import Callable, Generator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import Annotated, Any

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import RigError

Progress = Callable[[float], None]


class StudyRun(Described):
    """How a study runs; its figures depend on the seed alone."""

    folder: Annotated[Path, "For the bags that are kept; it exists."]
    seed: int
    workers: Annotated[int, "Processes in addition to this one; 1 means to do all of it here."] = 1
    progress: Progress | None = None

    def steps(self, count: int, share: float = 1.0) -> Callable[..., None]:
        """Return what counts one more job as finished, in any thread.

        Args:
            share: What all jobs together are of the work. [-]
        """
        number, lock = itertools.count(1), threading.Lock()

        def done(_job: Any = None) -> None:
            with lock:
                if self.progress is not None:
                    self.progress(min(1.0, share * next(number) / count))

        return done


@contextmanager
def job_pool(
    options: StudyRun, count: int, share: float = 1.0
) -> Generator[Callable[..., Future[Any]]]:
    """Yield a function that starts one of so many jobs: in another process, or here and at once.

    Args:
        share: What all jobs together are of the work. [-]
    """
    workers, done = options.workers, options.steps(count, share)
    if workers <= 1:

        def now(job: Callable[..., Any], *args: Any) -> Future[Any]:
            future: Future[Any] = Future()
            future.set_result(job(*args))
            done(future)
            return future

        yield now
        return
    # A fresh interpreter in each: a fork would copy the threads of numerical libraries.
    others = set(active_children())
    pool = ProcessPoolExecutor(
        workers, mp_context=get_context("spawn"), initializer=_leave_interrupts
    )

    def later(job: Callable[..., Any], *args: Any) -> Future[Any]:
        future = pool.submit(job, *args)
        future.add_done_callback(done)
        return future

    try:
        yield later
    except BrokenProcessPool as broken:
        raise RigError(
            "a worker process ended by itself, usually for lack of memory",
            remedy="use --workers 1, or free memory",
        ) from broken
    except BaseException:  # the results of running jobs are not needed any more
        pool.shutdown(wait=False, cancel_futures=True)
        for child in set(active_children()) - others:
            child.terminate()
            child.join()  # it writes no file any more
        raise
    pool.shutdown()


def _leave_interrupts() -> None:
    """Ctrl-C is for the parent, which ends its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
