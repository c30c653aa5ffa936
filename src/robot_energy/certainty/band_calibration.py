"""Scales that make bands hold: how wide they must be for 90 % of a meter's readings to lie within.

The score of a reading is its error over the standard deviation of the prediction. The scale of the
power is the 90 % quantile of the scores of a phase, followed online: a score above the scale
raises it nine times as much as one below lowers it, so that in the long run one in ten lies
above, whatever their distribution and their correlation (conformal quantile tracking). Scores
count from the next whole second on.

Readings are set against the prediction as the meter shows it
(`robot_energy.accounting.meter_response`), so what it shows late is not an error.

Windows of 5 s show what the band of an energy must be (`EnergyCalibration`).

All is causal and all sums are integers, so the cutting of the input makes no difference.
"""

from __future__ import annotations

import math
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from robot_energy.accounting.averaging import MeanBlock
from robot_energy.accounting.meter_response import (
    MIN_SHARE,
    READING_NS,
    STRETCH_NS,
    MeterSums,
    starts_of,
)
from robot_energy.accounting.record import Calibrated
from robot_energy.accounting.registers import HeldEnergies
from robot_energy.certainty.deviation import (
    BUS,
    LOSS_GRID,
    TEMPERATURE,
    Z90,
    BandKind,
    EnergyBand,
    energy_std,
    half_width,
    scores,
)
from robot_energy.certainty.energy_calibration import EnergyCalibration
from robot_energy.foundation.units import MAX_COUNTER, NANOJOULE_PER_JOULE, SECOND_NS
from robot_energy.timeline.blocks import Float, Int, MeterLocation, Phase, PowerBlock, differences
from robot_energy.timeline.pieces import Compared

COVERED = 0.9  # share of the readings that a band holds
SLOT_NS = 20_000_000  # of deviations that wait for the meter
MAX_SLOTS = 20_000  # of them: minutes
MAX_STRETCHES = 16  # that wait for the meter
MIN_READINGS = 60  # scored in a phase before its scale is used
FIRST_STEP = 0.5  # of the logarithm of a scale, falling with the root of the count ...
MIN_STEP = 0.15  # ... down to this: six misses in turn double a scale, 47 hits halve it
MAX_LOG_SCALE = math.log(1e3)
PARTS = [BUS, LOSS_GRID, TEMPERATURE]
POOLED = Phase.UNKNOWN  # the place of all phases together


class _Scored(NamedTuple):
    """A reading: the whole second from which it counts [ns], its phase, its score."""

    counts_ns: int
    phase: int
    score: float


