"""Message definitions as a tree that can be walked over serialized bytes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

from robot_energy.foundation.errors import MessageTypeError

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_CODES = {
    **dict.fromkeys(("bool", "byte", "char"), "u1"),
    **{
        f"{kind}{8 * size}": f"{kind[0]}{size}" for kind in ("int", "uint") for size in (1, 2, 4, 8)
    },
    **{"float32": "f4", "float64": "f8"},
}


@dataclass(frozen=True, slots=True)
class ScalarField:
    """A number: numpy code without byte order, size [bytes], and whether it means a truth value."""

    code: str
    size: int
    is_bool: bool


@dataclass(frozen=True, slots=True)
class StringField:
    """A string: uint32 length with the closing NUL, then the bytes."""

    size: int = 5  # least bytes it takes


@dataclass(frozen=True, slots=True)
class StructField:
    """A nested message: its fields in order, and the least bytes it takes."""

    fields: tuple[tuple[str, Node], ...]
    size: int


@dataclass(frozen=True, slots=True)
class ArrayField:
    """Several items of one kind: a fixed array, or a sequence when ``count`` is None."""

    item: ScalarField | StringField | StructField
    count: int | None
    size: int


MAX_DEPTH = 30  # messages inside messages; those of ROS reach eight
MAX_FIELDS = 10_000
"""Fields of one message with all that it is made of; the largest of ROS have some hundreds."""

Node: TypeAlias = ScalarField | StringField | StructField | ArrayField
Wanted: TypeAlias = dict[str, "Wanted"]  # tree of field names; a leaf is an empty dict


def compile_schema(msgtype: str, store: Typestore) -> StructField:
    if msgtype in store.fielddefs:
        check_size(msgtype, store.fielddefs)
    return _record(msgtype, store, ())


def check_size(
    msgtype: str,
    fielddefs: Mapping[str, Any],
    inside: tuple[str, ...] = (),
    known: dict[str, int] | None = None,
) -> int:
    """Return the number of fields of a message type; refuse one too deep or too large.

    A type without a definition counts as one field.
    """
    from rosbags.interfaces import Nodetype

    known = {} if known is None else known
    if msgtype in inside:
        raise MessageTypeError(f"the message type {msgtype} contains itself", "a finite type")
    if len(inside) > MAX_DEPTH:
        raise MessageTypeError(
            f"the message type {inside[0]} nests messages more than {MAX_DEPTH} deep", "fewer"
        )
    if msgtype not in known:
        count = 1
        for _, (kind, detail) in fielddefs[msgtype][1]:
            inner = detail[0] if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE) else (kind, detail)
            if inner[0] == Nodetype.NAME and inner[1] in fielddefs:
                count += check_size(str(inner[1]), fielddefs, (*inside, msgtype), known)
            else:
                count += 1
            if count > MAX_FIELDS:
                raise MessageTypeError(
                    f"the message type {msgtype} has over {MAX_FIELDS} fields", "fewer"
                )
        known[msgtype] = count
    return known[msgtype]


def _record(msgtype: str, store: Typestore, inside: tuple[str, ...]) -> StructField:
    if msgtype not in store.fielddefs:
        raise MessageTypeError(
            f"the message type {msgtype} is unknown",
            "a type of ROS 2 Jazzy, of ros2_energy_msgs, or one defined in the bag",
            "pass a type store that has it",
        )
    fields: list[tuple[str, Node]] = []
    for name, description in store.fielddefs[msgtype][1]:
        fields.append((name, _node(description, store, (*inside, msgtype))))
    return StructField(tuple(fields), max(1, sum(node.size for _, node in fields)))


def _node(description: Any, store: Typestore, inside: tuple[str, ...]) -> Node:
    from rosbags.interfaces import Nodetype

    kind, detail = description
    if kind == Nodetype.BASE:
        base = str(detail[0])
        if base == "string":
            return StringField()
        if base not in _CODES:
            raise MessageTypeError(
                f"{inside[-1]} has a field of type {base}",
                "numbers up to 64 bits and strings",
                "decode this message type with rosbags instead",
            )
        return ScalarField(_CODES[base], int(_CODES[base][1]), base == "bool")
    if kind == Nodetype.NAME:
        return _record(str(detail), store, inside)
    item = _node(detail[0], store, inside)
    if isinstance(item, ArrayField):
        raise MessageTypeError(
            f"{inside[-1]} nests an array directly in an array", "an array of messages"
        )
    if kind == Nodetype.ARRAY:
        return ArrayField(item, int(detail[1]), int(detail[1]) * item.size)
    return ArrayField(item, None, 4)


def leaf(schema: StructField, path: str, msgtype: str) -> tuple[ScalarField | StringField, int]:
    """Return the number or string at the end of a dotted path, and the arrays on the way."""
    node: Node = schema
    axes = 0
    for depth, name in enumerate(path.split(".")):
        fields = dict(node.fields) if isinstance(node, StructField) else {}
        if name not in fields:
            where = ".".join([msgtype, *path.split(".")[:depth]])
            raise MessageTypeError(
                f"{where} has no field {name!r}",
                f"one of {', '.join(fields)}" if fields else "the path to end there",
            )
        node = fields[name]
        if isinstance(node, ArrayField):
            axes += 1
            node = node.item
    if isinstance(node, StructField):
        raise MessageTypeError(
            f"{path} of {msgtype} is a group of fields",
            f"one of {', '.join(f'{path}.{name}' for name, _ in node.fields)}",
        )
    return node, axes


def leaf_paths(schema: StructField) -> list[str]:
    """Return the dotted paths of all numbers and strings, in order of their bytes."""
    paths: list[str] = []
    for name, node in schema.fields:
        inner = node.item if isinstance(node, ArrayField) else node
        if isinstance(inner, StructField):
            paths += [f"{name}.{path}" for path in leaf_paths(inner)]
        else:
            paths.append(name)
    return paths


def tree(paths: Iterable[str]) -> Wanted:
    root: Wanted = {}
    for path in paths:
        node = root
        for name in path.split("."):
            node = node.setdefault(name, {})
    return root
