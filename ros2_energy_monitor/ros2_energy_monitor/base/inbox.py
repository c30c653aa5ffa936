# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Takes what a subscription has queued, in one block, as serialised bytes.

Waking the executor for every message is what costs in rclpy, so the subscription is kept out of
the wait set and emptied by the node's tick. That uses internals of rclpy 7 (Jazzy):
`CallbackGroup.can_execute` and `Subscription.handle.take_message`. Both are tried when an inbox
is made; where they behave differently, an ordinary callback for raw messages fills the queue
instead, at a higher price and with the same result.
"""

from __future__ import annotations

import time
from bisect import bisect_left, insort
from collections import Counter, deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from rclpy.callback_groups import CallbackGroup
from rclpy.clock import ROSClock
from rclpy.event_handler import QoSSubscriptionEventType as Event
from rclpy.event_handler import SubscriptionEventCallbacks, UnsupportedEventTypeError
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile

from robot_energy.bag.cdr.decode import RawBatch
from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.timeline.blocks import NANOSECOND
from ros2_energy_monitor.diagnostics.topic_publishers import TopicPublishers

MAX_EXPLANATIONS = 8
"""Explanations that are followed for each number of publishers not heard yet: those with the
fewest losses."""
MAX_WAIT = 120.0  # for data, before a trial to subscribe again [s]
AT_ONCE = 2.0  # data so soon after a trial are its success [s]


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


class ResubscribePolicy:
    """Decides when to subscribe again although publishers are there: data are not.

    After a network failure the middleware may never hand on data again. A topic may also
    be silent by nature. So the time to wait doubles with every trial, and a silence that ends
    without one teaches how long to wait at least.

    Args:
        after: Shortest silence after which to try. [s]
    """

    def __init__(self, after: float) -> None:
        self._after = after
        self._wait = after
        self._tried: float | None = None
        self._since: float | None = None  # start of the silence

    def heard(self, now: float) -> None:
        """Note data.

        Args:
            now: Time on any steady clock. [s]
        """
        if self._since is not None and self._tried is not None and now - self._tried > AT_ONCE:
            self._after = min(2.0 * (now - self._since), MAX_WAIT)
        self._wait, self._tried, self._since = self._after, None, now

    def due(self, now: float, publishers: int) -> bool:
        """Whether to subscribe again now.

        Args:
            now: Time on the same clock. [s]
            publishers: How many there are; without one there is nothing to wait for.
        """
        if not publishers or self._since is None:
            self._since = now
            self._wait, self._tried = self._after, None
            return False
        if now - (self._since if self._tried is None else self._tried) < self._wait:
            return False
        self._tried = now
        self._wait = min(2.0 * self._wait, MAX_WAIT)
        return True


INACTIVE = "inactive"  # the reason under which messages are counted meanwhile


class NeverReady(CallbackGroup):
    """A group whose entities never enter the wait set of an executor."""

    def can_execute(self, entity: Any) -> bool:
        """Refuse, so that the executor neither waits for the entity nor takes from it.

        Arguments and result as in `rclpy.callback_groups.CallbackGroup.can_execute`.
        """
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Refuse; as in `rclpy.callback_groups.CallbackGroup.beginning_execution`."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Do nothing: nothing of this group is ever executed.

        Arguments as in `rclpy.callback_groups.CallbackGroup.ending_execution`.
        """


def event_status(subscription: Any, kind: Event) -> Any:
    """Return what the middleware has counted of an event; None where it cannot."""
    try:
        with subscription:
            event = rclpy_implementation.EventHandle(subscription, kind)
        with event:
            status = event.take_event()
        event.destroy_when_not_in_use()
    except (InvalidHandle, UnsupportedEventTypeError, AttributeError, TypeError):
        return None
    return status


