"""Power meters -> meter blocks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_energy.blocks import MeterBlock, MeterLocation, MeterMeaning
from robot_energy.ingest.accounting import Accounting
from robot_energy.wire.batch import RawBatch
from robot_energy.wire.layout import Decoder, Run, stamp_ns

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

POWER_READING = "ros2_energy_msgs/msg/PowerReading"
FIELDS = (
    "header.stamp.sec",
    "header.stamp.nanosec",
    "meaning",
    "location",
    "power",
    "energy",
    "interval",
)


class MeterIngest:
    """Turns PowerReading messages into blocks.

    All readings of a meter must have one meaning and one location, those of its first
    reading; others are rejected as ``changed_meaning``.

    Args:
        typestore: Message definitions of the source; those known here by default.

    Attributes:
        account: Received, accepted and rejected messages. Acceptance here means that
            the message could be read; the comparison counts what it could use.
    """

    types = (POWER_READING,)

    def __init__(self, typestore: Typestore | None = None) -> None:
        self.account = Accounting()
        self._decoder = Decoder(POWER_READING, FIELDS, typestore)
        self._kind: tuple[MeterMeaning, MeterLocation] | None = None

    def step(self, batch: RawBatch) -> MeterBlock | None:
        """Take messages in order of arrival.

        Args:
            batch: Serialised PowerReading messages.

        Returns:
            The readings, or None if there are none.
        """
        self.account.received += len(batch)
        decoded = self._decoder.decode(batch)
        self.account.reject("malformed", len(decoded.malformed))
        blocks = [block for run in decoded.runs if (block := self._read(run)) is not None]
        return MeterBlock.concatenate(blocks) if blocks else None

    def _read(self, run: Run) -> MeterBlock | None:
        column = {name: np.asarray(run.columns[name]) for name in FIELDS}
        stamp = stamp_ns(run)
        known = np.isin(column["meaning"], (1, 2, 3)) & np.isin(column["location"], (1, 2))
        self.account.reject("unknown_meaning", int((~known).sum()))
        stamped = known & (stamp != 0)
        self.account.reject("zero_stamp", int((known & ~stamped).sum()))
        if not stamped.any():
            return None
        if self._kind is None:
            first = int(np.flatnonzero(stamped)[0])
            self._kind = (
                MeterMeaning(int(column["meaning"][first])),
                MeterLocation(int(column["location"][first])),
            )
        same = (column["meaning"] == self._kind[0]) & (column["location"] == self._kind[1])
        self.account.reject("changed_meaning", int((stamped & ~same).sum()))
        rows = stamped & same
        self.account.accepted += int(rows.sum())
        return MeterBlock(
            stamp[rows],
            column["power"][rows].astype(np.float64),
            column["energy"][rows].astype(np.float64),
            column["interval"][rows].astype(np.float64),
            *self._kind,
        )
