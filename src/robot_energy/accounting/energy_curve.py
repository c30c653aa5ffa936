"""Energies over time for plots, in bounded memory: neighbours are merged, no joule is lost."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from robot_energy.accounting.averaging import MeanBlock
from robot_energy.timeline.blocks import NANOSECOND, Block, Float, Int
from robot_energy.timeline.pieces import Compared

MAX_ROWS = 2**16  # many more than the points of a figure
MAX_PIECES = 1024  # arrays that are kept before they are joined


class EnergyRows(Block):
    """Stretches of time in order."""

    stamp_ns: Annotated[Int, "Where each ends, shape (K,). [ns]"]
    begin_ns: Annotated[Int, "Shape (K,). [ns]"]
    duration_ns: Annotated[Int, "Time that is covered between them, shape (K,). [ns]"]
    energy: Annotated[Float, "Of that time, shape (K, columns). [J]"]


class EnergyCurve:
    """Collects energies by the stamp at which they were known.

    What has the same stamp is one stretch. Where there are more than `max_rows`, every two,
    four, eight, ... neighbours become one; how the input was cut into blocks makes no
    difference.
    """

    def __init__(self, columns: int, max_rows: int = MAX_ROWS) -> None:
        self._max = max_rows
        self._every = 1  # stretches in a row
        self._count = 0  # stretches that are complete
        nothing = np.empty(0, dtype=np.int64)
        none = EnergyRows(nothing, nothing, nothing, np.empty((0, columns)))
        self._open = none  # the last one, which may go on
        self._pieces = [(nothing, none)]  # numbers of the first stretch in each row, and rows

    def add(self, stamp_ns: Int, duration_ns: Int, energy: Float) -> None:
        """Add energies.

        Args:
            stamp_ns: End of each stretch, in order, shape (K,). [ns]
            duration_ns: Time covered by each stretch, shape (K,). [ns]
            energy: Energy of each stretch, shape (K, columns). [J]
        """
        if not len(stamp_ns):
            return
        stamp = np.concatenate([self._open.stamp_ns, stamp_ns])
        edges = np.flatnonzero(np.diff(stamp, prepend=stamp[0] - 1))
        duration = np.add.reduceat(np.concatenate([self._open.duration_ns, duration_ns]), edges)
        total = np.add.reduceat(np.concatenate([self._open.energy, energy]), edges, axis=0)
        rows = EnergyRows(stamp[edges], stamp[edges] - duration, duration, total)
        self._open = rows[slice(-1, None)]
        closed = len(edges) - 1
        if closed:
            numbers = np.arange(self._count, self._count + closed)
            self._pieces.append((numbers, rows[slice(0, -1)]))
            self._count += closed
        if len(self._pieces) > MAX_PIECES or closed > self._max:
            self._join()

    def rows(self) -> EnergyRows:
        """Return all that was taken, in at most `max_rows` rows and one."""
        self._join()
        _, rows = self._pieces[0]
        return EnergyRows.concatenate([rows, self._open])

    def _join(self) -> None:
        """Make one piece of all, and merge neighbours while they are too many."""
        numbers = np.concatenate([numbers for numbers, _ in self._pieces])
        rows = EnergyRows.concatenate([rows for _, rows in self._pieces])
        while -(-self._count // self._every) > self._max:
            self._every *= 2
        if len(numbers):
            group = numbers // self._every
            edges = np.flatnonzero(np.diff(group, prepend=group[0] - 1))
            lasts = np.append(edges[1:], len(group)) - 1
            numbers = numbers[edges]
            rows = EnergyRows(
                rows.stamp_ns[lasts],
                rows.begin_ns[edges],
                np.add.reduceat(rows.duration_ns, edges),
                np.add.reduceat(rows.energy, edges, axis=0),
            )
        self._pieces = [(numbers, rows)]


def add_compared(curve: EnergyCurve, compared: Compared) -> None:
    """Add energy at the meter to a curve: measured, predicted as it shows it, drawn."""
    energy = np.stack([compared.measured, compared.predicted, compared.drawn], axis=1)
    curve.add(compared.stamp_ns, compared.duration_ns, energy)


def add_means(curve: EnergyCurve, means: MeanBlock) -> None:
    """Add the predicted net energy from the grid, where it is known."""
    power = means.predicted_power
    known = np.isfinite(power) & (means.period > 0)
    period = means.period[known]
    duration_ns = np.rint(period / NANOSECOND).astype(np.int64)
    curve.add(means.stamp_ns[known], duration_ns, (power[known] * period)[:, None])
