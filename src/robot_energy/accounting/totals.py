"""All counters of an energy account at an instant, as plain values with units in their names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from robot_energy.accounting.exact_sum import REMAINDER_BITS
from robot_energy.accounting.plain_text import MAX_NAME, MAX_TEXT
from robot_energy.accounting.registers import CABINET_REGISTERS, JOINT_REGISTERS, SHAFT_REGISTERS
from robot_energy.certainty.deviation import CABINET_DEVIATIONS, JOINT_DEVIATIONS
from robot_energy.foundation.errors import StateFileError
from robot_energy.foundation.units import MAX_COUNTER
from robot_energy.timeline.stamps import MAX_STAMP_NS, MIN_STAMP_NS

SHAFT_KEYS = tuple(f"shaft_{name}" for name in SHAFT_REGISTERS)
CABINET_DEVIATION_KEYS = tuple(f"deviation_{name}" for name in CABINET_DEVIATIONS)
JOINT_DEVIATION_KEYS = tuple(f"deviation_{name}" for name in JOINT_DEVIATIONS)
CABINET_KEYS = (*CABINET_REGISTERS, *CABINET_DEVIATION_KEYS)
JOINT_KEYS = (*JOINT_REGISTERS, *SHAFT_KEYS, *JOINT_DEVIATION_KEYS)


def one_line(limit: int) -> AfterValidator:
    """Return a validator that refuses a text that is too long or cannot be printed on one line."""

    def check(text: str) -> str:
        if len(text) > limit or not text.isprintable():
            raise ValueError(f"a text of at most {limit} printable characters")
        return text

    return AfterValidator(check)


Integer = Annotated[int, Field(ge=-MAX_COUNTER, le=MAX_COUNTER)]
Count = Annotated[int, Field(ge=0, le=MAX_COUNTER)]
Stamp = Annotated[int, Field(ge=MIN_STAMP_NS, le=MAX_STAMP_NS)]
Remainder = Annotated[int, Field(ge=0, le=2**REMAINDER_BITS - 1)]
Name = Annotated[str, one_line(MAX_NAME)]
Text = Annotated[str, one_line(MAX_TEXT)]
Power = Annotated[float, Field(allow_inf_nan=False)]


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
    """Return a counter, at its limit if it is beyond."""
    return max(-MAX_COUNTER, min(value, MAX_COUNTER))


class RecordPart(BaseModel):
    """Base of all records: frozen, strict, no unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, defer_build=True)


class LoadTotals(RecordPart):
    """What was counted of one auxiliary load."""

    energy_microjoule: Annotated[Integer, "While its power is known. [uJ]"] = 0
    outlet_energy_microjoule: Annotated[Integer, "While the power of every load is known. [uJ]"] = 0
    known_ns: Annotated[Integer, "Time for which its power is known. [ns]"] = 0
    missing_ns: Annotated[Integer, "Time for which it is not. [ns]"] = 0
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
    """What was counted of one auxiliary load in one of its states."""

    energy_microjoule: Annotated[Integer, "While the power of the load is known. [uJ]"] = 0
    remainder: Annotated[Remainder, "What that holds beyond whole microjoules. [2^-40 uJ]"] = 0
    ns: Annotated[Count, "That time. [ns]"] = 0


class Totals(RecordPart):
    """All counters at an instant, or what they counted between two; exact integers."""

    cabinet_energy_microjoule: Annotated[
        dict[str, Integer], "By the names of ``CABINET_KEYS``. [uJ]"
    ]
    joint_energy_microjoule: Annotated[
        dict[str, tuple[Integer, ...]], "By the names of ``JOINT_KEYS``, joints in order. [uJ]"
    ]
    shaft_compared_ns: Annotated[
        tuple[Integer, ...], "Time with a measured shaft power of each joint. [ns]"
    ]
    measured_energy_microjoule: Annotated[Integer, "By the meter, while compared. [uJ]"]
    predicted_energy_at_meter_microjoule: Annotated[Integer, "Over the same time. [uJ]"]
    compared_ns: Annotated[Integer, "That time. [ns]"]
    observed_ns: Annotated[Integer, "Time integrated. [ns]"]
    gap_ns: Annotated[Integer, "Time that could not be. [ns]"]
    gap_count: Integer
    jumps: Annotated[Integer, "Jumps of the stamps, backward or forward by more than a gap can be."]
    outlet_cabinet_energy_microjoule: Annotated[
        Integer, "Of the cabinet, net, while the power of every auxiliary load is known. [uJ]"
    ] = 0
    outlet_ns: Annotated[Integer, "That time. [ns]"] = 0
    auxiliary: Annotated[
        dict[str, LoadTotals], "What was counted of each auxiliary load, by its name."
    ] = Field(default_factory=dict[str, LoadTotals])

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
        """Return it with joints in another order and auxiliary loads that are new at zero."""
        cabinet, joints = self.cabinet_energy_microjoule, self.joint_energy_microjoule
        if wrong := (cabinet.keys() ^ {*CABINET_KEYS}) | (joints.keys() ^ {*JOINT_KEYS}):
            raise StateFileError(
                f"the state lacks register '{min(wrong)}', or has it alone",
                "registers of this release",
                "use the release that wrote it",
            )
        rows = [self.shaft_compared_ns, *joints.values()]
        if any(len(values) != len(order) for values in rows):
            raise StateFileError("a register of the state lacks joints", "one value per joint")
        return self.model_copy(
            update={
                "joint_energy_microjoule": {
                    name: tuple(values[index] for index in order) for name, values in joints.items()
                },
                "shaft_compared_ns": tuple(self.shaft_compared_ns[index] for index in order),
                "auxiliary": {name: self.auxiliary.get(name, LoadTotals()) for name in loads},
            }
        )
