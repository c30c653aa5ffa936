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

A message is a struct of its fields in order (`rosidl_runtime_c`); a string or sequence has a
pointer, a size and a capacity. Sizes are read where they lie, and figures in columns: a Python
object for each part would take some 20 us for a point of a trajectory.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectory

from robot_energy.foundation.errors import MotionError
from robot_energy.foundation.process_memory import give_back_freed_memory
from robot_energy.foundation.units import SECOND_NS
from ros2_energy_monitor.base.inbox import NeverReady

if TYPE_CHECKING:
    from robot_energy_plan.motion.joint_trajectory import PointColumns

MAX_NAMES = 1000  # joints of a request
NUMBERS: dict[str, Any] = {
    "double": ctypes.c_double,
    "float": ctypes.c_float,
    "int32": ctypes.c_int32,
    "uint32": ctypes.c_uint32,
    "boolean": ctypes.c_bool,
}


class Sequence(ctypes.Structure):
    """A string or a sequence of anything."""

    _fields_ = (
        ("data", ctypes.c_size_t),
        ("size", ctypes.c_size_t),
        ("capacity", ctypes.c_size_t),
    )


@cache
def layout(kind: type[Any]) -> type[ctypes.Structure]:
    """Return how a message lies in memory."""
    fields = [(name, _field(text)) for name, text in kind.get_fields_and_field_types().items()]
    return type(kind.__name__, (ctypes.Structure,), {"_fields_": fields})


def _field(text: str) -> Any:
    if text.startswith(("sequence<", "string")):
        return Sequence
    return NUMBERS[text] if text in NUMBERS else layout(_class(text))


def _class(text: str) -> type[Any]:
    """The class of ``package/Name``."""
    package, _, name = text.partition("/")
    return getattr(import_module(f"{package}.msg"), name)


class Allocator(ctypes.Structure):
    """What C allocates memory with: `rcutils_allocator_t`."""

    _fields_ = tuple(
        (name, ctypes.c_void_p)
        for name in ("allocate", "deallocate", "reallocate", "zero_allocate", "state")
    )


class Bytes(ctypes.Structure):
    """A serialised message: `rcutils_uint8_array_t`."""

    _fields_ = (
        ("buffer", ctypes.c_void_p),
        ("length", ctypes.c_size_t),
        ("capacity", ctypes.c_size_t),
        ("allocator", Allocator),
    )


class CMessage:
    """A message in memory of its own."""

    def __init__(self, kind: type[Any]) -> None:
        support: Any = type(kind)
        if support._TYPE_SUPPORT is None:
            support.__import_type_support__()
        create = ctypes.CFUNCTYPE(ctypes.c_void_p)(_pointer(support._CREATE_ROS_MESSAGE))
        self._destroy = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(
            _pointer(support._DESTROY_ROS_MESSAGE)
        )
        self._fill = ctypes.PYFUNCTYPE(ctypes.c_bool, ctypes.py_object, ctypes.c_void_p)(
            _pointer(support._CONVERT_FROM_PY)
        )
        self._kind, self._support = kind, _pointer(support._TYPE_SUPPORT)
        self.address: int = create()

    @property
    def fields(self) -> Any:
        """What lies there; meaningless once the memory was given back."""
        return layout(self._kind).from_address(self.address)

    def fill(self, message: Any) -> CMessage:
        """Return this with a message of rclpy written to it."""
        if not self._fill(message, self.address):
            raise TypeError(f"{message!r} is not a {self._kind.__name__}")
        return self

    def free(self) -> None:
        """Give the memory back, unless that was done."""
        if self.address:
            self._destroy(self.address)
            self.address = 0

    @contextmanager
    def serialised(self) -> Iterator[memoryview]:
        """Give the message as bytes, which are gone after the block; other threads run meanwhile.

        Raises:
            ValueError: If the middleware cannot serialise it.
        """
        rmw = _rmw()
        rmw.rcutils_get_default_allocator.restype = Allocator
        array = Bytes(None, 0, 0, rmw.rcutils_get_default_allocator())
        self._call(rmw.rmw_serialize, self.address, self._support, ctypes.addressof(array))
        try:
            yield memoryview((ctypes.c_char * array.length).from_address(array.buffer)).cast("B")
        finally:
            rmw.rcutils_uint8_array_fini(ctypes.byref(array))

    def deserialise(self, data: bytes) -> CMessage:
        """Return this with a serialised message written to it.

        Raises:
            ValueError: If the middleware cannot read it.
        """
        buffer = ctypes.create_string_buffer(data, len(data))
        array = Bytes(ctypes.addressof(buffer), len(data), len(data))
        self._call(_rmw().rmw_deserialize, ctypes.addressof(array), self._support, self.address)
        return self

    def _call(self, function: Any, *places: int) -> None:
        function.argtypes = [ctypes.c_void_p] * len(places)
        if function(*places):
            raise ValueError(f"{function.__name__} of {self._kind.__name__} failed")

    def read(self) -> SimpleNamespace:
        """Return the fields as Python has them; trajectories as `PointColumns`."""
        return _struct(self._kind, self.fields)


