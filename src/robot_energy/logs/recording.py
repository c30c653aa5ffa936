"""What a log holds, in blocks, and the bag that it becomes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from robot_energy.bag import SENSOR_QOS, BagWriter
from robot_energy.blocks import Block, Float, Int, MeterLocation, MeterMeaning
from robot_energy.cdr import Encoder, stamp_columns
from robot_energy.errors import LogFormatError
from robot_energy.inputs.joint_states.joint_states import JOINT_STATE
from robot_energy.inputs.meter.kinds import POWER_READING
from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.inputs.temperatures.kinds import FLOAT_ARRAY, MOTOR_TEMPERATURES
from robot_energy.timeline.stamps import BAD_STAMP, MIN_STAMP_NS

JOINT_STATES_TOPIC = "/joint_states"
TEMPERATURES_TOPIC = "/motor_temperatures"
METER_TOPIC = "/power_meter"
DRIVE_POWER_TOPIC = "/drive_power"
NO_TIMES = (
    "check the unit of time, and give the start of the recording where its times count from zero"
)
INTERLEAVED_ROWS = 16  # replay waits only a little for temperatures that come late


@dataclass(frozen=True)
class LogBlock(Block):
    """Rows of a log in SI units; NaN where the log says nothing.

    Attributes:
        joint_position: Joint side, shape (N, n). [rad] or [m]
        joint_velocity: Joint side, shape (N, n). [rad/s] or [m/s]
        effort: As the log has it: torque or motor current, shape (N, n). [N m] or [A]
        motor_temperature_degc: Shape (N, n). [degC]
        reading: Power or, of a counter, energy, shape (N,). [W] or [J]
        drive_power: Electrical input of each drive, shape (N, n). [W]
    """

    joint_position: Float
    joint_velocity: Float
    effort: Float
    motor_temperature_degc: Float
    reading: Float
    drive_power: Float


@dataclass(frozen=True)
class RecordingContents:
    """What the bag of a log holds beside positions.

    Attributes:
        joint_names: Joints, in the order of the arrays.
        velocity: Whether the log has velocities.
        effort: Whether it has efforts.
        temperatures: Whether it has motor temperatures.
        meaning: What a meter reading stands for; UNKNOWN: there is no meter.
        location: Where the meter sits.
        interval: Length of a mean's interval; NaN for other meanings. [s]
        drive_power: Whether it has the electrical power of each drive.
    """

    joint_names: tuple[str, ...]
    velocity: bool
    effort: bool
    temperatures: bool
    meaning: MeterMeaning = MeterMeaning.UNKNOWN
    location: MeterLocation = MeterLocation.UNKNOWN
    interval: float = float("nan")
    drive_power: bool = False


@dataclass
class FileAccount(RejectionLog):
    """What became of the rows of one file: received = accepted + rejected.

    Attributes:
        path: The file.
        first_line: Line number of the first row rejected for each reason.
    """

    path: Path = Path()
    first_line: dict[str, int] = field(default_factory=dict[str, int])

    def reject_lines(self, reason: str, lines: Int) -> None:
        """Count rejected rows and remember where the first one stands.

        Args:
            reason: Why they are rejected.
            lines: Where they stand in the file, rising, shape (N,).
        """
        if len(lines):
            self.first_line.setdefault(reason, int(lines[0]))
        self.reject(reason, len(lines))

    @property
    def reasons(self) -> str:
        """Count and first place of every reason for which rows were rejected."""
        return "; ".join(
            f"{count} {reason} from line {self.first_line[reason]} of {self.path.name}"
            for reason, count in self.rejected.items()
        )


@dataclass
class ImportReport:
    """What an import wrote.

    Attributes:
        bag: The bag.
        contents: Joints and quantities in it.
        files: Account of the rows of every file, in time order.
        start_ns: First stamp. [ns]
        end_ns: Last stamp. [ns]
        joint_states: Messages written.
        temperatures: Messages written; rows without any temperature give none.
        readings: Meter readings written; rows without one give none.
        drive_powers: Messages written, stamped by their log time alone; rows without any
            power of a drive give none.
        notes: What a reader of the bag should know, one sentence each.
    """

    bag: Path
    contents: RecordingContents
    files: list[FileAccount] = field(default_factory=list[FileAccount])
    start_ns: int | None = None
    end_ns: int | None = None
    joint_states: int = 0
    temperatures: int = 0
    readings: int = 0
    drive_powers: int = 0
    notes: list[str] = field(default_factory=list[str])


class _Encoders:
    def __init__(self, contents: RecordingContents) -> None:
        n_joints = len(contents.joint_names)
        self.contents = contents
        lengths = {
            "position": n_joints,
            "velocity": n_joints if contents.velocity else 0,
            "effort": n_joints if contents.effort else 0,
        }
        self.joint_states = Encoder(JOINT_STATE, {"name": contents.joint_names}, lengths)
        self.temperatures = Encoder(
            MOTOR_TEMPERATURES,
            {"joint_names": contents.joint_names},
            {"temperature_degc": n_joints},
        )
        self.readings = Encoder(
            POWER_READING,
            {
                "meaning": int(contents.meaning),
                "location": int(contents.location),
                "interval": contents.interval,
            },
        )
        self.drive_power = Encoder(FLOAT_ARRAY, lengths={"layout.dim": 0, "data": n_joints})

    def write(self, bag: BagWriter, block: LogBlock, report: ImportReport) -> None:
        """Write all topics, interleaved as a recorder would."""
        contents, none = self.contents, np.empty((len(block), 0))
        rows = self.joint_states.encode(
            {
                **stamp_columns(block.stamp_ns),
                "position": block.joint_position,
                "velocity": block.joint_velocity if contents.velocity else none,
                "effort": block.effort if contents.effort else none,
            },
            len(block),
        )
        given = np.isfinite(block.motor_temperature_degc).any(axis=1)
        warm = np.asarray(given & contents.temperatures)
        warm_rows = self.temperatures.encode(
            {
                **stamp_columns(block.stamp_ns),
                "temperature_degc": block.motor_temperature_degc,
            },
            len(block),
        )
        has_meter = contents.meaning is not MeterMeaning.UNKNOWN
        metered = np.asarray(np.isfinite(block.reading) & has_meter)
        nothing = np.full(len(block), np.nan)
        counter = contents.meaning is MeterMeaning.CUMULATIVE
        metered_rows = self.readings.encode(
            {
                **stamp_columns(block.stamp_ns),
                "power": nothing if counter else block.reading,
                "energy": block.reading if counter else nothing,
            },
            len(block),
        )
        every = np.ones(len(block), dtype=np.bool_)
        driven = np.asarray(np.isfinite(block.drive_power).any(axis=1) & contents.drive_power)
        flat = np.empty((len(block), 0), dtype=np.uint32)  # one row of values needs no layout
        driven_rows = self.drive_power.encode(
            {
                "layout.dim.size": flat,
                "layout.dim.stride": flat,
                "layout.data_offset": 0,
                "data": block.drive_power,
            },
            len(block),
        )
        streams = (
            (TEMPERATURES_TOPIC, warm, warm_rows),
            (METER_TOPIC, metered, metered_rows),
            (DRIVE_POWER_TOPIC, driven, driven_rows),
            (JOINT_STATES_TOPIC, every, rows),
        )
        for start in range(0, len(block), INTERLEAVED_ROWS):
            piece = slice(start, start + INTERLEAVED_ROWS)
            for topic, chosen, messages in streams:
                if chosen[piece].any():
                    stamps = block.stamp_ns[piece][chosen[piece]]
                    bag.write(topic, stamps, messages[piece][chosen[piece]])
        report.joint_states += len(block)
        report.temperatures += int(warm.sum())
        report.readings += int(metered.sum())
        report.drive_powers += int(driven.sum())


def write_bag(
    path: str | Path,
    contents: RecordingContents,
    blocks: Iterable[LogBlock],
    files: list[FileAccount],
    overwrite: bool = False,
    origin: str = "",
) -> ImportReport:
    """Write blocks of a log into a new bag; nothing is left behind if that fails.

    Args:
        path: Folder of the bag.
        contents: What the log holds.
        blocks: Its rows in time order.
        files: The accounts that ``blocks`` fills while it is read.
        overwrite: Whether an existing bag may be replaced.
        origin: Where the recording comes from, in words, noted with the bag.

    Returns:
        What was written.

    Raises:
        LogFormatError: If no row can be used, or a row cannot be read.
        BagError: If the bag cannot be written.
    """
    report = ImportReport(Path(path), contents, files)
    encoders = _Encoders(contents)
    inputs = [file.path for file in files]
    with BagWriter(path, overwrite=overwrite, origin=origin, inputs=inputs) as bag:
        bag.add_topic(JOINT_STATES_TOPIC, JOINT_STATE, SENSOR_QOS)
        if contents.temperatures:
            bag.add_topic(TEMPERATURES_TOPIC, MOTOR_TEMPERATURES)
        if contents.meaning is not MeterMeaning.UNKNOWN:
            bag.add_topic(METER_TOPIC, POWER_READING)
        if contents.drive_power:
            bag.add_topic(DRIVE_POWER_TOPIC, FLOAT_ARRAY)
        for block in blocks:
            if not len(block):
                continue
            if report.start_ns is None:
                report.start_ns = int(block.stamp_ns[0])
            report.end_ns = int(block.stamp_ns[-1])
            _check_start(report.start_ns, files)
            encoders.write(bag, block, report)
        if report.start_ns is None:
            raise LogFormatError(*nothing_used(files))
    if not report.readings and contents.meaning is not MeterMeaning.UNKNOWN:
        report.notes.append("no row has a meter reading")
    if not report.temperatures and contents.temperatures:
        report.notes.append("no row has a motor temperature")
    return report


def _check_start(start_ns: int, files: Sequence[FileAccount]) -> None:
    if start_ns <= MIN_STAMP_NS:
        raise LogFormatError(
            f"the stamps of {files[0].path} begin at zero", "times between 1970 and 2038", NO_TIMES
        )


def nothing_used(files: Sequence[FileAccount]) -> tuple[str, str, str]:
    """Return found, expected and remedy where no row can be used.

    Args:
        files: Accounts of the rows of all files.
    """
    received = sum(account.received for account in files)
    names = ", ".join(str(account.path) for account in files)
    reasons = "; ".join(account.reasons for account in files if account.rejected)
    found = f"none of the {received} rows of {names} can be used ({reasons or 'there are none'})"
    if any(account.rejected[BAD_STAMP] for account in files):
        return found, "rows with times between 1970 and 2038", NO_TIMES
    return found, "rows of numbers", ""