class Inbox:
    """The messages of one topic that arrived since they were last drained.

    Args:
        message_type: Message class, such as ``sensor_msgs.msg.JointState``.
        qos: Quality of service; its depth bounds what can wait between two ticks.
        direct: False to use ordinary callbacks although the internals of rclpy fit.
        renew_after: Silence after which to subscribe again although there are publishers,
            see `ResubscribePolicy`; None for never, as with topics that are silent by nature. [s]

    Attributes:
        msgtype: Type as bags name it, such as ``sensor_msgs/msg/JointState``.
        direct: Whether the queue of the middleware is drained without callbacks.
        overflows: How often the queue was found full, so that messages may be lost.
    """

    def __init__(
        self,
        node: Node,
        message_type: type[Any],
        topic: str,
        qos: QoSProfile,
        *,
        direct: bool = True,
        renew_after: float | None = None,
    ) -> None:
        self.topic = node.resolve_topic_name(topic)
        self.msgtype = f"{message_type.__module__.split('.')[0]}/msg/{message_type.__name__}"
        self.received = 0
        self.overflows = 0
        self.renewals = 0
        self.topic_publishers = TopicPublishers(node, self.topic, self.msgtype, qos)
        self._node = node
        self._type = message_type
        self._qos = qos
        self._depth = qos.depth
        self._arrived_ns: int | None = None
        self._unheard_ns: int | None = None  # the first time that `_revival` does not know
        # Messages, with what the middleware says of them.
        self._queue: deque[tuple[bytes, dict[str, Any]]] = deque(maxlen=qos.depth)
        self._sequences = MessageLossCounter(self.met)
        self._revival = None if renew_after is None else ResubscribePolicy(renew_after)
        self._met_before = 0  # publishers that earlier subscriptions have met
        self._subscribe(NeverReady())
        self.direct = direct and self._fits()
        if not self.direct:
            node.destroy_subscription(self._subscription)
            self._subscribe(None)

    def drain(self) -> RawBatch | None:
        """Take every message that waits.

        Returns:
            The messages in order of arrival, each with its time of receipt: that of the
            middleware, or of the node's clock where it is not the system's or the middleware
            gives none. None if there are no messages.
        """
        if self.direct:
            handle, take = self._subscription.handle, self._subscription.handle.take_message
            with suppress(InvalidHandle), handle:  # invalid while the node is being destroyed
                while len(self._queue) < self._depth and (taken := take(self._type, True)):
                    self._queue.append(taken)
        if not self._queue:
            return None
        messages, numbers, received_ns = list[bytes](), list[Any](), list[int]()
        for message, info in self._queue:
            messages.append(message)
            numbers.append(info.get("publication_sequence_number"))
            received_ns.append(int(info.get("received_timestamp") or 0))
        self._queue.clear()
        if None not in numbers:  # else the middleware does not count
            self._sequences.step(numbers)
        self.received += len(messages)
        self.overflows += len(messages) >= self._depth
        self._arrived_ns = time.monotonic_ns()
        self._unheard_ns = self._unheard_ns or self._arrived_ns
        clock = self._node.get_clock()
        now, times = clock.now().nanoseconds, np.array(received_ns, dtype=np.int64)
        if isinstance(clock, ROSClock) and clock.ros_time_is_active:
            times[:] = now
        times[(times <= 0) | (times > now)] = now
        return RawBatch.from_messages(self.topic, self.msgtype, times, messages)

    def discard(self, rejections: RejectionLog) -> None:
        """Take every message that waits and count it as rejected, since the node is inactive.

        Args:
            rejections: Account of the input that these messages would have gone to.
        """
        batch = self.drain()
        if batch is not None:
            rejections.received += len(batch)
            rejections.reject(INACTIVE, len(batch))

    def renew_after(self, seconds: float) -> None:
        """Change the silence after which to subscribe again, where there is one.

        Args:
            seconds: The silence. [s]
        """
        if self._revival is not None:
            self._revival = ResubscribePolicy(seconds)

    def resubscribe_if_silent(self) -> None:
        """Subscribe again if it is time for that; called about once a second."""
        if self._revival is None:
            return
        if self._unheard_ns is not None and self._arrived_ns is not None:
            self._revival.heard(self._unheard_ns * NANOSECOND)  # which ended a silence
            self._revival.heard(self._arrived_ns * NANOSECOND)
            self._unheard_ns = None
        known = self._node.count_publishers(self.topic)
        if self._revival.due(time.monotonic(), known):
            self.renew()

    def renew(self) -> None:
        """Subscribe again, in case the middleware has lost a publisher that is there."""
        ever, now = self.met()
        self._node.destroy_subscription(self._subscription)
        self._met_before = ever - now
        self._subscribe(NeverReady() if self.direct else None)
        self.renewals += 1

    @property
    def lost(self) -> int:
        """Messages that were published since the first that arrived, and are missing."""
        return self._sequences.lost

    @property
    def mismatches(self) -> int:
        """Publishers met so far whose quality of service does not fit."""
        kind = Event.RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS
        status = event_status(self._subscription.handle, kind)
        return 0 if status is None else int(status.total_count)

    @property
    def age(self) -> float:
        """Time since messages were last drained; NaN before the first. [s]"""
        if self._arrived_ns is None:
            return float("nan")
        return (time.monotonic_ns() - self._arrived_ns) * NANOSECOND

    @property
    def publishers(self) -> int:
        """Number of publishers of the topic that are matched."""
        try:
            return self._subscription.get_publisher_count()
        except InvalidHandle:  # closed
            return 0

    def _subscribe(self, group: CallbackGroup | None) -> None:
        self._subscription = self._node.create_subscription(
            self._type,
            self.topic,
            cast("Callable[[Any], None]", self._keep),  # rclpy looks whether it wants the info
            self._qos,
            callback_group=group,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            raw=True,
        )

    def met(self) -> tuple[int, int]:
        """Return how many publishers were ever matched, and how many are now."""
        status = event_status(self._subscription.handle, Event.RCL_SUBSCRIPTION_MATCHED)
        if status is None:
            return self._met_before + self.publishers, self.publishers
        return self._met_before + int(status.total_count), int(status.current_count)

    def _keep(self, message: bytes, info: dict[str, Any]) -> None:
        """Queue a message, as the callback of the subscription where it has one."""
        self._queue.append((message, info))

    def _fits(self) -> bool:
        """Try the internals of rclpy; a message that arrives meanwhile is kept."""
        try:
            asks_the_group: Callable[..., bool] = Executor.can_execute
            if asks_the_group(None, self._subscription) is not False:
                return False
            handle = self._subscription.handle
            with handle:
                taken = handle.take_message(self._type, True)
            if taken is not None:
                if not isinstance(taken[0], bytes):
                    return False
                self._queue.append(taken)
        except (AttributeError, TypeError, IndexError, KeyError, NotImplementedError):
            return False
        return True
