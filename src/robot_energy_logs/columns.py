"""Columns of a log: of which quantity, in which unit, with which sign, scale and zero.

Validated by pydantic, as parts of a mapping (`robot_energy_logs.mapping`).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Generic, Literal, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, model_validator

from robot_energy.foundation.units import ENERGY_UNITS, POWER_UNITS, DqScaling
from robot_energy.inputs.joint_states.correction import MAX_SCALE, JointCorrection
from robot_energy.inputs.meter.source import LOAD_NEGATIVE, LOAD_POSITIVE

PLACEHOLDER = "{joint}"
DEGREE = 0.017453292519943295  # rad
FACTORS = {
    **{"rad": 1.0, "deg": DEGREE, "m": 1.0, "mm": 1e-3},
    **{"rad_per_s": 1.0, "deg_per_s": DEGREE, "m_per_s": 1.0, "mm_per_s": 1e-3},
    "rpm": 0.10471975511965977,
    **{"newton_metre": 1.0, "newton": 1.0, "ampere": 1.0, "milliampere": 1e-3},
    **{"degc": 1.0, "celsius": 1.0, "kelvin": 1.0, "fahrenheit": 5 / 9},
    **{"V": 1.0, "mV": 1e-3, "A": 1.0, "mA": 1e-3},
    **POWER_UNITS,
    **ENERGY_UNITS,
}
"""What one of each unit is in SI or, of temperatures, in degC apart from their zero."""
ZEROS = {"kelvin": -273.15, "fahrenheit": -160 / 9}  # degC
SPELLINGS = {
    **{"rad": "rad", "deg": "deg", "\N{DEGREE SIGN}": "deg", "grad": "deg", "m": "m", "mm": "mm"},
    **{"rad/s": "rad_per_s", "deg/s": "deg_per_s", "\N{DEGREE SIGN}/s": "deg_per_s"},
    **{"grad/s": "deg_per_s", "m/s": "m_per_s", "mm/s": "mm_per_s"},
    **{"rpm": "rpm", "1/min": "rpm", "u/min": "rpm"},
    **{"nm": "newton_metre", "n m": "newton_metre", "n": "newton"},
    **{"a": "ampere", "ma": "milliampere", "w": "W", "kw": "kW"},
    **{"f": "fahrenheit", "\N{DEGREE SIGN}f": "fahrenheit", "degf": "fahrenheit"},
    **{"k": "kelvin", "kelvin": "kelvin", "c": "degc", "\N{DEGREE SIGN}c": "degc", "degc": "degc"},
}
"""Units in the words of files, small letters, and in those of a mapping. Grad is German."""
CORRECTED = ("position", "velocity", "effort")
ROTOR_FRAME = ("current_d", "current_q", "voltage_d", "voltage_q")

Text = Annotated[str, Field(min_length=1)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Scale = Annotated[float, Field(gt=0, le=MAX_SCALE)]
Names = Annotated[list[Text], Field(min_length=1)]
Side = Literal["motor", "joint"]
Unit = TypeVar("Unit")


class MappingEntry(BaseModel):
    """Base of all parts: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Columns(MappingEntry, Generic[Unit]):
    """Columns of one quantity of every joint.

    Attributes:
        column: Pattern in which ``{joint}`` stands for the joint's key.
        columns: One column per joint, in their order.
        file: Another file with as many rows, in the folder of the log; ``{recording}`` stands
            for the name of each recording, and ``{joint}`` for the joint's key where each joint
            has a file of its own. Without column and columns: its first columns.
        column_names: Of all columns of that file, if it has no header.
    """

    unit: Unit
    column: Text | None = None
    columns: Names | None = None
    file: Text | None = None
    column_names: Names | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.column is not None and self.columns is not None:
            raise ValueError("either column or columns, not both")
        if self.column is None and self.columns is None and self.file is None:
            raise ValueError("either column or columns, or the file whose first columns they are")
        if self.column is None and self.files_of_joints:
            raise ValueError(f"column, with {PLACEHOLDER} in the name of the file")
        if self.column is not None and PLACEHOLDER not in f"{self.column}{self.file}":
            raise ValueError(f"a pattern with {PLACEHOLDER}, found '{self.column}'")
        if self.column_names is not None and self.file is None:
            raise ValueError("column_names at the top of the mapping, or together with file")
        return self

    @property
    def files_of_joints(self) -> bool:
        """Whether each joint has a file of its own."""
        return PLACEHOLDER in (self.file or "")

    def names(self, keys: list[str]) -> list[str] | None:
        """Return the column of every joint; None for the first columns of the file.

        Args:
            keys: What stands for ``{joint}`` in a pattern, one per joint.
        """
        if self.column is None:
            return self.columns
        return [self.column.replace(PLACEHOLDER, key) for key in keys]


