"""How each message type says temperatures: from decoded columns to names and values."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, Protocol, cast

import numpy as np

from robot_energy.bag.cdr.decode import Run
from robot_energy.foundation.kinds import Kind, Kinds
from robot_energy.timeline.blocks import Float

if TYPE_CHECKING:
    from robot_energy.inputs.sources import TemperatureSource

MOTOR_TEMPERATURES = "ros2_energy_msgs/msg/MotorTemperatures"
TEMPERATURE = "sensor_msgs/msg/Temperature"
FLOAT_ARRAY = "std_msgs/msg/Float64MultiArray"
EXAMPLE_FLOAT_ARRAY = "example_interfaces/msg/Float64MultiArray"
DYNAMIC_JOINT_STATE = "control_msgs/msg/DynamicJointState"
INTERFACE_VALUES = "control_msgs/msg/Float64Values"
INTERFACE_NAMES = "control_msgs/msg/Keys"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"

HEADER = ("header.stamp.sec", "header.stamp.nanosec")
INTERFACES, INTERFACE_NUMBERS = "interface_values.interface_names", "interface_values.values"
TO_DEGC = {"degc": (1.0, 0.0), "kelvin": (1.0, 273.15), "fahrenheit": (5 / 9, 160 / 9)}
"""Units of temperature: factor on a value, and what is subtracted then. [degC]"""
NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")
UNITS = {
    **dict.fromkeys(("c", "degc", "deg c", "celsius", "°c", "° c"), "degc"),
    **dict.fromkeys(("k", "kelvin"), "kelvin"),
    **dict.fromkeys(("f", "degf", "deg f", "fahrenheit", "°f", "° f"), "fahrenheit"),
}


class Said(NamedTuple):
    """What the messages of one run say."""

    names: tuple[str, ...]
    values: Annotated[
        Float, "Shape (m, k), in the unit of the source; NaN where nothing usable is said."
    ]


class Adapter(Protocol):
    """Reads the messages of one type.

    An adapter of a kind with a ``keys_type`` also has an attribute ``keys``, which the
    reader sets to the names in force.
    """

    @property
    def fields(self) -> tuple[str, ...]:
        """Paths of the fields it needs."""
        ...

    def read(self, run: Run, /) -> Said | str:
        """Return what messages of one layout say, or the reason why they cannot be used."""
        ...


@dataclass(frozen=True)
class _Reading:
    """An adapter that keeps nothing."""

    fields: tuple[str, ...]
    said: Callable[[TemperatureSource, Run], Said | str]
    source: TemperatureSource

    def read(self, run: Run) -> Said | str:
        return self.said(self.source, run)


def _reading(
    fields: tuple[str, ...], said: Callable[[TemperatureSource, Run], Said | str]
) -> Callable[[TemperatureSource], Adapter]:
    return partial(_Reading, fields, said)


def _motor_temperatures(source: TemperatureSource, run: Run) -> Said | str:
    return _named(run.names("joint_names"), run.array("temperature_degc"))


def _temperature(source: TemperatureSource, run: Run) -> Said | str:
    joint = source.joints[0] if source.joints and not source.names else None
    frame = str(run.columns["header.frame_id"])
    return _named((joint or frame,), run.array("temperature")[:, None])


def _float_array(source: TemperatureSource, run: Run) -> Said | str:
    return _named(source.joints, run.array("data"))


def _dynamic_joint_state(source: TemperatureSource, run: Run) -> Said | str:
    joints = run.names("joint_names")
    interfaces = cast("tuple[tuple[str, ...], ...]", run.columns[INTERFACES])
    values = cast("Any", run.columns[INTERFACE_NUMBERS])  # (m, j, k), or (m, k) for each joint
    whole = isinstance(run.columns[INTERFACE_NUMBERS], np.ndarray)
    if len(interfaces) != len(joints):
        return "wrong_length"
    names: list[str] = []
    columns: list[Float] = []
    for index, (joint, own) in enumerate(zip(joints, interfaces, strict=True)):
        if source.interface not in own:
            continue
        part: Float = values[:, index] if whole else values[index]
        if part.shape[1] != len(own):
            return "wrong_length"
        names.append(joint)
        columns.append(part[:, own.index(source.interface)])
    return _named(tuple(names), np.stack(columns, axis=1)) if names else "no_temperature"


class _InterfaceValues:
    """Values whose keys, ``joint/interface``, came on a topic of their own."""

    fields = (*HEADER, "values")

    def __init__(self, source: TemperatureSource) -> None:
        self.keys: tuple[str, ...] | None = None
        self._interface = source.interface

    def read(self, run: Run) -> Said | str:
        if self.keys is None:
            return "before_names"
        values = run.array("values")
        if values.shape[1] != len(self.keys):
            return "wrong_length"
        parts = [key.rpartition("/") for key in self.keys]
        chosen = [index for index, part in enumerate(parts) if part[2] == self._interface]
        if not chosen:
            return "no_temperature"
        return _named(tuple(parts[index][0] for index in chosen), values[:, chosen])


class _Diagnostics:
    """Texts such as ``45.2`` or ``45.2 C`` under a status and a key.

    A unit in the text counts more than that of the source, as it stands next to the value.
    """

    fields = (*HEADER, "status.name", "status.values.key", "status.values.value")

    def __init__(self, source: TemperatureSource) -> None:
        self._unit = source.unit
        joints = source.joints
        places = (
            values * len(joints) if len(values) == 1 else values
            for values in (source.names or joints, source.keys)
        )
        self._places = list(zip(joints, *places, strict=True))

    def read(self, run: Run) -> Said | str:
        columns = [cast("Sequence[Any]", run.columns[field]) for field in self.fields[2:]]
        statuses = list(zip(*columns, strict=True))
        found: dict[str, float] = {}
        for joint, name, key in self._places:
            for status, keys, values in statuses:
                begins = name.endswith("*") and status.startswith(name[:-1])
                if (begins or status == name) and key in keys:
                    found[joint] = self._number(values[keys.index(key)])
        if not found:
            return "no_temperature"
        if np.isnan(list(found.values())).all():
            return "not_a_number"
        return _named(tuple(found), np.tile(list(found.values()), (len(run.rows), 1)))

    def _number(self, text: str) -> float:
        """The value of a text in the unit of the source, NaN if it is none."""
        match = NUMBER.fullmatch(text)
        unit = UNITS.get(match[2].lower()) if match and match[2] else self._unit
        if match is None or unit is None:
            return float("nan")
        value = float(match[1])
        if unit == self._unit:
            return value
        (factor, offset), (own_factor, own_offset) = TO_DEGC[unit], TO_DEGC[self._unit]
        return (value * factor - offset + own_offset) / own_factor


@dataclass(frozen=True, kw_only=True)
class TemperatureKind(Kind):
    """One kind of temperature source. Its name is the type of its messages.

    Attributes:
        found_by_type: Whether a topic of this type needs no settings.
        headed: Whether its messages have a header with a stamp.
        needs_joints: Whether the source must list the joints.
        named: Whether ``names`` may say what the messages call the joints.
        single: Whether a message is of one joint.
        by_status: Whether ``names`` and ``keys`` are places in a status, one for all or one
            for each joint, and the joints are then the model's own.
        keys_type: Type of a topic next to it that names the values; empty for none.
        topic_word: A topic with this word may hold temperatures, and the user is informed.
    """

    adapter: Callable[[TemperatureSource], Adapter]
    found_by_type: bool = False
    headed: bool = True
    needs_joints: bool = False
    named: bool = True
    single: bool = False
    by_status: bool = False
    keys_type: str = ""
    topic_word: str = ""


_FLOAT_ARRAY = TemperatureKind(
    name=FLOAT_ARRAY,
    label="Float64MultiArray",
    line="values alone, in the order of the joints of the source",
    adapter=_reading(("data",), _float_array),
    headed=False,
    needs_joints=True,
    named=False,
    topic_word="temp",
)
TEMPERATURE_KINDS = Kinds(
    "temperature type",
    TemperatureKind(
        name=MOTOR_TEMPERATURES,
        label="MotorTemperatures",
        line="parallel arrays of joint names and temperatures",
        adapter=_reading((*HEADER, "joint_names", "temperature_degc"), _motor_temperatures),
        found_by_type=True,
    ),
    TemperatureKind(
        name=TEMPERATURE,
        label="Temperature",
        line="one value; its joint is that of the topic, or said by `frame_id`",
        adapter=_reading((*HEADER, "header.frame_id", "temperature"), _temperature),
        found_by_type=True,
        single=True,
    ),
    _FLOAT_ARRAY,
    replace(
        _FLOAT_ARRAY,
        name=EXAMPLE_FLOAT_ARRAY,
        line="the same, as the RTDE publisher of Universal Robots sends it",
    ),
    TemperatureKind(
        name=DYNAMIC_JOINT_STATE,
        label="DynamicJointState",
        line="interfaces of each joint, one of which is the temperature",
        adapter=_reading(
            (*HEADER, "joint_names", INTERFACES, INTERFACE_NUMBERS),
            _dynamic_joint_state,
        ),
    ),
    TemperatureKind(
        name=INTERFACE_VALUES,
        label="Float64Values",
        line="values whose keys, `joint/interface`, come on a second topic",
        adapter=_InterfaceValues,
        keys_type=INTERFACE_NAMES,
    ),
    TemperatureKind(
        name=DIAGNOSTICS,
        label="DiagnosticArray",
        line="texts such as `45.2 C` under a status and a key",
        adapter=_Diagnostics,
        needs_joints=True,
        by_status=True,
    ),
)

register_temperature_kind = TEMPERATURE_KINDS.register
"""Add a kind of yours, by the type of its messages: parameters may name it from now on."""


def _named(names: tuple[str, ...], values: Float) -> Said | str:
    if values.shape[1] != len(names):
        return "wrong_length"
    return Said(names, values.astype(np.float64))
