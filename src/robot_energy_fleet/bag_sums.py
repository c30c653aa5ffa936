"""Sums of one bag: time and energy by clock hours, errors against the meter by temperature."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot_energy.accounting.sample_counts import MIN_STANDBY
from robot_energy.foundation.units import HOUR_NS, SECOND_NS
from robot_energy.model import RobotModel
from robot_energy.physics.drivetrain import motor_rest
from robot_energy.pipeline import Output
from robot_energy.timeline.blocks import NANOSECOND, Float, Int
from robot_energy.timeline.pieces import Compared
from robot_energy_plan.consecutive import ConsecutiveBlocks

SUMS = ("observed_time", "motion_time", "grid_energy", "standby_time", "standby_energy")
OBSERVED, MOTION, ENERGY, STANDBY, STANDBY_ENERGY = range(len(SUMS))
BIN = 5.0  # width of a bin of temperature [K]


class HourSums:
    """Gathers the sums of one bag.

    Energy is that from the grid, by the trapezoidal rule between samples of one segment; what is
    fed back does not count. Rest is standby once it has lasted `MIN_STANDBY`, from its beginning; a
    robot rests while its motors are slower than motion that says something of friction, so that
    noise of a reported velocity is not motion.

    Attributes:
        hours: Sums by the stamp at which the hour begins: observed time [s], time not at rest [s],
            energy [J], standby [s], energy in standby [J].
    """

    def __init__(self, model: RobotModel) -> None:
        self._floor = motor_rest(model)
        self.hours: dict[int, Float] = {}
        self._blocks = ConsecutiveBlocks()
        self._rest: dict[int, Float] = {}  # sums of a rest that is not standby yet
        self._rested = 0.0

    def take(self, output: Output) -> None:
        """Take what a step of the pipeline gave."""
        if output.power is None:
            return
        block, time = self._blocks.joined(output.power)
        stamp, power = block.stamp_ns, np.maximum(np.nan_to_num(block.grid_power), 0.0)
        energy = 0.5 * (power[1:] + power[:-1]) * time
        rest = (np.abs(block.motor_velocity[:-1]) <= self._floor).all(axis=1) & (time > 0.0)
        hour = stamp[:-1] // HOUR_NS
        cuts = (np.flatnonzero((np.diff(hour) != 0) | (np.diff(rest) != 0)) + 1).tolist()
        for start, stop in zip([0, *cuts], [*cuts, len(time)], strict=True):
            if stop > start:
                sums = (float(time[start:stop].sum()), float(energy[start:stop].sum()))
                self._add(int(hour[start]) * HOUR_NS, bool(rest[start]), *sums)

    def table(self) -> list[dict[str, Any]]:
        """Return one row for each hour, of plain values."""
        return [
            {"hour_ns": hour, **dict(zip(SUMS, sums.tolist(), strict=True))}
            for hour, sums in sorted(self.hours.items())
        ]

    def _add(self, hour: int, rest: bool, time: float, energy: float) -> None:
        own = self.hours.setdefault(hour, np.zeros(len(SUMS)))
        own[OBSERVED] += time
        own[ENERGY] += energy
        if not rest:
            own[MOTION] += time
            self._rest.clear()
            self._rested = 0.0
            return
        self._rested += time
        waiting = self._rest.setdefault(hour, np.zeros(2))
        waiting += time, energy
        if self._rested >= MIN_STANDBY:
            for at, sums in self._rest.items():
                self.hours[at][STANDBY:] += sums
            self._rest.clear()


class MeterErrors:
    """Remembers how warm the motors were, once a second, and sums the errors by it."""

    def __init__(self) -> None:
        self._stamps: list[Int] = []
        self._degc: list[Float] = []
        self._second = -1

    def take(self, output: Output) -> None:
        """Take what a step of the pipeline gave."""
        if (block := output.power) is None or not len(block):
            return
        second = block.stamp_ns // SECOND_NS
        new = np.flatnonzero(np.diff(second, prepend=self._second))
        self._second = int(second[-1])
        if len(new):
            self._stamps.append(block.stamp_ns[new])
            self._degc.append(block.motor_temperature_degc[new].mean(axis=1))

    def table(self, compared: Sequence[Compared]) -> list[dict[str, Any]]:
        """Return one row for each bin with errors, of plain values."""
        if not self._stamps or not compared:
            return []
        pieces = Compared.concatenate(list(compared))
        stamps, degc = np.concatenate(self._stamps), np.concatenate(self._degc)
        order = np.argsort(stamps, kind="stable")  # stamps may jump back
        place = np.searchsorted(stamps[order], pieces.stamp_ns, side="right") - 1
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
