"""Mapping of a log: which column means what, in which unit. Validated by pydantic.

One form serves every table: CSV, gzip and Parquet, whether it becomes a bag or is
identified from directly. Examples: ``src/examples/mappings`` and ``src/examples/identify``.
"""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import numpy as np
from pydantic import Field, model_validator

from robot_energy.foundation.config_file import parse_yaml, read_text, validated
from robot_energy.foundation.described import documented
from robot_energy.foundation.errors import LogFormatError
from robot_energy.foundation.time_zone import MAX_NAME, time_zone
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy_logs.columns import (
    Joints,
    MappingEntry,
    Names,
    Number,
    PayloadColumns,
    Power,
    Text,
)

PLACE = "{recording}"  # in the name of a file: the name of a recording
LATEST_NS = 2**62  # from 1970 on, either way: sums with times of the log stay within 64 bits
MAX_FORMAT, MAX_SKIPPED = 100, 1_000_000
MADE_UP_DATE = datetime(2000, 1, 1, tzinfo=UTC)  # of rows that are counted at a rate
DIGITS = {"s": 9, "ms": 6, "us": 3, "ns": 0}  # after the decimal sign, down to nanoseconds
Name = Annotated[str, Field(pattern=r"^[\w.-]+$")]


class Time(MappingEntry):
    """When each row was measured: a column, or a rate where there is none.

    Attributes:
        unit: Its unit; a column of dates needs none. ``excel_day``: days as Excel counts them.
        format: Of dates that are not ISO 8601, in the words of ``strptime``, such as
            ``%d.%m.%Y %H:%M:%S.%f``; without a day it is the time since midnight.
        zone: Time zone of dates that state none, such as ``Europe/Berlin``; None: UTC.
        rate: Rows per second, where the log has no time. [Hz]
        start: Added to every time; needed where times count from zero. If it states no zone, it
            is of ``zone``. With a rate the default is 2000-01-01.
        run: Column whose change begins another run, where each run counts from zero.
        each_file_is_a_run: Whether each file counts from its own zero, as after a restart of
            the controller; its files are then taken in the order in which they are named.
        apart: How long after the end of a run the next one is set. [s]
    """

    column: Text | None = None
    unit: Literal["s", "ms", "us", "ns", "excel_day"] = "s"
    format: Annotated[str, Field(min_length=2, max_length=MAX_FORMAT)] | None = None
    zone: Annotated[str, Field(max_length=MAX_NAME)] | None = None
    rate: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    start: datetime | None = None
    run: Text | None = None
    each_file_is_a_run: bool = False
    apart: Annotated[float, Field(gt=1, allow_inf_nan=False)] = 10.0

    @model_validator(mode="after")
    def _check(self) -> Time:
        if (self.column is None) == (self.rate is None):
            raise ValueError("either column or rate, not both")
        if self.zone is not None:
            time_zone(self.zone)
        if self.format is not None:
            _check_format(self.format)
        if abs(self.start_ns) > LATEST_NS:
            raise ValueError(f"a start within the years 1824 to 2116, found {self.start}")
        return self

    @property
    def start_ns(self) -> int:
        """The start, 0 where times have a date. [ns]"""
        start = self.start or (None if self.rate is None else MADE_UP_DATE)
        if start is not None and start.tzinfo is None and self.zone is not None:
            start = start.replace(tzinfo=time_zone(self.zone))
        return 0 if start is None else since_1970(start)


def since_1970(instant: datetime) -> int:
    """Return the nanoseconds from 1970 to an instant."""
    instant = instant if instant.tzinfo else instant.replace(tzinfo=UTC)
    elapsed = instant - datetime(1970, 1, 1, tzinfo=UTC)
    return (elapsed.days * 86400 + elapsed.seconds) * 10**9 + elapsed.microseconds * 1000


def _check_format(form: str) -> None:
    date = datetime(2026, 1, 31, 12, 30, 15, 250_000, tzinfo=UTC)
    try:
        datetime.strptime(date.strftime(form), form)
        good = "%" in form
    except (ValueError, re.error):
        good = False
    if not good:
        raise ValueError(f"a format such as '%d.%m.%Y %H:%M:%S.%f', found '{form}'")


class CouplingEntry(MappingEntry):
    """A motor that turns along with another joint, as in a model file."""

    motor: Text
    joint: Text
    ratio: Number


@documented
class LogRobot(MappingEntry):
    """The robot, where there is no model file of it."""

    urdf: Annotated[Text, "Kinematics and bodies, in the folder of data or mapping."]
    gear_ratio: Annotated[list[Number], "Motor turns per joint turn; the sign is the sense."]
    coupling: Annotated[tuple[CouplingEntry, ...], "Motors that turn along with other joints."] = ()


