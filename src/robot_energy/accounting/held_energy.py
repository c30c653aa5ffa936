"""Integrals of what is computed every 10 ms and held in between, such as deviations of power."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robot_energy.accounting.integration import MAX_ENERGY
from robot_energy.blocks import NANOSECOND, Block, Float, Int, PowerBlock


@dataclass(frozen=True)
class HeldEnergies(Block):
    """Rows that have ended, with their integrals.

    Attributes:
        stamp_ns: Where each began, shape (M,). [ns]
        phase: At that sample, shape (M,).
        duration_ns: Integrated time, shape (M,). [ns]
        energy: Shape (M, K). [J]
    """

    phase: NDArray[np.uint8]
    duration_ns: Int
    energy: Float


class _Open(NamedTuple):
    """The row that has not ended: where it began, its phase, its time so far, its values."""

    stamp_ns: int
    phase: int
    duration_ns: int
    values: Float


class HeldIntegrator:
    """Integrates held rows over the observed time by trapezoids, from where each begins.

    A row is complete once the next one begins, so the cutting of the input makes no difference.
    """

    def __init__(self) -> None:
        self._open: _Open | None = None

    def step(self, block: PowerBlock, duration_ns: Int) -> HeldEnergies | None:
        """Take power samples.

        Args:
            block: In time order.
            duration_ns: Observed time up to each sample, shape (N,). [ns]

        Returns:
            What became complete, if anything.
        """
        held, before = block.deviation, self._open
        starts = held.begins.nonzero()[0]
        if not len(starts):
            if before is not None:
                time = before.duration_ns + int(duration_ns.sum())
                self._open = before._replace(duration_ns=time)
            return None
        passed = np.cumsum(duration_ns)
        upto, last = passed[starts], int(starts[-1])
        stamp, phase = block.stamp_ns[starts], block.phase[starts]
        values = held.values[held.row[starts]]
        self._open = _Open(
            int(stamp[-1]), int(phase[-1]), int(passed[-1] - passed[last]), values[-1]
        )
        time = upto[1:] - upto[:-1]
        if before is not None:
            stamp = np.concatenate([[before.stamp_ns], stamp])
            phase = np.concatenate([np.array([before.phase], dtype=np.uint8), phase])
            time = np.concatenate([[before.duration_ns + upto[0]], time])
            values = np.concatenate([before.values[None], values])
        if len(stamp) == 1:
            return None
        energy = (values[1:] + values[:-1]) * (time * (0.5 * NANOSECOND))[:, None]
        np.clip(energy, -MAX_ENERGY, MAX_ENERGY, out=energy)
        return HeldEnergies(stamp[:-1], phase[:-1], time, energy)

    @property
    def open_ns(self) -> int:
        """Where the row began that is not complete, after the first sample. [ns]"""
        return 0 if self._open is None else self._open.stamp_ns

    @property
    def open_energy(self) -> Float | float:
        """Its integral so far, shape (K,). [J]"""
        row = self._open
        return 0.0 if row is None else row.values * (row.duration_ns * NANOSECOND)

    def interrupt(self) -> None:
        """Drop the row that is not complete."""
        self._open = None
