# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""What a meter has said, from numbers of an exchange to readings with a time."""

from __future__ import annotations

import math
from collections import Counter
from enum import Enum
from typing import Annotated

from robot_energy.foundation.described import Described


class Quantity(Enum):
    """What a number is of."""

    ENERGY = "energy"
    POWER = "power"


class MeterTerm(Described):
    """One number of a sum."""

    value: Annotated[float, "NaN if the meter calls it invalid. [W or J]"]
    wraps_at: Annotated[
        float | None, "Where the counter starts again from zero; None if it never does. [J]"
    ] = None
    scale: Annotated[
        float | None, "What one count is, where the meter says so with each reading. [J]"
    ] = None


class Exchange(Described):
    """The numbers of one quantity, read together."""

    quantity: Quantity
    terms: tuple[MeterTerm, ...]
    requested: Annotated[
        float,
        "When the first one was asked for, by the steady clock; for a meter that sends by itself, "
        "when its message arrived. [s]",
    ]
    answered: Annotated[float, "When the last one arrived, likewise. [s]"]


class NetworkReading(Described):
    """A sum with its time."""

    quantity: Quantity
    value: Annotated[float, "[W or J]"]
    at: Annotated[
        float,
        "Middle between request and answer, by the steady clock: the number was taken somewhere "
        "between the two, so the error is at most half of the round trip. [s]",
    ]


class CounterWrap:
    """Continues a counter that starts again from zero at a known value.

    A fall counts as a wrap if the energy that it then implies is one that `max_power` can
    deliver in the time since the last reading. Any other fall is passed on: the monitor takes
    it for a reset or a wrong reading.

    A count whose scale has changed is taken only if it continues the old one: a wrong scale makes
    a thousandfold of it. A new connection may bring another scale, as of a meter set up again.

    Args:
        max_power: Highest power that the installation can draw. [W]
    """

    def __init__(self, max_power: float) -> None:
        self.wraps = 0
        self._max_power = max_power
        self._offset = 0.0  # [J]
        self._last: tuple[float, float] | None = None  # count [J], time [s]
        self._scale: float | None = None  # what one count is [J]; None for not known

    def reconnected(self) -> None:
        """Take the next scale as it is."""
        self._scale = None

    def step(self, term: MeterTerm, at: float) -> float:
        """Return the count as if it never started again; NaN if its scale is in doubt. [J]

        Args:
            at: Time of the reading. [s]
        """
        last, count = self._last, term.value
        if last is not None and self._scale and term.scale and term.scale != self._scale:
            coarse = max(self._scale, term.scale)
            if not -coarse <= count - last[0] <= self._max_power * (at - last[1]) + coarse:
                return math.nan
        self._last, self._scale = (count, at), term.scale
        if term.wraps_at is not None and last is not None and count < last[0]:
            step = count + term.wraps_at - last[0]
            if 0 <= step <= self._max_power * (at - last[1]):
                self._offset += term.wraps_at
                self.wraps += 1
        return self._offset + count


class ReadingFilter:
    """Turns exchanges into readings and counts what it refuses, by reason.

    Args:
        max_power: Highest power that the installation can draw. [W]
        max_round_trip: Longest time from request to answer whose middle is still a stamp. [s]

    Attributes:
        rejected: Refused exchanges by reason: ``not_finite`` (the meter calls a number invalid, or
            it is none), ``too_high`` (a power beyond `max_power`), ``slow``, ``scale_changed`` (the
            meter states another scale for its counter, and the count does not continue).
        round_trip: Of the newest exchange. [s]
    """

    def __init__(self, max_power: float, max_round_trip: float) -> None:
        self.rejected: Counter[str] = Counter()
        self.accepted = 0
        self.round_trip = math.nan
        self._max_power, self._max_round_trip = max_power, max_round_trip
        self._counters: list[CounterWrap] = []

    @property
    def wraps(self) -> int:
        """How often counters started again."""
        return sum(counter.wraps for counter in self._counters)

    def reconnected(self) -> None:
        """Take the scales of counters as they are now."""
        for counter in self._counters:
            counter.reconnected()

    def step(self, exchange: Exchange) -> NetworkReading | None:
        """Return the reading of an exchange; None if it is refused."""
        self.round_trip = exchange.answered - exchange.requested
        at = (exchange.requested + exchange.answered) / 2
        values = [term.value for term in exchange.terms]
        power = exchange.quantity is Quantity.POWER
        reason = ""
        if not all(map(math.isfinite, values)):
            reason = "not_finite"
        elif power and abs(sum(values)) > self._max_power:
            reason = "too_high"
        elif self.round_trip > self._max_round_trip:
            reason = "slow"
        elif not power:
            while len(self._counters) < len(values):
                self._counters.append(CounterWrap(self._max_power))
            pairs = zip(self._counters, exchange.terms, strict=False)
            values = [counter.step(term, at) for counter, term in pairs]
            reason = "" if all(map(math.isfinite, values)) else "scale_changed"
        if reason:
            self.rejected[reason] += 1
            return None
        self.accepted += 1
        return NetworkReading(exchange.quantity, sum(values), at)
