"""Recordings with a deliberate mistake, made from sound ones, to try the checks on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from robot_energy.bag import BagReader, BagWriter

STATES = "sensor_msgs/msg/JointState"
METER = "ros2_energy_msgs/msg/PowerReading"
Change = Callable[[Any], None]


def rewrite(
    source: Path,
    out: Path,
    states: Change | None,
    meter: Change | None = None,
    seconds: float = 1e9,
    others: dict[str, Change] | None = None,
) -> Path:
    """Copy a bag with its joint states or its meter changed message by message.

    Args:
        source: Bag.
        out: Folder of the new bag.
        states: Changes a joint state in place.
        meter: Changes a meter reading in place.
        seconds: Length of the copy, from the start. [s]
        others: Changes of messages of other types.
    """
    bag = BagReader(source)
    changes = {STATES: states, METER: meter, **(others or {})}
    with BagWriter(out) as writer:
        for topic, info in bag.topics.items():
            writer.add_topic(topic, info.msgtype)
        for part in bag.parts(bag.topics):
            for topic, batch in part.items():
                change = changes.get(batch.msgtype)
                until = np.searchsorted(batch.log_time_ns, (bag.start_ns or 0) + seconds * 1e9)
                rows = [batch.row(i) for i in range(int(until))]
                if change is not None:
                    for i, row in enumerate(rows):
                        message = bag.typestore.deserialize_cdr(row, batch.msgtype)
                        change(message)
                        rows[i] = bytes(bag.typestore.serialize_cdr(message, batch.msgtype))
                writer.write(topic, batch.log_time_ns[: len(rows)], rows)
    return out


def turned(field: str, joints: list[int]) -> Change:
    """The sign of some joints of a field."""

    def change(message: Any) -> None:
        values = getattr(message, field).copy()
        if len(values):
            values[joints] *= -1.0
            setattr(message, field, values)

    return change


def both(*changes: Change) -> Change:
    """Several changes of one message."""

    def change(message: Any) -> None:
        for one in changes:
            one(message)

    return change


def scaled(fields: tuple[str, ...], factor: float, joints: list[int] | None = None) -> Change:
    """A factor on fields."""

    def change(message: Any) -> None:
        for field in fields:
            values = getattr(message, field).copy()
            values[slice(None) if joints is None else joints] *= factor
            setattr(message, field, values)

    return change


def shifted(joint: int, value: float) -> Change:
    """A zero offset."""

    def change(message: Any) -> None:
        values = message.position.copy()
        values[joint] += value
        message.position = values

    return change


def swapped(first: int, second: int) -> Change:
    """The values of two joints exchanged."""

    def change(message: Any) -> None:
        for field in ("position", "velocity", "effort"):
            values = getattr(message, field).copy()
            if len(values):
                values[[first, second]] = values[[second, first]]
                setattr(message, field, values)

    return change


def metered(field: str, factor: float) -> Change:
    """A factor on the readings of the meter."""

    def change(message: Any) -> None:
        setattr(message, field, getattr(message, field) * factor)

    return change


def delayed(seconds: float) -> Change:
    """Stamps that are late."""
    step = round(seconds * 1e9)

    def change(message: Any) -> None:
        stamp = message.header.stamp
        total = stamp.sec * 1_000_000_000 + stamp.nanosec + step
        stamp.sec, stamp.nanosec = divmod(total, 1_000_000_000)

    return change


@dataclass(frozen=True)
class Mistake:
    """A deliberate mistake.

    Attributes:
        cause: To be named.
        joints: Which have it; empty for all, or for the meter.
        states: What it changes in the joint states.
        meter: What it changes in the readings of the meter.
    """

    cause: str
    joints: tuple[int, ...] = ()
    states: Change | None = None
    meter: Change | None = None


def mistakes(joint: int, other: int, all_joints: int) -> dict[str, Mistake]:
    """Ten mistakes.

    Args:
        joint: The joint with the mistake.
        other: Exchanged with it.
        all_joints: How many there are.
    """
    every, degrees = list(range(all_joints)), 180 / np.pi
    backwards = both(turned("position", [joint]), turned("velocity", [joint]))
    return {
        "sign of one torque": Mistake("torque_sign", (joint,), turned("effort", [joint])),
        "sign of one joint": Mistake("joint_sign", (joint,), backwards),
        "sign of all torques": Mistake("torque_sign", (), turned("effort", every)),
        "degrees": Mistake("degrees", (), scaled(("position", "velocity"), degrees)),
        "zero offset 0.1 rad": Mistake("zero_offset", (joint,), shifted(joint, 0.1)),
        "torque scale sqrt 2": Mistake("torque_scale", (), scaled(("effort",), 2**0.5)),
        "two joints exchanged": Mistake("joint_order", (joint, other), swapped(joint, other)),
        "meter sign": Mistake("meter_sign", meter=metered("power", -1.0)),
        "meter in kW": Mistake("meter_unit", meter=metered("power", 1e-3)),
        "meter clock 0.3 s": Mistake("meter_clock", meter=delayed(0.3)),
    }
