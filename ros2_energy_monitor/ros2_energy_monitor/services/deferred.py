"""A service whose answer takes longer than a tick, without a second executor thread."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.node import Node


class DeferredService:
    """A service that may answer later; one request waits at a time.

    rclpy sends what the callback returns, at once; a coroutine would make its executor poll
    without a pause. So the callback may return None here: the request is kept then, and
    answered in the executor's thread after `wake`, which any thread may call.

    Args:
        node: The node that serves.
        kind: Class of the service.
        name: Its name.
        begin: Takes a request; returns its answer, or None to answer later.
        end: Returns the answer to the waiting request, or None to wait on.
    """

    def __init__(
        self,
        node: Node,
        kind: Any,
        name: str,
        begin: Callable[[Any], Any],
        end: Callable[[], Any],
    ) -> None:
        self._node, self._kind, self._name = node, kind, name
        self._begin, self._end = begin, end
        self._header: Any = None  # of the request that waits
        self._send: Callable[[Any, Any], None] | None = None
        self._done: Any = None  # guard condition
        self._service: Any = None

    @property
    def pending(self) -> bool:
        """Whether a request waits for its answer."""
        return self._header is not None

    def open(self) -> None:
        """Create the service."""
        self._done = self._node.create_guard_condition(self._finish_if_done)
        self._service = self._node.create_service(self._kind, self._name, self._take)
        self._send = self._service.send_response
        self._service.send_response = self._send_or_keep

    def wake(self) -> None:
        """Ask for the answer soon; from any thread."""
        done = self._done
        if done is None:
            return
        try:
            done.trigger()
        except InvalidHandle:  # destroyed meanwhile
            pass

    def close(self, answer: Any) -> None:
        """Answer the request that waits, and end; the node destroys the service itself.

        Args:
            answer: A response of the service; it is not sent if no request waits.
        """
        self.finish(answer)
        if self._service is not None:
            del self._service.send_response  # its reference to this object
        self._service = self._send = self._done = None

    def finish(self, answer: Any) -> None:
        """Answer the request that waits, if one does.

        Args:
            answer: A response of the service; it is not sent if no request waits.
        """
        header, self._header = self._header, None
        if header is not None and self._send is not None:
            self._send(answer, header)

    def _take(self, request: Any, _: Any) -> Any:
        return self._begin(request)

    def _send_or_keep(self, answer: Any, header: Any) -> None:
        if answer is None:
            self._header = header
        elif self._send is not None:
            self._send(answer, header)

    def _finish_if_done(self) -> None:
        answer = self._end() if self.pending else None
        if answer is not None:
            self.finish(answer)
