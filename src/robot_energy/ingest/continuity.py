"""Jumps of the stamps: new epochs, and strays that belong to none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_energy.blocks import differences
from robot_energy.ingest.order import BACKWARD_JUMP_NS, SECOND_NS
from robot_energy.ingest.readings import Readings

REACH_NS = BACKWARD_JUMP_NS  # stamps within this of the newest one continue it


@dataclass(frozen=True)
class Stretch:
    """Messages that belong together.

    Attributes:
        readings: In order of arrival.
        new_epoch: Whether the stamps jumped back before them.
        restless: Whether they did so within a second after another jump, as they do when
            two clocks take turns.
        rising: Whether it is known that each stamp is newer than all before.
    """

    readings: Readings
    new_epoch: bool
    restless: bool
    rising: bool = False


class Continuity:
    """Cuts messages at backward jumps of their stamps, and takes strays out.

    A message whose stamp lies more than a second from the newest one waits for the next
    message to say which of the two goes on. If the next continues the newest, the one that
    waited is a stray: a message of the run before a loop, a stale one, a wrong clock. If the
    next continues the one that waited, the stamps have jumped: forward (a gap) or back (a
    new epoch, as when a bag loops or a simulation restarts). So no single message can send
    the state into the past or the future.

    Attributes:
        strays: Messages taken out.
        newest_ns: Newest stamp of the running epoch; None before the first. [ns]
    """

    def __init__(self) -> None:
        self.strays = 0
        self.newest_ns: int | None = None
        self._begin: int | None = None  # first stamp since the last jump
        self._held: Readings | None = None

    @property
    def waiting(self) -> int:
        """Messages that wait for the next one: 0 or 1."""
        return 0 if self._held is None else 1

    def step(self, readings: Readings) -> list[Stretch]:
        """Take messages in order of arrival.

        Args:
            readings: At least one.

        Returns:
            The messages that are known to belong to their epoch; often one stretch.
        """
        stamp = readings.stamp_ns
        if self._held is None:
            first = int(stamp[0]) if self.newest_ns is None else self.newest_ns
            steps = differences(stamp, first)
            rising = bool((steps > 0).all())
            if rising:
                calm = int(steps.max()) <= REACH_NS
            else:
                newest = np.maximum.accumulate(np.concatenate([[first], stamp]))[:-1]
                ahead = stamp - newest
                calm = bool(((ahead > -BACKWARD_JUMP_NS) & (ahead <= REACH_NS)).all())
            if calm:
                if self._begin is None:
                    self._begin = first
                self.newest_ns = int(stamp[-1]) if rising else max(first, int(stamp.max()))
                return [Stretch(readings, new_epoch=False, restless=False, rising=rising)]
        else:
            readings = Readings.joined([self._held, readings])
        return self._sort_out(readings)

    def flush(self) -> list[Stretch]:
        """Return what still waits; nothing says that it is a stray."""
        held, self._held = self._held, None
        if held is None or self.newest_ns is None:
            return []
        stamp = int(held.stamp_ns[0])
        back = stamp < self.newest_ns
        self.newest_ns = self._begin = stamp
        return [Stretch(held, back, restless=False)]

    def _sort_out(self, readings: Readings) -> list[Stretch]:
        stamps: list[int] = readings.stamp_ns.tolist()
        if self.newest_ns is None or self._begin is None:
            self.newest_ns = self._begin = stamps[0]
        newest, begin = self.newest_ns, self._begin
        stretches: list[tuple[list[int], bool, bool]] = [([], False, False)]
        held: int | None = None
        for row, stamp in enumerate(stamps):
            while True:
                if newest - BACKWARD_JUMP_NS < stamp <= newest + REACH_NS:
                    if stamp > newest and held is not None:
                        self.strays += 1
                        held = None
                    newest = max(newest, stamp)
                    stretches[-1][0].append(row)
                    break
                if held is None:
                    held = row
                    break
                waited = stamps[held]
                beyond_both = waited < newest and stamp > newest
                if stamp <= waited - BACKWARD_JUMP_NS or beyond_both:
                    self.strays += 1
                    held = row
                    break
                if waited < newest:  # confirmed: the stamps have jumped back
                    stretches.append(([], True, newest - begin < SECOND_NS))
                stretches[-1][0].append(held)
                newest = begin = waited
                held = None
        self.newest_ns, self._begin = newest, begin
        self._held = None if held is None else readings[slice(held, held + 1)]
        return [
            Stretch(readings[np.asarray(rows, dtype=np.int64)], back, restless)
            for rows, back, restless in stretches
            if rows
        ]
