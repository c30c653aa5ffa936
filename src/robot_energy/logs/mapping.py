"""Mapping of a log: which column means what, in which unit. Validated by pydantic.

One form serves every table: CSV, gzip and Parquet, whether it becomes a bag or is identified
from directly. Examples: ``src/examples/mappings`` and ``src/examples/identify``.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from robot_energy.config_file import parse_yaml, read_text, validated
from robot_energy.errors import LogFormatError
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.units import ENERGY_UNITS, POWER_UNITS

PLACEHOLDER = "{joint}"
PLACE = "{recording}"  # in the name of a file: the name of a recording
LATEST_NS = 2**62  # from 1970 on, either way: sums with times of the log stay within 64 bits
MADE_UP_DATE = datetime(2000, 1, 1, tzinfo=UTC)  # of rows that are counted at a rate
DEGREE = 0.017453292519943295  # rad
FACTORS = {
    **{"rad": 1.0, "deg": DEGREE, "m": 1.0, "mm": 1e-3},
    **{"rad_per_s": 1.0, "deg_per_s": DEGREE, "m_per_s": 1.0, "mm_per_s": 1e-3},
    **{"newton_metre": 1.0, "newton": 1.0, "ampere": 1.0, "milliampere": 1e-3},
    **{"celsius": 1.0, "kelvin": 1.0, "V": 1.0, "mV": 1e-3, "A": 1.0, "mA": 1e-3},
    **POWER_UNITS,
    **ENERGY_UNITS,
}
"""What one of each unit is in SI or, of temperatures, in degC apart from their zero."""
ZEROS = {"kelvin": -273.15}  # degC

Text = Annotated[str, Field(min_length=1)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Name = Annotated[str, Field(pattern=r"^[\w.-]+$")]
Names = Annotated[list[Text], Field(min_length=1)]
Side = Literal["motor", "joint"]


class MappingEntry(BaseModel):
    """Base of all parts: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Time(MappingEntry):
    """When each row was measured: a column, or a rate where there is none.

    Attributes:
        column: Column of the time.
        unit: Its unit; a column of dates needs none.
        rate: Rows per second, where the log has no time. [Hz]
        start: Added to every time; needed where times count from zero. Without zone: UTC.
            With a rate the default is 2000-01-01.
        run: Column whose change begins another run, where each run counts from zero.
        apart: How long after the end of a run the next one is set. [s]
    """

    column: Text | None = None
    unit: Literal["s", "ms", "us", "ns"] = "s"
    rate: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    start: datetime | None = None
    run: Text | None = None
    apart: Annotated[float, Field(gt=1, allow_inf_nan=False)] = 10.0

    @model_validator(mode="after")
    def _check(self) -> Time:
        if (self.column is None) == (self.rate is None):
            raise ValueError("either column or rate, not both")
        if abs(self.start_ns) > LATEST_NS:
            raise ValueError(f"a start within the years 1824 to 2116, found {self.start}")
        return self

    @property
    def start_ns(self) -> int:
        """The start, 0 where times have a date. [ns]"""
        start = self.start or (None if self.rate is None else MADE_UP_DATE)
        return 0 if start is None else since_1970(start)


def since_1970(instant: datetime) -> int:
    """Return the nanoseconds from 1970 to an instant.

    Args:
        instant: Without zone it is UTC.
    """
    instant = instant if instant.tzinfo else instant.replace(tzinfo=UTC)
    elapsed = instant - datetime(1970, 1, 1, tzinfo=UTC)
    return (elapsed.days * 86400 + elapsed.seconds) * 10**9 + elapsed.microseconds * 1000


class Columns(MappingEntry):
    """Columns of one quantity of every joint.

    Attributes:
        column: Pattern in which ``{joint}`` stands for the joint's key.
        columns: One column per joint, in their order.
        file: Another file with as many rows, beside the log; ``{recording}`` stands for the
            name of each recording. Without column and columns: its first columns.
        column_names: Of all columns of that file, if it has no header.
        unit: Of the columns; each quantity narrows it to its own.
    """

    unit: Any
    column: Text | None = None
    columns: Names | None = None
    file: Text | None = None
    column_names: Names | None = None

    @model_validator(mode="after")
    def _check(self) -> Columns:
        if self.column is not None and self.columns is not None:
            raise ValueError("either column or columns, not both")
        if self.column is None and self.columns is None and self.file is None:
            raise ValueError("either column or columns, or the file whose first columns they are")
        if self.column is not None and PLACEHOLDER not in self.column:
            raise ValueError(f"a pattern with {PLACEHOLDER}, found '{self.column}'")
        if self.column_names is not None and self.file is None:
            raise ValueError("column_names at the top of the mapping, or together with file")
        return self

    def names(self, keys: list[str]) -> list[str] | None:
        """Return the column of every joint; None for the first columns of the file.

        Args:
            keys: What stands for ``{joint}`` in a pattern, one per joint.
        """
        if self.column is None:
            return self.columns
        return [self.column.replace(PLACEHOLDER, key) for key in keys]


