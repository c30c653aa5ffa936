"""Measured electrical power of each drive, from topics without names or stamps of their own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np

from robot_energy.bag import BagReader
from robot_energy.bag.cdr import Decoder
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import MissingTopicError
from robot_energy.foundation.units import DqScaling
from robot_energy.physics.electrical_power import electrical_power
from robot_energy.timeline.blocks import NANOSECOND, Float, Int
from robot_energy.timeline.stamps import valid_stamps
from robot_energy_logs.columns import ROTOR_FRAME

MAX_BETWEEN = 0.1  # time between two messages of a current or voltage that is bridged [s]
ARRAYS = ("std_msgs/msg/Float64MultiArray", "std_msgs/msg/Float32MultiArray")


class MeasuredDrivePower(Described):
    """Readings of the electrical power of all drives, in model joint order."""

    stamp_ns: Annotated[Int, "Rising, shape (N,). [ns]"]
    power: Annotated[Float, "Positive into the drive, shape (N, n). [W]"]
    refused: Annotated[int, "Messages that were malformed, of another length, or not newer."]

    def at(self, stamp_ns: Int, longest: float) -> Float:
        """Return the power between readings at given instants, NaN off them, shape (K, n). [W]

        Args:
            stamp_ns: Instants, of shape (K,). [ns]
            longest: Time between two readings that is bridged. [s]
        """
        if len(self.stamp_ns) < 2:
            return np.full((len(stamp_ns), self.power.shape[1]), np.nan)
        right = np.clip(np.searchsorted(self.stamp_ns, stamp_ns), 1, len(self.stamp_ns) - 1)
        before, after = self.stamp_ns[right - 1], self.stamp_ns[right]
        inside = (stamp_ns >= before) & (stamp_ns <= after)
        inside &= after - before <= longest / NANOSECOND
        share = ((stamp_ns - before) / (after - before))[:, None]
        between = self.power[right - 1] * (1.0 - share) + self.power[right] * share
        return np.where(inside[:, None], between, np.nan)


class DrivePowerTopics(Described):
    """Where a bag has the power of the drives: arrays with one value per drive."""

    topics: Annotated[
        tuple[str, ...],
        "Of Float64MultiArray or Float32MultiArray: one with powers [W], or four with "
        "currents d and q [A] and voltages d and q [V], from which the power is computed "
        "(paper B eq. 1) at each message of the second.",
    ]
    joints: Annotated[
        tuple[str, ...] | None, "In the order of the values; None: as in the model."
    ] = None
    scaling: DqScaling = "peak"

    def __post_init__(self) -> None:
        if len(self.topics) not in (1, len(ROTOR_FRAME)):
            raise MissingTopicError(
                f"{len(self.topics)} topics for the power of the drives",
                f"one with powers, or four: {', '.join(ROTOR_FRAME)}",
            )

    def read(self, path: str | Path, names: Sequence[str]) -> MeasuredDrivePower:
        """Read the power of the drives, by the time each message was recorded.

        Returns:
            The readings; NaN where a current or voltage is missing for longer than 0.1 s.

        Raises:
            MissingTopicError: If a topic is absent, of another type, has another number of
                values, or the order lacks a joint.
            BagError: If the bag cannot be read.
        """
        parts = [_read_array(path, topic, names, self.joints) for topic in self.topics]
        if len(parts) == 1:
            return parts[0]
        stamp_ns = parts[1].stamp_ns
        values = [part.at(stamp_ns, MAX_BETWEEN) for part in parts]
        power = electrical_power(*values, scaling=self.scaling)
        return MeasuredDrivePower(stamp_ns, power, sum(part.refused for part in parts))


def drive_topics(
    topics: str | Sequence[str] | None,
    joints: Sequence[str] | None = None,
    scaling: DqScaling = "peak",
) -> DrivePowerTopics | None:
    """Return where bags have the power of the drives; None if no topic is given.

    Args:
        joints: In the order of the values; None: as in the model.
    """
    if not topics:
        return None
    given = (topics,) if isinstance(topics, str) else tuple(topics)
    return DrivePowerTopics(given, None if joints is None else tuple(joints), scaling)


def _read_array(
    path: str | Path, topic: str, names: Sequence[str], order: Sequence[str] | None
) -> MeasuredDrivePower:
    """Read one value per drive from a topic, by the time it was recorded."""
    bag = BagReader(path)
    info = bag.require(topic, ARRAYS)
    given = tuple(order or names)
    if not set(names) <= set(given):
        raise MissingTopicError(
            f"the order of {topic} lacks {', '.join(sorted(set(names) - set(given)))}",
            "every joint of the model",
        )
    place = [given.index(name) for name in names]
    decoder = Decoder(info.msgtype, ("data",), bag.typestore)
    stamps: list[Int] = []
    powers: list[Float] = []
    received = 0
    widths: set[int] = set()
    for part in bag.parts([topic]):
        batch = part[topic]
        received += len(batch)
        for run in decoder.decode(batch).runs:
            values = run.array("data")
            widths.add(values.shape[1])
            if values.shape[1] == len(given):
                logged = batch.log_time_ns[run.rows]
                stamps.append(logged[valid_stamps(logged)])
                powers.append(values[valid_stamps(logged)][:, place].astype(np.float64))
    if not stamps:
        found = f"{sorted(widths)[0]} values" if widths else "no readable message"
        raise MissingTopicError(
            f"{topic} of {bag.path} has {found}",
            f"{len(given)} values, one per drive: {', '.join(given)}",
            "name the joints in the order of the values with --drive-joints",
        )
    stamp, power = np.concatenate(stamps), np.concatenate(powers)
    newer = np.diff(np.maximum.accumulate(stamp), prepend=-1) > 0
    return MeasuredDrivePower(stamp[newer], power[newer], received - int(newer.sum()))
