"""What is kept of the registers across restarts: plain values with units in their names.

A state file holds one `AccountRecord` as JSON: unknown keys and missing units are refused as
a whole. Only where an earlier release let a number or a text grow beyond what can be kept, that
one is brought to its limit, and `AccountRecord.repairs` says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PrivateAttr,
    ValidationError,
    model_validator,
)

from robot_energy.accounting.exact_sum import REMAINDER_BITS
from robot_energy.accounting.plain_text import MAX_NAME, MAX_TEXT
from robot_energy.accounting.record_repair import one_line, repaired
from robot_energy.accounting.registers import CABINET_REGISTERS, JOINT_REGISTERS, SHAFT_REGISTERS
from robot_energy.errors import StateFileError
from robot_energy.shown_text import shown
from robot_energy.timeline.stamps import MAX_STAMP_NS, MIN_STAMP_NS
from robot_energy.uncertainty.deviation import CABINET_DEVIATIONS, JOINT_DEVIATIONS
from robot_energy.units import MAX_COUNTER

FORMAT_VERSION = 4  # 1 had no node, 2 no calibration, 3 no auxiliary loads
SHAFT_KEYS = tuple(f"shaft_{name}" for name in SHAFT_REGISTERS)
CABINET_DEVIATION_KEYS = tuple(f"deviation_{name}" for name in CABINET_DEVIATIONS)
JOINT_DEVIATION_KEYS = tuple(f"deviation_{name}" for name in JOINT_DEVIATIONS)
DEVIATION_KEYS = frozenset((*CABINET_DEVIATION_KEYS, *JOINT_DEVIATION_KEYS))
CABINET_KEYS = (*CABINET_REGISTERS, *CABINET_DEVIATION_KEYS)
JOINT_KEYS = (*JOINT_REGISTERS, *SHAFT_KEYS, *JOINT_DEVIATION_KEYS)

Integer = Annotated[int, Field(ge=-MAX_COUNTER, le=MAX_COUNTER)]
Count = Annotated[int, Field(ge=0, le=MAX_COUNTER)]
Stamp = Annotated[int, Field(ge=MIN_STAMP_NS, le=MAX_STAMP_NS)]
Remainder = Annotated[int, Field(ge=0, le=2**REMAINDER_BITS - 1)]
Name = Annotated[str, one_line(MAX_NAME)]
Text = Annotated[str, one_line(MAX_TEXT)]
Power = Annotated[float, Field(allow_inf_nan=False)]
TraceKind = Literal[
    "reset",
    "restart",
    "model_changed",
    "began_anew",
    "file_lost",
    "register_added",
    "adopted",
    "repaired",
]


SINGLE = (
    "measured_energy_microjoule",
    "predicted_energy_at_meter_microjoule",
    "compared_ns",
    "observed_ns",
    "gap_ns",
    "gap_count",
    "jumps",
    "outlet_cabinet_energy_microjoule",
    "outlet_ns",
)  # totals that are one number


def saturated(value: int) -> int:
    """Return a counter, at its limit if it is beyond.

    Args:
        value: The counter; its limits are plus and minus ``MAX_COUNTER``.
    """
    return max(-MAX_COUNTER, min(value, MAX_COUNTER))


class RecordPart(BaseModel):
    """Base of all records: frozen, strict, no unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class LoadTotals(RecordPart):
    """What was counted of one auxiliary load.

    Attributes:
        energy_microjoule: While its power is known. [uJ]
        outlet_energy_microjoule: While the power of every load is known. [uJ]
        known_ns: Time for which its power is known. [ns]
        missing_ns: Time for which it is not. [ns]
        missing_count: How often it ceased to be known.
    """

    energy_microjoule: Integer = 0
    outlet_energy_microjoule: Integer = 0
    known_ns: Integer = 0
    missing_ns: Integer = 0
    missing_count: Integer = 0

    def __sub__(self, earlier: LoadTotals) -> LoadTotals:
        """Return what was counted since earlier totals of the same load, within limits."""
        return LoadTotals(
            **{
                name: saturated(getattr(self, name) - getattr(earlier, name))
                for name in LoadTotals.model_fields
            }
        )


