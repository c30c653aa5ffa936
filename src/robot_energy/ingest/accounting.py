"""What became of every message: received = accepted + sum of rejected by reason.

A message whose fate later messages decide waits; at the end none does.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

MOST_NAMES = 100  # of joints remembered at most, whatever the messages say


@dataclass
class Accounting:
    """Counts of one input.

    Attributes:
        received: Messages that arrived.
        accepted: Messages that were used.
        rejected: Messages that were not, by reason.
        waiting: Messages of which it is not known yet.
    """

    received: int = 0
    accepted: int = 0
    rejected: Counter[str] = field(default_factory=lambda: Counter[str]())
    waiting: int = 0

    def reject(self, reason: str, count: int = 1) -> None:
        """Count rejected messages."""
        if count:
            self.rejected[reason] += count

    @property
    def balanced(self) -> bool:
        """Whether every message is accounted for."""
        return self.received == self.accepted + sum(self.rejected.values()) + self.waiting
