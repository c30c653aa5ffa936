"""Power meters -> meter blocks."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_energy.bag.cdr.decode import Decoder, RawBatch, Run, stamp_ns
from robot_energy.bag.cdr.schema import ScalarField, compile_schema, leaf, leaf_paths
from robot_energy.bag.cdr.types import typestore as default_typestore
from robot_energy.foundation.errors import ParameterError
from robot_energy.foundation.units import SECOND_NS
from robot_energy.inputs.meter.source import MeterSource
from robot_energy.inputs.parameters import HEADER, RECEIVE
from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.timeline.blocks import (
    NANOSECOND,
    Float,
    Int,
    MeterBlock,
    MeterLocation,
    MeterMeaning,
)
from robot_energy.timeline.stamps import (
    BACKWARD_JUMP_NS,
    BAD_STAMP,
    EpochRun,
    Reach,
    first_needed,
    held_rows,
    sentence_of,
    valid_stamps,
)
from robot_energy.timeline.streams import StreamSplitter, joined

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore


Values = tuple[Int, Float]  # times of receipt [ns] and what was received then, each (N,)


def _nothing() -> Values:
    return np.empty(0, dtype=np.int64), np.empty(0)


class Pairing:
    """Multiplies each current by the voltage that was valid when it was received.

    A current waits until a later message of either topic has come, so that the order in
    which messages of one instant are handed over does not matter. Its voltage is the
    newest one not later than itself, and at most ``max_age`` old: power never comes from
    a voltage that may long have changed. Where the clock steps back, what waits is refused.

    Args:
        max_age: Longest time from the voltage to its current. [s]
        rejections: Where messages are counted; a current that waits counts as accepted until
            it turns out to be without a voltage.
    """

    def __init__(self, max_age: float, rejections: RejectionLog) -> None:
        self._max_age_ns = round(max_age / NANOSECOND)
        self._rejections = rejections
        self._voltage, self._current = _nothing(), _nothing()
        self._newest_ns: int | None = None

    def step(self, voltage: Values, current: Values) -> Values:
        """Return times [ns] and powers [W] of the currents that found their voltage by now."""
        times = np.concatenate([voltage[0], current[0]])
        if not len(times):
            return _nothing()
        if self._newest_ns is not None and times.min() < self._newest_ns - BACKWARD_JUMP_NS:
            self._refuse(len(self._current[0]))
            self._voltage, self._current, self._newest_ns = _nothing(), _nothing(), None
        self._rejections.received += len(times)
        self._rejections.accepted += len(times)
        self._voltage = _joined(self._voltage, voltage)
        self._current = _joined(self._current, current)
        newest = int(times.max())
        if self._newest_ns is not None:
            newest = max(newest, self._newest_ns)
        self._newest_ns = newest
        ready = int(np.searchsorted(self._current[0], newest))
        stamp, ampere = self._current[0][:ready], self._current[1][:ready]
        self._current = self._current[0][ready:], self._current[1][ready:]
        times, values = self._voltage
        volt = np.full(len(stamp), np.nan)  # none, or too old
        if len(times):
            row = held_rows(times, stamp, self._max_age_ns)
            volt = np.where(row >= 0, values[row], np.nan)
        with np.errstate(over="ignore"):  # beyond all numbers: refused below
            power = ampere * volt
        found = np.isfinite(power)
        self._refuse(int((~found).sum()))
        waiting = self._current[0]  # forget voltages before that of what waits, or of now
        first = first_needed(times, int(waiting[0]) if len(waiting) else newest)
        self._voltage = times[first:], values[first:]
        return stamp[found], power[found]

    def _refuse(self, unpaired: int) -> None:
        self._rejections.accepted -= unpaired
        self._rejections.reject("unpaired", unpaired)


def _joined(held: Values, new: Values) -> Values:
    """Both in order of time."""
    if not len(new[0]):
        return held
    times, values = np.concatenate([held[0], new[0]]), np.concatenate([held[1], new[1]])
    if bool((times[1:] >= times[:-1]).all()):
        return times, values
    order = np.argsort(times, kind="stable")
    return times[order], values[order]


Kind = tuple[MeterMeaning, MeterLocation]
MAX_REFUSED = 0.1  # of the messages, beyond which it is said
REACH = Reach(max_ahead_ns=3600 * SECOND_NS, prompt=True)  # meters of one reading an hour
STAMP = ("header.stamp.sec", "header.stamp.nanosec")
_INDEX = re.compile(r"\[(\d{1,9})\]")


@dataclass(frozen=True)
class _Number:
    """One number of a message: the path of its field, and its place where that is an array."""

    path: str
    index: int | None = None

    @classmethod
    def read(cls, text: str) -> _Number:
        """Read a path with at most one index, such as ``phases[0].power``."""
        places = _INDEX.findall(text)
        if len(places) > 1:
            raise ParameterError(f"value_path has {len(places)} indices: {text}", "at most one")
        return cls(_INDEX.sub("", text).strip(), int(places[0]) if places else None)

    def of(self, run: Run) -> Float:
        """Return its values, shape (m,); NaN where the array is too short."""
        values = run.array(self.path).astype(np.float64)
        if self.index is None:
            return values
        short = self.index >= values.shape[1]
        return np.full(len(values), np.nan) if short else values[:, self.index]


class MeterIngest:
    """Turns the messages of one meter into blocks.

    All readings of a meter must have one meaning and one location; where the messages say
    them, those of the first reading, and others are rejected as ``changed_meaning``.

    Attributes:
        rejections: Received, accepted and rejected messages. Acceptance here means that
            the message could be read; the comparison counts what it could use. A current
            of a pair may turn out to be ``unpaired`` when a later message has come.
        receive_time: Whether readings are dated by their receipt.
    """

    def __init__(
        self, source: MeterSource | None = None, typestore: Typestore | None = None
    ) -> None:
        self.source = source or MeterSource()
        self.rejections = RejectionLog()
        self._numbers = self._read_numbers(typestore or default_typestore())
        paths = tuple(number.path for number in self._numbers.values())
        fields = paths if self.receive_time else (*STAMP, *paths)
        self._decoder = Decoder(self.source.type, fields, typestore)
        self._shift_ns, self._factor = self.source.shift_ns, self.source.factor
        self._number = self.source.reading.number
        self._given = self.source.kind  # None where the readings say it
        self._kind: Kind | None = None  # of the first reading that says it
        self._pairing = Pairing(self.source.pair_max_age, self.rejections)
        self._stream = StreamSplitter[MeterBlock](REACH, self.rejections.reject)
        self.epochs = self._stream.epochs

    @property
    def refused(self) -> str:
        """That more than a tenth of its messages were refused, and why; empty if not."""
        rejected, received = self.rejections.rejected, self.rejections.received
        if rejected.total() <= MAX_REFUSED * received:
            return ""
        reasons = ", ".join(f"{count} {reason}" for reason, count in rejected.most_common())
        return f"of {received} messages of the power meter {reasons} were refused"

    def _read_numbers(self, typestore: Typestore) -> dict[str, _Number]:
        """Return what makes a reading, by its text, after a check that the type has it."""
        source = self.source
        schema = compile_schema(source.type, typestore)
        headed = set(STAMP) <= set(leaf_paths(schema))
        if source.stamp_source == HEADER and not headed:
            raise ParameterError(
                f"stamp_source is header, which {source.type} does not have", RECEIVE
            )
        self.receive_time = not headed or source.stamp_source == RECEIVE
        if source.reading.fields:
            return {path: _Number(path) for path in source.reading.fields}
        terms = [term.strip() for term in source.value_path.split("+")]
        if len(set(terms)) < len(terms):
            raise ParameterError(
                f"value_path {source.value_path} adds a number twice", "different numbers"
            )
        numbers = {term: _Number.read(term) for term in terms}
        for text, number in numbers.items():
            node, axes = leaf(schema, number.path, source.type)
            if not isinstance(node, ScalarField):
                raise ParameterError(
                    f"value_path {text} of {source.type} is not a number", "the path of a number"
                )
            if axes != (number.index is not None):
                found, expected = (
                    ("is an array", f"one place of it, such as {number.path}[0]")
                    if axes
                    else ("is not an array", f"{number.path} without an index")
                )
                raise ParameterError(f"value_path {text} of {source.type} {found}", expected)
        return numbers

    def step(self, batches: Sequence[RawBatch]) -> MeterBlock | None:
        """Return the readings in messages of the topics of the meter; None if there are none."""
        kind = self._given
        if kind is not None and self.source.pair:
            block = self._pair(batches, kind)
        else:
            read = (self._batch(batch, kind) for batch in batches)
            blocks = [block for block in read if block is not None and len(block)]
            block = MeterBlock.concatenate(blocks) if blocks else None
        return None if block is None else self._taken(self._stream.step(block))

    def flush(self) -> MeterBlock | None:
        """Return what still waits and is not an outlier, as at the end of a bag."""
        return self._taken(self._stream.flush())

    def clock_doubts(self, within: float | None = None) -> list[str]:
        """Return what the stamps say of the meter's clock, one sentence each.

        Args:
            within: Only what concerns so much of the newest time; None for all. [s]
        """
        topics = " and ".join(self.source.topics)
        remedy = "synchronise the clocks, or let one meter publish"
        clock = sentence_of(self.epochs, f"readings of the meter on {topics}", remedy, within)
        return [clock] if clock else []

    def _taken(self, runs: list[tuple[MeterBlock, EpochRun]]) -> MeterBlock | None:
        """Bring the account up to date."""
        refused, waiting = self._stream.refused, self._stream.waiting
        strays = 0 if refused is None else len(refused)
        self.rejections.accepted += self.rejections.waiting - waiting - strays
        self.rejections.waiting = waiting
        return joined(runs)

    def restart(self) -> None:
        """Drop what waits, as after an error. The account is left alone."""
        self._pairing = Pairing(self.source.pair_max_age, self.rejections)
        self._stream.restart()

    def _batch(self, batch: RawBatch, kind: Kind | None) -> MeterBlock | None:
        self.rejections.received += len(batch)
        rows, stamp, column = self._columns(batch)
        if not len(rows):
            return None
        if kind is None:
            return self._stated(stamp, column)
        value = self._number(column)
        used = self.rejections.refuse({"zero_stamp": stamp == 0, "not_finite": ~np.isfinite(value)})
        self.rejections.accepted += int(used.sum())
        return self._readings(stamp[used], value[used], kind)

    def _columns(self, batch: RawBatch) -> tuple[Int, Int, dict[str, Float]]:
        """Return the rows that could be decoded and dated, in order, with times and numbers."""
        decoded = self._decoder.decode(batch)
        self.rejections.reject("malformed", len(decoded.malformed))
        runs = decoded.runs
        if not runs:
            none = np.empty(0, dtype=np.int64)
            return none, none, {}
        rows = np.concatenate([run.rows for run in runs])
        order = np.argsort(rows)
        rows = rows[order]
        if self.receive_time:
            stamp = batch.log_time_ns[rows]
        else:
            stamp = np.concatenate([stamp_ns(run) for run in runs])[order]
        valid = valid_stamps(stamp) & valid_stamps(stamp + self._shift_ns)
        self.rejections.reject(BAD_STAMP, int((~valid).sum()))
        column: dict[str, Float] = {
            text: np.concatenate([number.of(run) for run in runs])[order]
            for text, number in self._numbers.items()
        }
        if not bool(valid.all()):
            rows, stamp = rows[valid], stamp[valid]
            column = {path: values[valid] for path, values in column.items()}
        return rows, stamp, column

    def _stated(self, stamp: Int, column: dict[str, Float]) -> MeterBlock | None:
        """Readings that say by themselves what they are."""
        good = self.rejections.refuse(
            {
                "zero_stamp": stamp == 0,
                "unknown_meaning": ~np.isin(column["meaning"], (1, 2, 3)),
                "unknown_location": ~np.isin(column["location"], (1, 2)),
            }
        )
        if not good.any():
            return None
        if self._kind is None:
            first = int(np.flatnonzero(good)[0])
            self._kind = (
                MeterMeaning(int(column["meaning"][first])),
                MeterLocation(int(column["location"][first])),
            )
        meaning, location = self._kind
        same = (column["meaning"] == meaning) & (column["location"] == location)
        self.rejections.reject("changed_meaning", int((good & ~same).sum()))
        rows = good & same
        self.rejections.accepted += int(rows.sum())
        return MeterBlock(
            stamp[rows] + self._shift_ns,
            self._scaled(column["power"][rows]),
            self._scaled(column["energy"][rows]),
            column["interval"][rows],
            meaning,
            location,
        )

    def _readings(self, stamp: Int, value: Float, kind: Kind) -> MeterBlock:
        """Readings whose meaning the source says."""
        meaning, location = kind
        value, none = self._scaled(value), np.full(len(value), np.nan)
        cumulative = meaning is MeterMeaning.CUMULATIVE
        mean = meaning is MeterMeaning.MEAN_OVER_INTERVAL
        return MeterBlock(
            stamp + self._shift_ns,
            none if cumulative else value,
            value if cumulative else none,
            np.full(len(value), self.source.interval) if mean else none,
            meaning,
            location,
        )

    def _scaled(self, value: Float) -> Float:
        """In SI; what is beyond all numbers then is infinite, which the comparison refuses."""
        with np.errstate(over="ignore"):
            return value * self._factor

    def _pair(self, batches: Sequence[RawBatch], kind: Kind) -> MeterBlock | None:
        voltage = [self._values(b) for b in batches if b.topic == self.source.voltage_topic]
        current = [self._values(b) for b in batches if b.topic == self.source.current_topic]
        stamp, power = self._pairing.step(_sequence(voltage), _sequence(current))
        return self._readings(stamp, power, kind) if len(stamp) else None

    def _values(self, batch: RawBatch) -> Values:
        """Dated finite values of one topic of a pair, which the pairing counts."""
        rows, stamp, column = self._columns(batch)
        value = self._number(column) if len(rows) else np.empty(0)
        used = self.rejections.refuse({"zero_stamp": stamp == 0, "not_finite": ~np.isfinite(value)})
        self.rejections.received += len(batch) - int(used.sum())
        return stamp[used], value[used]


def _sequence(parts: Sequence[Values]) -> Values:
    if not parts:
        return np.empty(0, dtype=np.int64), np.empty(0)
    return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