class LoadStateTotals(RecordPart):
    """What was counted of one auxiliary load in one of its states.

    Attributes:
        energy_microjoule: While the power of the load is known. [uJ]
        remainder: What that holds beyond whole microjoules. [2^-40 uJ]
        ns: That time. [ns]
    """

    energy_microjoule: Integer = 0
    remainder: Remainder = 0
    ns: Count = 0


class Totals(RecordPart):
    """All counters at an instant, or what they counted between two; exact integers.

    Attributes:
        cabinet_energy_microjoule: By the names of ``CABINET_KEYS``. [uJ]
        joint_energy_microjoule: By the names of ``JOINT_KEYS``, joints in order. [uJ]
        shaft_compared_ns: Time with a measured shaft power of each joint. [ns]
        measured_energy_microjoule: By the meter, while compared. [uJ]
        predicted_energy_at_meter_microjoule: Over the same time. [uJ]
        compared_ns: That time. [ns]
        observed_ns: Time integrated. [ns]
        gap_ns: Time that could not be. [ns]
        gap_count: Number of gaps.
        jumps: Jumps of the stamps, backward or forward by more than a gap can be.
        outlet_cabinet_energy_microjoule: Of the cabinet, net, while the power of every auxiliary
            load is known. [uJ]
        outlet_ns: That time. [ns]
        auxiliary: What was counted of each auxiliary load, by its name.
    """

    cabinet_energy_microjoule: dict[str, Integer]
    joint_energy_microjoule: dict[str, tuple[Integer, ...]]
    shaft_compared_ns: tuple[Integer, ...]
    measured_energy_microjoule: Integer
    predicted_energy_at_meter_microjoule: Integer
    compared_ns: Integer
    observed_ns: Integer
    gap_ns: Integer
    gap_count: Integer
    jumps: Integer
    outlet_cabinet_energy_microjoule: Integer = 0
    outlet_ns: Integer = 0
    auxiliary: dict[str, LoadTotals] = Field(default_factory=dict[str, LoadTotals])

    @property
    def outlet_energy_microjoule(self) -> int:
        """From the outlet, while the power of every auxiliary load is known. [uJ]"""
        loads = (load.outlet_energy_microjoule for load in self.auxiliary.values())
        return self.outlet_cabinet_energy_microjoule + sum(loads)

    def __sub__(self, earlier: Totals) -> Totals:
        """Return what was counted since earlier totals of the same registers, within limits."""
        cabinet, joints = earlier.cabinet_energy_microjoule, earlier.joint_energy_microjoule
        return Totals(
            cabinet_energy_microjoule={
                name: saturated(value - cabinet[name])
                for name, value in self.cabinet_energy_microjoule.items()
            },
            joint_energy_microjoule={
                name: tuple(saturated(a - b) for a, b in zip(values, joints[name], strict=True))
                for name, values in self.joint_energy_microjoule.items()
            },
            shaft_compared_ns=tuple(
                saturated(a - b)
                for a, b in zip(self.shaft_compared_ns, earlier.shaft_compared_ns, strict=True)
            ),
            **{name: saturated(getattr(self, name) - getattr(earlier, name)) for name in SINGLE},
            auxiliary={
                name: load - earlier.auxiliary[name] for name, load in self.auxiliary.items()
            },
        )

    def arranged(self, order: Sequence[int], loads: Sequence[str] = ()) -> Totals:
        """Return it with joints in another order and registers that are new at zero.

        Args:
            order: Where each joint of the result stands here.
            loads: Names of the auxiliary loads of the result.

        Raises:
            StateFileError: If a register is unknown or has another number of joints.
        """
        cabinet, joints = self.cabinet_energy_microjoule, self.joint_energy_microjoule
        unknown = (set(cabinet) - {*CABINET_KEYS}) | (set(joints) - {*JOINT_KEYS})
        if unknown:
            raise StateFileError(
                f"the state has a register '{min(unknown)}'",
                "registers of this release",
                "use the release that wrote it",
            )
        rows = [self.shaft_compared_ns, *joints.values()]
        if any(len(values) != len(order) for values in rows):
            raise StateFileError("a register of the state lacks joints", "one value per joint")
        zero = (0,) * len(order)
        return self.model_copy(
            update={
                "cabinet_energy_microjoule": {name: cabinet.get(name, 0) for name in CABINET_KEYS},
                "joint_energy_microjoule": {
                    name: tuple(joints.get(name, zero)[index] for index in order)
                    for name in JOINT_KEYS
                },
                "shaft_compared_ns": tuple(self.shaft_compared_ns[index] for index in order),
                "auxiliary": {name: self.auxiliary.get(name, LoadTotals()) for name in loads},
            }
        )


