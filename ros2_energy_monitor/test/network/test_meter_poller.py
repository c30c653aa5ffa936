# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""How long the poller waits before it connects again."""

from contextlib import suppress
from typing import Any

from robot_energy.foundation.errors import MeterAnswerError, MeterLinkError
from ros2_energy_monitor.meters.poller import MAX_REFUSALS, MIN_BACKOFF, Poller
from ros2_energy_monitor.meters.reading import ReadingFilter


class FailingLink:
    """Connects, and raises at every request."""

    waits = False

    def __init__(self, error: Exception) -> None:
        self.error = error
        self.closed = 0

    def connect(self) -> None:
        pass

    def read(self) -> Any:
        raise self.error

    def close(self) -> None:
        self.closed += 1


def pauses(link: Any, steps: int) -> list[float]:
    """Pauses before each new attempt to connect, without waiting for them."""
    poller = Poller(link, ReadingFilter(1e5, 1.0), 1.0, 30.0, lambda _, work: work())
    found: list[float] = []
    for _ in range(steps):
        with suppress(ZeroDivisionError):
            poller._step()
        if not poller.state.connected:
            found.append(poller.state.backoff)
    return found


def test_pauses_double_from_refusal_to_refusal_and_from_loss_to_loss() -> None:
    doubled = [MIN_BACKOFF * 2**n for n in range(6)] + [30.0]
    refused = FailingLink(MeterAnswerError("exception 6", "a number", "wait"))
    assert pauses(refused, 7 * MAX_REFUSALS) == doubled
    assert refused.closed == 7
    lost = FailingLink(MeterLinkError("no answer", "one", "look at the cable"))
    assert pauses(lost, 7) == doubled


def test_an_internal_error_is_a_loss_with_a_pause_that_doubles_and_a_text() -> None:
    link = FailingLink(ZeroDivisionError("a fault of ours"))
    assert pauses(link, 3) == [MIN_BACKOFF, 2 * MIN_BACKOFF, 4 * MIN_BACKOFF]
    assert link.closed == 3
    poller = Poller(link, ReadingFilter(1e5, 1.0), 1.0, 30.0, lambda _, work: work())
    with suppress(ZeroDivisionError):
        poller._step()
    assert poller.state.last_error == "a fault of ours"
    assert poller.state.errors == {"ZeroDivisionError": 1}
    assert poller.state.failures == 1
