"""Decode serialized messages to numpy columns, one layout at a time.

Messages of one publisher differ only in their numbers: names and lengths stay. So one message is
walked by its schema; the bytes that decide the layout (byte order, lengths, strings) are kept, and
every message whose bytes agree there is decoded with the same strided views, thousands at a time.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import gcd
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robot_energy.bag.cdr.encode import Encoder, stamp_columns
from robot_energy.bag.cdr.schema import (
    ScalarField,
    StringField,
    StructField,
    compile_schema,
    leaf,
    tree,
)
from robot_energy.bag.cdr.types import typestore as default_typestore
from robot_energy.bag.cdr.walk import (
    HEADER_SIZE,
    MAX_PARTS,
    MAX_TRAILING,
    Column,
    Malformed,
    Plan,
    Slot,
    View,
    Walk,
    make_plan,
    nested,
    read,
    walk,
)
from robot_energy.foundation.errors import MessageTypeError, ShapeError
from robot_energy.foundation.units import SECOND_NS
from robot_energy.physics import kernels
from robot_energy.timeline.stamps import INVALID_STAMP_NS

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

__all__ = ["Decoded", "Decoder", "Encoder", "RawBatch", "Run", "stamp_columns", "stamp_ns"]

MAX_LAYOUTS = 32
MAX_LAYOUT_BYTES = 16 * 2**20
"""Layouts a decoder remembers, and their memory; the one unused for longest goes first."""
_PART_BYTES = 600  # of memory for each length and string that decides a layout
_MAX_LONELY = 2
"""Layouts in a row that fit one message or none, before the rest is walked one by one."""


@dataclass(frozen=True, slots=True, eq=False)
class RawBatch:
    """Serialized messages of one topic inside one shared buffer, in log order.

    Attributes:
        msgtype: Message type, such as ``sensor_msgs/msg/JointState``.
        log_time_ns: When each message was recorded or received, int64, shape (n,). [ns]
        buffer: Bytes that hold every message, uint8, one-dimensional and contiguous.
        offset: First byte of each message (of its CDR encapsulation header), int64, shape (n,).
        length: Bytes of each message, int64, shape (n,).
    Validity: offsets and lengths come from the data and may be wrong; the decoder checks them.
    """

    topic: str
    msgtype: str
    log_time_ns: NDArray[np.int64]
    buffer: NDArray[np.uint8]
    offset: NDArray[np.int64]
    length: NDArray[np.int64]

    @classmethod
    def from_messages(
        cls,
        topic: str,
        msgtype: str,
        log_time_ns: ArrayLike,
        messages: Sequence[bytes | memoryview],
    ) -> RawBatch:
        """Return messages received at times of shape (n,) [ns], in a buffer of their own."""
        times = np.atleast_1d(np.asarray(log_time_ns, dtype=np.int64))
        if times.shape != (len(messages),):
            raise ShapeError(
                f"{len(messages)} messages of {topic} came with times of shape {times.shape}",
                f"shape ({len(messages)},)",
            )
        length = np.fromiter(map(len, messages), np.int64, len(messages))
        buffer = np.frombuffer(b"".join(messages), dtype=np.uint8)
        return cls(topic, msgtype, times, buffer, np.cumsum(length) - length, length)

    def __len__(self) -> int:
        return len(self.offset)

    def __getitem__(self, rows: slice | NDArray[np.int64]) -> RawBatch:
        """Return some of the messages, in the order given, in the same buffer."""
        return replace(
            self,
            log_time_ns=self.log_time_ns[rows],
            offset=self.offset[rows],
            length=self.length[rows],
        )

    def copy(self) -> RawBatch:
        """Return the messages in a buffer of their own, without what lies between them."""
        messages = [self.row(number) for number in range(len(self))]
        return self.from_messages(self.topic, self.msgtype, self.log_time_ns, messages)

    def pieces(self, max_bytes: int) -> Iterator[tuple[int, RawBatch]]:
        """Yield pieces of at most so many bytes, or of one message, behind their first row."""
        end = np.cumsum(self.length)
        start = 0
        while start < len(self):
            before = int(end[start - 1]) if start else 0
            stop = max(int(np.searchsorted(end, before + max_bytes, side="right")), start + 1)
            yield start, self[slice(start, stop)]
            start = stop

    def row(self, i: int) -> bytes:
        start, length = int(self.offset[i]), int(self.length[i])
        if not 0 <= start <= start + length <= len(self.buffer):
            raise ShapeError(
                f"message {i} of {self.topic} spans bytes {start} to {start + length}",
                f"a span inside the {len(self.buffer)} bytes of the buffer",
            )
        return self.buffer[start : start + length].tobytes()


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """Messages of one layout."""

    rows: Annotated[NDArray[np.int64], "Their indices in the batch, ascending, int64, shape (m,)."]
    columns: Annotated[
        dict[str, Column],
        "Per field path: number (m,), numbers (m, k), one more axis per array of messages "
        "passed; str or (nested) tuple of str for strings, the same for the whole run; a tuple "
        "of arrays where inner arrays differ in length.",
    ]

    def array(self, path: str) -> NDArray[Any]:
        """Return a numeric column, shape (m, ...)."""
        column = self.columns[path]
        if not isinstance(column, np.ndarray):
            raise MessageTypeError(f"the field {path} is not a numeric array", "a numeric field")
        return column

    def names(self, path: str) -> tuple[str, ...]:
        """Return a column of strings, the same for all rows of the run."""
        column = self.columns[path]
        if not isinstance(column, tuple) or not all(isinstance(item, str) for item in column):
            raise MessageTypeError(f"the field {path} is not a list of strings", "string sequence")
        return column


@dataclass(frozen=True, slots=True, eq=False)
class Decoded:
    """A decoded batch."""

    runs: Annotated[
        list[Run], "In the order of their first row; each row of the batch is in one at most."
    ]
    malformed: Annotated[
        NDArray[np.int64], "Rows that do not follow the message definition, ascending, int64."
    ]


class _Layout:
    """One arrangement of bytes: what must agree, and where the wanted values lie.

    Made for every message with names of its own, so it computes at first use what only
    messages that follow need.
    """

    def __init__(
        self,
        found: Walk,
        data: bytes,
        columns: dict[str, Column | Plan],
    ) -> None:
        self.key = _key(found, data)
        self.size = found.end
        self.columns = columns
        self.memory = 2 * found.end + _PART_BYTES * (found.parts + len(found.spans))
        self._spans = found.spans
        self._message = data[: found.end]
        self._views = {path: c for path, c in columns.items() if isinstance(c, View)}
        self._constants: dict[str, Column] = {
            path: column for path, column in columns.items() if isinstance(column, str | tuple)
        }
        self._places = tuple(view.offset for view in self._views.values())
        self._plain = len(columns) == len(self._views) + len(self._constants)
        self._plain &= len(columns) <= kernels.MAX_COLUMNS
        self._plain &= all(view.plain for view in self._views.values())

    @cached_property
    def _edges(self) -> NDArray[np.int64]:
        """First byte of each span, and that behind it, shape (2, spans)."""
        return np.array(self._spans, dtype=np.int64).T.copy()

    @cached_property
    def _parts(self) -> list[tuple[int, NDArray[np.unsignedinteger[Any]]]]:
        """Bytes of each span as words, which numpy compares several times quicker than bytes."""
        return [
            (start, np.frombuffer(self._message[start:stop], dtype=f"u{gcd(stop - start, 4)}"))
            for start, stop in self._spans
        ]

    def gather(self, buffer: NDArray[np.uint8], offset: NDArray[np.int64]) -> NDArray[np.uint8]:
        """Return the messages at ``offset`` as rows (m, size); all must lie inside the buffer."""
        row = np.dtype((np.void, self.size))
        starts = np.ndarray((len(buffer) - self.size + 1,), row, buffer, 0, (1,))
        return starts[offset].view(np.uint8).reshape(len(offset), self.size)

    def agree(self, rows: NDArray[np.uint8]) -> NDArray[np.bool_] | None:
        """Return which rows have this layout; None for all of them."""
        equal = np.ones(len(rows), dtype=np.bool_)
        for start, part in self._parts:
            shape, strides = (len(rows), len(part)), (self.size, part.itemsize)
            words = np.ndarray(shape, part.dtype, rows, start, strides)
            equal &= (words == part).all(axis=1)
        return None if equal.all() else equal

    def compiled_run(
        self, index: NDArray[np.int64], buffer: NDArray[np.uint8], offset: NDArray[np.int64]
    ) -> Run | None:
        """Return the columns of messages by the kernel; None if it cannot, or some do not agree."""
        if not self._plain or kernels.compiled is None:
            return None
        columns, outs = self._constants.copy(), list[NDArray[Any]]()
        for path, view in self._views.items():
            outs.append(np.empty((len(offset), *view.shape), view.native, order="F"))
            columns[path] = outs[-1]
        begin, end = self._edges
        agree = kernels.compiled.columns(
            buffer, offset, self._message, begin, end, self._places, tuple(outs)
        )
        return Run(index, columns) if agree else None

    def run(self, index: NDArray[np.int64], rows: NDArray[np.uint8]) -> Run:
        columns: dict[str, Column] = {}
        for path, column in self.columns.items():
            constant = isinstance(column, str | tuple)
            columns[path] = column if constant else read(column, rows)  # pyright: ignore
        return Run(index, columns)


class Decoder:
    """Decodes chosen fields of one message type.

    Keeps the layouts it has met, so that messages like earlier ones cost no walk. Not for use by
    several threads at once.

    Args:
        msgtype: Message type, such as ``sensor_msgs/msg/JointState``.
        fields: Dotted paths of the wanted fields: ``name``, ``header.stamp.sec``,
            ``temperature_stamp.sec`` (a field of each element of an array of messages).
        typestore: Definitions; default those of ROS 2 Jazzy and ros2_energy_msgs.
        max_parts: Strings and messages in the arrays of one message; more are malformed.
    """

    def __init__(
        self,
        msgtype: str,
        fields: Iterable[str],
        typestore: Typestore | None = None,
        max_parts: int = MAX_PARTS,
    ) -> None:
        self._max_parts = max_parts
        self.msgtype = msgtype
        self.fields = tuple(dict.fromkeys(fields))
        store = default_typestore() if typestore is None else typestore
        self._schema: StructField = compile_schema(msgtype, store)
        self._places = [
            (path, path.split("."), *leaf(self._schema, path, msgtype)) for path in self.fields
        ]
        self._wanted = tree(self.fields)
        self._layouts: OrderedDict[bytes, _Layout] = OrderedDict()
        self._kept_bytes = 0

    def decode(self, batch: RawBatch) -> Decoded:
        """Decode a batch.

        Returns:
            Columns by layout, and the rows that could not be decoded. A message is malformed when
            it lies outside the buffer, is too short, has more than three bytes after its end, an
            encapsulation other than CDR, or strings that are not closed or not UTF-8.
        """
        if batch.msgtype != self.msgtype:
            raise MessageTypeError(f"a batch of {batch.msgtype} on {batch.topic}", self.msgtype)
        room = len(batch.buffer) - batch.length
        inside = (batch.length >= HEADER_SIZE) & (batch.offset >= 0) & (batch.offset <= room)
        pending = np.flatnonzero(inside)
        malformed: list[int] = []
        if len(pending) < len(batch):
            malformed = np.flatnonzero(~inside).tolist()
        runs: list[Run] = []
        vain = 0
        for layout in reversed(list(self._layouts.values())):
            if not len(pending) or vain == _MAX_LONELY:
                break
            before = len(pending)
            pending = self._take(layout, batch, pending, runs)
            vain = vain + 1 if len(pending) == before else 0
        lonely = 0
        while len(pending) and lonely < _MAX_LONELY:
            layout = self._walk(batch.row(int(pending[0])))
            if layout is None:
                malformed.append(int(pending[0]))
                pending = pending[1:]
                continue
            before = len(pending)
            pending = self._take(layout, batch, pending, runs)
            lonely = lonely + 1 if before - len(pending) == 1 else 0
        if len(pending):
            self._walk_each(batch, pending, runs, malformed)
        if len(runs) > 1:
            runs.sort(key=lambda run: int(run.rows[0]))
        return Decoded(runs, np.array(sorted(malformed), dtype=np.int64))

    def _take(
        self, layout: _Layout, batch: RawBatch, pending: NDArray[np.int64], runs: list[Run]
    ) -> NDArray[np.int64]:
        """Decode the pending rows that have this layout; return the others."""
        whole = len(pending) == len(batch)
        length = batch.length if whole else batch.length[pending]
        fits = (length >= layout.size) & (length <= layout.size + MAX_TRAILING)
        every = bool(fits.all())
        index = pending if every else pending[fits]
        if not len(index):
            return pending
        offset = batch.offset if whole and every else batch.offset[index]
        run = layout.compiled_run(index, batch.buffer, offset)
        if run is None:
            rows = layout.gather(batch.buffer, offset)
            agree = layout.agree(rows)
            if agree is not None:
                every, index, rows = False, index[agree], rows[agree]
                if not len(index):
                    return pending
            run = layout.run(index, rows)
        runs.append(run)
        if layout.key not in self._layouts:
            self._layouts[layout.key] = layout
            self._kept_bytes += layout.memory
        self._layouts.move_to_end(layout.key)  # as the last one used, within the bounds
        while len(self._layouts) > MAX_LAYOUTS or self._kept_bytes > MAX_LAYOUT_BYTES:
            _, oldest = self._layouts.popitem(last=False)
            self._kept_bytes -= oldest.memory
        return pending[:0] if every else np.setdiff1d(pending, index, assume_unique=True)

    def _walk(self, data: bytes) -> _Layout | None:
        """Return the layout of one message; None if it is malformed."""
        try:
            found = walk(self._schema, data, self._wanted, self._max_parts)
        except Malformed:
            return None
        return self._layouts.get(_key(found, data)) or self._layout(found, data)

    def _layout(self, found: Walk, data: bytes) -> _Layout:
        columns: dict[str, Column | Plan] = {}
        for path, names, node, axes in self._places:
            if isinstance(node, StringField):
                columns[path] = nested(found.values, names, tuple)
            else:
                columns[path] = make_plan(
                    nested(found.values, names, list), node, axes, found.order
                )
        return _Layout(found, data, columns)

    def _walk_each(
        self, batch: RawBatch, pending: NDArray[np.int64], runs: list[Run], malformed: list[int]
    ) -> None:
        """Walk every pending row: for messages whose strings change all the time."""
        groups: dict[bytes, tuple[Walk, bytes, list[int]]] = {}
        for row in pending.tolist():
            data = batch.row(row)
            try:
                found = walk(self._schema, data, self._wanted, self._max_parts)
            except Malformed:
                malformed.append(row)
                continue
            groups.setdefault(_key(found, data), (found, data, []))[2].append(row)
        for found, data, members in groups.values():
            index = np.array(members, dtype=np.int64)
            columns = self._only(found, data) if len(members) == 1 else None
            if columns is not None:
                runs.append(Run(index, columns))
                continue
            layout = self._layout(found, data)
            offset = batch.offset[index]
            run = layout.compiled_run(index, batch.buffer, offset)
            runs.append(run or layout.run(index, layout.gather(batch.buffer, offset)))

    def _only(self, found: Walk, data: bytes) -> dict[str, Column] | None:
        """Return the columns of one message without a plan; None if one takes a plan."""
        columns: dict[str, Column] = {}
        for path, names, node, _ in self._places:
            value = nested(found.values, names, tuple)
            if isinstance(node, ScalarField):
                if not isinstance(value, Slot):
                    return None
                value = value.read(data, found.order)
            columns[path] = value
        return columns


def _key(found: Walk, data: bytes) -> bytes:
    """Return what is equal in messages of one layout."""
    return b"".join([data[start:stop] for start, stop in found.spans])


def stamp_ns(run: Run, path: str = "header.stamp") -> NDArray[np.int64]:
    """Return stamps of a run [ns], int64, shape (m, ...), from ``<path>.sec`` and ``.nanosec``.

    ``INVALID_STAMP_NS`` where the nanoseconds are a second or more.
    """
    seconds = run.array(f"{path}.sec").astype(np.int64)
    nanoseconds = run.array(f"{path}.nanosec").astype(np.int64)
    stamp = seconds * SECOND_NS + nanoseconds
    if bool((nanoseconds >= SECOND_NS).any()):
        stamp[nanoseconds >= SECOND_NS] = INVALID_STAMP_NS
    return stamp
