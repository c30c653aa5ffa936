"""Cuts time at the readings of the meter, into windows with their energies.

Each window is made of whole pieces of the meter's curve, and every predicted energy is
integrated over these pieces, so that all are of the very same time. A piece counts once the
samples have passed its end by ``METER_WAIT``: what the meter says a little late still counts in
its own time.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from robot_energy.blocks import NANOSECOND, Float, Int, MeterBlock, MeterLocation
from robot_energy.inputs.meter.power_curve import MeterCurve
from robot_energy.timeline.pieces import CoveredPieces

WINDOW = 5.0  # shortest window [s]
METER_WAIT = 2_000_000_000  # ns
MAX_HOLE = 1_000_000_000  # between two pieces of a window [ns]
MAX_PIECES = 20_000  # that wait for samples
KEPT_NS = 120_000_000_000  # of predicted energies, behind the newest sample


class Window(NamedTuple):
    """Energies over one window.

    Attributes:
        stamp_ns: Where it ends. [ns]
        duration: Of its pieces. [s]
        measured: By the meter. [J]
        energies: Predicted ones, in the order they were given, shape (E,). [J]
    """

    stamp_ns: int
    duration: float
    measured: float
    energies: Float


class MeterWindows:
    """Predicted and measured energy over the same windows.

    Args:
        energies: How many predicted energies there are.
        curve: Turns readings into pieces.

    Attributes:
        location: Where the meter sits.
    """

    def __init__(self, energies: int, curve: MeterCurve) -> None:
        self.location = MeterLocation.UNKNOWN
        self._curve = curve
        self._pieces = CoveredPieces.empty()
        self._begin(energies)

    def _begin(self, energies: int) -> None:
        """Forget what was predicted: the stamps have jumped, or samples are missing."""
        self._stamp: Int = np.empty(0, dtype=np.int64)
        self._total: Float = np.empty((0, energies))  # energy up to each stamp [J]
        self._power: Float = np.empty((0, energies))
        self._segment: int | None = None
        self._drop()

    def _drop(self) -> None:
        """Begin a new window with the next piece."""
        self._end_ns = 0  # of the newest piece in it
        self._sum: Float = np.zeros(2 + self._total.shape[1])  # measured, duration, predicted

    def measure(self, block: MeterBlock) -> None:
        """Take readings.

        Args:
            block: In order of arrival.
        """
        self.location = block.location
        for number, part in enumerate(self._curve.step(block)):
            if number:
                self._pieces = CoveredPieces.empty()
            self._pieces = self._pieces.join(part)[slice(-MAX_PIECES, None)]

    def step(self, stamp_ns: Int, segment: Int, power: Float, until_ns: int) -> Iterator[Window]:
        """Take predicted powers and return the windows that are complete.

        Args:
            stamp_ns: Rising but for jumps, shape (N,). [ns]
            segment: Shape (N,).
            power: Shape (N, E). [W]
            until_ns: Pieces that end later wait. [ns]

        Yields:
            The windows, in order of time.
        """
        bounds = np.flatnonzero(np.diff(segment)) + 1
        for rows in np.split(np.arange(len(stamp_ns)), bounds):
            if self._segment != segment[rows[0]]:
                yield from self._windows(until_ns)
                self._begin(power.shape[1])
                self._segment = int(segment[rows[0]])
            self._extend(stamp_ns[rows], power[rows])
        yield from self._windows(until_ns)

    def _extend(self, stamp_ns: Int, power: Float) -> None:
        good = np.isfinite(power.sum(axis=1))
        if not good.all():  # nothing is known of the time around such samples
            self._begin(power.shape[1])
            return
        stamp = np.concatenate([self._stamp[-1:], stamp_ns])
        value = np.concatenate([self._power[-1:], power])
        half = 0.5 * NANOSECOND * np.diff(stamp)[:, None]
        more: Float = np.cumsum((value[1:] + value[:-1]) * half, axis=0)
        zero: Float = np.zeros((1, power.shape[1]))
        base = self._total[-1:] if len(self._total) else zero
        if not len(self._stamp):
            more = np.concatenate((zero, more))
        oldest = int(stamp_ns[-1]) - KEPT_NS
        old = int(np.searchsorted(self._stamp, oldest))
        self._stamp = np.concatenate([self._stamp[old:], stamp_ns])
        self._total = np.concatenate([self._total[old:], np.asarray(base + more)])
        self._power = np.concatenate([self._power[old:], power])

    def _windows(self, until_ns: int) -> Iterator[Window]:
        if not len(self._stamp):
            return
        limit = min(until_ns, int(self._stamp[-1]))
        ready = int(np.searchsorted(self._pieces.end_ns, limit, side="right"))
        pieces, self._pieces = self._pieces[slice(0, ready)], self._pieces[slice(ready, None)]
        pieces = pieces[pieces.start_ns >= self._stamp[0]]
        spans = np.stack([pieces.start_ns, pieces.end_ns])
        columns: list[Float] = list(self._total.T)
        ends = [np.interp(spans, self._stamp, total) for total in columns]
        measured = pieces.mean_power * pieces.duration
        energies = np.stack([measured, pieces.duration, *(end[1] - end[0] for end in ends)], axis=1)
        for start, end, part in zip(*spans.tolist(), energies, strict=True):
            if start - self._end_ns > MAX_HOLE:
                self._drop()
            self._end_ns = end
            self._sum = self._sum + part
            if self._sum[1] > WINDOW - 1e-6:
                yield Window(end, float(self._sum[1]), float(self._sum[0]), self._sum[2:])
                self._drop()
