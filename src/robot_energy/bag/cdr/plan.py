"""Where the values of a column lie in messages of one layout, as numpy views."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Annotated, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robot_energy.bag.cdr.schema import ScalarField
from robot_energy.bag.cdr.walk import Slot

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
        return np.ndarray(
            shape,
            self.dtype,
            rows,
            self.offset,
            (rows.strides[0], *self.strides),
        )


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
