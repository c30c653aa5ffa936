"""Keeps something in a pair of slots: one job of the disk at a time, taken up when it has ended.

The disk may be full, read-only, gone or held by another monitor at any time: work goes on in
memory, `SlotStore.trouble` says why, and the next write tries again.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import Any, Generic, TypeVar, cast

from robot_energy.foundation.errors import StateFileError
from robot_energy.store.slots import SlotPair, Stored

T = TypeVar("T")
Submit = Callable[[Callable[[], Any]], "Future[Any]"]


def at_once(job: Callable[[], Any]) -> Future[Any]:
    """Return the finished future of a job done now; it holds a `StateFileError` that it raised."""
    future: Future[Any] = Future()
    try:
        future.set_result(job())
    except StateFileError as error:
        future.set_exception(error)
    return future


class SlotStore(ABC, Generic[T]):
    """Keeps something in state files.

    Args:
        slots: The state files; None keeps nothing.
        submit: Does work on the disk; jobs must run one after the other.

    Attributes:
        trouble: Why nothing can be kept at present, and what to do; empty while all is well.
        remedy: What to do about it, where that is known.
        notices: What the user should know, oldest first; take them out.
    """

    def __init__(self, slots: SlotPair[T] | None, submit: Submit) -> None:
        self.trouble = self.cause = self.remedy = ""
        self.failures = self.checkpoints = 0
        self.notices: list[str] = []
        self._slots, self._submit = slots, submit
        self._pending: Future[Any] | None = None

    @abstractmethod
    def _payload(self) -> bytes | None:
        """Return what to write; None for nothing yet."""

    @abstractmethod
    def _adopt(self, stored: Stored[T]) -> None:
        """Continue from what is on disk."""

    def begin(self) -> bool:
        """Whether a write of what there is to keep was begun; an absent folder is tried again."""
        slots = self._slots
        if slots is None or self._pending is not None:
            return False
        if not slots.held:
            self._pending = self._submit(slots.acquire)
            return False
        payload = self._payload()
        if payload is not None:
            self._pending = self._submit(lambda: slots.write(payload))
        return payload is not None

    def poll(self) -> bool | None:
        """Return whether the disk's work succeeded; None if there is nothing to report."""
        if self._pending is None or not self._pending.done():
            return None
        job, self._pending = self._pending, None
        try:
            result = job.result()
            if isinstance(result, Stored):
                stored = cast("Stored[T]", result)
                self.notices += stored.notices
                self._adopt(stored)
                return None
        except StateFileError as error:
            self.failures += 1
            self.trouble, self.remedy = str(error), error.remedy
            self.cause = str(StateFileError(error.found, error.expected))
            return False
        self.checkpoints += 1
        self.trouble = self.cause = self.remedy = ""
        return True

    def open(self, patience: float | None = None) -> None:
        """Open the folder and continue from what is there, as far as that is possible.

        Args:
            patience: How long to wait for the disk; None waits for ever. [s]
        """
        self._finish(patience)
        if self._slots is not None and not self._slots.held:
            self.begin()
            self._finish(patience)

    def _finish(self, patience: float | None) -> bool | None:
        """Wait for the work under way, and take its result."""
        if self._pending is not None:
            wait([self._pending], patience)
        return self.poll()

    def _release(self) -> None:
        """Let another monitor write, unless the disk is still at work."""
        if self._slots is not None and self._pending is None:
            self._slots.release()
