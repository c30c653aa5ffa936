"""Measured electrical power of each drive, from a topic without names or stamps of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot_energy.bag import BagReader
from robot_energy.blocks import NANOSECOND, Float, Int
from robot_energy.cdr import Decoder
from robot_energy.errors import MissingTopicError
from robot_energy.timeline.stamps import valid_stamps

ARRAYS = ("std_msgs/msg/Float64MultiArray", "std_msgs/msg/Float32MultiArray")


@dataclass(frozen=True)
class MeasuredDrivePower:
    """Readings of the electrical power of all drives, in model joint order.

    Attributes:
        stamp_ns: Rising, shape (N,). [ns]
        power: Positive into the drive, shape (N, n). [W]
        refused: Messages that were malformed, of another length, or not newer.
    """

    stamp_ns: Int
    power: Float
    refused: int

    def at(self, stamp_ns: Int, longest: float) -> Float:
        """Return the power at given instants, straight between readings.

        Args:
            stamp_ns: Instants, of shape (K,). [ns]
            longest: Time between two readings that is bridged. [s]

        Returns:
            Shape (K, n), NaN off the readings. [W]
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


def read_drive_power(
    path: str | Path, topic: str, names: Sequence[str], order: Sequence[str] | None = None
) -> MeasuredDrivePower:
    """Read the power of the drives from a bag, by the time each message was recorded.

    Args:
        path: MCAP file or rosbag2 folder.
        topic: Of a Float64MultiArray or Float32MultiArray, one value per drive. [W]
        names: Joints of the model.
        order: Joints in the order of the values; None for that of the model.

    Returns:
        The readings.

    Raises:
        MissingTopicError: If the topic is absent, of another type, has another number of
            values, or the order lacks a joint.
        BagError: If the bag cannot be read.
    """
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
