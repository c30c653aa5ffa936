"""Import of UR RTDE recordings: the columns of the robot's real-time interface."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from robot_energy.blocks import Float, MeterLocation, MeterMeaning
from robot_energy.errors import LogFormatError
from robot_energy.logs.recording import ImportReport, LogBlock, RecordingContents, write_bag
from robot_energy.logs.table import Clock, LogTable, newer_than

UR_JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
AXES = range(len(UR_JOINTS))
POSITION = [f"actual_q_{axis}" for axis in AXES]  # rad
VELOCITY = [f"actual_qd_{axis}" for axis in AXES]  # rad/s
CURRENT = [f"actual_current_{axis}" for axis in AXES]  # A
TEMPERATURE = [f"joint_temperatures_{axis}" for axis in AXES]  # degC
SUPPLY = ["actual_robot_voltage", "actual_robot_current"]  # V, A, on the 48 V bus
CLOCK = "timestamp"
WALLS = ("time", "_id")  # recorders differ in where they note the wall clock
WALL_FORMATS = ("%Y:%m:%d:%H:%M:%S.%f", "%Y-%m-%dT%H:%M:%S.%f", "%Y-%m-%d %H:%M:%S.%f")
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def import_ur_rtde(
    logs: Sequence[str | Path],
    out: str | Path,
    joint_names: Sequence[str] = UR_JOINTS,
    overwrite: bool = False,
) -> ImportReport:
    """Turn UR RTDE recordings (CSV) into one bag.

    Positions and velocities become ``/joint_states`` with the motor currents [A] as its
    effort, joint temperatures ``/motor_temperatures``, and robot voltage times current
    ``/power_meter``: instantaneous, on the DC bus. Stamps follow the controller's clock
    ``timestamp``; where ``time`` or ``_id`` holds a wall clock, its first entry says when
    the recording started, taken as UTC.

    Args:
        logs: Files of one recording, joined in the order of their time.
        out: Folder of the bag.
        joint_names: Names of the six joints from the base on.
        overwrite: Whether an existing bag may be replaced.

    Returns:
        What was written, and the account of every row.

    Raises:
        LogFormatError: If a file cannot be read, lacks a column, or has no usable row.
        BagError: If the bag cannot be written.
    """
    names = tuple(joint_names)
    if len(names) != len(UR_JOINTS) or len(set(names)) != len(names):
        raise LogFormatError(f"the joint names {', '.join(names)}", "six different names")
    tables = [LogTable(path) for path in logs]
    if not tables:
        raise LogFormatError("no log is named", "at least one file")
    for table in tables:
        for column in (CLOCK, *POSITION):
            table.require(column, "a UR RTDE recording")
    tables.sort(key=_first_time)
    offset_ns, note = _offset(tables[0])
    have = [_present(tables, group) for group in (VELOCITY, CURRENT, TEMPERATURE, SUPPLY)]
    velocity, effort, temperatures, supply = have
    contents = RecordingContents(
        names,
        velocity,
        effort,
        temperatures,
        MeterMeaning.INSTANTANEOUS if supply else MeterMeaning.UNKNOWN,
        MeterLocation.DC_BUS if supply else MeterLocation.UNKNOWN,
    )
    accounts = [table.account for table in tables]
    origin = f"UR RTDE recording: {', '.join(table.path.name for table in tables)}"
    report = write_bag(out, contents, _blocks(tables, offset_ns), accounts, overwrite, origin)
    report.notes.append(note)
    if effort:
        report.notes.append("the effort of /joint_states is the motor current [A]")
    for present, what in zip(
        have,
        ("velocities", "motor currents", "joint temperatures", "supply voltage and current"),
        strict=True,
    ):
        if not present:
            report.notes.append(f"the recording has no {what}")
    return report


def _present(tables: list[LogTable], group: list[str]) -> bool:
    return any(set(group) <= set(table.columns) for table in tables)


def _first_time(table: LogTable) -> float:
    try:
        return float(table.first([CLOCK])[0])
    except ValueError:
        return float("inf")


def _offset(table: LogTable) -> tuple[int, str]:
    """What to add to the controller's clock. [ns]"""
    for column in WALLS:
        if column not in table.columns:
            continue
        wall, clock = table.first([column, CLOCK])
        start = _instant(wall)
        if start is not None:
            elapsed = start - EPOCH
            start_ns = (elapsed.days * 86400 + elapsed.seconds) * 10**9
            start_ns += elapsed.microseconds * 1000
            text = start.isoformat(timespec="milliseconds").removesuffix("+00:00")
            return start_ns - round(float(clock) * 1e9), (
                f"stamps are the controller's clock, set to {text} at the first row; "
                f"the column '{column}' is taken as UTC"
            )
    return 0, "stamps are the controller's own clock (time since it was started)"


def _instant(text: str) -> datetime | None:
    for form in WALL_FORMATS:
        try:
            return datetime.strptime(text.strip(), form).replace(tzinfo=UTC)
        except ValueError:
            continue
    return None


def _blocks(tables: list[LogTable], offset_ns: int) -> Iterator[LogBlock]:
    last: int | None = None
    for table in tables:
        groups = [
            POSITION,
            *(
                group if set(group) <= set(table.columns) else []
                for group in (VELOCITY, CURRENT, TEMPERATURE, SUPPLY)
            ),
        ]
        cuts = np.cumsum([len(group) for group in groups])[:-1]
        columns = [table.require(name) for group in groups for name in group]
        for rows in table.blocks(columns, len(POSITION), Clock(CLOCK)):
            kept, last = newer_than(rows, last, table.account, offset_ns)
            position, velocity, current, temperature, supply = (
                _filled(part) for part in np.split(kept.values, cuts, axis=1)
            )
            yield LogBlock(
                kept.time_ns + offset_ns,
                position,
                velocity,
                current,
                temperature,
                supply[:, 0] * supply[:, 1],
                np.full_like(position, np.nan),
            )


def _filled(part: Float) -> Float:
    """The columns of a group, or NaN where the file lacks them."""
    return part if part.shape[1] else np.full((len(part), len(UR_JOINTS)), np.nan)
