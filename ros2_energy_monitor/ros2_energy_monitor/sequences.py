"""Counts messages lost in transport, by the numbers their publishers gave them.

Every publisher numbers its messages 1, 2, 3 ...; the middleware hands the number on, but
not whose it is. With one publisher the count is exact: published = received + lost, from
its first message that arrived on. With several, a number is taken to continue the
publisher whose last number lies closest below it. That can exchange publishers of like
numbers, which changes nothing in the sum.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence


class Sequences:
    """Follows the numbers of all publishers of a topic.

    Args:
        met: Tells how many publishers were ever met, and how many are there now. Called
            only when the numbers do not simply go on.

    Attributes:
        lost: Messages that were published and never arrived.
    """

    def __init__(self, met: Callable[[], tuple[int, int]]) -> None:
        self.lost = 0
        self._met = met
        self._last: list[int] = []  # newest number of each publisher, the one heard last at the end
        self._started = 0  # publishers of which a message has arrived

    def step(self, numbers: Sequence[int]) -> None:
        """Take the numbers of messages in order of arrival."""
        if len(self._last) == 1 and numbers:
            first = self._last[0] + 1
            if numbers == list(range(first, first + len(numbers))):
                self._last[0] = numbers[-1]
                return
        ever, now = self._met() if numbers else (0, 0)
        for number in numbers:
            self._take(number, ever, max(now, 1))

    def _take(self, number: int, ever: int, now: int) -> None:
        before = max((last for last in self._last if last < number), default=None)
        if before is not None and (before + 1 == number or self._started >= ever):
            self.lost += number - before - 1
            self._last.remove(before)
        else:  # the first message of a publisher; those before it are not ours
            self._started = min(self._started + 1, ever)
        self._last.append(number)
        del self._last[:-now]
