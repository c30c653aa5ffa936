# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""A service whose requests are taken outside the executor, and stay in C until their size is known.

rclpy takes a request in the thread of the ticks, and no other thread runs until every part of it is
a Python object: 300,000 points of a trajectory silenced a monitor for seconds. Here a thread of
its own takes requests with `rcl`, which leaves the interpreter to the ticks meanwhile. The service
itself is one of rclpy, in a callback group that no executor asks.

The middleware keeps as much memory for a service as its longest request took, 128 MB for 1,000,000
points, and gives it back with the service only.
"""

from __future__ import annotations

import ctypes
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.node import Node

from robot_energy.foundation.process_memory import give_back_freed_memory
from ros2_energy_monitor.base.inbox import NeverReady
from ros2_energy_monitor.services.c_memory import CMessage

OK = 0  # RCL_RET_OK
HEADER = 256  # bytes; a `rmw_request_id_t` has 24


class TakenRequest:
    """A request that waits for its answer.

    Attributes:
        message: What was asked; `CMessage.free` it when it was read.
    """

    def __init__(self, kind: Any) -> None:
        self.message = CMessage(kind)
        self.header = ctypes.create_string_buffer(HEADER)


class RawService:
    """A service that is polled by a thread; use it from one thread only.

    Raises:
        OSError: If `rcl` cannot be called.
        AttributeError: If `rclpy` does not say where its service lies.
    """

    def __init__(self, node: Node, kind: Any, name: str) -> None:
        rcl = ctypes.CDLL("librcl.so")  # rclpy has loaded it
        self._take, self._send = rcl.rcl_take_request, rcl.rcl_send_response
        for function in (self._take, self._send):
            function.argtypes = [ctypes.c_void_p] * 3
        self._node, self._kind, self.name = node, kind, name
        self._create()
        self._next = TakenRequest(kind.Request)

    def _create(self) -> None:
        self._service: Any = self._node.create_service(
            self._kind, self.name, lambda _, response: response, callback_group=NeverReady()
        )
        self.name: str = self._service.service_name
        self._handle: Any = self._service.handle
        self._place: int = self._handle.pointer

    def renew(self) -> None:
        """Give back the memory of the middleware; a request that arrives meanwhile is lost."""
        self._node.destroy_service(self._service)
        self._create()
        give_back_freed_memory()

    def take(self) -> TakenRequest | None:
        """Return a request that has arrived; None if there is none."""
        taken = self._next
        if self._call(self._take, taken.header, taken.message.address) != OK:
            return None
        self._next = TakenRequest(self._kind.Request)
        return taken

    def answer(self, request: TakenRequest, response: Any) -> None:
        """Answer a request; nothing happens if the service is gone."""
        message = CMessage(self._kind.Response).fill(response)
        self._call(self._send, request.header, message.address)
        message.free()

    def _call(self, function: Any, header: Any, message: int) -> int | None:
        """Call `rcl` while the service is there; other threads run meanwhile."""
        try:
            with self._handle:
                return function(self._place, ctypes.addressof(header), message)
        except InvalidHandle:
            return None
