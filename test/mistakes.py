"""Recordings with a deliberate mistake, made from sound ones, to try the checks on."""

from __future__ import annotations

from collections.abc import Callable
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
) -> Path:
    """Copy a bag with its joint states or its meter changed message by message.

    Args:
        source: Bag.
        out: Folder of the new bag.
        states: Changes a joint state in place.
        meter: Changes a meter reading in place.
        seconds: Length of the copy, from the start. [s]
    """
    bag = BagReader(source)
    changes = {STATES: states, METER: meter}
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


def mistakes(
    joint: int, other: int, all_joints: int
) -> dict[str, tuple[str, Change | None, Change | None]]:
    """Ten mistakes: the cause to be named, and what to change in joint states and meter.

    Args:
        joint: The joint with the mistake.
        other: Exchanged with it.
        all_joints: How many there are.
    """
    every = list(range(all_joints))
    return {
        "sign of one torque": ("torque_sign", turned("effort", [joint]), None),
        "sign of one joint": (
            "joint_sign", both(turned("position", [joint]), turned("velocity", [joint])), None
        ),
        "sign of all torques": ("torque_sign", turned("effort", every), None),
        "degrees": ("degrees", scaled(("position", "velocity"), 180 / np.pi), None),
        "zero offset 0.1 rad": ("zero_offset", shifted(joint, 0.1), None),
        "torque scale sqrt 2": ("torque_scale", scaled(("effort",), 2**0.5), None),
        "two joints exchanged": ("joint_order", swapped(joint, other), None),
        "meter sign": ("meter_sign", None, metered("power", -1.0)),
        "meter in kW": ("meter_unit", None, metered("power", 1e-3)),
        "meter clock 0.3 s": ("meter_clock", None, delayed(0.3)),
    }  # fmt: skip