class PositionColumn(Columns):
    """Positions of the joints, or of the motors.

    Attributes:
        unit: Of the column.
        side: Whether joints or motors were measured; motors need ``robot`` or a model.
        zero: Position of each joint in the URDF where the log says 0. [rad] or [m]
    """

    unit: Literal["rad", "deg", "m", "mm"]
    side: Side = "joint"
    zero: list[Number] | None = None


class Velocity(Columns):
    """Velocities of the joints, or of the motors."""

    unit: Literal["rad_per_s", "deg_per_s", "m_per_s", "mm_per_s"]
    side: Side = "joint"


class EffortColumns(Columns):
    """Torque or current; a bag keeps it, and ``effort`` tells the monitor what it means.

    Attributes:
        unit: Of the column.
        side: Whether joints or motors were measured; ``identify dynamics --log`` needs it.
        torque_constant: Per motor; turns currents into torques. [N m/A]
    """

    unit: Literal["newton_metre", "newton", "ampere", "milliampere"]
    side: Side | None = None
    torque_constant: list[Number] | None = None

    @model_validator(mode="after")
    def _check_current(self) -> EffortColumns:
        if self.torque_constant is not None and (not self.is_current or self.side == "joint"):
            raise ValueError("torque_constant for ampere or milliampere of motors, and only there")
        return self

    @property
    def is_current(self) -> bool:
        """Whether the column is a current."""
        return self.unit.endswith("ampere")

    @property
    def si_unit(self) -> str:
        """Unit of what is made of it: ``newton_metre``, ``newton`` or ``ampere``."""
        if self.torque_constant is not None:
            return "newton_metre"
        return "ampere" if self.is_current else self.unit


class TemperatureColumns(Columns):
    """Motor temperatures."""

    unit: Literal["celsius", "kelvin"]


class DrivePowerColumns(Columns):
    """Electrical power that each drive takes, positive into the drive."""

    unit: Literal["W", "kW", "mW"]


class Joints(MappingEntry):
    """The joints and their columns.

    Attributes:
        names: As in the model file, from the base on.
        keys: What stands for ``{joint}`` in patterns; default the names.
        signs: 1 or -1 per joint, where the log counts the other way than the URDF.
    """

    names: Names
    keys: list[Text] | None = None
    signs: list[Literal[1, -1]] | None = None
    position: PositionColumn
    velocity: Velocity | None = None
    effort: EffortColumns | None = None
    temperature: TemperatureColumns | None = None
    drive_power: DrivePowerColumns | None = None

    @model_validator(mode="after")
    def _check(self) -> Joints:
        if len(set(self.names)) != len(self.names):
            raise ValueError("each joint name once")
        lists: dict[str, list[Any] | None] = {"keys": self.keys, "signs": self.signs}
        for name, group in self.quantities():
            lists[f"columns for {name}"] = group.columns
        lists["zero for position"] = self.position.zero
        if self.effort is not None:
            lists["torque_constant for effort"] = self.effort.torque_constant
        for what, entries in lists.items():
            if entries is not None and len(entries) != len(self.names):
                raise ValueError(
                    f"as many {what} as names: {len(self.names)}, found {len(entries)}"
                )
        return self

    def quantities(self) -> Iterator[tuple[str, Columns]]:
        """Yield key and columns of every quantity that the log has."""
        for name in ("position", "velocity", "effort", "temperature", "drive_power"):
            if (group := getattr(self, name)) is not None:
                yield name, group


class PowerColumn(MappingEntry):
    """Measured power or energy in one column."""

    column: Text
    unit: Literal["W", "kW", "mW", "J", "kJ", "Wh", "kWh"]


class VoltageColumn(MappingEntry):
    """Measured voltage."""

    column: Text
    unit: Literal["V", "mV"]


class CurrentColumn(MappingEntry):
    """Measured current."""

    column: Text
    unit: Literal["A", "mA"]


class Power(MappingEntry):
    """The power meter: one column, or voltage and current of a DC supply.

    Attributes:
        location: Where the meter sits: ``grid`` or ``dc_bus``.
        meaning: ``instantaneous``, ``mean_over_interval`` or ``cumulative`` (energy).
        interval: Length of the interval that ends at each row, for a mean. [s]
    """

    location: Literal["grid", "dc_bus"]
    meaning: Literal["instantaneous", "mean_over_interval", "cumulative"]
    interval: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    reading: PowerColumn | None = None
    voltage: VoltageColumn | None = None
    current: CurrentColumn | None = None

    @model_validator(mode="after")
    def _check(self) -> Power:
        pair = [self.voltage is not None, self.current is not None]
        if (self.reading is not None) == any(pair) or any(pair) != all(pair):
            raise ValueError("either reading, or both voltage and current")
        if (self.meaning == "mean_over_interval") != (self.interval is not None):
            raise ValueError("interval for mean_over_interval, and only for it")
        energy = self.reading is not None and self.reading.unit in ENERGY_UNITS
        if energy != (self.meaning == "cumulative"):
            raise ValueError("an energy unit (J, kJ, Wh, kWh) for cumulative, and only for it")
        return self

    def factors(self) -> dict[str, tuple[str, float]]:
        """Return column and factor to SI of all whose product is the reading, by key."""
        entries = {"reading": self.reading, "voltage": self.voltage, "current": self.current}
        return {
            key: (entry.column, FACTORS[entry.unit])
            for key, entry in entries.items()
            if entry is not None
        }