class Remainders(RecordPart):
    """What the totals hold beyond whole microjoules, in units of 2^-40 microjoule."""

    cabinet: dict[str, Remainder]
    joints: dict[str, tuple[Remainder, ...]]
    measured: Remainder
    predicted_at_meter: Remainder
    phases: dict[str, Remainder]
    learned: Remainder = 0
    outlet_cabinet: Remainder = 0
    auxiliary: dict[str, tuple[Remainder, Remainder]] = Field(
        default_factory=dict[str, tuple[int, int]]
    )

    def arranged(self, order: Sequence[int]) -> Remainders:
        """Return them with joints in another order and new registers at zero.

        Args:
            order: Where each joint of the result stands here.
        """
        zero = (0,) * len(order)
        return self.model_copy(
            update={
                "cabinet": {name: self.cabinet.get(name, 0) for name in CABINET_KEYS},
                "joints": {
                    name: tuple(self.joints.get(name, zero)[index] for index in order)
                    for name in JOINT_KEYS
                },
            }
        )


class OpenInterval(RecordPart):
    """An interval that has not been closed.

    Attributes:
        interval_id: Unique in the life of the state file.
        name: Unique among the open ones.
        start_ns: Newest counted sample when it was opened. [ns]
        base: All counters at that instant.
        peak_power_watt: Highest grid power since; None before the next sample. [W]
    """

    interval_id: Count
    name: Name
    start_ns: Stamp
    base: Totals
    peak_power_watt: Power | None


class EnergyInterval(RecordPart):
    """What an interval has counted, up to its end or up to now.

    Attributes:
        interval_id: Unique in the life of the state file.
        name: As given by who opened it.
        start_ns: Newest counted sample when it was opened. [ns]
        end_ns: Newest counted sample when it was closed, or now. [ns]
        is_open: Whether it still counts.
        counted: What all counters counted in between.
        peak_power_watt: Highest grid power of the samples after the start. [W]
    """

    interval_id: Count
    name: Name
    start_ns: Stamp
    end_ns: Stamp
    is_open: bool
    counted: Totals
    peak_power_watt: Power | None


class TraceEntry(RecordPart):
    """Something that happened to the registers and must be seen later.

    Attributes:
        kind: What happened.
        stamp_ns: Newest counted sample then; None before the first. [ns]
        text: The reason, in words.
        totals: All counters before, where they were set to zero.
        energy_start_ns: Since when those had counted. [ns]
    """

    kind: TraceKind
    stamp_ns: Stamp | None
    text: Text
    totals: Totals | None = None
    energy_start_ns: Stamp | None = None


class Identity(RecordPart):
    """Whose registers they are.

    Attributes:
        robot_type: As in the model file.
        robot_serial: As in the model file; empty if it has none.
        joint_names: In model order.
        model_id: Hash of the model file that counts.
        node: Full name of the node that counts; empty for none, as before format 2.
    """

    robot_type: str
    robot_serial: str
    joint_names: tuple[str, ...]
    model_id: str
    node: str = ""


class Calibrated(RecordPart):
    """How wide bands must be, see `robot_energy.accounting.band_calibration`.

    Attributes:
        location: Where the meter sat, name of a `MeterLocation`.
        log_scale: Logarithm of the scale of power by phase, the first of all phases.
        readings: Of the meter, behind each.
        energy_windows: The newest, oldest first: error, step of the measured power, deviation of
            the form. [J], [W], [J]
        energy_figures: Mean products of the deviations of the figures. [J^2]
    """

    location: Literal["UNKNOWN", "GRID", "DC_BUS"]
    log_scale: tuple[Power, ...]
    readings: tuple[Count, ...]
    energy_windows: tuple[tuple[Power, Power, Power], ...]
    energy_figures: tuple[tuple[Power, ...], ...]


