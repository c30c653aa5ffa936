"""One source of motor temperatures: its messages -> readings of model joints in degC."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from robot_energy.bag.cdr.decode import Decoder, RawBatch, Run, stamp_ns
from robot_energy.foundation.errors import ParameterError
from robot_energy.inputs.parameters import RECEIVE
from robot_energy.inputs.rejection_log import ByNames, RejectionLog, remember_names
from robot_energy.inputs.sources import NO_JOINT, TemperatureSource
from robot_energy.inputs.temperatures.kinds import TO_DEGC, Adapter, Said
from robot_energy.timeline.blocks import PLAUSIBLE_DEGC, Float, Int, TemperatureBlock
from robot_energy.timeline.stamps import BAD_STAMP, valid_stamps

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

TENTH_NS = 100_000_000
# What sensors and drivers say that measure nothing, in the unit of the source.
FAULT_CODES = (0.0, -1.0, -40.0, 127.0, 255.0)
NEAR_CODE = 2.0  # K; a motor comes to such a temperature by smaller steps
MOTOR_KELVIN = (273.0, 420.0)  # of a motor in use
HOT_KELVIN = 333.0  # so warm a motor is rarer than one of a tenth of the number in degC
MAX_TENTHS = 900.0  # 90 degC


class TemperatureReadings(NamedTuple):
    """Readings of one source in order of arrival.

    Attributes:
        arrival_ns: When each was received, shape (N,). [ns]
    """

    block: TemperatureBlock
    arrival_ns: Int


class TemperatureReader:
    """Reads the messages of one source.

    Joints are matched by name in every message; names that the model does not know, or
    that the source does not list, are ignored and listed. Of a source that is quicker than
    temperatures change, the first reading of a joint in each tenth of a second counts.
    A fault code counts as no reading, unless the last other reading is within 2 K of it.

    Attributes:
        receive_time: Whether messages are dated by their receipt.
    """

    def __init__(
        self,
        name: str,
        source: TemperatureSource,
        joint_names: Sequence[str],
        typestore: Typestore | None = None,
    ) -> None:
        self.name, self.source = name, source
        self.rejections = RejectionLog()
        self.keys_account = RejectionLog()
        self.ignored_joints: set[str] = set()  # names met that are none of the source's joints
        self.missing_readings = 0  # values that were not numbers, in messages that were accepted
        self._joint_names = tuple(joint_names)
        self._factor, self._offset = TO_DEGC[source.unit]
        self._codes_degc = np.array(FAULT_CODES) * self._factor - self._offset
        self._newest: Int = np.full(len(self._joint_names), -1, dtype=np.int64)
        self._true_degc: Float = np.full(len(self._joint_names), np.nan)  # last that is not a code
        self._odd: dict[int, float] = {}  # last value by column, where it is not used [degC]
        self._columns = self._wanted()
        self._placed = ByNames[list[tuple[int, int]]]()
        self._adapter: Adapter = source.reading.adapter(source)
        self._decoder = Decoder(source.type, self._adapter.fields, typestore)
        self._nameless = False
        self.receive_time = not source.reading.headed or source.stamp_source == RECEIVE
        self._keys, self.keys_topic = None, source.keys_topic
        if source.keys_topic:
            self._keys = Decoder(source.reading.keys_type, ("keys",), typestore)

    def read(self, batches: Mapping[str, RawBatch]) -> TemperatureReadings | None:
        """Return the readings in messages in order of arrival; None if there are none."""
        parts = [part for batch in self._pieces(batches) for part in self._decode(batch)]
        if not parts:
            return None
        block = TemperatureBlock.concatenate([part.block for part in parts])
        arrival = np.concatenate([part.arrival_ns for part in parts])
        due = self._due(block)
        if not due.any():
            return None
        return TemperatureReadings(block[due], arrival[due])

    @property
    def doubt(self) -> str:
        """What the last readings look like if not what the source says; empty if they fit."""
        topic, scale = self.source.topic, self.source.scale
        if self._nameless:
            return (
                f"{topic} names no joint (its frame_id is empty): name the joint under joints of "
                "this source in the parameter file"
            )
        said: list[str] = []
        for column, degc in sorted(self._odd.items()):
            value = (degc + self._offset) / self._factor
            said.append(f"{value / scale:g} for {self._joint_names[column]}")
            advice = "" if degc in self._codes_degc else _advice(value, self.source)
            if advice:
                return f"{topic} reads {said[-1]}: {advice}"
        if not said:
            return ""
        return (
            f"{topic} reads {', '.join(said)}, which looks like a fault code: not used; check the "
            "sensor"
        )

    def _due(self, block: TemperatureBlock) -> NDArray[np.bool_]:
        """Return which readings are in another tenth of a second than the last of some joint."""
        given = ~np.isnan(block.motor_temperature_degc)
        tenth = np.where(given, (block.stamp_ns // TENTH_NS)[:, None], 0)
        tenth = np.concatenate([self._newest[None], tenth])
        row = np.arange(len(tenth))[:, None] * np.concatenate([np.ones_like(given[:1]), given])
        last = np.take_along_axis(tenth, np.maximum.accumulate(row, axis=0), axis=0)
        self._newest = last[-1]
        return np.logical_or.reduce(given & (tenth[1:] != last[:-1]), axis=1)

    def _wanted(self) -> dict[str, int]:
        """Model column of every name that counts."""
        columns = {name: index for index, name in enumerate(self._joint_names)}
        source = self.source
        joints = [name for name in source.joints if name != NO_JOINT]
        unknown = [name for name in joints if name not in columns]
        if unknown:
            raise ParameterError(
                f"the temperature source '{self.name}' names {', '.join(unknown)}",
                f"joints of the model, {', '.join(self._joint_names)}",
            )
        if not joints:
            return columns
        named = source.names and not source.reading.by_status
        names = source.names if named else joints
        return {name: columns[joint] for name, joint in zip(names, joints, strict=True)}

    def _pieces(self, batches: Mapping[str, RawBatch]) -> Iterator[RawBatch]:
        """Yield the batch of values; in pieces where the keys of the values change."""
        batch = batches.get(self.source.topic)
        keys = batches.get(self.keys_topic) if self._keys is not None else None
        for arrival_ns, names in self._new_keys(keys) if keys is not None else ():
            if batch is not None:
                before = int(np.searchsorted(batch.log_time_ns, arrival_ns))
                if before:
                    yield batch[slice(0, before)]
                batch = batch[slice(before, None)]
            cast("Any", self._adapter).keys = names  # as adapters with a keys_type have
        if batch is not None and len(batch):
            yield batch

    def _new_keys(self, batch: RawBatch) -> list[tuple[int, tuple[str, ...]]]:
        """Keys and when they arrived, in order."""
        assert self._keys is not None
        decoded = self._keys.decode(batch)
        self.keys_account.received += len(batch)
        self.keys_account.reject("malformed", len(decoded.malformed))
        self.keys_account.accepted += len(batch) - len(decoded.malformed)
        found = [(row, run.names("keys")) for run in decoded.runs for row in run.rows.tolist()]
        return [(int(batch.log_time_ns[row]), names) for row, names in sorted(found)]

    def _decode(self, batch: RawBatch) -> list[TemperatureReadings]:
        """Return the usable readings of a batch in order of arrival."""
        self.rejections.received += len(batch)
        decoded = self._decoder.decode(batch)
        self.rejections.reject("malformed", len(decoded.malformed))
        blocks: list[TemperatureBlock] = []
        rows: list[Int] = []
        for run in decoded.runs:
            said = self._adapter.read(run)
            block = said if isinstance(said, str) else self._place(run, batch, said)
            if isinstance(block, str):
                self.rejections.reject(block, len(run.rows))
                continue
            blocks.append(block)
            rows.append(run.rows)
        if not blocks:
            return []
        block, row = TemperatureBlock.arranged(blocks, rows)
        block = TemperatureBlock(block.stamp_ns, self._believed(block.motor_temperature_degc))
        good = self._usable(block)
        self.rejections.accepted += int(good.sum())
        if not good.any():
            return []
        return [TemperatureReadings(block[good], batch.log_time_ns[row[good]])]

    def _usable(self, block: TemperatureBlock) -> NDArray[np.bool_]:
        """Refuse readings without a stamp in range or without a number."""
        stamp, finite = block.stamp_ns, np.isfinite(block.motor_temperature_degc)
        none = ~np.logical_or.reduce(finite, axis=1)
        return self.rejections.refuse(
            {"zero_stamp": stamp == 0, BAD_STAMP: ~valid_stamps(stamp), "not_finite": none}
        )

    def _place(self, run: Run, batch: RawBatch, said: Said) -> TemperatureBlock | str:
        """Put what was said into model joint order, in degC."""
        places = self._placed.get(said.names)
        if places is None:
            places = self._match(said.names)
        if not places:
            return "unknown_joint"
        if len({column for _, column in places}) < len(places):
            return "repeated_joint"
        taken = said.values[:, [index for index, _ in places]]
        if not np.isfinite(taken).all():
            taken = np.where(np.isfinite(taken), taken, np.nan)
            self.missing_readings += int(np.isnan(taken).sum())
        values = np.full((len(run.rows), len(self._joint_names)), np.nan)
        with np.errstate(over="ignore"):  # what is beyond all numbers is refused as implausible
            taken = taken * (self.source.scale * self._factor) - self._offset
        values[:, [column for _, column in places]] = taken
        return TemperatureBlock(
            batch.log_time_ns[run.rows] if self.receive_time else stamp_ns(run), values
        )

    def _match(self, names: tuple[str, ...]) -> list[tuple[int, int]]:
        """Place in the message and model column of every joint that counts."""
        self._nameless |= names == ("",)
        unnamed = (NO_JOINT, "")
        foreign = (name for name in names if name not in self._columns and name not in unnamed)
        remember_names(self.ignored_joints, foreign)
        columns = self._columns
        places = [(index, columns[name]) for index, name in enumerate(names) if name in columns]
        return self._placed.put(names, places)

    def _believed(self, degc: Float) -> Float:
        """Return readings in order of arrival without fault codes; note what is not used."""
        given = ~np.isnan(degc)
        code = np.isin(degc, self._codes_degc)
        true = np.concatenate([self._true_degc[None], np.where(code, np.nan, degc)])
        row = np.arange(len(true))[:, None] * ~np.isnan(true)
        true = np.take_along_axis(true, np.maximum.accumulate(row, axis=0), axis=0)
        self._true_degc = true[-1]
        code &= ~(np.abs(degc - true[:-1]) <= NEAR_CODE)
        odd = code | (given & ((degc < PLAUSIBLE_DEGC[0]) | (degc > PLAUSIBLE_DEGC[1])))
        if odd.any() or self._odd:
            for column in np.flatnonzero(given.any(axis=0)).tolist():
                last = np.flatnonzero(given[:, column])[-1]
                self._odd.pop(column, None)
                if odd[last, column]:
                    self._odd[column] = float(degc[last, column])
        return np.where(code, np.nan, degc)


def _advice(value: float, source: TemperatureSource) -> str:
    """What to set if a value that is not used is a temperature in another unit; else empty."""
    low, high = PLAUSIBLE_DEGC
    if source.unit != "degc":
        return "set unit: degc" if low <= value <= high else ""
    tenths = f"scale: {source.scale / 10:g} if these are tenths of a degree"
    if MOTOR_KELVIN[0] <= value <= MOTOR_KELVIN[1]:
        either = value > HOT_KELVIN or value.is_integer()  # as tenths are sent
        return f"set unit: kelvin, or {tenths}" if either else "set unit: kelvin"
    return f"set {tenths}" if high < value <= MAX_TENTHS else ""
