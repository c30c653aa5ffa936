"""Message definitions as a tree that can be walked over serialized bytes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

from robot_energy.errors import MessageTypeError

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_CODES = {
    "bool": "u1",
    "byte": "u1",
    "char": "u1",
    "uint8": "u1",
    "int8": "i1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "int64": "i8",
    "uint64": "u8",
    "float32": "f4",
    "float64": "f8",
}


@dataclass(frozen=True, slots=True)
class Number:
    """A number: numpy code without byte order, size [bytes], and whether it means a truth value."""

    code: str
    size: int
    is_bool: bool


@dataclass(frozen=True, slots=True)
class Text:
    """A string: uint32 length with the closing NUL, then the bytes."""

    size: int = 5  # least bytes it takes


@dataclass(frozen=True, slots=True)
class Record:
    """A nested message: its fields in order, and the least bytes it takes."""

    fields: tuple[tuple[str, Node], ...]
    size: int


@dataclass(frozen=True, slots=True)
class Many:
    """Several items of one kind: a fixed array, or a sequence when ``count`` is None."""

    item: Number | Text | Record
    count: int | None
    size: int


Node: TypeAlias = Number | Text | Record | Many
Wanted: TypeAlias = dict[str, "Wanted"]  # tree of field names; a leaf is an empty dict


def compile_schema(msgtype: str, store: Typestore) -> Record:
    """Return the tree of one message type.

    Args:
        msgtype: Message type, such as ``sensor_msgs/msg/JointState``.
        store: Type store that knows it.

    Returns:
        The tree.

    Raises:
        MessageTypeError: If the type, or one it is made of, is unknown or holds wide strings.
    """
    return _record(msgtype, store, ())


def _record(msgtype: str, store: Typestore, inside: tuple[str, ...]) -> Record:
    if msgtype not in store.fielddefs:
        raise MessageTypeError(
            f"the message type {msgtype} is unknown",
            "a type of ROS 2 Jazzy, of ros2_energy_msgs, or one defined in the bag",
            "pass a type store that has it",
        )
    if msgtype in inside:
        raise MessageTypeError(f"the message type {msgtype} contains itself", "a finite type")
    fields: list[tuple[str, Node]] = []
    for name, description in store.fielddefs[msgtype][1]:
        fields.append((name, _node(description, store, (*inside, msgtype))))
    return Record(tuple(fields), sum(node.size for _, node in fields))


def _node(description: Any, store: Typestore, inside: tuple[str, ...]) -> Node:
    from rosbags.interfaces import Nodetype

    kind, detail = description
    if kind == Nodetype.BASE:
        base = str(detail[0])
        if base == "string":
            return Text()
        if base not in _CODES:
            raise MessageTypeError(
                f"{inside[-1]} has a field of type {base}",
                "numbers up to 64 bits and strings",
                "decode this message type with rosbags instead",
            )
        return Number(_CODES[base], int(_CODES[base][1]), base == "bool")
    if kind == Nodetype.NAME:
        return _record(str(detail), store, inside)
    item = _node(detail[0], store, inside)
    if isinstance(item, Many):
        raise MessageTypeError(f"{inside[-1]} nests an array directly in an array")
    if kind == Nodetype.ARRAY:
        return Many(item, int(detail[1]), int(detail[1]) * item.size)
    return Many(item, None, 4)


def leaf(schema: Record, path: str, msgtype: str) -> tuple[Number | Text, int]:
    """Return what a dotted path names and how many axes it has beside the message axis.

    Args:
        schema: Tree of the message type.
        path: Dotted field path, such as ``header.stamp.sec``.
        msgtype: Name of the message type, for the error text.

    Returns:
        The number or string at the end of the path, and the count of arrays passed on the way.

    Raises:
        MessageTypeError: If the path names no field, or a group of fields.
    """
    node: Node = schema
    axes = 0
    for depth, name in enumerate(path.split(".")):
        fields = dict(node.fields) if isinstance(node, Record) else {}
        if name not in fields:
            where = ".".join([msgtype, *path.split(".")[:depth]])
            raise MessageTypeError(
                f"{where} has no field {name!r}",
                f"one of {', '.join(fields)}" if fields else "the path to end there",
            )
        node = fields[name]
        if isinstance(node, Many):
            axes += 1
            node = node.item
    if isinstance(node, Record):
        raise MessageTypeError(
            f"{path} of {msgtype} is a group of fields",
            f"one of {', '.join(f'{path}.{name}' for name, _ in node.fields)}",
        )
    return node, axes


def leaf_paths(schema: Record) -> list[str]:
    """Return the dotted paths of all numbers and strings, in order of their bytes."""
    paths: list[str] = []
    for name, node in schema.fields:
        inner = node.item if isinstance(node, Many) else node
        if isinstance(inner, Record):
            paths += [f"{name}.{path}" for path in leaf_paths(inner)]
        else:
            paths.append(name)
    return paths


def tree(paths: Iterable[str]) -> Wanted:
    """Return dotted paths as a tree of names."""
    root: Wanted = {}
    for path in paths:
        node = root
        for name in path.split("."):
            node = node.setdefault(name, {})
    return root
