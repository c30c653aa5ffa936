"""Takes what a subscription has queued, in one block, as serialised bytes.

Waking the executor for every message is what costs in rclpy; the message itself is cheap.
So the subscription is kept out of the wait set and is emptied by the node's tick. That
uses internals of rclpy 7 (Jazzy): `CallbackGroup.can_execute`, which the executor asks
before it waits for a subscription, and `Subscription.handle.take_message`. Both are tried
when an inbox is made; where they are missing or behave differently, an ordinary callback
for raw messages fills the queue instead, at a higher price and with the same result.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.qos import QoSProfile

from robot_energy.ingest import Accounting
from robot_energy.wire.batch import RawBatch


class NeverReady(CallbackGroup):
    """A group whose entities never enter the wait set of an executor."""

    def can_execute(self, entity: Any) -> bool:
        """Refuse, so that the executor neither waits for the entity nor takes from it."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Refuse."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Do nothing: nothing of this group is ever executed."""


class Inbox:
    """The messages of one topic that arrived since they were last drained.

    Args:
        node: The node that subscribes.
        message_type: Message class, such as ``sensor_msgs.msg.JointState``.
        topic: Name of the topic.
        qos: Quality of service; its depth bounds what can wait between two ticks.
        direct: False to use ordinary callbacks although the internals of rclpy fit.

    Attributes:
        topic: Resolved name of the topic.
        msgtype: Type as bags name it, such as ``sensor_msgs/msg/JointState``.
        direct: Whether the queue of the middleware is drained without callbacks.
        received: Messages drained so far.
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
    ) -> None:
        self.topic = node.resolve_topic_name(topic)
        self.msgtype = f"{message_type.__module__.split('.')[0]}/msg/{message_type.__name__}"
        self.received = 0
        self.overflows = 0
        self._node = node
        self._type = message_type
        self._depth = qos.depth
        self._arrived_ns: int | None = None
        self._queue: deque[bytes] = deque(maxlen=qos.depth)
        self._subscription = node.create_subscription(
            message_type, topic, self._keep, qos, callback_group=NeverReady(), raw=True
        )
        self.direct = direct and self._fits()
        if not self.direct:
            node.destroy_subscription(self._subscription)
            self._subscription = node.create_subscription(
                message_type, topic, self._keep, qos, raw=True
            )

    def drain(self) -> RawBatch | None:
        """Take every message that waits.

        Returns:
            The messages in order of arrival, with the time of the node's clock, or None if
            there are none.
        """
        messages = list(self._take() if self.direct else self._popped())
        if not messages:
            return None
        self.received += len(messages)
        self.overflows += len(messages) >= self._depth
        self._arrived_ns = time.monotonic_ns()
        now = self._node.get_clock().now().nanoseconds
        return RawBatch.from_messages(self.topic, self.msgtype, [now] * len(messages), messages)

    def discard(self, account: Accounting) -> None:
        """Take every message that waits and count it as rejected, since the node is inactive.

        Args:
            account: Account of the input that these messages would have gone to.
        """
        batch = self.drain()
        if batch is not None:
            account.received += len(batch)
            account.reject("inactive", len(batch))

    @property
    def age(self) -> float:
        """Time since messages were last drained; NaN before the first. [s]"""
        if self._arrived_ns is None:
            return float("nan")
        return (time.monotonic_ns() - self._arrived_ns) * 1e-9

    @property
    def publishers(self) -> int:
        """Number of publishers of the topic that are matched."""
        return self._subscription.get_publisher_count()

    def _take(self) -> Iterator[bytes]:
        """Yield from the queue of the middleware, at most as many as it holds."""
        yield from self._popped()
        handle = self._subscription.handle
        try:
            with handle:
                for _ in range(self._depth):
                    taken = handle.take_message(self._type, True)
                    if taken is None:
                        return
                    yield taken[0]
        except InvalidHandle:  # the node is being destroyed
            return

    def _keep(self, message: bytes) -> None:
        """Queue a message, as the callback of the subscription where it has one."""
        self._queue.append(message)

    def _popped(self) -> Iterator[bytes]:
        """Yield what callbacks, or the trial in the constructor, have queued."""
        while self._queue:
            yield self._queue.popleft()

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
                self._queue.append(taken[0])
        except (AttributeError, TypeError, IndexError, KeyError, NotImplementedError):
            return False
        return True
