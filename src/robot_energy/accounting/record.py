"""What is kept of the registers across restarts: plain values with units in their names.

A state file holds one `LedgerRecord` as JSON. It is strict: unknown keys, missing units
or numbers out of range are refused as a whole, never adapted.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from robot_energy.errors import StateFileError
from robot_energy.registers.exact_sum import REMAINDER_BITS
from robot_energy.registers.totals import CABINET_REGISTERS, JOINT_REGISTERS, SHAFT_REGISTERS

FORMAT_VERSION = 1
SHAFT_KEYS = tuple(f"shaft_{name}" for name in SHAFT_REGISTERS)
JOINT_KEYS = (*JOINT_REGISTERS, *SHAFT_KEYS)

Integer = Annotated[int, Field(ge=-(2**63), lt=2**63)]
Count = Annotated[int, Field(ge=0, lt=2**63)]
Remainder = Annotated[int, Field(ge=0, lt=2**REMAINDER_BITS)]
Power = Annotated[float, Field(allow_inf_nan=False)]
TraceKind = Literal[
    "reset", "restart", "model_changed", "began_anew", "file_lost", "register_added"
]


class Record(BaseModel):
    """Base of all records: frozen, strict, no unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class Tally(Record):
    """All counters at an instant, or what they counted between two; exact integers.

    Attributes:
        cabinet_energy_microjoule: By the names of ``CABINET_REGISTERS``. [uJ]
        joint_energy_microjoule: By the names of ``JOINT_KEYS``, joints in order. [uJ]
        shaft_compared_ns: Time with a measured shaft power of each joint. [ns]
        measured_energy_microjoule: By the meter, while compared. [uJ]
        predicted_energy_at_meter_microjoule: Over the same time. [uJ]
        compared_ns: That time. [ns]
        observed_ns: Time integrated. [ns]
        gap_ns: Time that could not be. [ns]
        gap_count: Number of gaps.
        jumps: Backward jumps of the stamps.
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

    def __sub__(self, earlier: Tally) -> Tally:
        """Return what was counted since an earlier tally of the same registers."""
        cabinet, joints = earlier.cabinet_energy_microjoule, earlier.joint_energy_microjoule
        return Tally(
            cabinet_energy_microjoule={
                name: value - cabinet[name]
                for name, value in self.cabinet_energy_microjoule.items()
            },
            joint_energy_microjoule={
                name: tuple(a - b for a, b in zip(values, joints[name], strict=True))
                for name, values in self.joint_energy_microjoule.items()
            },
            shaft_compared_ns=tuple(
                a - b
                for a, b in zip(self.shaft_compared_ns, earlier.shaft_compared_ns, strict=True)
            ),
            measured_energy_microjoule=self.measured_energy_microjoule
            - earlier.measured_energy_microjoule,
            predicted_energy_at_meter_microjoule=self.predicted_energy_at_meter_microjoule
            - earlier.predicted_energy_at_meter_microjoule,
            compared_ns=self.compared_ns - earlier.compared_ns,
            observed_ns=self.observed_ns - earlier.observed_ns,
            gap_ns=self.gap_ns - earlier.gap_ns,
            gap_count=self.gap_count - earlier.gap_count,
            jumps=self.jumps - earlier.jumps,
        )

    def arranged(self, order: Sequence[int]) -> Tally:
        """Return it with joints in another order and registers that are new at zero.

        Args:
            order: Where each joint of the result stands here.

        Raises:
            StateFileError: If a register is unknown or has another number of joints.
        """
        cabinet, joints = self.cabinet_energy_microjoule, self.joint_energy_microjoule
        unknown = (set(cabinet) - {*CABINET_REGISTERS}) | (set(joints) - {*JOINT_KEYS})
        if unknown:
            raise StateFileError(
                f"the state has a register '{min(unknown)}'",
                "registers that this release knows",
                "use the release that wrote it",
            )
        rows = [self.shaft_compared_ns, *joints.values()]
        if any(len(values) != len(order) for values in rows):
            raise StateFileError("a register of the state lacks joints", "one value per joint")
        zero = (0,) * len(order)
        return self.model_copy(
            update={
                "cabinet_energy_microjoule": {
                    name: cabinet.get(name, 0) for name in CABINET_REGISTERS
                },
                "joint_energy_microjoule": {
                    name: tuple(joints.get(name, zero)[index] for index in order)
                    for name in JOINT_KEYS
                },
                "shaft_compared_ns": tuple(self.shaft_compared_ns[index] for index in order),
            }
        )


class Remainders(Record):
    """What the totals hold beyond whole microjoules, in units of 2^-40 microjoule."""

    cabinet: dict[str, Remainder]
    joints: dict[str, tuple[Remainder, ...]]
    measured: Remainder
    predicted_at_meter: Remainder
    phases: dict[str, Remainder]

    def arranged(self, order: Sequence[int]) -> Remainders:
        """Return them with joints in another order and new registers at zero."""
        zero = (0,) * len(order)
        return self.model_copy(
            update={
                "cabinet": {name: self.cabinet.get(name, 0) for name in CABINET_REGISTERS},
                "joints": {
                    name: tuple(self.joints.get(name, zero)[index] for index in order)
                    for name in JOINT_KEYS
                },
            }
        )


class OpenInterval(Record):
    """An interval that has not been closed.

    Attributes:
        interval_id: Unique in the life of the state file.
        name: Unique among the open ones.
        start_ns: Newest booked sample when it was opened. [ns]
        base: All counters at that instant.
        peak_power_watt: Highest grid power since; None before the next sample. [W]
    """

    interval_id: Count
    name: str
    start_ns: Integer
    base: Tally
    peak_power_watt: Power | None


class EnergyInterval(Record):
    """What an interval has counted, up to its end or up to now.

    Attributes:
        interval_id: Unique in the life of the state file.
        name: As given by who opened it.
        start_ns: Newest booked sample when it was opened. [ns]
        end_ns: Newest booked sample when it was closed, or now. [ns]
        is_open: Whether it still counts.
        counted: What all counters counted in between.
        peak_power_watt: Highest grid power of the samples after the start. [W]
    """

    interval_id: Count
    name: str
    start_ns: Integer
    end_ns: Integer
    is_open: bool
    counted: Tally
    peak_power_watt: Power | None


class TraceEntry(Record):
    """Something that happened to the registers and must be seen later.

    Attributes:
        kind: What happened.
        stamp_ns: Newest booked sample then; None before the first. [ns]
        text: The reason, in words.
        totals: All counters before, where they were set to zero.
        energy_start_ns: Since when those had counted. [ns]
    """

    kind: TraceKind
    stamp_ns: Integer | None
    text: str
    totals: Tally | None = None
    energy_start_ns: Integer | None = None


class Identity(Record):
    """Whose registers they are.

    Attributes:
        robot_type: As in the model file.
        robot_serial: As in the model file; empty if it has none.
        joint_names: In model order.
        model_id: Hash of the model file that counts.
    """

    robot_type: str
    robot_serial: str
    joint_names: tuple[str, ...]
    model_id: str


class LedgerRecord(Record):
    """All that the books keep across a restart.

    Attributes:
        format_version: Of this record.
        identity: Whose registers they are.
        energy_start_ns: Since when they count; None before the first sample. [ns]
        end_ns: Newest booked sample. [ns]
        totals: All counters.
        remainders: What they hold beyond whole microjoules.
        phase_energy_microjoule: Energy drawn from the grid by phase. [uJ]
        phase_observed_ns: Observed time by phase. [ns]
        peak_power_watt: Highest grid power since the start. [W]
        samples: Power samples taken.
        quality_counts: Samples that carried each quality bit, by its name.
        restarts: How often the registers were taken over from a file.
        next_interval_id: Number of the next interval.
        open_intervals: Those that still count.
        closed_intervals: The latest closed ones, oldest first.
        trace: Resets, restarts, changes of the model; the latest of each kind.
    """

    format_version: Literal[1] = FORMAT_VERSION
    identity: Identity
    energy_start_ns: Integer | None
    end_ns: Integer | None
    totals: Tally
    remainders: Remainders
    phase_energy_microjoule: dict[str, Integer]
    phase_observed_ns: dict[str, Count]
    peak_power_watt: Power | None
    samples: Count
    quality_counts: dict[str, Count]
    restarts: Count
    next_interval_id: Count
    open_intervals: tuple[OpenInterval, ...]
    closed_intervals: tuple[EnergyInterval, ...]
    trace: tuple[TraceEntry, ...]

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.energy_start_ns is None) != (self.end_ns is None):
            raise ValueError("energy_start_ns and end_ns must be known together")
        return self

    def arranged(self, joint_names: Sequence[str]) -> LedgerRecord:
        """Return the record for the same joints in another order, with every register.

        Args:
            joint_names: The same names in any order.

        Raises:
            StateFileError: If a register is unknown or has another number of joints.
        """
        order = [self.identity.joint_names.index(name) for name in joint_names]

        def interval(entry: OpenInterval) -> OpenInterval:
            return entry.model_copy(update={"base": entry.base.arranged(order)})

        def closed(entry: EnergyInterval) -> EnergyInterval:
            return entry.model_copy(update={"counted": entry.counted.arranged(order)})

        return self.model_copy(
            update={
                "totals": self.totals.arranged(order),
                "remainders": self.remainders.arranged(order),
                "open_intervals": tuple(map(interval, self.open_intervals)),
                "closed_intervals": tuple(map(closed, self.closed_intervals)),
            }
        )

    def to_json(self) -> bytes:
        """Return it as JSON text."""
        return self.model_dump_json().encode()

    @classmethod
    def from_json(cls, text: bytes) -> LedgerRecord:
        """Read what `to_json` wrote.

        Raises:
            StateFileError: Naming the first key that is wrong.
        """
        try:
            return cls.model_validate_json(text)
        except ValidationError as error:
            first = error.errors()[0]
            key = ".".join(map(str, first["loc"])) or "the text"
            raise StateFileError(
                f"the state cannot be used: {key}: {first['msg']}",
                f"a record of format {FORMAT_VERSION}",
            ) from error
