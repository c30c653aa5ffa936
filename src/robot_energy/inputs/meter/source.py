"""What a power or energy meter is: topics, type, unit, meaning and place."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import compress
from typing import Any

from robot_energy.foundation.errors import ParameterError
from robot_energy.foundation.units import ENERGY_UNITS, POWER_UNITS
from robot_energy.inputs.meter.kinds import (
    BATTERY_STATE,
    FLOAT32,
    FLOAT64,
    METER_KINDS,
    POWER_READING,
    MeterKind,
    meter_kind,
)
from robot_energy.inputs.parameters import HEADER, RECEIVE, group, parameter, setting
from robot_energy.timeline.blocks import NANOSECOND, MeterLocation, MeterMeaning

BY_TYPE = "by_type"
QUANTITIES = ("power", "energy")
MEANINGS = tuple(
    meaning.name.lower() for meaning in MeterMeaning if meaning is not MeterMeaning.UNKNOWN
)
LOCATIONS = tuple(
    place.name.lower() for place in MeterLocation if place is not MeterLocation.UNKNOWN
)
END, CENTRE, START = "end", "centre", "start"
LOAD_POSITIVE, LOAD_NEGATIVE = "load_positive", "load_negative"


def stamps_by_type() -> Any:
    """Return the parameter of where stamps come from, for messages of any type."""
    return parameter(
        "Where the stamps come from: the header, or the receive time; by_type: the header "
        "where there is one.",
        BY_TYPE,
        choices=(BY_TYPE, HEADER, RECEIVE),
    )


@dataclass(frozen=True, kw_only=True)
class MeterSource:
    """A topic, or a pair of topics, that brings the readings of one meter.

    ``by_type`` stands for what follows from the type of the messages; where the type does
    not say it, it must be set.
    """

    topic: str = parameter("Topic of the readings; unused for a pair of topics.", "power_meter")
    type: str = parameter(
        f"Type of the messages: {POWER_READING}, which says by itself what a reading is; "
        f"{FLOAT64} or {FLOAT32}; {BATTERY_STATE}, whose power is voltage times current and "
        "whose current is negative under load; or any other type whose number value_path names.",
        POWER_READING,
    )
    value_path: str = parameter(
        "Path of the number in messages of any other type, such as power, measurement.power or "
        "data[2]; a sum such as phases[0].power + phases[1].power adds them.",
        "",
    )
    quantity: str = parameter(
        "Quantity of the number; by_type: the quantity that its unit measures.",
        BY_TYPE,
        choices=(BY_TYPE, *QUANTITIES),
    )
    unit: str = parameter(
        "Unit of the number.", BY_TYPE, choices=(BY_TYPE, *POWER_UNITS, *ENERGY_UNITS)
    )
    meaning: str = parameter(
        "What a reading stands for: the power at its stamp, its mean over an interval, or a "
        "counter; energy is always cumulative.",
        BY_TYPE,
        choices=(BY_TYPE, *MEANINGS),
    )
    interval: float = parameter(
        "Length of the interval of mean_over_interval; 0 for the other meanings [s].",
        0.0,
        (0.0, 86_400.0),
    )
    stamp_at: str = parameter(
        "Which instant of that interval the stamp is.", END, choices=(END, CENTRE, START)
    )
    location: str = parameter(
        "Where the meter sits: mains supply of the cabinet, or DC bus between rectifier and "
        "drives; by_type: dc_bus for BatteryState.",
        BY_TYPE,
        choices=(BY_TYPE, *LOCATIONS),
    )
    sign: str = parameter(
        "Sign of the reading while the robot draws power.",
        LOAD_POSITIVE,
        choices=(LOAD_POSITIVE, LOAD_NEGATIVE),
    )
    scale: float = parameter(
        "Factor on the reading, as of a current transformer [-].", 1.0, (1e-9, 1e9)
    )
    voltage_topic: str = parameter(
        f"Topic of the voltage [V] of a pair, of {FLOAT64} or {FLOAT32}; empty for no pair.", ""
    )
    current_topic: str = parameter("Topic of the current [A] of a pair; empty for no pair.", "")
    pair_max_age: float = parameter(
        "Age of the voltage beyond which a current of a pair gives no power [s].",
        1.0,
        (0.001, 3600.0),
    )
    stamp_source: str = stamps_by_type()
    stamp_offset: float = parameter(
        "Added to the stamps, where the clock of the meter is off by a known time [s].",
        0.0,
        (-1e9, 1e9),
    )
    wraps_at: float = parameter(
        "Reading at which a counter starts again from zero, in its unit; 0: it never does "
        "[of the unit].",
        0.0,
        (0.0, 1e18),
    )
    max_power: float = parameter(
        "Highest plausible power, drawn or fed back; readings that state or imply more are refused "
        "[W].",
        1e6,
        (1.0, 1e6),
    )

    def __post_init__(self) -> None:
        for wrong, found, expected in self._faults():
            if wrong:
                raise ParameterError(found, expected)

    def _faults(self) -> Iterator[tuple[bool, str, str]]:
        """Whether something is wrong, what, and what was expected, one after the other."""
        kind, name = self.reading, self.type.rpartition("/")[2]
        yield not (self.pair or self.topic), "topic is empty", "the topic of the readings"
        if kind.says_all:
            said = {
                "quantity": self.quantity != BY_TYPE,
                "unit": self.unit != BY_TYPE,
                "meaning": self.meaning != BY_TYPE,
                "location": self.location != BY_TYPE,
                "interval": self.interval != 0.0,
                "stamp_at": self.stamp_at != END,
                "value_path": bool(self.value_path),
                "voltage_topic": self.pair,
            }
            given = ", ".join(compress(said, said.values()))
            found = f"{given} given for {name}, whose messages state that themselves"
            yield bool(given), found, f"another type, such as {FLOAT64}"
            return
        pair, both = "voltage_topic and current_topic", self.voltage_topic and self.current_topic
        lone = "voltage_topic" if self.voltage_topic else "current_topic"
        yield self.pair and not both, f"{lone} is given alone", pair
        types = " or ".join(each for each, other in METER_KINDS.items() if other.pairs)
        yield self.pair and not kind.pairs, f"a pair of topics of type {self.type}", types
        same = self.voltage_topic == self.current_topic
        yield self.pair and same, f"{pair} are the same", "two topics"
        headless = kind.headed is False and self.stamp_source == HEADER
        yield headless, f"stamp_source is header, which {name} does not have", RECEIVE
        found = f"value_path is given for {name}, whose number is known"
        yield bool(kind.fields and self.value_path), found, "another type, or no value_path"
        found = f"type is {self.type} but value_path is empty"
        yield not (kind.fields or self.value_path), found, "the path of the number in its messages"
        nowhere = self.location == BY_TYPE and not kind.location
        yield nowhere, f"location is by_type, which {name} does not say", " or ".join(LOCATIONS)
        implied, quantity = ("W", "power") if self.pair else (kind.unit, kind.quantity)
        what = "voltage times current" if self.pair else kind.label
        other = self.unit not in (BY_TYPE, implied) or self.quantity not in (BY_TYPE, quantity)
        found = f"a unit or quantity other than {quantity} in {implied} given for {what}"
        expected = "by_type, and scale where the numbers are in other units"
        yield bool(implied) and other, found, expected
        units = ", ".join((*POWER_UNITS, *ENERGY_UNITS))
        unknown = not implied and self.unit == BY_TYPE
        yield unknown, f"unit is by_type, which {name} does not say", f"one of {units}"
        fitting = {"power": POWER_UNITS, "energy": ENERGY_UNITS}.get(self.quantity, (self.unit,))
        found = f"quantity is {self.quantity} but unit is {self.unit}"
        yield not implied and self.unit not in fitting, found, f"one of {', '.join(fitting)}"
        counts, mean = self.meaning == "cumulative", self.meaning == "mean_over_interval"
        energy = "an energy" if self.cumulative else "a power"
        found = f"meaning is {self.meaning} but the reading is {energy}"
        other = self.meaning != BY_TYPE and counts != self.cumulative
        yield other, found, "cumulative for energy, and only for it"
        known = self.cumulative or self.pair or kind.instantaneous
        found = f"meaning is by_type, which {name} does not say"
        expected = "instantaneous or mean_over_interval"
        yield self.meaning == BY_TYPE and not known, found, expected
        found = f"meaning is {self.meaning} and interval is {self.interval:g} s"
        expected = "an interval above 0 for mean_over_interval, and only for it"
        yield mean != (self.interval > 0), found, expected
        found = f"stamp_at is {self.stamp_at} but meaning is {self.meaning}"
        yield self.stamp_at != END and not mean, found, "mean_over_interval"
        power = bool(self.wraps_at) and not self.cumulative
        yield power, "wraps_at is given for a power", "a unit of energy, or 0"

    @property
    def pair(self) -> bool:
        """Whether voltage and current come on two topics."""
        return bool(self.voltage_topic or self.current_topic)

    @property
    def reading(self) -> MeterKind:
        """What the type of the messages says of a reading."""
        return meter_kind(self.type)

    @property
    def reading_unit(self) -> str:
        """Unit of the number: as it was said, or what the type implies."""
        return self.unit if self.unit != BY_TYPE else self.reading.unit

    @property
    def cumulative(self) -> bool:
        """Whether the number is a counted energy; False for PowerReading, which may be."""
        return self.reading_unit in ENERGY_UNITS

    @property
    def topics(self) -> dict[str, str]:
        """Type of the messages of each topic."""
        names = (self.voltage_topic, self.current_topic) if self.pair else (self.topic,)
        return dict.fromkeys(names, self.type)

    @property
    def kind(self) -> tuple[MeterMeaning, MeterLocation] | None:
        """Meaning and place of every reading; None where each reading says it."""
        if self.reading.says_all:
            return None
        usual = "cumulative" if self.cumulative else "instantaneous"
        meaning = MeterMeaning[(usual if self.meaning == BY_TYPE else self.meaning).upper()]
        place = self.reading.location if self.location == BY_TYPE else self.location
        return meaning, MeterLocation[place.upper()]

    @property
    def factor(self) -> float:
        """What one of the reading is in W or J, with its sign."""
        unit = {**POWER_UNITS, **ENERGY_UNITS}.get(self.reading_unit, 1.0)
        return unit * self.scale * (-1.0 if self.sign == LOAD_NEGATIVE else 1.0)

    @property
    def shift_ns(self) -> int:
        """From the stamp of a message to the end of what it covers. [ns]"""
        share = {END: 0.0, CENTRE: 0.5, START: 1.0}[self.stamp_at]
        return round((self.stamp_offset + share * self.interval) / NANOSECOND)

    @property
    def wraps_at_joule(self) -> float | None:
        """Reading at which the counter starts again; None: it never does. [J]"""
        return abs(self.wraps_at * self.factor) or None

    @property
    def limits(self) -> tuple[float, float | None, str]:
        """What the comparison must know: greatest power [W], wrap [J], unit as it was said."""
        unit = "" if self.unit == BY_TYPE else self.unit
        return self.max_power, self.wraps_at_joule, unit

    def resolved(self, resolve: Callable[[str], str]) -> MeterSource:
        """Return the source with the full names of its topics."""
        if not self.pair:
            return replace(self, topic=resolve(self.topic))
        voltage, current = resolve(self.voltage_topic), resolve(self.current_topic)
        return replace(self, voltage_topic=voltage, current_topic=current)


@dataclass(frozen=True, kw_only=True)
class MeterInputs:
    """Parameters of the power meter."""

    meter: MeterSource = group(MeterSource)
    meter_max_gap: float = setting("meter_max_gap", 2.0, (0.01, 3600.0))
