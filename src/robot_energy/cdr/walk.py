"""Walk one serialized message by its schema: where every value lies, and which bytes decide it."""

from __future__ import annotations

from dataclasses import dataclass
from struct import Struct
from typing import Any, NamedTuple

from robot_energy.cdr.schema import ArrayField, Node, ScalarField, StringField, StructField, Wanted

HEADER_SIZE = 4
"""Bytes of the CDR encapsulation header; alignment counts from its end. [bytes]"""
MAX_TRAILING = 3
"""Padding bytes allowed after the payload. [bytes]"""

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


class Walk(NamedTuple):
    """What a walk found.

    Attributes:
        order: Byte order, ``<`` or ``>``.
        end: Bytes up to the end of the payload, with the encapsulation header.
        constants: Spans [start, stop) of lengths and strings: they decide where the rest lies.
        spans: The same, with the padding between neighbours included.
        values: Tree of the wanted fields: Slot, str or tuple of str at the leaves, lists for
            arrays of messages.
    """

    order: str
    end: int
    constants: list[tuple[int, int]]
    spans: list[tuple[int, int]]
    values: dict[str, Any]


def walk(schema: StructField, data: bytes, wanted: Wanted, max_parts: int = MAX_PARTS) -> Walk:
    """Walk one message.

    Args:
        schema: Tree of the message type.
        data: The message with its encapsulation header.
        wanted: Fields whose values are asked for.
        max_parts: Strings and messages in its arrays.

    Returns:
        Places and constants.

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
    spans = [(start, stop) for start, stop in walker.spans]
    return Walk(order, end, walker.constants, spans, values)


class _Walker:
    def __init__(self, data: bytes, order: str, max_parts: int) -> None:
        self.data = data
        self.size = len(data)
        self.unpack = _COUNT[order].unpack_from
        self.constants: list[tuple[int, int]] = [(0, 2)]
        self.spans: list[list[int]] = [[0, 2]]
        self.adjacent = False
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
        values: list[Any] = []
        for _ in range(count):
            pos, value = self.node(item, pos, wanted)
            values.append(value)
        return pos, tuple(values) if isinstance(item, StringField) else values

    def numbers(self, number: ScalarField, pos: int, count: int | None) -> tuple[int, Slot]:
        if count != 0:
            pos += -(pos - HEADER_SIZE) % number.size
            self.adjacent = False
        end = pos + number.size * (1 if count is None else count)
        if end > self.size:
            raise Malformed("too short")
        return end, Slot(pos, count, number)

    def length(self, pos: int) -> tuple[int, int]:
        pos += -(pos - HEADER_SIZE) % 4
        if pos + 4 > self.size:
            raise Malformed("too short")
        self.constant(pos, pos + 4)
        return pos + 4, self.unpack(self.data, pos)[0]

    def text(self, pos: int) -> tuple[int, str]:
        pos, size = self.length(pos)
        end = pos + size
        if size < 1 or end > self.size or self.data[end - 1] != 0:
            raise Malformed("string")
        self.constant(pos, end)
        try:
            return end, self.data[pos : end - 1].decode()
        except UnicodeDecodeError:
            raise Malformed("utf-8") from None

    def constant(self, start: int, stop: int) -> None:
        self.constants.append((start, stop))
        if self.adjacent:
            self.spans[-1][1] = stop
        else:
            self.spans.append([start, stop])
        self.adjacent = True