@documented
class ReferenceFriction(MappingEntry):
    """Published friction, to be printed next to the fit, joint side."""

    viscous: Annotated[list[Number], "Torque of each joint per its own velocity. [N m s/rad]"]
    coulomb: Annotated[list[Number], "[N m]"]
    source: str = ""


class LogMapping(MappingEntry):
    """What the columns of a log mean.

    Attributes:
        delimiter: Between cells of a text; None: taken from its first line.
        encoding: Of a text; None: UTF-8, UTF-16 or Windows-1252, whichever it is.
        comment: What lines begin with that are left out; None: ``#``.
        skip_rows: Lines before the header, or before the rows, that are left out.
        column_names: Of all columns of the log, if it has no header.
        recordings: Names of several recordings, in files of their own.
    """

    schema_version: Literal[1]
    description: str = ""
    delimiter: Annotated[str, Field(min_length=1, max_length=1)] | None = None
    decimal: Literal[".", ","] = "."
    encoding: Annotated[str, Field(min_length=1, max_length=MAX_NAME)] | None = None
    comment: Annotated[str, Field(min_length=1, max_length=MAX_NAME)] | None = None
    skip_rows: Annotated[int, Field(ge=0, le=MAX_SKIPPED)] = 0
    column_names: Names | None = None
    recordings: Annotated[list[Name], Field(min_length=1)] | None = None
    time: Time
    joints: Joints
    power: Power | None = None
    payload: PayloadColumns | None = None
    robot: LogRobot | None = None
    reference: ReferenceFriction | None = None

    @model_validator(mode="after")
    def _check(self) -> LogMapping:
        if self.encoding is not None:
            try:
                io.TextIOWrapper(io.BytesIO(), encoding=self.encoding)
            except (LookupError, ValueError):
                expected = f"an encoding such as cp1252 or utf-16, found '{self.encoding}'"
                raise ValueError(expected) from None
        names = self.joints.names
        lists: dict[str, list[float]] = {}
        if self.robot is not None:
            lists["robot.gear_ratio"] = self.robot.gear_ratio
            for entry in self.robot.coupling:
                if unknown := {entry.motor, entry.joint} - set(names):
                    raise ValueError(f"coupling of joints of the log, found {min(unknown)}")
        if self.reference is not None:
            lists["reference.viscous"] = self.reference.viscous
            lists["reference.coulomb"] = self.reference.coulomb
        for key, values in lists.items():
            if len(values) != len(names):
                raise ValueError(
                    f"{len(names)} entries of {key}, as many as joints; found {len(values)}"
                )
        files = [group.file for _, group in self.joints.quantities() if group.file]
        several = self.recordings is not None
        if any(several != (PLACE in file) for file in files) or (several and not self.in_folder):
            raise ValueError(
                f"recordings (or --recordings) together with {PLACE} in every file name, or neither"
            )
        if self.recordings is not None and len(set(self.recordings)) < len(self.recordings):
            raise ValueError("every name of recordings once")
        return self

    @property
    def in_folder(self) -> bool:
        """Whether the mapping names the files itself, and the log is their folder."""
        return self.joints.first.file is not None

    @property
    def in_runs(self) -> bool:
        """Whether rows are set one run after the other, since each counts its own time."""
        return self.time.run is not None or self.time.each_file_is_a_run

    @property
    def files(self) -> list[str]:
        """All files that the mapping names, those of the first quantity first, each once."""
        groups = [group.file for _, group in self.joints.quantities() if group.file]
        names = self.recordings or [""]
        return list(dict.fromkeys(f.replace(PLACE, name) for name in names for f in groups))

    def drivetrain(self) -> Drivetrain:
        """Return what ``robot`` says of gears and coupling."""
        if self.robot is None:
            raise LogFormatError(
                "positions or velocities of motors, and no gear ratios",
                "robot.gear_ratio in the mapping, or a model file (--model)",
            )
        names, matrix = self.joints.names, np.diag(self.robot.gear_ratio)
        for entry in self.robot.coupling:
            matrix[names.index(entry.motor), names.index(entry.joint)] += entry.ratio
        return Drivetrain(matrix, np.zeros(len(names)))


def load_mapping(path: str | Path, recordings: Sequence[str] = ()) -> LogMapping:
    """Return the validated mapping of a log."""
    remedy = "see src/examples/mappings and src/examples/identify"
    text = read_text(path, LogFormatError, "mapping", remedy=remedy)
    data = parse_yaml(text, str(path), LogFormatError)
    if recordings and isinstance(data, dict):
        data = {**cast("dict[str, Any]", data), "recordings": list(recordings)}
    return validated(data, LogMapping, str(path), LogFormatError)