class AccountRecord(RecordPart):
    """All that an energy account keeps across a restart.

    Attributes:
        format_version: Of this record.
        identity: Whose registers they are.
        energy_start_ns: Since when they count; None before the first sample. [ns]
        end_ns: Newest counted sample. [ns]
        totals: All counters.
        remainders: What they hold beyond whole microjoules.
        phase_energy_microjoule: Energy drawn from the grid by phase. [uJ]
        phase_observed_ns: Observed time by phase. [ns]
        peak_power_watt: Highest grid power since the start. [W]
        samples: Power samples taken.
        learned_energy_microjoule: Drawn from the grid as predicted with learned figures. [uJ]
        quality_counts: Samples that carried each quality bit, by its name.
        restarts: How often the registers were taken over from a file.
        next_interval_id: Number of the next interval.
        open_intervals: Those that still count.
        closed_intervals: The latest closed ones, oldest first.
        trace: Resets, restarts, changes of the model; the latest of each kind.
        calibration: Of the bands; None before format 3.
        auxiliary_states: What was counted in each state of auxiliary loads, by load and state.
    """

    format_version: Literal[1, 2, 3, 4] = FORMAT_VERSION
    identity: Identity
    energy_start_ns: Stamp | None
    end_ns: Stamp | None
    totals: Totals
    remainders: Remainders
    phase_energy_microjoule: dict[str, Integer]
    phase_observed_ns: dict[str, Count]
    peak_power_watt: Power | None
    samples: Count
    learned_energy_microjoule: Integer = 0
    quality_counts: dict[str, Count]
    restarts: Count
    next_interval_id: Count
    open_intervals: tuple[OpenInterval, ...]
    closed_intervals: tuple[EnergyInterval, ...]
    trace: tuple[TraceEntry, ...]
    calibration: Calibrated | None = None
    auxiliary_states: dict[str, dict[str, LoadStateTotals]] = Field(
        default_factory=dict[str, dict[str, LoadStateTotals]]
    )
    _repairs: tuple[str, ...] = PrivateAttr(())

    @property
    def repairs(self) -> tuple[str, ...]:
        """What was brought to its limit when the record was read."""
        return self._repairs

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.energy_start_ns is None) != (self.end_ns is None):
            raise ValueError("energy_start_ns and end_ns must be known together")
        return self

    def arranged(self, joint_names: Sequence[str], loads: Sequence[str] = ()) -> AccountRecord:
        """Return the record for the same joints in another order, with every register.

        Args:
            joint_names: The same names in any order.
            loads: Names of the auxiliary loads that are counted from now on.

        Raises:
            StateFileError: If a register is unknown or has another number of joints.
        """
        order = [self.identity.joint_names.index(name) for name in joint_names]

        def interval(entry: OpenInterval) -> OpenInterval:
            return entry.model_copy(update={"base": entry.base.arranged(order, loads)})

        def closed(entry: EnergyInterval) -> EnergyInterval:
            return entry.model_copy(update={"counted": entry.counted.arranged(order, loads)})

        return self.model_copy(
            update={
                "totals": self.totals.arranged(order, loads),
                "remainders": self.remainders.arranged(order),
                "open_intervals": tuple(map(interval, self.open_intervals)),
                "closed_intervals": tuple(map(closed, self.closed_intervals)),
            }
        )

    def to_json(self) -> bytes:
        """Return it as JSON text."""
        return self.model_dump_json().encode()

    @classmethod
    def from_json(cls, text: bytes) -> AccountRecord:
        """Read what `to_json` wrote.

        Args:
            text: JSON of one record, in UTF-8.

        Returns:
            The record; values beyond their limits are at them, and `repairs` says which.

        Raises:
            StateFileError: If it is no such record; names the first key that is wrong.
        """
        try:
            return cls.model_validate_json(text)
        except ValidationError as error:
            mended, repairs = repaired(text, error)
        try:
            record = cls.model_validate_json(mended)
        except ValidationError as error:
            first = error.errors(include_input=False)[0]
            key = shown(".".join(map(str, first["loc"])) or "the text")
            raise StateFileError(
                f"the state cannot be used: {key}: {first['msg']}",
                f"a record of format {FORMAT_VERSION}",
            ) from error
        record._repairs = repairs
        return record