class BandCalibration:
    """Scores the readings of a meter and scales the bands.

    Attributes:
        counts: Readings by phase: scored, of these within the band that was in force, within the
            band of the standard deviation alone, shape (P, 3).
    """

    def __init__(self) -> None:
        self.location = MeterLocation.UNKNOWN
        self.reset()

    def reset(self) -> None:
        """Drop all scores, as after a change of the model."""
        self._log_scale = [math.log(Z90)] * len(Phase)
        self._count = [0] * len(Phase)
        self._energies = EnergyCalibration()
        self.counts: Int = np.zeros((len(Phase), 3), dtype=np.int64)
        self._last_ns: int | None = None
        self.interrupt()

    def interrupt(self) -> None:
        """Drop what is not scored yet: nothing is, from the last to the next sample."""
        self._second: int | None = None  # up to which all is scored
        self._noted: list[HeldEnergies] = []
        self._waiting: list[Compared] = []
        self._slot: Int = np.empty(0, dtype=np.int64)
        self._slots: Int = np.empty((0, len(PARTS) + len(Phase)), dtype=np.int64)
        self._sums = MeterSums()
        self._deviations: dict[int, Int] = {}

    def step(
        self,
        block: PowerBlock,
        held: HeldEnergies | None,
        open_ns: int,
        compared: Compared,
        means: MeanBlock | None,
    ) -> None:
        """Take power samples and what became comparable; set the bands of the means in place."""
        if self.location is MeterLocation.UNKNOWN:
            return
        stamp = block.stamp_ns
        before = int(stamp[0]) if self._last_ns is None else self._last_ns
        self._last_ns = int(stamp[-1])
        jumps = (differences(stamp, before) < 0).nonzero()[0].tolist()
        bounds = [0, *jumps, len(block)]
        pieces = periods = noted = [slice(None)]
        if jumps:
            ended = np.empty(0, dtype=np.int64) if means is None else means.stamp_ns
            begun = np.array([open_ns]) if held is None else np.append(held.stamp_ns, open_ns)
            cut = partial(_between_falls, falls=len(jumps))
            pieces, periods, noted = map(cut, (compared.stamp_ns, ended, begun))
        for number, (start, stop) in enumerate(pairwise(bounds)):
            if number:
                self.interrupt()
            if stop > start:
                if held is not None:
                    self._noted.append(held[noted[number]])
                self._waiting.append(compared[pieces[number]])
                self._set(self._scored(int(stamp[stop - 1])), means, periods[number])

    def _scored(self, now_ns: int) -> list[_Scored]:
        """Return the readings up to the last whole second."""
        second = now_ns // SECOND_NS
        if second == self._second:
            return []
        self._second = second
        if self._noted:
            noted = HeldEnergies.concatenate(self._noted)
            self._noted.clear()
            self._note(noted)
        waiting = Compared.concatenate(self._waiting)
        due = int(np.searchsorted(waiting.stamp_ns, second * SECOND_NS, side="right"))
        self._waiting = [waiting[slice(due, None)]]
        scored = self._score(waiting[slice(0, due)])
        self._slot, self._slots = self._slot[-MAX_SLOTS:], self._slots[-MAX_SLOTS:]
        for old in list(self._deviations)[:-MAX_STRETCHES]:
            del self._deviations[old]
        return scored

    def _note(self, noted: HeldEnergies) -> None:
        """Keep deviations and phases until the meter reads."""
        stamp_ns, duration_ns, energy = noted.stamp_ns, noted.duration_ns, noted.energy
        if not len(stamp_ns):
            return
        columns = energy.shape[1]
        whole = np.empty((len(stamp_ns), columns + 1), dtype=np.int64, order="F")
        whole[:, :columns] = np.rint(energy * NANOJOULE_PER_JOULE)
        whole[:, columns] = duration_ns
        table = np.zeros((len(stamp_ns), len(PARTS) + len(Phase)), dtype=np.int64, order="F")
        table[:, : len(PARTS)] = whole[:, PARTS]
        table[np.arange(len(stamp_ns)), len(PARTS) + noted.phase] = duration_ns
        slot = stamp_ns // SLOT_NS
        starts = starts_of(slot)
        self._slot = np.concatenate([self._slot, slot[starts]])
        self._slots = np.concatenate([self._slots, np.add.reduceat(table, starts, axis=0)])
        stretch = stamp_ns // STRETCH_NS
        starts = starts_of(stretch)
        for number, row in zip(
            stretch[starts].tolist(), np.add.reduceat(whole, starts, axis=0), strict=True
        ):
            known = self._deviations.get(number)
            self._deviations[number] = row if known is None else known + row

    def _score(self, compared: Compared) -> list[_Scored]:
        """Return the readings that are complete."""
        if not len(compared):
            return []
        stretches, readings, counts = self._sums.take(
            compared, compared.measured, compared.predicted, compared.drawn
        )
        for row, step, _ in stretches:
            self._score_stretch(row, 0.0 if math.isnan(step) else step)
        if not len(readings):
            return []
        end, duration = readings[:, 0], readings[:, 1]
        low = np.searchsorted(self._slot, (end - duration) // SLOT_NS)
        high = np.searchsorted(self._slot, end // SLOT_NS)
        total = np.concatenate([np.zeros((1, self._slots.shape[1]), np.int64), self._slots])
        found = np.diff(np.cumsum(total, axis=0)[np.stack([low, high])], axis=0)[0]
        phases = found[:, len(PARTS) :]
        held, phase = phases.sum(axis=1), phases.argmax(axis=1)
        bus, grid, temperature = found[:, : len(PARTS)].T / np.maximum(held, 1)
        rest = np.hypot(bus, grid) if self.location is MeterLocation.GRID else bus
        sound = (held > 0) & (rest > 0) & (duration > 0)
        measured, predicted = readings[:, 2:4].T / np.maximum(duration, 1)
        error, rest = np.abs(predicted - measured), np.where(sound, rest, 1.0)
        score = np.where(sound, scores(error, rest, temperature), np.nan)
        keep = int(np.searchsorted(self._slot, (int(end[-1]) - 2 * READING_NS) // SLOT_NS))
        self._slot, self._slots = self._slot[keep:], self._slots[keep:]
        return [*map(_Scored, counts.tolist(), phase.tolist(), score.tolist())]

    def _score_stretch(self, row: list[int], step: float) -> None:
        end_ns, duration_ns, measured, _, predicted = row
        number = end_ns // STRETCH_NS
        noted = self._deviations.get(number)
        if noted is None or duration_ns < MIN_SHARE * STRETCH_NS or noted[-1] <= 0:
            return
        share = duration_ns / int(noted[-1])
        noted = noted[:-1] * (share / NANOJOULE_PER_JOULE)
        at_bus = self.location is MeterLocation.DC_BUS
        self._energies.take(noted, (predicted - measured) / NANOJOULE_PER_JOULE, step, at_bus)

    def _set(self, scored: list[_Scored], means: MeanBlock | None, periods: slice) -> None:
        """Follow the scores in the order of time, and set the band of each period on the way."""
        if means is None:
            self._follow(scored, 0, None)
            return
        done, found, stamps = 0, list[float](), means.stamp_ns[periods]
        for stamp, phase in zip(stamps.tolist(), means.phase[periods].tolist(), strict=True):
            done = self._follow(scored, done, stamp)
            found.append(self._scale(phase) or 0.0)
        self._follow(scored, done, None)
        scale = np.array(found)
        if (scale > 0.0).any():
            bus, grid, temperature = means.deviation[periods][:, PARTS].T
            same = scale if self.location is MeterLocation.GRID else Z90
            half = half_width(bus, temperature, scale)
            half = np.hypot(half, same * grid)
            means.band_half[periods] = np.where(scale > 0.0, half, means.band_half[periods])
            means.band[periods][scale > 0.0] = BandKind.CALIBRATED

    def _follow(self, scored: list[_Scored], done: int, until_ns: int | None) -> int:
        """Take scores up to a stamp; return how many are taken in all."""
        log_scale, count = self._log_scale, self._count
        for place in range(done, len(scored)):
            counts_ns, phase, score = scored[place]
            if until_ns is not None and counts_ns > until_ns:
                return place
            if score != score:
                continue
            self.counts[phase] += (1, score <= (self._scale(phase) or Z90), score <= Z90)
            if not count[phase]:
                log_scale[phase] = log_scale[POOLED]
            for kept in (POOLED, phase) if phase != POOLED else (POOLED,):
                met = count[kept]
                step = max(MIN_STEP, FIRST_STEP / math.sqrt(met + 1))
                above = score > math.exp(log_scale[kept])
                moved = log_scale[kept] + step * (above - (1.0 - COVERED))
                log_scale[kept] = max(-MAX_LOG_SCALE, min(moved, MAX_LOG_SCALE))
                count[kept] = min(met + 1, MAX_COUNTER)
        return len(scored)

    def _scale(self, phase: int) -> float | None:
        """Half width of the band of power over the deviation; None if too little was read."""
        for place in (phase, POOLED):
            if self._count[place] >= MIN_READINGS:
                return math.exp(self._log_scale[place])
        return None

    def finish(self, means: MeanBlock) -> None:
        """Set the bands of periods after which nothing follows."""
        if self.location is not MeterLocation.UNKNOWN:
            self._set([], means, slice(0, len(means)))

    def energy_band(self, deviation: Float) -> EnergyBand:
        """Return how sure an energy from the grid is.

        Args:
            deviation: Integrals of the deviations, shape (K,). [J]
        """
        std = energy_std(deviation)
        half = self._energies.half(deviation)
        if half is None:
            return EnergyBand(std, Z90 * std, BandKind.PARAMETRIC)
        return EnergyBand(std, half, BandKind.CALIBRATED)

    def state(self) -> Calibrated:
        """Return what must be kept across a restart."""
        windows, figures = self._energies.state()
        return Calibrated(
            location=self.location.name,
            log_scale=tuple(self._log_scale),
            readings=tuple(self._count),
            energy_windows=windows,
            energy_figures=figures,
        )

    def restore(self, kept: Calibrated) -> None:
        """Go on from an earlier state, unless more was read since."""
        if len(kept.log_scale) != len(Phase) or len(kept.readings) != len(Phase):
            return
        if kept.readings[POOLED] >= self._count[POOLED]:
            self.location = MeterLocation[kept.location]
            self._log_scale, self._count = [*kept.log_scale], [*kept.readings]
        self._energies.restore(kept.energy_windows, kept.energy_figures)


def _between_falls(stamp_ns: Int, falls: int) -> list[slice]:
    """Cut rows where their stamps fall, into one part more than `falls`; the last has the rest."""
    places = np.flatnonzero(np.diff(stamp_ns) < 0)[:falls] + 1
    edges = [0, *places.tolist()]
    edges += [len(stamp_ns)] * (falls + 2 - len(edges))
    return [slice(start, stop) for start, stop in pairwise(edges)]
