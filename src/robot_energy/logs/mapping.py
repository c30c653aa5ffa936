"""Mapping of a CSV log: which column means what, in which unit. Validated by pydantic."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from robot_energy.config_file import load
from robot_energy.errors import LogFormatError
from robot_energy.units import ENERGY_UNITS

PLACEHOLDER = "{joint}"
LATEST_NS = 2**62  # from 1970 on, either way: sums with times of the log stay within 64 bits
DEGREE = 0.017453292519943295  # rad
POSITION_UNITS = {"rad": 1.0, "deg": DEGREE, "m": 1.0, "mm": 1e-3}
VELOCITY_UNITS = {"rad_per_s": 1.0, "deg_per_s": DEGREE, "m_per_s": 1.0, "mm_per_s": 1e-3}
EFFORT_UNITS = {"newton_metre": 1.0, "newton": 1.0, "ampere": 1.0, "milliampere": 1e-3}
TEMPERATURE_OFFSETS = {"celsius": 0.0, "kelvin": -273.15}
VOLTAGE_UNITS = {"V": 1.0, "mV": 1e-3}
CURRENT_UNITS = {"A": 1.0, "mA": 1e-3}

Text = Annotated[str, Field(min_length=1)]


class MappingEntry(BaseModel):
    """Base of all parts: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Time(MappingEntry):
    """When each row was measured: a column, or a rate where there is none.

    Attributes:
        column: Column of the time.
        unit: Its unit.
        rate: Rows per second, where the log has no time. [Hz]
        start: Added to every time; needed where times count from zero. Without zone: UTC.
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
        if self.rate is not None and self.start is None:
            raise ValueError("a start beside rate")
        if abs(self.start_ns) > LATEST_NS:
            raise ValueError(f"a start within the years 1824 to 2116, found {self.start}")
        return self

    @property
    def start_ns(self) -> int:
        """The start, 0 where there is none. [ns]"""
        if self.start is None:
            return 0
        start = self.start if self.start.tzinfo else self.start.replace(tzinfo=UTC)
        elapsed = start - datetime(1970, 1, 1, tzinfo=UTC)
        return (elapsed.days * 86400 + elapsed.seconds) * 10**9 + elapsed.microseconds * 1000


class Columns(MappingEntry):
    """Columns of one quantity of every joint: a pattern, or one name per joint.

    Attributes:
        column: Pattern in which ``{joint}`` stands for the joint's key.
        columns: One column per joint, in their order.
    """

    column: Text | None = None
    columns: Annotated[list[Text], Field(min_length=1)] | None = None

    @model_validator(mode="after")
    def _check(self) -> Columns:
        if (self.column is None) == (self.columns is None):
            raise ValueError("either column or columns, not both")
        if self.column is not None and PLACEHOLDER not in self.column:
            raise ValueError(f"a pattern with {PLACEHOLDER}, found '{self.column}'")
        return self

    def names(self, keys: list[str]) -> list[str]:
        """Return the column of every joint."""
        if self.columns is not None:
            return self.columns
        return [str(self.column).replace(PLACEHOLDER, key) for key in keys]


class PositionColumn(Columns):
    """Joint positions, joint side."""

    unit: Literal["rad", "deg", "m", "mm"]


class Velocity(Columns):
    """Joint velocities, joint side."""

    unit: Literal["rad_per_s", "deg_per_s", "m_per_s", "mm_per_s"]


class EffortColumns(Columns):
    """Torque or current, kept as it is; what it means is told to the monitor as ``effort``."""

    unit: Literal["newton_metre", "newton", "ampere", "milliampere"]


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

    names: Annotated[list[Text], Field(min_length=1)]
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
        for what in ("keys", "signs"):
            entries = getattr(self, what)
            if entries is not None and len(entries) != len(self.names):
                raise ValueError(
                    f"as many {what} as names: {len(self.names)}, found {len(entries)}"
                )
        for what in ("position", "velocity", "effort", "temperature", "drive_power"):
            group = getattr(self, what)
            if group is not None and group.columns and len(group.columns) != len(self.names):
                raise ValueError(
                    f"as many columns for {what} as names: {len(self.names)}, "
                    f"found {len(group.columns)}"
                )
        return self

    def columns(self, group: Columns | None) -> list[str]:
        """Return the columns of a quantity; none where the log lacks it."""
        return [] if group is None else group.names(self.keys or self.names)


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


class LogMapping(MappingEntry):
    """What the columns of a log mean."""

    schema_version: Literal[1]
    description: str = ""
    delimiter: Annotated[str, Field(min_length=1, max_length=1)] | None = None
    time: Time
    joints: Joints
    power: Power | None = None


def load_mapping(path: str | Path) -> LogMapping:
    """Load the mapping of a log.

    Args:
        path: A YAML file.

    Returns:
        The validated mapping.

    Raises:
        LogFormatError: Naming the bad key, what was found and what was expected.
    """
    return load(path, LogMapping, LogFormatError, "mapping", "see src/examples/mappings")
