"""A predicted power as a meter with a delay and a low pass shows it.

The reading y of a meter with delay d and time constant T follows the power p that is drawn by

    T dy/dt = p(t - d) - y

Between two samples p is straight, ``p = p0 + s (t - t0)``, and with ``b = y - p`` the solution is

    b(t) = b0 exp(-(t - t0) / T) - s T (1 - exp(-(t - t0) / T))

The energy that the meter shows from t1 to t2 follows from the equation itself, without another
approximation: ``integral of y = integral of p(t - d) - T (y(t2) - y(t1))``. A stretch of known
power begins settled: before it the power was that of its first sample.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from itertools import accumulate
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import Described
from robot_energy.foundation.units import NANOJOULE_PER_JOULE, SECOND_NS
from robot_energy.model import RobotModel
from robot_energy.timeline.blocks import NANOSECOND, Block, Float, Int, differences
from robot_energy.timeline.pieces import Compared

STRETCH_NS = 5_000_000_000  # whose energies show the lag: about a motion
READING_NS = 100_000_000  # readings of so much time are one, if a meter reads faster
MIN_SHARE = 0.5  # of a stretch that must be compared
MIN_STRETCHES = 12  # before a lag is found: a minute
MAX_STRETCHES = 120  # behind it: ten minutes
MAX_LAG = 1.0  # that is found [s]
SAME = 1e-6  # of a reading by which those of a meter that stands still differ
MIN_STILL = 8.0  # s of equal readings that are worth a sentence
MIN_READINGS = 10  # among them
VARIES = 0.2  # standard deviation over mean of the power of a robot that works: 0.6 to 1
SIGNIFICANT = 3.0  # standard deviations of a lag that is believed
SQUARES_UNIT = 1e3  # whole numbers of squared power over time in one W² s
WINDOW = 60  # of the rolling residual [s]
MAX_WAITING = 4096  # intervals whose sums are made together
Sums = list[int]  # compared time [ns], measured energy [nJ], predicted energy [nJ]


class MeterResponse(Described):
    """How late a meter shows what is drawn."""

    time_constant: Annotated[float, "Of its low pass. [s]"] = 0.0
    delay: Annotated[float, "Of its readings behind the power. [s]"] = 0.0
    stated: Annotated[
        bool, "Whether the model states it; else the monitor finds it from the readings."
    ] = False

    @property
    def sentence(self) -> str:
        """That the monitor found it; empty where it did not."""
        if self.stated or not self.time_constant:
            return ""
        return (
            f"the meter shows power {self.time_constant:.2f} s late, as found from its readings: "
            "powers are compared with that lag; state meter.time_constant in the model file to "
            "have it from the beginning"
        )

    @classmethod
    def of(cls, model: RobotModel) -> MeterResponse | None:
        """Return what a model states of its meter; None for nothing."""
        if (meter := model.meter) is None:
            return None
        values = (0.0 if one is None else one.value for one in (meter.time_constant, meter.delay))
        return cls(*values, stated=True)


class _Followed(Block):
    """Samples that the meter has followed."""

    stamp_ns: Annotated[Int, "Shape (N,). [ns]"]
    power: Annotated[Float, "Drawn, straight until the next one, shape (N,). [W]"]
    behind: Annotated[Float, "What the meter shows beyond it, shape (N,). [W]"]
    constant: Annotated[Float, "Time constant until the next one, shape (N,). [s]"]
    energy: Annotated[Float, "What the meter shows since a time before the first, shape (N,). [J]"]
    first_ns: Annotated[Int, "Where the stretch of each begins, shape (N,). [ns]"]
    first_power: Annotated[Float, "The power there, shape (N,). [W]"]


class ShownPower:
    """Follows a predicted power as the meter shows it.

    The recursion goes from sample to sample, so the cutting of the input makes no difference.

    Args:
        delay: Of the meter. [s]

    Attributes:
        waiting: Samples for `follow`: stamps in the order of time [ns], powers [W], and where
            nothing is known between a sample and the one before; shape (N,) each.
        needed_ns: No interval before it is asked for any more. [ns]
    """

    def __init__(self, delay: float = 0.0) -> None:
        self._delay_ns = round(delay / NANOSECOND)
        self.waiting: list[tuple[Int, Float, NDArray[np.bool_]]] = []
        self.needed_ns = 0
        self._rows: _Followed | None = None

    def follow(self, since_ns: list[int], constants: list[float]) -> None:
        """Let the meter show what waits.

        Args:
            since_ns: From when on each time constant counts but the first. [ns]
            constants: Time constants. [s]
        """
        if not self.waiting:
            return
        stamp, power, begins = map(np.concatenate, zip(*self.waiting, strict=True))
        self.waiting.clear()
        constant = np.array(constants)[np.searchsorted(since_ns, stamp, side="right")]
        before = self._rows
        if before is None:
            begins[0] = True
            last = _Followed(
                stamp[:1], power[:1], np.zeros(1), constant[:1], np.zeros(1), stamp[:1], power[:1]
            )
        else:
            needed = np.searchsorted(before.stamp_ns, self.needed_ns - self._delay_ns, side="left")
            before = before[slice(max(int(needed) - 1, 0), None)]
            last = before[slice(-1, None)]
        step_ns = np.diff(np.concatenate([last.stamp_ns, stamp]))
        low = np.concatenate([last.power, power[:-1]])
        slow = np.concatenate([last.constant, constant[:-1]])
        known = ~begins
        first = float(last.behind[0])
        behind = np.zeros(len(stamp))
        if first != 0.0 or slow.any():
            kept, moved = _decay(step_ns * NANOSECOND, slow)
            kept, moved = np.where(known, kept, 0.0), np.where(known, (power - low) * moved, 0.0)
            steps = zip(kept.tolist(), moved.tolist(), strict=True)
            found = accumulate(steps, lambda b, step: b * step[0] - step[1], initial=first)
            behind = np.fromiter(found, dtype=np.float64, count=len(stamp) + 1)[1:]
        lags = slow * (power + behind - (low + np.concatenate([last.behind, behind[:-1]])))
        energy = np.where(known, 0.5 * (low + power) * (step_ns * NANOSECOND) - lags, 0.0)
        total = np.add.accumulate(np.concatenate([last.energy, energy]))[1:]
        place = np.maximum.accumulate(np.where(begins, np.arange(len(stamp)), -1))
        fresh = place >= 0
        rows = _Followed(
            stamp,
            power,
            behind,
            constant,
            total,
            np.where(fresh, stamp[place], last.first_ns),
            np.where(fresh, power[place], last.first_power),
        )
        self._rows = rows if before is None else _Followed.concatenate([before, rows])

    def energy(self, drawn: Float, begin_ns: Int, end_ns: Int) -> Float:
        """Return what the meter shows over intervals without a sample within, shape (K,). [J]

        Args:
            drawn: Energy that is drawn over each, shape (K,). [J]
            begin_ns: Shape (K,). [ns]
            end_ns: Within the samples that were followed, shape (K,). [ns]
        """
        rows = self._rows
        if rows is None or not len(drawn):
            return drawn
        if not (self._delay_ns or rows.behind.any() or rows.constant.any()):
            return drawn  # the meter shows what is drawn
        own = np.searchsorted(rows.stamp_ns, end_ns, side="left") - 1
        first_ns, first_power = rows.first_ns[own], rows.first_power[own]
        begin, end = begin_ns - self._delay_ns, end_ns - self._delay_ns
        low, high = np.maximum(begin, first_ns), np.maximum(end, first_ns)
        before_ns = np.maximum(first_ns - begin, 0) - np.maximum(first_ns - end, 0)
        shown = _energy_at(rows, high, "left") - _energy_at(rows, low, "right")
        shown = np.where(high > low, shown, 0.0)
        return np.asarray(shown + first_power * (before_ns * NANOSECOND))


def _decay(seconds: Float, constant: Float) -> tuple[Float, Float]:
    """Share of b that is left after a time, and what a step of p over it takes from b."""
    slow = constant > 0.0
    ratio = np.where(slow, seconds, 0.0) / np.where(slow, constant, 1.0)
    safe = np.where(ratio > 0.0, ratio, 1.0)
    kept = np.where(slow, np.exp(-ratio), 0.0)
    moved = np.where(ratio > 0.0, -np.expm1(-safe) / safe, 1.0)
    return kept, np.where(slow, moved, 0.0)


def _energy_at(rows: _Followed, time_ns: Int, side: str) -> Float:
    """Energy that the meter has shown by a time, from the piece before ("left") or behind it."""
    row = np.searchsorted(rows.stamp_ns, time_ns, side="left" if side == "left" else "right") - 1
    row = np.minimum(np.maximum(row, 0), max(len(rows) - 2, 0))
    start, then = rows[row], rows[np.minimum(row + 1, len(rows) - 1)]
    seconds = (time_ns - start.stamp_ns) * NANOSECOND
    whole = np.maximum(then.stamp_ns - start.stamp_ns, 1)
    power = start.power + (then.power - start.power) * ((time_ns - start.stamp_ns) / whole)
    power = np.where(time_ns == start.stamp_ns, start.power, power)
    kept, moved = _decay(seconds, start.constant)
    behind = start.behind * kept - (power - start.power) * moved
    lag = start.constant * (power + behind - (start.power + start.behind))
    return start.energy + 0.5 * (start.power + power) * seconds - lag


class StillReadings:
    """Readings that stay the same to the digit while the predicted power changes.

    Sums are integers, so the cutting of the input makes no difference.

    Attributes:
        longest: Time [s] and value [W] of the longest such run that has ended; 0 s for none.
    """

    def __init__(self) -> None:
        self.longest = (0.0, 0.0)
        self._power, self._stamp_ns = np.nan, 0
        self._sums: Int = np.zeros(5, dtype=np.int64)  # of the run that goes on, see `_still`

    @property
    def open(self) -> tuple[float, float]:
        """The same of the run that goes on."""
        return _still(self._sums.tolist())

    def take(self, compared: Compared) -> None:
        """Take what became comparable, one interval or more."""
        measured, drawn = compared.measured, compared.drawn
        seconds = compared.duration_ns * NANOSECOND
        power = measured / seconds
        before = np.append(self._power, power[:-1])
        fresh = compared.stamp_ns != np.append(self._stamp_ns, compared.stamp_ns[:-1])
        differs = ~(np.abs(power - before) <= SAME * np.abs(before))
        sums = np.stack([measured, drawn, drawn * drawn / seconds * SQUARES_UNIT])
        sums[:2] *= NANOJOULE_PER_JOULE
        table = np.stack([compared.duration_ns, fresh, *np.rint(sums).astype(np.int64)], axis=1)
        differs[0], goes_on = True, not differs[0]
        runs = np.add.reduceat(table, np.flatnonzero(differs), axis=0)
        if goes_on:
            runs[0] += self._sums
        else:
            runs = np.concatenate([self._sums[None], runs])
        for run in runs[:-1][runs[:-1, 0] * NANOSECOND >= MIN_STILL].tolist():
            self.longest = max(self.longest, _still(run))
        self._sums, self._power = runs[-1], float(power[-1])
        self._stamp_ns = int(compared.stamp_ns[-1])


def _still(run: list[int]) -> tuple[float, float]:
    """Time [s] and value [W] of a run of equal readings while the predicted power varies; else 0.

    Args:
        run: Time [ns], readings, measured and predicted energy [nJ], and the sum of squared
            predicted power over time [0.001 W² s].
    """
    time_ns, readings, measured, drawn, squares = run
    seconds = time_ns * NANOSECOND
    if seconds < MIN_STILL or readings < MIN_READINGS:
        return 0.0, 0.0
    mean = drawn / time_ns
    varies = squares / SQUARES_UNIT / seconds - mean**2 > (VARIES * mean) ** 2
    return (seconds, measured / time_ns) if varies else (0.0, 0.0)


class MeterSums:
    """Sums of what was compared, in whole nanojoules: over stretches, and over readings.

    Readings within ``READING_NS`` are one. The cutting of the input makes no difference.
    """

    def __init__(self) -> None:
        self._begun: list[Int | None] = [None, None]  # the sums that may go on
        self._border: tuple[int, float] | None = None  # a stretch, and the power at its end

    def take(
        self, compared: Compared, *energies: Float
    ) -> tuple[list[tuple[list[int], float, int]], Int, Int]:
        """Return what ended with these intervals.

        Args:
            energies: What is summed, measured energies first, shape (K,) each. [J]

        Returns:
            Stretches: end and duration [ns] and sums [nJ]; step of the reading's power from the
            begin to the end, NaN where the stretch before is not known [W]; and the whole second
            from which each counts, as it is known to be complete when the next one begins [ns].
            Readings: the first of these, shape (M, 2 + energies); and the last, shape (M,).
        """
        whole = np.rint(np.stack(energies) * NANOJOULE_PER_JOULE).astype(np.int64)
        table = np.column_stack([compared.stamp_ns, compared.duration_ns, *whole])
        found: list[Int] = []
        for place, length_ns in enumerate((STRETCH_NS, READING_NS)):
            begun = self._begun[place]
            rows = table if begun is None else np.concatenate([begun, table])
            starts = starts_of(rows[:, 0] // length_ns)
            sums = np.add.reduceat(rows, starts, axis=0)
            sums[:, 0] = rows[np.append(starts[1:], len(rows)) - 1, 0]
            self._begun[place] = sums[-1:]
            found += [sums[:-1], -(-rows[starts[1:], 0] // SECOND_NS) * SECOND_NS]
        stretches, known, readings, counts = found
        lasts = readings[np.searchsorted(readings[:, 0], stretches[:, 0])]
        powers = lasts[:, 2] / np.maximum(lasts[:, 1], 1)  # at their ends
        ended: list[tuple[list[int], float, int]] = []
        for row, power, since in zip(
            stretches.tolist(), powers.tolist(), known.tolist(), strict=True
        ):
            before, self._border = self._border, (row[0] // STRETCH_NS, power)
            follows = before is not None and before[0] == self._border[0] - 1
            ended.append((row, power - before[1] if before and follows else math.nan, since))
        return ended, readings, counts


class LagEstimate:
    """How late a meter shows what is drawn, from its readings.

    Over a stretch of 5 s a meter that is late by T shows ``T dy`` less than is drawn, ``dy``
    the step of the reading from its begin to its end; that is fitted to the newest ten
    minutes. Sums are integers, so the cutting of the input makes no difference.
    """

    def __init__(self) -> None:
        self.since_ns: list[int] = []  # from when on each lag counts but the first [ns]
        self.lags = [0.0]  # that later samples may ask for [s]
        self._windows: deque[tuple[float, float]] = deque(maxlen=MAX_STRETCHES)
        self.jump()

    @property
    def known(self) -> bool:
        """Whether enough was compared to find a lag."""
        return len(self._windows) >= MIN_STRETCHES

    def jump(self) -> None:
        """Forget what is open, as where stamps go back; the newest lag stays."""
        self.since_ns, self.lags = [], self.lags[-1:]
        self._sums = MeterSums()

    def begin(self, windows: list[tuple[float, float]]) -> None:
        """Put windows of an earlier run before those of this one.

        Args:
            windows: Errors [J] and steps [W], in the order of time.
        """
        self._windows = deque([*windows, *self._windows], maxlen=MAX_STRETCHES)
        self.lags[-1] = self._lag()

    def take(self, compared: Compared) -> None:
        """Take what became comparable, one interval or more."""
        stretches, _, _ = self._sums.take(compared, compared.measured, compared.drawn)
        for (_, duration_ns, measured, drawn), step, since in stretches:
            if duration_ns >= MIN_SHARE * STRETCH_NS and not math.isnan(step):
                self._windows.append(((drawn - measured) / NANOJOULE_PER_JOULE, step))
                self.since_ns.append(since)
                self.lags.append(self._lag())

    def forget(self, before_ns: int) -> None:
        """Drop lags that no later sample asks for."""
        past = bisect_right(self.since_ns, before_ns)
        del self.since_ns[:past], self.lags[:past]

    def _lag(self) -> float:
        """The lag of the windows; 0 where they do not show one."""
        if not self.known:
            return 0.0
        windows = np.array(self._windows)
        error, step = (windows - windows.mean(axis=0)).T
        squares = float(step @ step)
        if squares <= 0.0:
            return 0.0
        lag = float(error @ step) / squares
        left = error - lag * step
        std = math.sqrt(float(left @ left) / (len(left) - 2) / squares)
        return min(lag, MAX_LAG) if lag > SIGNIFICANT * std else 0.0


class NewestMinute:
    """Sums over the newest minute that was compared, and what readings have shown since the start.

    Sums are integers, so that they do not depend on how the input is cut; few intervals wait for
    others.
    """

    def __init__(self) -> None:
        self.seconds: deque[tuple[int, Sums]] = deque()  # as of the last `sums`
        self._sums: Sums = [0, 0, 0]
        self._waiting: list[Compared] = []
        self._rows = 0  # of them
        self._drawn = self._returned = self._predicted_returned = 0  # since the start [nJ]
        self._still = StillReadings()

    def take(self, compared: Compared) -> None:
        """Take what became comparable."""
        self._waiting.append(compared)
        self._rows += len(compared)
        if self._rows >= MAX_WAITING:
            self._settle()

    @property
    def sums(self) -> Sums:
        """Over the newest minute."""
        self._settle()
        return self._sums

    def newest(self, time: float) -> Sums:
        """Return the sums over the newest seconds.

        Args:
            time: Compared time that they make at least, where there is as much. [s]
        """
        found: Sums = [0, 0, 0]
        for _, sums in reversed(self.seconds):
            if found[0] * NANOSECOND >= time:
                break
            found = [a + b for a, b in zip(found, sums, strict=True)]
        return found

    @property
    def still(self) -> StillReadings:
        """Readings that stay the same, since the start."""
        self._settle()
        return self._still

    @property
    def returned_share(self) -> float:
        """Energy fed back over energy drawn, by the meter; 0 where a prediction gives some. [-]"""
        self._settle()
        return 0.0 if self._predicted_returned or not self._drawn else self._returned / self._drawn

    @property
    def time(self) -> float:
        """Compared time within it. [s]"""
        return self.sums[0] * NANOSECOND

    @property
    def residual_share(self) -> float:
        """Predicted minus measured energy, relative to measured. [-]

        NaN where nothing was compared or measured.
        """
        _, measured, predicted = self.sums
        return (predicted - measured) / abs(measured) if measured else math.nan

    def _settle(self) -> None:
        """Count what waits; how it was cut makes no difference."""
        if not self._rows:
            return
        compared = Compared.concatenate(self._waiting)
        self._waiting.clear()
        self._rows = 0
        self._still.take(compared)
        second = compared.stamp_ns // SECOND_NS
        measured = np.rint(compared.measured * NANOJOULE_PER_JOULE).astype(np.int64)
        predicted = np.rint(compared.drawn * NANOJOULE_PER_JOULE).astype(np.int64)
        self._drawn += int(measured[measured > 0].sum())
        self._returned -= int(measured[measured < 0].sum())
        self._predicted_returned -= int(predicted[predicted < 0].sum())
        starts = starts_of(second)
        table = np.stack([compared.duration_ns, measured, predicted], axis=1)
        sums = np.add.reduceat(table, starts, axis=0)
        for number, row in zip(second[starts].tolist(), sums.tolist(), strict=True):
            self._add(number, row)

    def _add(self, second: int, sums: Sums) -> None:
        seconds = self.seconds
        if seconds and second < seconds[-1][0]:
            seconds.clear()  # the recording loops
            self._sums = [0, 0, 0]
        if seconds and second == seconds[-1][0]:
            seconds[-1][1][:] = [a + b for a, b in zip(seconds[-1][1], sums, strict=True)]
        else:
            seconds.append((second, list(sums)))
        self._sums = [a + b for a, b in zip(self._sums, sums, strict=True)]
        while seconds[0][0] <= second - WINDOW:
            _, old = seconds.popleft()
            self._sums = [a - b for a, b in zip(self._sums, old, strict=True)]


def starts_of(number: Int) -> Int:
    """Return where runs of equal numbers begin, shape (runs,).

    Args:
        number: Shape (N,), N > 0.
    """
    return np.flatnonzero(differences(number, int(number[0]) - 1))
