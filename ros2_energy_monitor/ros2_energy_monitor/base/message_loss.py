# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Counts messages lost in transport, by the numbers their publishers gave them.

The middleware hands the numbers on, but rclpy does not say whose they are. With one publisher the
count is exact. With several it is the least number of losses that explains all numbers, given when
publishers joined and left: not above the truth, as long as the true explanation is followed.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

MAX_EXPLANATIONS = 8
"""Explanations that are followed for each number of publishers not heard yet: those with the
fewest losses."""


@dataclass(slots=True)
class _Explanation:
    """One way in which the numbers so far can have come about.

    Attributes:
        last: The newest number of each publisher that was heard, ascending.
    """

    last: list[int]
    unheard: int
    lost: int


class MessageLossCounter:
    """Follows the numbers of all publishers of a topic.

    Args:
        met: Returns how many publishers were ever met, and how many are there now. Called
            only when the numbers do not simply go on.
    """

    def __init__(self, met: Callable[[], tuple[int, int]]) -> None:
        self._met = met
        self._explanations = [_Explanation([], 0, 0)]
        self._ever = self._now = 0  # as of the last step that asked
        self._leaving = 0  # publishers that have left; their last messages may still wait

    @property
    def lost(self) -> int:
        """Messages that were published and never arrived, at least."""
        return min(one.lost for one in self._explanations)

    def step(self, numbers: Sequence[int]) -> None:
        """Take the numbers of messages."""
        if not numbers:
            return
        first = self._explanations[0]
        if len(self._explanations) == len(first.last) == 1:
            following = first.last[0] + 1
            if numbers == list(range(following, following + len(numbers))):
                first.last[0] = numbers[-1]
                return
        ever, now = self._met()
        joined = max(ever - self._ever, 0)
        left = max(self._now + joined - now, 0)
        self._ever, self._now = ever, now
        for one in self._explanations:
            one.unheard += joined
        for number in numbers:
            self._take(number)
        for _ in range(self._leaving):
            self._explanations = _fewest(_without_one(self._explanations))
        self._leaving = left

    def _take(self, number: int) -> None:
        """Follow each explanation on: the number continues a publisher, or is the first of one.

        If it continues one, then the one with the nearest number below: any other choice
        can be made good later at no lower cost. Where it continues one without a gap, that
        is never worse than a first number.
        """
        found: list[_Explanation] = []
        changed = False
        for one in self._explanations:
            place = bisect_left(one.last, number) - 1
            gap = number - one.last[place] - 1 if place >= 0 else 0
            changed |= place < 0 or gap > 0
            if one.unheard and (place < 0 or gap):
                found.append(_Explanation(sorted([*one.last, number]), one.unheard - 1, one.lost))
            if place >= 0:
                one.last[place] = number
                one.lost += gap
                found.append(one)
        if not found:  # a publisher that was not announced
            best = min(self._explanations, key=lambda one: one.lost)
            insort(best.last, number)
            found = [best]
        self._explanations = _fewest(found) if changed else found


def _without_one(explanations: Iterable[_Explanation]) -> list[_Explanation]:
    """Each explanation without one publisher, whichever it may be."""
    found: list[_Explanation] = []
    for one in explanations:
        found += [
            _Explanation([*one.last[:place], *one.last[place + 1 :]], one.unheard, one.lost)
            for place in range(len(one.last))
        ]
        if one.unheard:
            found.append(_Explanation(one.last, one.unheard - 1, one.lost))
        if not one.last and not one.unheard:
            found.append(one)
    return found


def _fewest(explanations: Iterable[_Explanation]) -> list[_Explanation]:
    """Those with the fewest losses, for each number of publishers that are unheard."""
    kept: dict[tuple[int, ...], _Explanation] = {}
    like = Counter[int]()
    for one in sorted(explanations, key=lambda one: one.lost):
        key = (one.unheard, *one.last)
        if like[one.unheard] < MAX_EXPLANATIONS and key not in kept:
            kept[key] = one
            like[one.unheard] += 1
    return list(kept.values())
