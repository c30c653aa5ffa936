"""Errors of the prediction against the meter of one bag, by temperature of the motors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot_energy.blocks import NANOSECOND, Float, Int
from robot_energy.pipeline import Output
from robot_energy.timeline.pieces import Compared
from robot_energy.units import SECOND_NS

BIN = 5.0  # width of a bin of temperature [K]


class MeterErrors:
    """Remembers how warm the motors were, once a second, and sums the errors by it."""

    def __init__(self) -> None:
        self._stamps: list[Int] = []
        self._degc: list[Float] = []
        self._second = -1

    def take(self, output: Output) -> None:
        """Take what a step of the pipeline gave.

        Args:
            output: In time order.
        """
        if (block := output.power) is None or not len(block):
            return
        second = block.stamp_ns // SECOND_NS
        new = np.flatnonzero(np.diff(second, prepend=self._second))
        self._second = int(second[-1])
        if len(new):
            self._stamps.append(block.stamp_ns[new])
            self._degc.append(block.motor_temperature_degc[new].mean(axis=1))

    def table(self, compared: Sequence[Compared]) -> list[dict[str, Any]]:
        """Return one row for each bin with errors, of plain values.

        Args:
            compared: All that was compared, in the order of time.
        """
        if not self._stamps or not compared:
            return []
        pieces = Compared.concatenate(list(compared))
        stamps, degc = np.concatenate(self._stamps), np.concatenate(self._degc)
        order = np.argsort(stamps, kind="stable")  # stamps may jump back
        place = np.searchsorted(stamps[order], pieces.available_ns, side="right") - 1
        warm = degc[order][np.maximum(place, 0)]
        used = np.isfinite(warm) & (pieces.duration_ns > 0)
        number = np.floor(warm[used] / BIN).astype(np.int64)
        time_ns, measured = pieces.duration_ns[used], pieces.measured[used]
        error = pieces.predicted[used] - measured
        rows: list[dict[str, Any]] = []
        for one in np.unique(number).tolist():
            own = number == one
            squares = error[own] ** 2 / (time_ns[own] * NANOSECOND)
            rows.append(
                {
                    "degc": (one + 0.5) * BIN,
                    "compared_ns": int(time_ns[own].sum()),
                    "measured": float(measured[own].sum()),
                    "error": float(error[own].sum()),
                    "error_squares": float(squares.sum()),
                }
            )
        return rows
