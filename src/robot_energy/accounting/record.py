"""What is kept of the registers across restarts: plain values with units in their names.

A state file holds one `AccountRecord` as JSON: unknown keys and missing units are refused as
a whole.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Literal, Self

from pydantic import Field, ValidationError, model_validator

from robot_energy.accounting.totals import (
    Count,
    Integer,
    LoadStateTotals,
    Name,
    Power,
    RecordPart,
    Remainder,
    Stamp,
    Text,
    Totals,
)
from robot_energy.foundation.errors import StateFileError
from robot_energy.foundation.shown_text import shown

KEPT = 16  # latest trace entries of each kind, so that restarts never push out a reset
FORMAT_VERSION = 5
TraceKind = Literal[
    "reset", "restart", "model_changed", "began_anew", "file_lost", "register_added",
    "adopted", "repaired",
]  # fmt: skip
"""What happened. ``adopted`` and ``repaired`` are only read: files of this format hold them."""


class Remainders(RecordPart):
    """What the totals hold beyond whole microjoules, in units of 2^-40 microjoule."""

    cabinet: dict[str, Remainder]
    joints: dict[str, tuple[Remainder, ...]]
    measured: Remainder
    predicted_at_meter: Remainder
    phases: dict[str, Remainder]
    learned: Remainder = 0
    standby: Remainder = 0
    outlet_cabinet: Remainder = 0
    auxiliary: dict[str, tuple[Remainder, Remainder]] = Field(
        default_factory=dict[str, tuple[int, int]]
    )

    def arranged(self, order: Sequence[int]) -> Remainders:
        """Return them with joints in another order."""
        joints = self.joints.items()
        return self.model_copy(
            update={"joints": {name: tuple(row[index] for index in order) for name, row in joints}}
        )


class OpenInterval(RecordPart):
    """An interval that has not been closed.

    Attributes:
        interval_id: Unique in the life of the state file.
        name: Unique among the open ones.
        start_ns: Newest counted sample when it was opened. [ns]
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
        start_ns: Newest counted sample when it was opened. [ns]
        end_ns: Newest counted sample when it was closed, or now. [ns]
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
        stamp_ns: Newest counted sample then; None before the first. [ns]
        totals: All counters before, where they were set to zero.
    """

    kind: TraceKind
    stamp_ns: Stamp | None
    text: Text
    totals: Totals | None = None
    energy_start_ns: Stamp | None = None


class EventLog:
    """What happened to the registers, oldest first; bounded for each kind."""

    def __init__(self, entries: Iterable[TraceEntry] = ()) -> None:
        self._entries: list[TraceEntry] = []
        for entry in entries:
            self.add(entry)

    @property
    def entries(self) -> tuple[TraceEntry, ...]:
        """All entries, oldest first."""
        return tuple(self._entries)

    def add(self, entry: TraceEntry) -> None:
        """Note an entry; the oldest of its kind beyond 16 is dropped."""
        self._entries.append(entry)
        count = Counter(one.kind for one in self._entries)[entry.kind]
        if count > KEPT:
            oldest = next(one for one in self._entries if one.kind == entry.kind)
            self._entries.remove(oldest)


class Identity(RecordPart):
    """Whose registers they are.

    Attributes:
        robot_serial: As in the model file; empty if it has none.
        node: Full name of the node that counts; empty for none.
    """

    robot_type: str
    robot_serial: str
    joint_names: tuple[str, ...]
    model_id: str
    node: str = ""


class Calibrated(RecordPart):
    """How wide bands must be, see `robot_energy.certainty.band_calibration`.

    Attributes:
        log_scale: Logarithm of the scale of power by phase, the first of all phases.
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
        energy_start_ns: Since when they count; None before the first sample. [ns]
        remainders: What they hold beyond whole microjoules.
        phase_energy_microjoule: Energy drawn from the grid by phase. [uJ]
        peak_power_watt: Highest grid power since the start. [W]
        learned_energy_microjoule: Drawn from the grid as predicted with learned figures. [uJ]
        standby_energy_microjoule: Drawn from the grid in standby. [uJ]
        quality_counts: Samples that carried each quality bit, by its name.
        restarts: How often the registers were taken over from a file.
        trace: Resets, restarts, changes of the model; the latest of each kind.
        calibration: Of the bands.
        auxiliary_states: What was counted in each state of auxiliary loads, by load and state.
    """

    format_version: Literal[5] = FORMAT_VERSION
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
    standby_energy_microjoule: Integer = 0
    standby_ns: Count = 0
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

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.energy_start_ns is None) != (self.end_ns is None):
            raise ValueError("energy_start_ns and end_ns must be known together")
        return self

    def arranged(self, joint_names: Sequence[str], loads: Sequence[str] = ()) -> AccountRecord:
        """Return the record for the same joints in another order, and the loads that count now."""
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
        """Return what `to_json` wrote."""
        try:
            return cls.model_validate_json(text)
        except ValidationError as error:
            first = error.errors(include_input=False)[0]
            key = shown(".".join(map(str, first["loc"])) or "the text")
            raise StateFileError(
                f"the state cannot be used: {key}: {first['msg']}",
                f"a record of format {FORMAT_VERSION}",
            ) from error
