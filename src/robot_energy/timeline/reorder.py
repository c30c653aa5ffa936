"""Messages that overtook each other: sorted within a window of their stamps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np

from robot_energy.blocks import Block, Int

OLDER = "older_stamp"  # the reason under which messages that come too late are counted
B = TypeVar("B", bound=Block)


def all_alike(block: Block) -> dict[bytes, Int]:
    """Return the rows of each kind of messages in a stream that has one kind only.

    Args:
        block: The messages.
    """
    return {b"": np.arange(len(block))}


class ReorderBuffer(Generic[B]):
    """Puts messages of one kind into the order of their stamps.

    A message waits until the stamps of its kind have passed it by the window. One that
    arrives later than that is dropped.

    Args:
        window_ns: How far a stamp may lie behind the newest one of the same kind. [ns]
        reject: Counts what is dropped, by its reason.
        kinds: Gives the rows of each kind, as of the messages that have the same joints.
    """

    def __init__(
        self,
        window_ns: int,
        reject: Callable[[str, int], None],
        kinds: Callable[[B], dict[bytes, Int]] = all_alike,
    ) -> None:
        self._window_ns = window_ns
        self._reject = reject
        self._kinds = kinds
        self.restart()

    @property
    def waiting(self) -> int:
        """Messages that wait for the window to pass."""
        return 0 if self._held is None else len(self._held)

    def restart(self) -> None:
        """Forget what waits, and the stamps met."""
        self._newest: dict[bytes, int] = {}
        self._held: B | None = None

    def step(self, block: B) -> B:
        """Take messages.

        Args:
            block: Of one epoch, in order of arrival.

        Returns:
            Those that are in order, which may be none.
        """
        if not self._window_ns:
            return block
        known = self.waiting
        whole = block if self._held is None else type(block).concatenate([self._held, block])
        release = np.full(len(whole), -1, dtype=np.int64)  # row whose arrival lets it go
        keep = np.ones(len(whole), dtype=np.bool_)
        for key, rows in self._kinds(whole).items():
            fresh = rows[rows >= known]
            stamp = whole.stamp_ns[fresh]
            if not len(stamp):
                continue
            before = self._newest.get(key, int(stamp[0]))
            newest = np.maximum.accumulate(np.append(before, stamp))
            keep[fresh[stamp < newest[:-1] - self._window_ns]] = False
            self._newest[key] = int(newest[-1])
            at = np.searchsorted(newest[1:], whole.stamp_ns[rows] + self._window_ns, side="left")
            free = at < len(stamp)
            release[rows[free]] = fresh[at[free]]
        self._reject(OLDER, int((~keep).sum()))
        free = np.flatnonzero(keep & (release >= 0))
        order = np.lexsort((whole.stamp_ns[free], release[free]))
        left = keep & (release < 0)
        self._held = whole[left] if bool(left.any()) else None
        return whole[free[order]]

    def flush(self) -> B | None:
        """Return what still waits, as at the end of an epoch, and forget its stamps."""
        held = self._held
        self.restart()
        return None if held is None else held[np.argsort(held.stamp_ns, kind="stable")]