class JointColumns(Columns[Unit], Generic[Unit]):
    """Columns of a quantity whose sign, scale and zero can differ from those of the URDF.

    ``value = sign * scale * logged + zero``, where ``logged`` is in SI, and of the joint where
    gears are known; one entry stands for all joints. The parameters of a node
    (``joint_states.position.sign`` ...) have the same names and meaning.

    Attributes:
        sign: 1 or -1: -1 where the log counts the other way than the URDF.
        zero: Value in the URDF where the log says 0. [rad], [rad/s], [N m] or [A]
    """

    sign: Annotated[list[Literal[1, -1]], Field(min_length=1)] = [1]
    scale: Annotated[list[Scale], Field(min_length=1)] = [1.0]
    zero: Annotated[list[Number], Field(min_length=1)] = [0.0]

    @property
    def correction(self) -> JointCorrection:
        """The three as one."""
        sign, scale, zero = map(tuple, (self.sign, self.scale, self.zero))
        return JointCorrection(sign=sign, scale=scale, zero=zero)


class PositionColumn(JointColumns[Literal["rad", "deg", "m", "mm"]]):
    """Positions of the joints, or of the motors.

    Attributes:
        side: Whether joints or motors were measured; motors need ``robot`` or a model.
    """

    side: Side = "joint"


class Velocity(JointColumns[Literal["rad_per_s", "deg_per_s", "m_per_s", "mm_per_s", "rpm"]]):
    """Velocities of the joints, or of the motors."""

    side: Side = "joint"


class EffortColumns(JointColumns[Literal["newton_metre", "newton", "ampere", "milliampere"]]):
    """Torque or current; a bag keeps it, and ``effort`` says to the monitor what it means.

    Attributes:
        side: Whether joints or motors were measured; ``identify dynamics --log`` needs it.
        torque_constant: Per motor; turns currents into torques. [N m/A]
    """

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


