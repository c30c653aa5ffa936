"""What became of every message: received = accepted + sum of rejected by reason.

A message whose fate later messages decide waits; at the end none does.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.shown_text import shown

MAX_NAMES = 100  # of joints remembered at most, whatever the messages say
MAX_KEPT_CHARACTERS = 1_000_000  # of names that messages are matched by
MAX_JOINTS = 1_000  # of one message, as of a URDF; no robot has a tenth of them

Value = TypeVar("Value")


def remember_names(kept: set[str], names: Iterable[str]) -> None:
    """Add names, as they can be shown, while there is room for them."""
    for name in names:
        if len(kept) >= MAX_NAMES:
            return
        kept.add(shown(name))


class ByNames(dict[tuple[str, ...], Value], Generic[Value]):
    """What was found out about lists of names, for those met lately."""

    _characters = 0

    def put(self, names: tuple[str, ...], value: Value) -> Value:
        """Return a value, remembered from now on; a full memory is emptied before."""
        size = sum(map(len, names)) + len(names)
        if len(self) >= MAX_NAMES or self._characters + size > MAX_KEPT_CHARACTERS:
            self.clear()
            self._characters = 0
        if size <= MAX_KEPT_CHARACTERS:
            self[names] = value
            self._characters += size
        return value


@dataclass
class RejectionLog:
    """Counts of one input."""

    received: int = 0
    accepted: int = 0
    rejected: Annotated[Counter[str], "Messages that were not, by reason."] = field(
        default_factory=lambda: Counter[str]()
    )
    waiting: Annotated[int, "Messages of which it is not known yet."] = 0

    def reject(self, reason: str, count: int = 1) -> None:
        """Count rejected messages."""
        if count:
            self.rejected[reason] += count

    def refuse(self, wrong: Mapping[str, NDArray[np.bool_]]) -> NDArray[np.bool_]:
        """Return which messages are left, shape (N,); count others for the first reason they have.

        Args:
            wrong: Which messages each reason applies to, shape (N,) each; at least one reason.
        """
        left = np.ones_like(next(iter(wrong.values())))
        for reason, rows in wrong.items():
            self.reject(reason, int((rows & left).sum()))
            left &= ~rows
        return left

    def lose(self, before: RejectionLog, arrived: int, reason: str) -> None:
        """Count what has arrived since, and what waited then, as rejected: all of it was lost."""
        self.received = before.received + arrived
        self.accepted = before.accepted
        self.rejected.clear()
        self.rejected.update(before.rejected)
        self.reject(reason, arrived + before.waiting)
        self.waiting = 0

    @property
    def balanced(self) -> bool:
        """Whether every message is accounted for."""
        return self.received == self.accepted + sum(self.rejected.values()) + self.waiting
