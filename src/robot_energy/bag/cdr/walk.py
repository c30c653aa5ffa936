"""Walk one serialized message by its schema: where every value lies, and which bytes decide it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from struct import Struct
from typing import Annotated, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robot_energy.bag.cdr.schema import (
    ArrayField,
    Node,
    ScalarField,
    StringField,
    StructField,
    Wanted,
)

HEADER_SIZE = 4  # bytes of the CDR encapsulation header; alignment counts from its end [bytes]
MAX_TRAILING = 3  # padding bytes allowed after the payload [bytes]

MAX_PARTS = 20_000
"""Strings and messages in the arrays of one message; a large diagnostic message has 10,000."""

_COUNT = {"<": Struct("<I"), ">": Struct(">I")}
_ORDER = {b"\x00\x00": ">", b"\x00\x01": "<"}


class Malformed(Exception):
    """The bytes do not follow the schema; never leaves this package."""


@dataclass(frozen=True, slots=True)
class Slot:
    """Place of a number, or of ``count`` adjacent numbers."""

    offset: int
    count: int | None
    number: ScalarField

    def read(self, data: bytes, order: str) -> NDArray[Any]:
        """Return the numbers of one message in a byte order, shape (1,) or (1, count)."""
        count = 1 if self.count is None else self.count
        at = self.offset if count else 0
        found = np.frombuffer(data, order + self.number.code, count, at)
        native = found != 0 if self.number.is_bool else found.astype(self.number.code)
        return native if self.count is None else native[None]


class Walk(NamedTuple):
    """What a walk found.

    Attributes:
        order: Byte order, ``<`` or ``>``.
        end: Bytes up to the end of the payload, with the encapsulation header.
        spans: Bytes [start, stop) of lengths and strings: they decide where the rest lies.
        values: Tree of the wanted fields: Slot, str or tuple of str at the leaves, lists for
            arrays of messages.
    """

    order: str
    end: int
    spans: list[tuple[int, int]]
    parts: int
    values: dict[str, Any]


def walk(
    schema: StructField,
    data: bytes,
    wanted: Wanted,
    max_parts: int = MAX_PARTS,
) -> Walk:
    """Return the places in one message, and what decides them.

    Raises:
        Malformed: If the message is too short or too long, has another encapsulation than CDR,
            too many parts, a length beyond its end, or a string without closing NUL or not
            in UTF-8.
    """
    order = _ORDER.get(data[:2])
    if order is None or len(data) < HEADER_SIZE:
        raise Malformed("encapsulation")
    walker = _Walker(data, order, max_parts)
    end, values = walker.record(schema, HEADER_SIZE, wanted)
    if len(data) - end > MAX_TRAILING:
        raise Malformed("trailing bytes")
    return Walk(order, end, walker.spans, max_parts - walker.room, values)


class _Walker:
    def __init__(self, data: bytes, order: str, max_parts: int) -> None:
        self.data = data
        self.size = len(data)
        self.unpack = _COUNT[order].unpack_from
        self.spans: list[tuple[int, int]] = [(0, 2)]
        self.room = max_parts

    def record(
        self, node: StructField, pos: int, wanted: Wanted | None
    ) -> tuple[int, dict[str, Any]]:
        values: dict[str, Any] = {}
        for name, field in node.fields:
            inner = wanted.get(name) if wanted is not None else None
            pos, value = self.node(field, pos, inner)
            if inner is not None:
                values[name] = value
        return pos, values

    def node(self, node: Node, pos: int, wanted: Wanted | None) -> tuple[int, Any]:
        if isinstance(node, ScalarField):
            return self.numbers(node, pos, None)
        if isinstance(node, StringField):
            return self.text(pos)
        if isinstance(node, StructField):
            return self.record(node, pos, wanted)
        return self.many(node, pos, wanted)

    def many(self, node: ArrayField, pos: int, wanted: Wanted | None) -> tuple[int, Any]:
        count = node.count
        if count is None:
            pos, count = self.length(pos)
        item = node.item
        if count * item.size > self.size - pos:
            raise Malformed("absurd length")
        if isinstance(item, ScalarField):
            return self.numbers(item, pos, count)
        self.room -= count
        if self.room < 0:
            raise Malformed("too many parts")
        if isinstance(item, StringField):
            return self.texts(pos, count)
        values: list[Any] = []
        for _ in range(count):
            pos, value = self.node(item, pos, wanted)
            values.append(value)
        return pos, values

    def numbers(self, number: ScalarField, pos: int, count: int | None) -> tuple[int, Slot]:
        if count != 0:
            pos += -(pos - HEADER_SIZE) % number.size
        end = pos + number.size * (1 if count is None else count)
        if end > self.size:
            raise Malformed("too short")
        return end, Slot(pos, count, number)

    def length(self, pos: int) -> tuple[int, int]:
        pos += -(pos - HEADER_SIZE) % 4
        if pos + 4 > self.size:
            raise Malformed("too short")
        self.spans.append((pos, pos + 4))
        return pos + 4, self.unpack(self.data, pos)[0]

    def text(self, pos: int) -> tuple[int, str]:
        pos, (text,) = self.texts(pos, 1)
        return pos, text

    def texts(self, pos: int, count: int) -> tuple[int, tuple[str, ...]]:
        """Read strings that follow each other: the names of joints of every new layout."""
        data, unpack, last = self.data, self.unpack, self.size - 4
        texts: list[str] = []
        for _ in range(count):
            pos += -pos & 3  # the header has four bytes, so alignment counts from 0 as well
            if pos > last:
                raise Malformed("too short")
            end = pos + 4 + unpack(data, pos)[0]
            if end > self.size or end < pos + 5 or data[end - 1]:
                raise Malformed("string")
            try:
                texts.append(data[pos + 4 : end - 1].decode())
            except UnicodeDecodeError:
                raise Malformed("utf-8") from None
            self.spans.append((pos, end))
            pos = end
        return pos, tuple(texts)


Column: TypeAlias = "NDArray[Any] | str | tuple[Any, ...]"


@dataclass(frozen=True, slots=True)
class View:
    """Values at regular distances: a strided view of the rows."""

    offset: int
    shape: Annotated[tuple[int, ...], "Axes after the row axis."]
    strides: Annotated[tuple[int, ...], "Distance along each of them. [bytes]"]
    dtype: np.dtype[Any]
    native: np.dtype[Any]
    is_bool: Annotated[bool, "Whether the number means a truth value."]

    @property
    def plain(self) -> bool:
        """Whether these are numbers as this machine holds them, one behind the other."""
        follow = self.strides in ((), (self.dtype.itemsize,))
        return follow and not self.is_bool and self.dtype.isnative

    def of(self, rows: NDArray[np.uint8]) -> NDArray[Any]:
        """Return a view of the values of rows, in their byte order, shape (m, ...).

        Args:
            rows: Messages, uint8, shape (m, row size).
        """
        shape = (len(rows), *self.shape)
        if not rows.size:
            return np.empty(shape, self.dtype)
        strides = (rows.strides[0], *self.strides)
        return np.ndarray(shape, self.dtype, rows, self.offset, strides)


@dataclass(frozen=True, slots=True)
class Stack:
    """Values at irregular distances: one plan per element of an array of messages."""

    parts: tuple[View | Stack, ...]


Plan: TypeAlias = View | Stack


def make_plan(value: Any, number: ScalarField, axes: int, order: str) -> Plan:
    """Return one view of the numbers of a field where their places are regular, else a stack."""
    dtype, native = _types(order, number.code)
    if isinstance(value, Slot):
        shape = () if value.count is None else (value.count,)
        strides = () if value.count is None else (number.size,)
        return View(value.offset, shape, strides, dtype, native, number.is_bool)
    parts = tuple(make_plan(item, number, axes - 1, order) for item in value)
    if not parts:
        return View(0, (0,) * axes, (0,) * axes, dtype, native, number.is_bool)
    views = [part for part in parts if isinstance(part, View)]
    first = views[0] if views else None
    if first is None or len(views) < len(parts):
        return Stack(parts)
    steps = {after.offset - before.offset for before, after in pairwise(views)}
    regular = len(steps) <= 1 and all(
        view.shape == first.shape and view.strides == first.strides for view in views
    )
    if not regular:
        return Stack(parts)
    step = steps.pop() if steps else 0
    shape, strides = (len(views), *first.shape), (step, *first.strides)
    return View(first.offset, shape, strides, dtype, native, number.is_bool)


@cache
def _types(order: str, code: str) -> tuple[np.dtype[Any], np.dtype[Any]]:
    """The type of a number in the message, and as this machine holds it."""
    return np.dtype(order + code), np.dtype(code)


def plan_shape(plan: Plan) -> tuple[int, ...] | None:
    """Return the axes of a column behind the first; None if its parts differ in length."""
    if isinstance(plan, View):
        return plan.shape
    shapes = {plan_shape(part) for part in plan.parts}
    shape = shapes.pop()
    return None if shapes or shape is None else (len(plan.parts), *shape)


def read(plan: Plan, rows: NDArray[np.uint8]) -> Column:
    """Return a column (m, ...) of its own memory in native order; a tuple where lengths differ.

    Args:
        rows: Messages, uint8, shape (m, row size).
    """
    if isinstance(plan, View):
        view = plan.of(rows)
        return view != 0 if plan.is_bool else view.astype(plan.native, order="F")
    parts = [read(part, rows) for part in plan.parts]
    if plan_shape(plan) is None:
        return tuple(parts)
    return np.stack([np.asarray(part) for part in parts], axis=1)


def write(plan: Plan, rows: NDArray[np.uint8], values: NDArray[Any]) -> None:
    """Put values into messages.

    Args:
        rows: Messages, uint8, shape (m, row size); changed in place.
        values: Array of a shape that broadcasts to (m, ...).
    """
    if isinstance(plan, View):
        plan.of(rows)[...] = values
        return
    for j, part in enumerate(plan.parts):
        write(part, rows, values[:, j] if values.ndim else values)


def nested(value: Any, names: list[str], leaf: Callable[[Any], Any]) -> Any:
    """Return one field out of a tree of values, arrays of messages in ``leaf`` containers."""
    if isinstance(value, list):
        items: list[Any] = value  # pyright: ignore[reportUnknownVariableType]
        return leaf(nested(item, names, leaf) for item in items)
    return nested(value[names[0]], names[1:], leaf) if names else value
