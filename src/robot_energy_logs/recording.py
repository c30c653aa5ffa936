"""What a log holds, in blocks, and the bag that it becomes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from robot_energy.bag import SENSOR_QOS, BagWriter
from robot_energy.bag.cdr import Encoder, stamp_columns
from robot_energy.bag.writer import DEFAULT_QOS
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import LogFormatError
from robot_energy.inputs.joint_states.joint_states import JOINT_STATE
from robot_energy.inputs.meter.kinds import POWER_READING
from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.inputs.temperatures.kinds import FLOAT_ARRAY, MOTOR_TEMPERATURES
from robot_energy.messages.fields import (
    DRIVE_POWER_TOPIC,
    JOINT_STATES_TOPIC,
    METER_TOPIC,
    TEMPERATURES_TOPIC,
)
from robot_energy.messages.payload import FIELDS, PAYLOAD
from robot_energy.timeline.blocks import NANOSECOND, Block, Float, Int, MeterLocation, MeterMeaning
from robot_energy.timeline.stamps import BAD_STAMP, MAX_GAP_NS, MIN_PERIOD_NS, MIN_STAMP_NS
from robot_energy_logs.instants import time_remedy
from robot_energy_logs.table import number_remedy

PAYLOAD_TOPIC = "/energy/payload"
BODY = FIELDS[1:]  # fields of a message, in the order of the figures of a payload
NO_TIMES = "check time.unit; where times count from zero, give time.start: when the recording began"
MIN_ROWS = 2  # a state alone has no duration, so no energy
NO_OTHERS = ("there are none", "there are no others")
REMEDIES = {"bad_time": time_remedy, "not_numeric": number_remedy}
INTERLEAVED_ROWS = 16  # replay waits only a little for temperatures that come late


class LogBlock(Block):
    """Rows of a log in SI units; NaN where the log says nothing."""

    joint_position: Annotated[Float, "Joint side, shape (N, n). [rad] or [m]"]
    joint_velocity: Annotated[Float, "Joint side, shape (N, n). [rad/s] or [m/s]"]
    effort: Annotated[Float, "As logged: torque or motor current, shape (N, n). [N m] or [A]"]
    motor_temperature_degc: Annotated[Float, "Shape (N, n). [degC]"]
    reading: Annotated[Float, "Power or, of a counter, energy, shape (N,). [W] or [J]"]
    drive_power: Annotated[Float, "Electrical input of each drive, shape (N, n). [W]"]
    payload: Annotated[
        Float | None,
        "Mass, centre of mass (3) and inertia (6) of what the robot carries, shape (N, 10); None "
        "where the log says nothing of it. [kg], [m], [kg m^2]",
    ] = None
    run: Annotated[Int | None, "Number of the run of each row, shape (N,); None: one run."] = None


class RecordingContents(Described):
    """What the bag of a log holds next to positions."""

    joint_names: Annotated[tuple[str, ...], "Joints, in the order of the arrays."]
    velocity: bool
    effort: bool
    temperatures: bool
    meaning: Annotated[
        MeterMeaning, "What a meter reading stands for; UNKNOWN: there is no meter."
    ] = MeterMeaning.UNKNOWN
    location: MeterLocation = MeterLocation.UNKNOWN
    interval: Annotated[float, "Of a mean; NaN for other meanings. [s]"] = float("nan")
    drive_power: Annotated[bool, "Whether it has the electrical power of each drive."] = False
    payload_link: Annotated[str, "Link that carries the payload; empty: not logged."] = ""


@dataclass
class FileAccount(RejectionLog):
    """What became of the rows of one file: received = accepted + rejected.

    Attributes:
        first_line: Line number of the first row rejected for each reason.
        first_cell: Name and text of the cell that offends there; the name may be empty.
    """

    path: Path = Path()
    first_line: dict[str, int] = field(default_factory=dict[str, int])
    first_cell: dict[str, tuple[str, str]] = field(default_factory=dict[str, tuple[str, str]])

    @property
    def reasons(self) -> str:
        """Count and first place of every reason for which rows were rejected."""
        return "; ".join(
            f"{count} {reason} from line {self.first_line[reason]} of {self.path.name}"
            + self.offending(reason)
            for reason, count in self.rejected.items()
        )

    def offending(self, reason: str) -> str:
        """Return the first cell that was rejected for a reason, as in ", where q1 is 'x'"."""
        name, text = self.first_cell.get(reason, ("", ""))
        if name:
            return f", where {name} is '{text}'"
        return f", which has {text}" if text else ""

    @property
    def remedy(self) -> str:
        """What in a mapping reads the first cells that were rejected; empty if nothing is known."""
        found = [
            remedy(self.first_cell[reason][1])
            for reason, remedy in REMEDIES.items()
            if reason in self.first_cell
        ]
        return next(filter(None, found), "")


@dataclass
class ImportReport:
    """What an import wrote."""

    bag: Path
    contents: RecordingContents
    files: Annotated[list[FileAccount], "Account of the rows of every file, in time order."] = (
        field(default_factory=list[FileAccount])
    )
    start_ns: Annotated[int | None, "First stamp. [ns]"] = None
    end_ns: Annotated[int | None, "Last stamp. [ns]"] = None
    joint_states: int = 0
    temperatures: Annotated[int, "Messages written; rows without any temperature give none."] = 0
    readings: Annotated[int, "Meter readings written; rows without one give none."] = 0
    drive_powers: Annotated[int, "Messages written; rows without any power give none."] = 0
    payloads: int = 0
    notes: Annotated[list[str], "What a reader of the bag should know, one sentence each."] = field(
        default_factory=list[str]
    )


@dataclass(frozen=True)
class _Stream:
    """One topic of the bag: which rows give a message, and what is in it."""

    topic: str
    encoder: Encoder
    given: Callable[[LogBlock], NDArray[np.bool_]]
    fields: Callable[[LogBlock], dict[str, Any]]


class _PayloadChanges:
    """Rows from which on the robot carries something else."""

    def __init__(self) -> None:
        self._last: Float = np.full(len(BODY), np.nan)

    def __call__(self, block: LogBlock) -> NDArray[np.bool_]:
        changed = np.zeros(len(block), dtype=np.bool_)
        if block.payload is None:
            return changed
        known = np.flatnonzero(np.isfinite(block.payload).all(axis=1))
        if len(known):
            found = np.vstack([self._last[None], block.payload[known]])
            changed[known] = (found[1:] != found[:-1]).any(axis=1)
            self._last = found[-1]
        return changed


def _streams(contents: RecordingContents) -> list[_Stream]:
    """The topics of a log, in the order in which a recorder would write them."""
    names, counter = contents.joint_names, contents.meaning is MeterMeaning.CUMULATIVE
    count = len(names)
    where = {"meaning": int(contents.meaning), "location": int(contents.location)}
    states = {
        "position": count,
        "velocity": count * contents.velocity,
        "effort": count * contents.effort,
    }

    def flat(block: LogBlock) -> NDArray[np.uint32]:
        return np.empty((len(block), 0), dtype=np.uint32)  # one row of values needs no layout

    def payload_fields(block: LogBlock) -> dict[str, Any]:
        body = np.zeros((len(block), len(BODY))) if block.payload is None else block.payload
        return {**stamp_columns(block.stamp_ns), **dict(zip(BODY, body.T, strict=True))}

    temperature = _Stream(
        TEMPERATURES_TOPIC,
        Encoder(MOTOR_TEMPERATURES, {"joint_names": names}, {"temperature_degc": count}),
        lambda b: _any(b.motor_temperature_degc),
        lambda b: {**stamp_columns(b.stamp_ns), "temperature_degc": b.motor_temperature_degc},
    )
    reading = _Stream(
        METER_TOPIC,
        Encoder(POWER_READING, {**where, "interval": contents.interval}),
        lambda b: _any(b.reading[:, None]),
        lambda b: {
            **stamp_columns(b.stamp_ns),
            "power": np.where(counter, np.nan, b.reading),
            "energy": np.where(counter, b.reading, np.nan),
        },
    )
    drive_power = _Stream(
        DRIVE_POWER_TOPIC,
        Encoder(FLOAT_ARRAY, lengths={"layout.dim": 0, "data": count}),
        lambda b: _any(b.drive_power),
        lambda b: {
            "layout.dim.size": flat(b),
            "layout.dim.stride": flat(b),
            "layout.data_offset": 0,
            "data": b.drive_power,
        },
    )
    joint_states = _Stream(
        JOINT_STATES_TOPIC,
        Encoder(JOINT_STATE, {"name": names}, states),
        lambda b: np.ones(len(b), dtype=np.bool_),
        lambda b: {
            **stamp_columns(b.stamp_ns),
            "position": b.joint_position,
            "velocity": b.joint_velocity[:, : states["velocity"]],
            "effort": b.effort[:, : states["effort"]],
        },
    )
    link = contents.payload_link
    payload = _Stream(
        PAYLOAD_TOPIC,
        Encoder(PAYLOAD, {"header.frame_id": link, "model_id": ""}),
        _PayloadChanges(),
        payload_fields,
    )
    return [
        *([payload] if link else []),
        *([temperature] if contents.temperatures else []),
        *([reading] if contents.meaning is not MeterMeaning.UNKNOWN else []),
        *([drive_power] if contents.drive_power else []),
        joint_states,
    ]


def _any(values: Float) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(values).any(axis=1))


def write_bag(
    path: str | Path,
    contents: RecordingContents,
    blocks: Iterable[LogBlock],
    files: list[FileAccount],
    overwrite: bool = False,
    origin: str = "",
) -> ImportReport:
    """Return what was written of a log into a new bag; nothing is left behind if that fails.

    Args:
        origin: Where the recording comes from, in words, noted with the bag.
    """
    report = ImportReport(Path(path), contents, files)
    streams = _streams(contents)
    counts: Counter[str] = Counter()
    rows = 0
    inputs = [file.path for file in files]
    with BagWriter(path, overwrite=overwrite, origin=origin, inputs=inputs) as bag:
        for stream in reversed(streams):
            qos = SENSOR_QOS if stream.topic == JOINT_STATES_TOPIC else DEFAULT_QOS
            bag.add_topic(stream.topic, stream.encoder.msgtype, qos)
        for block in blocks:
            if not len(block):
                continue
            rows += len(block)
            if report.start_ns is None:
                report.start_ns = int(block.stamp_ns[0])
            report.end_ns = int(block.stamp_ns[-1])
            if report.start_ns <= MIN_STAMP_NS:
                found = f"the stamps of {files[0].path} begin at zero"
                raise LogFormatError(found, "times between 1970 and 2038", NO_TIMES)
            counts.update(_write(bag, streams, block))
        if rows < MIN_ROWS:
            raise LogFormatError(*nothing_used(files))
    report.joint_states = counts[JOINT_STATES_TOPIC]
    report.temperatures = counts[TEMPERATURES_TOPIC]
    report.readings, report.drive_powers = counts[METER_TOPIC], counts[DRIVE_POWER_TOPIC]
    report.payloads = counts[PAYLOAD_TOPIC]
    rows, span_ns = report.joint_states - 1, (report.end_ns or 0) - (report.start_ns or 0)
    if rows > 0 and not MIN_PERIOD_NS <= span_ns / rows <= MAX_GAP_NS:
        apart = span_ns / rows * NANOSECOND
        report.notes.append(f"rows are {apart:.3g} s apart on average: is the unit of time right?")
    if not report.readings and contents.meaning is not MeterMeaning.UNKNOWN:
        report.notes.append("no row has a meter reading")
    if not report.temperatures and contents.temperatures:
        report.notes.append("no row has a motor temperature")
    return report


def _write(bag: BagWriter, streams: Sequence[_Stream], block: LogBlock) -> dict[str, int]:
    """Write all topics, interleaved as a recorder would; return the messages of each."""
    parts: list[tuple[str, Int, NDArray[np.uint8]]] = []
    turns: list[Int] = []
    for stream in streams:
        rows = stream.given(block)
        messages = stream.encoder.encode(stream.fields(block), len(block))
        messages = messages if rows.all() else messages[rows]
        parts.append((stream.topic, block.stamp_ns[rows], messages))
        turns.append(np.flatnonzero(rows) // INTERLEAVED_ROWS)
    bag.write_sorted(parts, turns)
    return {topic: len(stamps) for topic, stamps, _ in parts}


def nothing_used(files: Sequence[FileAccount]) -> tuple[str, str, str]:
    """Return found, expected and remedy where no row can be used, or one alone."""
    received = sum(account.received for account in files)
    used = sum(account.accepted for account in files)
    names = ", ".join(str(account.path) for account in files)
    reasons = "; ".join(account.reasons for account in files if account.rejected)
    count = f"only {used}" if used else "none"
    found = (
        f"{count} of the {received} rows of {names} can be used ({reasons or NO_OTHERS[used > 0]})"
    )
    remedy = next(filter(None, (account.remedy for account in files)), "")
    if any(account.rejected[BAD_STAMP] for account in files):
        return found, "rows with times between 1970 and 2038", NO_TIMES
    if any(account.rejected["bad_time"] for account in files):
        expected = "times as numbers in time.unit, as ISO 8601 dates, or in time.format"
        return found, expected, remedy or NO_TIMES
    return found, "at least two rows of numbers", remedy