class Joints(MappingEntry):
    """The joints and their columns.

    Attributes:
        names: As in the model file, from the base on.
        keys: What stands for ``{joint}`` in patterns; default the names.
        position: May be left out for ``identify drives``, as of a test bench. ``identify
            thermal`` needs neither positions nor velocities.
        drive_power: Electrical power that each drive takes, positive into the drive.
        current_d: Of each drive, along the flux of the rotor; with the three below instead of
            ``drive_power``, which is computed from them (paper B eq. 1).
        dq_scaling: What these amplitudes are: ``peak`` of a phase, ``rms`` of a phase, or those
            of the power-invariant transformation.
    """

    names: Names
    keys: list[Text] | None = None
    position: PositionColumn | None = None
    velocity: Velocity | None = None
    effort: EffortColumns | None = None
    temperature: Columns[Literal["degc", "celsius", "kelvin", "fahrenheit"]] | None = None
    drive_power: Columns[Literal["W", "kW", "mW"]] | None = None
    current_d: Columns[Literal["ampere", "milliampere"]] | None = None
    current_q: Columns[Literal["ampere", "milliampere"]] | None = None
    voltage_d: Columns[Literal["V", "mV"]] | None = None
    voltage_q: Columns[Literal["V", "mV"]] | None = None
    dq_scaling: DqScaling = "peak"

    @model_validator(mode="after")
    def _check(self) -> Joints:
        if len(set(self.names)) != len(self.names):
            raise ValueError("each joint name once")
        heats = self.effort is not None and self.temperature is not None
        if self.position is None and self.velocity is None and not heats:
            raise ValueError(
                "position or velocity, or both; for identify thermal effort and temperature"
            )
        given = [getattr(self, name) is not None for name in ROTOR_FRAME]
        if any(given) and (not all(given) or self.drive_power is not None):
            raise ValueError(f"all of {', '.join(ROTOR_FRAME)}, or drive_power instead")
        lists: dict[str, list[Any] | None] = {"keys": self.keys}
        for name, group in self.quantities():
            lists[f"columns for {name}"] = group.columns
            if isinstance(group, JointColumns):
                group.correction.check(self.names, name)
        if self.effort is not None:
            lists["torque_constant for effort"] = self.effort.torque_constant
        for what, entries in lists.items():
            if entries is not None and len(entries) != len(self.names):
                raise ValueError(
                    f"as many {what} as names: {len(self.names)}, found {len(entries)}"
                )
        return self

    @property
    def first(self) -> Columns[Any]:
        """The quantity that every row must have: positions, else velocities, else efforts."""
        return next(group for _, group in self.quantities())

    def quantities(self) -> Iterator[tuple[str, Columns[Any]]]:
        """Yield key and columns of every quantity that the log has."""
        for name in (*CORRECTED, "temperature", "drive_power", *ROTOR_FRAME):
            if (group := getattr(self, name)) is not None:
                yield name, group


class MeterColumn(MappingEntry, Generic[Unit]):
    """One column of the power meter."""

    column: Text
    unit: Unit


class Power(MappingEntry):
    """The power meter: one column, or voltage and current of a DC supply.

    Attributes:
        location: Where the meter sits: ``grid`` or ``dc_bus``.
        interval: Length of the interval that ends at each row, for a mean. [s]
        sign: Of the reading while the robot draws power, as of a meter's topic.
        scale: Factor on the reading, as of a current transformer.
    """

    location: Literal["grid", "dc_bus"]
    meaning: Literal["instantaneous", "mean_over_interval", "cumulative"]
    interval: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    sign: Literal["load_positive", "load_negative"] = LOAD_POSITIVE
    scale: Scale = 1.0
    reading: MeterColumn[Literal["W", "kW", "mW", "J", "kJ", "Wh", "kWh"]] | None = None
    voltage: MeterColumn[Literal["V", "mV"]] | None = None
    current: MeterColumn[Literal["A", "mA"]] | None = None

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

    @property
    def factor(self) -> float:
        """Factor on the reading, with its sign."""
        return -self.scale if self.sign == LOAD_NEGATIVE else self.scale

    def factors(self) -> dict[str, tuple[str, float]]:
        """Return column and factor to SI of all whose product is the reading, by key."""
        entries = {"reading": self.reading, "voltage": self.voltage, "current": self.current}
        return {
            key: (entry.column, FACTORS[entry.unit])
            for key, entry in entries.items()
            if entry is not None
        }


class PayloadColumns(MappingEntry):
    """What the robot carries, as set in the controller; each change goes into the bag.

    Attributes:
        link: Link of the URDF in whose frame centre of mass and inertia are.
        mass: Column of the mass. [kg]
        centre_of_mass: Columns of x, y and z. [m]
        inertia: Columns of Ixx, Iyy, Izz, Ixy, Ixz and Iyz about the centre of mass, axes of
            ``link``; without them a point mass. [kg m^2]
    """

    link: Text
    mass: Text
    centre_of_mass: Annotated[list[Text], Field(min_length=3, max_length=3)]
    inertia: Annotated[list[Text], Field(min_length=6, max_length=6)] | None = None
