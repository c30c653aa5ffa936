"""Sums of one bag: time and energy by clock hours, errors against the meter by temperature."""

from __future__ import annotations

from typing import Any

import numpy as np

from robot_energy.accounting.exact_sum import MIN_STANDBY
from robot_energy.foundation.units import HOUR_NS, SECOND_NS
from robot_energy.model import RobotModel
from robot_energy.physics.drivetrain import motor_rest
from robot_energy.pipeline import Output
from robot_energy.timeline.blocks import NANOSECOND, Float, Int
from robot_energy.timeline.pieces import Compared
from robot_energy_plan.optimization.deviations import ConsecutiveBlocks

SUMS = ("observed_time", "motion_time", "grid_energy", "standby_time", "standby_energy")
OBSERVED, MOTION, ENERGY, STANDBY, STANDBY_ENERGY = range(len(SUMS))
LAST_NS = 2**62  # behind all stamps
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
        self._stamp_ns: Int = np.empty(0, dtype=np.int64)
        self._degc: Float = np.empty(0)
        self._second = -1
        self._waiting: list[Compared] = []
        self._sums: dict[int, Float] = {}  # by bin: time [ns], measured, error, squares of it

    def compare(self, compared: Compared) -> None:
        """Take what became comparable with the meter, before the step of the same samples."""
        self._waiting.append(compared)

    def take(self, output: Output) -> None:
        """Take what a step of the pipeline gave."""
        if (block := output.power) is None or not len(block):
            return
        second = block.stamp_ns // SECOND_NS
        new = np.flatnonzero(np.diff(second, prepend=self._second))
        self._second = int(second[-1])
        if len(new):
            warm = block.motor_temperature_degc[new].mean(axis=1)
            self._stamp_ns = np.concatenate([self._stamp_ns, block.stamp_ns[new]])
            self._degc = np.concatenate([self._degc, warm])
        self._sum(int(block.stamp_ns[-1]))

    def table(self) -> list[dict[str, Any]]:
        """Return one row for each bin with errors, of plain values, after the last step."""
        self._sum()
        return [
            {
                "degc": (number + 0.5) * BIN,
                "compared_ns": int(sums[0]),
                "measured": float(sums[1]),
                "error": float(sums[2]),
                "error_squares": float(sums[3]),
            }
            for number, sums in sorted(self._sums.items())
        ]

    def _sum(self, until_ns: int = LAST_NS) -> None:
        """Sum what the meter had reported by a time; the temperature of the rest is to come."""
        if not self._waiting or not len(self._stamp_ns):
            return
        whole = Compared.concatenate(self._waiting)
        later = whole.stamp_ns > until_ns
        self._waiting = [whole[later]] if later.any() else []
        order = np.argsort(self._stamp_ns, kind="stable")  # stamps may jump back
        place = np.searchsorted(self._stamp_ns[order], whole.stamp_ns, side="right") - 1
        warm = self._degc[order][np.maximum(place, 0)]
        used = np.isfinite(warm) & (whole.duration_ns > 0) & ~later
        number = np.floor(warm[used] / BIN).astype(np.int64)
        pieces = whole[used]
        error = pieces.predicted - pieces.measured
        squares = error**2 / (pieces.duration_ns * NANOSECOND)
        sums = np.stack([pieces.duration_ns, pieces.measured, error, squares])
        for one in np.unique(number).tolist():
            self._sums[one] = self._sums.get(one, 0.0) + sums[:, number == one].sum(axis=1)
