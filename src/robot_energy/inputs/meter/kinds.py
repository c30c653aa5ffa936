"""Table of the kinds of meters: what each message type says of a power or an energy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from robot_energy.foundation.kinds import Kind, Kinds
from robot_energy.foundation.units import POWER_UNITS
from robot_energy.timeline.blocks import Float

POWER_READING = "ros2_energy_msgs/msg/PowerReading"
FLOAT64 = "std_msgs/msg/Float64"
FLOAT32 = "std_msgs/msg/Float32"
EXAMPLE_FLOAT64 = "example_interfaces/msg/Float64"
BATTERY_STATE = "sensor_msgs/msg/BatteryState"
METER_WORDS = ("power", "energy", "watt", "current")  # in names of topics that may be a meter


def _total(column: Mapping[str, Float]) -> Float:
    """The number, or the sum of several, as of phases."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.sum(np.stack(list(column.values())), axis=0)


@dataclass(frozen=True, kw_only=True)
class MeterKind(Kind):
    """One kind of meter. Its name is the type of its messages.

    What the type does not say (unit, location, meaning) a parameter must.

    Attributes:
        fields: Paths of the numbers of a reading; empty where ``value_path`` names one.
        number: Makes the reading, in its unit, of the columns of these fields.
        unit: What the reading is in; empty if the type does not say it.
        location: Where such a meter sits; empty if the type does not say it.
        instantaneous: Whether the type says that a power is the one at its stamp.
        says_all: Whether each reading says its meaning and location, by the fields of
            PowerReading.
        headed: Whether it has a header; None: as the definition of its messages has it.
        pairs: Whether voltage and current may come on two topics of this type.
        found_by_type: Whether a topic of this type is a meter without any settings.
        topic_words: A topic with one of these words may be a meter, and the user is informed;
            ``("",)`` for every topic of the type.
    """

    fields: tuple[str, ...] = ("data",)
    number: Callable[[Mapping[str, Float]], Float] = _total
    unit: str = ""
    location: str = ""
    instantaneous: bool = False
    says_all: bool = False
    headed: bool | None = None
    pairs: bool = False
    found_by_type: bool = False
    topic_words: tuple[str, ...] = ()

    @property
    def quantity(self) -> str:
        """What the implied unit is of."""
        return "power" if self.unit in POWER_UNITS else "energy"


def _discharging(column: Mapping[str, Float]) -> Float:
    """Power that a battery gives; its current is negative under load. [W]"""
    with np.errstate(over="ignore"):
        return -column["voltage"] * column["current"]


_NUMBER = MeterKind(
    name=FLOAT64,
    label="Float64",
    line="a number; unit, meaning and location by parameters",
    headed=False,
    pairs=True,
    topic_words=METER_WORDS,
)
METER_KINDS = Kinds(
    "meter type",
    MeterKind(
        name=POWER_READING,
        label="PowerReading",
        line="says by itself what a reading is",
        fields=("meaning", "location", "power", "energy", "interval"),
        says_all=True,
        found_by_type=True,
    ),
    _NUMBER,
    replace(_NUMBER, name=FLOAT32, label="Float32"),
    replace(
        _NUMBER,
        name=EXAMPLE_FLOAT64,
        line="a number, as the RTDE publisher of Universal Robots sends it; likewise",
    ),
    MeterKind(
        name=BATTERY_STATE,
        label="voltage times current",
        line="voltage times current of a battery, negative under load; on the DC bus",
        fields=("voltage", "current"),
        number=_discharging,
        unit="W",
        location="dc_bus",
        instantaneous=True,
        topic_words=("",),
    ),
)
OTHER = MeterKind(
    name="any other type",
    label="number at value_path",
    line="the number that `value_path` names, or a sum; unit, meaning and location by parameters",
    fields=(),
)


def meter_kind(msgtype: str) -> MeterKind:
    """Return the kind of a message type; `OTHER` for a type that the table lacks."""
    return METER_KINDS.get(msgtype, OTHER)


register_meter_kind = METER_KINDS.register
"""Add a kind of yours, by the type of its messages: parameters may name it from now on."""
