"""What is kept of the registers across restarts: plain values with units in their names.

A state file holds one `AccountRecord` as JSON: unknown keys and missing units are refused as
a whole.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Annotated, Literal, Self

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
    """An interval that has not been closed."""

    interval_id: Annotated[Count, "Unique in the life of the state file."]
    name: Annotated[Name, "Unique among the open ones."]
    start_ns: Annotated[Stamp, "Newest counted sample when it was opened. [ns]"]
    base: Totals
    peak_power_watt: Annotated[
        Power | None, "Highest grid power since; None before the next sample. [W]"
    ]


class EnergyInterval(RecordPart):
    """What an interval has counted, up to its end or up to now."""

    interval_id: Annotated[Count, "Unique in the life of the state file."]
    name: Name
    start_ns: Annotated[Stamp, "Newest counted sample when it was opened. [ns]"]
    end_ns: Annotated[Stamp, "Newest counted sample when it was closed, or now. [ns]"]
    is_open: bool
    counted: Totals
    peak_power_watt: Annotated[
        Power | None, "Highest grid power of the samples after the start. [W]"
    ]


class TraceEntry(RecordPart):
    """Something that happened to the registers and must be seen later."""

    kind: TraceKind
    stamp_ns: Annotated[Stamp | None, "Newest counted sample then; None before the first. [ns]"]
    text: Text
    totals: Annotated[Totals | None, "All counters before, where they were set to zero."] = None
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
    """Whose registers they are."""

    robot_type: str
    robot_serial: Annotated[str, "As in the model file; empty if it has none."]
    joint_names: tuple[str, ...]
    model_id: str
    node: Annotated[str, "Full name of the node that counts; empty for none."] = ""


class Calibrated(RecordPart):
    """How wide bands must be, see `robot_energy.certainty.band_calibration`."""

    location: Literal["UNKNOWN", "GRID", "DC_BUS"]
    log_scale: Annotated[
        tuple[Power, ...], "Logarithm of the scale of power by phase, the first of all phases."
    ]
    readings: tuple[Count, ...]
    energy_windows: Annotated[
        tuple[tuple[Power, Power, Power], ...],
        "The newest, oldest first: error, step of the measured power, deviation of the form. [J], "
        "[W], [J]",
    ]
    energy_figures: Annotated[
        tuple[tuple[Power, ...], ...], "Mean products of the deviations of the figures. [J^2]"
    ]


class AccountRecord(RecordPart):
    """All that an energy account keeps across a restart."""

    format_version: Literal[5] = FORMAT_VERSION
    identity: Identity
    energy_start_ns: Annotated[
        Stamp | None, "Since when they count; None before the first sample. [ns]"
    ]
    end_ns: Stamp | None
    totals: Totals
    remainders: Annotated[Remainders, "What they hold beyond whole microjoules."]
    phase_energy_microjoule: Annotated[
        dict[str, Integer], "Energy drawn from the grid by phase. [uJ]"
    ]
    phase_observed_ns: dict[str, Count]
    peak_power_watt: Annotated[Power | None, "Highest grid power since the start. [W]"]
    samples: Count
    learned_energy_microjoule: Annotated[
        Integer, "Drawn from the grid as predicted with learned figures. [uJ]"
    ] = 0
    standby_energy_microjoule: Annotated[Integer, "Drawn from the grid in standby. [uJ]"] = 0
    standby_ns: Count = 0
    quality_counts: Annotated[
        dict[str, Count], "Samples that carried each quality bit, by its name."
    ]
    restarts: Annotated[Count, "How often the registers were taken over from a file."]
    next_interval_id: Count
    open_intervals: tuple[OpenInterval, ...]
    closed_intervals: tuple[EnergyInterval, ...]
    trace: Annotated[
        tuple[TraceEntry, ...], "Resets, restarts, changes of the model; the latest of each kind."
    ]
    calibration: Annotated[Calibrated | None, "Of the bands."] = None
    auxiliary_states: Annotated[
        dict[str, dict[str, LoadStateTotals]],
        "What was counted in each state of auxiliary loads, by load and state.",
    ] = Field(default_factory=dict[str, dict[str, LoadStateTotals]])

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