class CouplingEntry(MappingEntry):
    """A motor that turns along with another joint, as in a model file."""

    motor: Text
    joint: Text
    ratio: Number


class LogRobot(MappingEntry):
    """The robot, where there is no model file of it.

    Attributes:
        urdf: File with kinematics and bodies, in the folder of the data or of the mapping.
        gear_ratio: Motor turns per joint turn; the sign is the sense.
        coupling: Motors that turn along with other joints.
    """

    urdf: Text
    gear_ratio: list[Number]
    coupling: tuple[CouplingEntry, ...] = ()


class ReferenceFriction(MappingEntry):
    """Published friction, to be printed beside the fit, joint side.

    Attributes:
        viscous: Torque of each joint per its own velocity. [N m s/rad]
        coulomb: [N m]
        source: Where it comes from.
    """

    viscous: list[Number]
    coulomb: list[Number]
    source: str = ""


class LogMapping(MappingEntry):
    """What the columns of a log mean.

    Attributes:
        delimiter: Between cells of a text; None: taken from its first line.
        column_names: Of all columns of the log, if it has no header.
        recordings: Names of several recordings, in files of their own.
    """

    schema_version: Literal[1]
    description: str = ""
    delimiter: Annotated[str, Field(min_length=1, max_length=1)] | None = None
    column_names: Names | None = None
    recordings: Annotated[list[Name], Field(min_length=1)] | None = None
    time: Time
    joints: Joints
    power: Power | None = None
    robot: LogRobot | None = None
    reference: ReferenceFriction | None = None

    @model_validator(mode="after")
    def _check(self) -> LogMapping:
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
            raise ValueError(f"recordings together with {PLACE} in every file name, or neither")
        if self.recordings is not None and len(set(self.recordings)) < len(self.recordings):
            raise ValueError("every name of recordings once")
        return self

    @property
    def in_folder(self) -> bool:
        """Whether the mapping names the files itself, and the log is their folder."""
        return self.joints.position.file is not None

    @property
    def files(self) -> list[str]:
        """All files that the mapping names, positions first, each once."""
        groups = [group.file for _, group in self.joints.quantities() if group.file]
        names = self.recordings or [""]
        return list(dict.fromkeys(f.replace(PLACE, name) for name in names for f in groups))

    def drivetrain(self) -> Drivetrain:
        """Return what ``robot`` says of gears and coupling.

        Raises:
            LogFormatError: If there is no such entry.
            ModelFileError: If motors cannot move the joints independently.
        """
        if self.robot is None:
            raise LogFormatError(
                "positions or velocities of motors, and no gear ratios",
                "robot.gear_ratio in the mapping, or a model file (--model)",
            )
        names, matrix = self.joints.names, np.diag(self.robot.gear_ratio)
        for entry in self.robot.coupling:
            matrix[names.index(entry.motor), names.index(entry.joint)] += entry.ratio
        return Drivetrain(matrix, np.zeros(len(names)))


def load_mapping(path: str | Path) -> LogMapping:
    """Load the mapping of a log.

    Args:
        path: A YAML file.

    Returns:
        The validated mapping.

    Raises:
        LogFormatError: Naming the bad key, what was found and what was expected.
    """
    remedy = "see src/examples/mappings and src/examples/identify"
    text = read_text(path, LogFormatError, "mapping", remedy=remedy)
    data = _in_present_form(parse_yaml(text, str(path), LogFormatError))
    return validated(data, LogMapping, str(path), LogFormatError)


def _in_present_form(data: Any) -> Any:
    """Move the keys of the former mapping of raw drive logs to their present places."""
    if not isinstance(data, dict) or not {"position", "torque"} & data.keys():
        return cast("object", data)
    former = dict(cast("dict[str, Any]", data))
    places = {
        "time": {"rate": "rate"},
        "joints": {"joints": "names", "position": "position", "torque": "effort"},
        "robot": {"urdf": "urdf", "gear_ratio": "gear_ratio", "coupling": "coupling"},
    }
    moved = {
        part: {new: former.pop(old) for old, new in keys.items() if old in former}
        for part, keys in places.items()
    }
    return {**former, **{part: entries for part, entries in moved.items() if entries}}