@cache
def _rmw() -> ctypes.CDLL:
    """The middleware of rclpy, which has loaded it; its calls let other threads run."""
    import rclpy.serialization  # noqa: F401

    return ctypes.CDLL("librcl.so")


def _pointer(capsule: Any) -> int:
    name = ctypes.pythonapi.PyCapsule_GetName
    name.restype, name.argtypes = ctypes.c_char_p, [ctypes.py_object]
    pointer = ctypes.pythonapi.PyCapsule_GetPointer
    pointer.restype, pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    return pointer(capsule, name(capsule))


def elements(sequence: Sequence, kind: type[Any]) -> list[Any]:
    if not sequence.size:
        return []
    return list((layout(kind) * sequence.size).from_address(sequence.data))


def _struct(kind: type[Any], fields: Any) -> Any:
    if kind is JointTrajectory:
        return _columns(fields)
    types = kind.get_fields_and_field_types()
    return SimpleNamespace(**{name: _read(types[name], getattr(fields, name)) for name in types})


def _read(text: str, value: Any) -> Any:
    if text.startswith("string"):
        return ctypes.string_at(value.data, value.size).decode(errors="replace")
    if not text.startswith("sequence<"):
        return value if text in NUMBERS else _struct(_class(text), value)
    inner = text.removeprefix("sequence<").removesuffix(">")
    if inner == "double" or inner == "string":
        if value.size > MAX_NAMES:
            raise MotionError(f"{value.size} figures of joints were given", f"at most {MAX_NAMES}")
        if inner == "double":
            return np.frombuffer(ctypes.string_at(value.data, 8 * value.size)).tolist()
        strings = (Sequence * value.size).from_address(value.data) if value.size else ()
        return [_read("string", each) for each in strings]
    return [_struct(_class(inner), each) for each in elements(value, _class(inner))]


def points_of(trajectory: Any) -> NDArray[np.void]:
    """Return the points of a trajectory as they lie in memory, shape (K,)."""
    point: Any = layout(_class("trajectory_msgs/JointTrajectoryPoint"))
    kind = np.dtype(point)
    points = trajectory.points
    if not points.size:
        return np.empty(0, dtype=kind)
    memory = (ctypes.c_char * (kind.itemsize * points.size)).from_address(points.data)
    return np.frombuffer(memory, dtype=kind)


def time_of(points: NDArray[np.void]) -> NDArray[np.float64]:
    """Return the times of points, shape (K,). [s]

    Args:
        points: From `points_of`, shape (K,).
    """
    time = points["time_from_start"]
    return time["sec"] + time["nanosec"] / SECOND_NS


def _columns(trajectory: Any) -> PointColumns:
    from robot_energy_plan.motion.joint_trajectory import (  # heavy, for the process
        KINDS,
        PointColumns,
    )

    names = _read("sequence<string>", trajectory.joint_names)
    points = points_of(trajectory)
    columns = {kind: _column(points[kind], len(names)) for kind in KINDS}
    return PointColumns(tuple(names), time_of(points), *columns.values())


def _column(sequences: NDArray[np.void], width: int) -> tuple[NDArray[np.int64], Any]:
    """Lengths of the rows, and their figures one after the other; none if a length is wrong."""
    lengths = sequences["size"].astype(np.int64)
    if not ((lengths == 0) | (lengths == width)).all():
        return lengths, np.empty(0)
    read: Callable[[int, int], bytes] = ctypes.string_at
    filled = sequences["data"][lengths > 0].tolist()
    return lengths, np.frombuffer(b"".join([read(place, 8 * width) for place in filled]))


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
