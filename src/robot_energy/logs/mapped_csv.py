"""Import of any CSV log by a mapping of its columns."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from robot_energy.blocks import Float, MeterLocation, MeterMeaning
from robot_energy.logs.mapping import (
    CURRENT_UNITS,
    EFFORT_UNITS,
    POSITION_UNITS,
    TEMPERATURE_OFFSETS,
    VELOCITY_UNITS,
    VOLTAGE_UNITS,
    LogMapping,
    Power,
)
from robot_energy.logs.recording import ImportReport, LogBlock, RecordingContents, write_bag
from robot_energy.logs.table import Clock, LogTable, newer_than
from robot_energy.units import ENERGY_UNITS, POWER_UNITS


def import_csv(
    log: str | Path, mapping: LogMapping, out: str | Path, overwrite: bool = False
) -> ImportReport:
    """Turn a CSV log into a bag.

    Args:
        log: The file, plain or gzip, with a header.
        mapping: What its columns mean.
        out: Folder of the bag.
        overwrite: Whether an existing bag may be replaced.

    Returns:
        What was written, and the account of every row.

    Raises:
        LogFormatError: If the file cannot be read, lacks a column, or has no usable row.
        BagError: If the bag cannot be written.
    """
    table, contents, blocks = read_csv(log, mapping)
    joints = mapping.joints
    origin = ": ".join(text for text in (mapping.description, table.path.name) if text)
    report = write_bag(out, contents, blocks, [table.account], overwrite, origin)
    if joints.effort is not None:
        report.notes.append(
            f"the effort of /joint_states is the log's, in {joints.effort.unit.replace('_', ' ')}"
        )
    return report


def read_csv(
    log: str | Path, mapping: LogMapping
) -> tuple[LogTable, RecordingContents, Iterator[LogBlock]]:
    """Read a CSV log.

    Args:
        log: The file, plain or gzip, with a header.
        mapping: What its columns mean.

    Returns:
        The table with the account of its rows, what it holds, and its rows in blocks.

    Raises:
        LogFormatError: If the file cannot be read or lacks a column.
    """
    table = LogTable(log, mapping.delimiter)
    joints, power = mapping.joints, mapping.power
    if mapping.time.column is not None:
        table.require(mapping.time.column, "time.column")
    if mapping.time.run is not None:
        table.require(mapping.time.run, "time.run")
    groups: list[list[str]] = []
    for key in ("position", "velocity", "effort", "temperature", "drive_power"):
        names = joints.columns(getattr(joints, key))
        groups.append([table.require(name, f"joints.{key}") for name in names])
    groups.append([table.require(name, f"power.{key}") for key, name in _power_columns(power)])
    contents = RecordingContents(
        tuple(joints.names),
        joints.velocity is not None,
        joints.effort is not None,
        joints.temperature is not None,
        MeterMeaning[power.meaning.upper()] if power else MeterMeaning.UNKNOWN,
        MeterLocation[power.location.upper()] if power else MeterLocation.UNKNOWN,
        power.interval if power and power.interval else float("nan"),
        joints.drive_power is not None,
    )
    return table, contents, _blocks(table, mapping, groups)


def _power_columns(power: Power | None) -> list[tuple[str, str]]:
    if power is None:
        return []
    entries = {"reading": power.reading, "voltage": power.voltage, "current": power.current}
    return [(key, entry.column) for key, entry in entries.items() if entry is not None]


def _blocks(table: LogTable, mapping: LogMapping, groups: list[list[str]]) -> Iterator[LogBlock]:
    joints, time = mapping.joints, mapping.time
    n_joints = len(joints.names)
    cuts = np.cumsum([len(group) for group in groups])[:-1]
    columns = [name for group in groups for name in group]
    signs = np.asarray(joints.signs or [1] * n_joints, dtype=np.float64)
    scale = signs * POSITION_UNITS[joints.position.unit]
    speed = signs * (VELOCITY_UNITS[joints.velocity.unit] if joints.velocity else 1.0)
    effort = signs * (EFFORT_UNITS[joints.effort.unit] if joints.effort else 1.0)
    offset = TEMPERATURE_OFFSETS[joints.temperature.unit] if joints.temperature else 0.0
    watt = POWER_UNITS[joints.drive_power.unit] if joints.drive_power else 1.0
    last: int | None = None
    clock = Clock(time.column, time.unit, time.rate or float("nan"), time.run, time.apart)
    parts = table.blocks(columns, n_joints, clock)
    for rows in parts:
        kept, last = newer_than(rows, last, table.account, time.start_ns)
        position, velocity, torque, temperature, drives, meter = np.split(kept.values, cuts, axis=1)
        none = np.full((len(kept.time_ns), n_joints), np.nan)
        yield LogBlock(
            kept.time_ns + time.start_ns,
            position * scale,
            velocity * speed if joints.velocity else none,
            torque * effort if joints.effort else none,
            temperature + offset if joints.temperature else none,
            _reading(meter, mapping.power),
            drives * watt if joints.drive_power else none,
        )


def _reading(meter: Float, power: Power | None) -> Float:
    """Power or energy of every row. [W] or [J]"""
    if power is None:
        return np.full(len(meter), np.nan)
    if power.reading is not None:
        return meter[:, 0] * {**POWER_UNITS, **ENERGY_UNITS}[power.reading.unit]
    factor = 1.0
    if power.voltage is not None and power.current is not None:
        factor = VOLTAGE_UNITS[power.voltage.unit] * CURRENT_UNITS[power.current.unit]
    return meter[:, 0] * meter[:, 1] * factor
