# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Checks one input: is it there, is it fresh, is it whole, is it accepted."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from robot_energy.inputs.rejection_log import RejectionLog
from ros2_energy_monitor.base.inbox import INACTIVE, Inbox
from ros2_energy_monitor.diagnostics.reporter import ERROR, STALE, WARN, Number, StatusBuilder

ALONE = "prediction only"  # what is left without the input
ABSENT_REPORTS = 5  # one a second: discovery takes less, so an input absent so long is absent
REJECTED_SHARE = 0.01  # more than this of the messages of one second is worth a warning
BETWEEN_NODES = {"other_model": "give all monitors the same model file"}


@dataclass(frozen=True)
class _Counts:
    """What was counted until a report."""

    received: int = 0
    rejected: Mapping[str, int] = field(default_factory=lambda: dict[str, int]())
    overflows: int = 0
    lost: int = 0
    mismatches: int = 0


class InputWatch:
    """Checks one input.

    Args:
        timeout: Gives the silence beyond which it counts as missing. [s]
        needed: Whether its absence from the start is an error; else it is a note.
        remedy: What to do about its absence.
        remedy_of: Gives what to do where all messages are rejected, for the reason of most.
    """

    def __init__(
        self,
        what: str,
        inbox: Inbox,
        rejections: RejectionLog,
        timeout: Callable[[], float],
        needed: bool = True,
        remedy: str = "",
        remedy_of: Callable[[str], str] = lambda reason: BETWEEN_NODES.get(reason, ""),
    ) -> None:
        self._what, self._inbox, self._rejections = what, inbox, rejections
        self._remedy = remedy
        self._remedy_of = remedy_of
        self._newest = (0, 0, "")  # messages of the newest second with any, how many rejected, why
        self._timeout, self._needed = timeout, needed
        self._before = _Counts()
        self._absent = 0  # reports since the start without a publisher

    def check(self, found: StatusBuilder, prefix: str = "") -> None:
        """Add the key values of the input and what is wrong with it."""
        inbox, rejections, before = self._inbox, self._rejections, self._before
        after = _Counts(
            rejections.received,
            dict(rejections.rejected),
            inbox.overflows,
            inbox.lost,
            inbox.mismatches,
        )
        self._before = after
        found.values |= {
            f"{prefix}input_age_s": inbox.age,
            f"{prefix}input_publishers": inbox.publishers,
            **accounting(rejections, prefix),
            f"{prefix}lost_in_transport": inbox.lost,
            f"{prefix}queue_overflows": inbox.overflows,
            f"{prefix}subscription_renewals": inbox.renewals,
        }
        self._presence(found)
        self._report_publishers(found, prefix, changed=after.mismatches != before.mismatches)
        self._rejected(found, before, after)
        if after.lost > before.lost:
            full = " as the queue was full" if after.overflows > before.overflows else ""
            found.add(
                WARN,
                f"{after.lost - before.lost} messages on {inbox.topic} were lost in transport in "
                f"the last second{full}",
                "raise the depth of the queue or tick_rate" if full else "check the network",
            )

    def _presence(self, found: StatusBuilder) -> None:
        inbox, alone = self._inbox, f"no publisher on {self._inbox.topic}: {ALONE}"
        missing = f"no {self._what} has arrived on {inbox.topic}, which has {counted(inbox)}"
        if inbox.received:
            if inbox.age > self._timeout():
                found.add(STALE, f"no {self._what} for {inbox.age:.1f} s on {inbox.topic}")
            elif math.isinf(self._timeout()) and not inbox.publishers:  # silence is not a fault
                gone = f"{inbox.topic} has no publisher any more"
                found.add(STALE, f"{gone}: no {self._what} for {inbox.age:.1f} s", self._remedy)
        elif self._needed:
            found.add(ERROR, missing, "" if inbox.publishers else self._remedy)
        elif inbox.publishers:
            found.notes.append(f"{missing}: {ALONE}")
        else:  # in the log, once it is sure
            found.notes.append(alone)
            self._absent += 1
            if self._absent >= ABSENT_REPORTS:
                found.remarks.append(alone)

    def _report_publishers(self, found: StatusBuilder, prefix: str, *, changed: bool) -> None:
        """Name the publishers if there are several, and those that nothing arrives from."""
        topic_publishers = self._inbox.topic_publishers
        topic_publishers.look(now=changed)
        if topic_publishers.names.total() > 1:
            found.values |= {
                f"{prefix}publisher.{name}": n for name, n in topic_publishers.names.items()
            }
        for complaint in topic_publishers.complaints:
            level = WARN if self._inbox.publishers else ERROR
            found.add(level, complaint, "change that publisher or the topic")

    def _rejected(self, found: StatusBuilder, before: _Counts, after: _Counts) -> None:
        """Say what is rejected; the newest messages count until others come or the input is late.

        Friction is published when it changes: rejected once, it may be missing for hours.
        """
        fresh = after.received - before.received
        if fresh:
            reasons = {
                reason: count - before.rejected.get(reason, 0)
                for reason, count in after.rejected.items()
                if reason != INACTIVE  # as asked for
            }
            worst = max(reasons, key=lambda reason: reasons[reason], default="")
            self._newest = fresh, sum(reasons.values()), worst
        new, count, worst = self._newest
        whole, age = count >= new, self._inbox.age
        if count <= REJECTED_SHARE * new or not (fresh or (whole and age <= self._timeout())):
            return
        share = f"all {new}" if whole else f"{count} of {new}"
        when = "in the last second" if fresh else f"{age:.0f} s ago and none since"
        found.add(
            ERROR if self._needed and whole else WARN,
            f"{share} messages on {self._inbox.topic} rejected {when}, most as {worst}",
            self._remedy_of(worst) if whole else "",
        )


def counted(inbox: Inbox) -> str:
    """Return how many publishers a topic has, in words."""
    number = inbox.publishers
    return f"{number or 'no'} publisher{'s' if number > 1 else ''}"


def accounting(rejections: RejectionLog, prefix: str = "") -> dict[str, Number]:
    """Return received messages, and what sums to them: accepted, waiting, rejected by reason."""
    return {
        f"{prefix}received": rejections.received,
        f"{prefix}accepted": rejections.accepted,
        f"{prefix}waiting": rejections.waiting,
        **{f"{prefix}rejected.{reason}": count for reason, count in rejections.rejected.items()},
    }
