"""Encode numpy columns to serialized messages of one layout."""

from __future__ import annotations

from collections.abc import Mapping
from struct import pack
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robot_energy.bag.cdr.schema import (
    ArrayField,
    Node,
    ScalarField,
    StringField,
    StructField,
    compile_schema,
    leaf,
    leaf_paths,
    tree,
)
from robot_energy.bag.cdr.types import typestore
from robot_energy.bag.cdr.walk import (
    HEADER_SIZE,
    Plan,
    View,
    make_plan,
    nested,
    plan_shape,
    walk,
    write,
)
from robot_energy.foundation.errors import MessageTypeError, ShapeError


class Encoder:
    """Encodes messages of one type that share their strings and lengths.

    Args:
        constants: What is the same in every message, by field path: str for a string (default
            empty), tuple of str for a string sequence or for the string of each element of an
            array of messages (which also fixes the length), number or tuple of numbers for a
            numeric field.
    """

    def __init__(
        self,
        msgtype: str,
        constants: Mapping[str, Any] | None = None,
        lengths: Mapping[str, int] | None = None,
    ) -> None:
        self.msgtype = msgtype
        self._constants = dict(constants or {})
        self._lengths = dict(lengths or {})
        schema = compile_schema(msgtype, typestore())
        paths = leaf_paths(schema)
        for path in self._constants:
            leaf(schema, path, msgtype)
        template = bytearray(b"\x00\x01\x00\x00")
        self._build(schema, "", (), template)
        numeric = [
            path for path in paths if isinstance(leaf(schema, path, msgtype)[0], ScalarField)
        ]
        found = walk(schema, bytes(template), tree(numeric))
        plans: dict[str, Plan] = {}
        for path in numeric:
            node, axes = leaf(schema, path, msgtype)
            if isinstance(node, ScalarField):
                value = nested(found.values, path.split("."), list)
                plans[path] = make_plan(value, node, axes, found.order)
        self._template = np.frombuffer(template, dtype=np.uint8).copy()
        self.size = len(template)
        row = self._template.reshape(1, -1)
        for path in [path for path in numeric if path in self._constants]:
            plan = plans.pop(path)
            shape = plan_shape(plan)
            values = np.asarray(self._constants[path])
            self._write(path, plan, row, values[None] if values.shape == shape != () else values)
        self._plans = plans
        self.fields = tuple(plans)  # paths of the numeric fields that ``encode`` needs

    def encode(self, columns: Mapping[str, ArrayLike], n: int) -> NDArray[np.uint8]:
        """Return ``n`` serialized messages, uint8, shape (n, size), little endian.

        Args:
            columns: Every path of ``fields``: array (n, ...) with one axis more per array passed,
                or one number for all of them. NaN where a quantity is unmeasured.
        """
        if columns.keys() != self._plans.keys():
            missing = [path for path in self._plans if path not in columns]
            unknown = [path for path in columns if path not in self._plans]
            raise MessageTypeError(
                f"columns for {self.msgtype} lack {missing} and have unknown {unknown}",
                f"exactly {list(self._plans)}",
                "give NaN for what is unmeasured",
            )
        rows = np.empty((n, self.size), dtype=np.uint8)
        rows[:] = self._template
        for path, plan in self._plans.items():
            values = np.asarray(columns[path])
            if n and isinstance(plan, View) and values.dtype == plan.native:
                shape, strides = (n, *plan.shape), (self.size, *plan.strides)
                if values.shape in ((), shape):  # as nearly always
                    np.ndarray(shape, plan.dtype, rows, plan.offset, strides)[...] = values
                    continue
            self._write(path, plan, rows, values)
        return rows

    def _write(self, path: str, plan: Plan, rows: NDArray[np.uint8], values: NDArray[Any]) -> None:
        shape = plan_shape(plan)
        if values.ndim and (shape is None or values.shape != (len(rows), *shape)):
            expected = "one number" if shape is None else f"{(len(rows), *shape)} or one number"
            raise ShapeError(f"{path} of {self.msgtype} got shape {values.shape}", expected)
        part = plan
        while not isinstance(part, View):
            part = part.parts[0]
        if part.native.kind != "f":
            with np.errstate(invalid="ignore"):
                fits = values.astype(part.native) == values
            if not fits.all():
                raise MessageTypeError(
                    f"{path} of {self.msgtype} got {values[~fits][0]}", f"what fits {part.native}"
                )
        write(plan, rows, values)

    def _build(self, node: Node, path: str, index: tuple[int, ...], out: bytearray) -> None:
        if isinstance(node, ScalarField):
            _pad(out, node.size)
            out += bytes(node.size)
        elif isinstance(node, StringField):
            value = _pick(self._constants.get(path, ""), index)
            if not isinstance(value, str):
                raise MessageTypeError(f"{path} of {self.msgtype} got {value!r}", "a string")
            data = value.encode() + b"\x00"
            _pad(out, 4)
            out += pack("<I", len(data)) + data
        elif isinstance(node, StructField):
            for name, field in node.fields:
                self._build(field, f"{path}.{name}" if path else name, index, out)
        else:
            count = self._count(node, path, index)
            if node.count is None:
                _pad(out, 4)
                out += pack("<I", count)
            for i in range(count):
                self._build(node.item, path, (*index, i), out)

    def _count(self, node: ArrayField, path: str, index: tuple[int, ...]) -> int:
        stated: list[int] = [] if node.count is None else [node.count]
        if path in self._lengths:
            stated.append(int(self._lengths[path]))
        for name, constant in self._constants.items():
            inside = name == path or (
                name.startswith(path + ".") and isinstance(node.item, StructField)
            )
            value = _pick(constant, index) if inside else None
            if isinstance(value, tuple | list | np.ndarray):
                stated.append(len(value))  # pyright: ignore[reportUnknownArgumentType]
        if len(set(stated)) != 1 or stated[0] < 0:
            raise ShapeError(
                f"{path} of {self.msgtype} is given the lengths {stated}",
                "one length (0 for empty), or a constant",
            )
        return stated[0]


def _pad(out: bytearray, size: int) -> None:
    out += bytes(-(len(out) - HEADER_SIZE) % size)


def _pick(value: Any, index: tuple[int, ...]) -> Any:
    for i in index:
        if not isinstance(value, tuple | list | np.ndarray) or i >= len(value):  # pyright: ignore
            return value  # pyright: ignore[reportUnknownVariableType]
        value = value[i]  # pyright: ignore[reportUnknownVariableType]
    return value  # pyright: ignore[reportUnknownVariableType]


def stamp_columns(
    stamp_ns: NDArray[np.int64], path: str = "header.stamp"
) -> dict[str, NDArray[np.int32] | NDArray[np.uint32]]:
    """Return ``<path>.sec`` (int32) and ``<path>.nanosec`` (uint32) of a Time field, same shape.

    Args:
        stamp_ns: Time since the epoch, int64, shape (n, ...). [ns]
    """
    seconds, rest = np.divmod(np.asarray(stamp_ns, dtype=np.int64), 1_000_000_000)
    narrow = seconds.astype(np.int32)
    if (narrow != seconds).any():
        raise ShapeError("a stamp is outside the years 1901 to 2038", "32-bit seconds")
    return {f"{path}.sec": narrow, f"{path}.nanosec": rest.astype(np.uint32)}
