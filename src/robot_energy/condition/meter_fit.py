"""Learns from one power meter: one factor on friction, and the constant losses.

One meter cannot distinguish six joints. What it can is regress the residual of each window,

``measured - predicted = (factor - 1) E_friction + offset T``,

on the friction energy of the model file and on time, by least squares whose past fades, with
the model file as the prior. Where the torque of all joints is measured, friction is learned
from that, and the meter says the offset alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np

from robot_energy.accounting.power_curve import MeterCurve
from robot_energy.condition.joint_friction import BOUNDS, GRID
from robot_energy.timeline.blocks import NANOSECOND, Float, Int, MeterBlock, MeterLocation
from robot_energy.timeline.pieces import NO_PIECES, CoveredPieces

MEMORY = 400.0  # of the past; a gear that lags its motor makes the residual drift [s]
PRIOR_FACTOR = 0.5  # standard deviation of the factor before any reading [-]
PRIOR_OFFSET = 0.3  # of the offset, share of the constant losses [-]
MAX_OFFSET = 0.5  # share of the constant losses [-]
LEAST_OFFSET = 20.0  # however small the constant losses are [W]
NOISE_SHARE = 0.05  # of the measured power: residual of one window that is not a surprise [-]
MIN_NOISE = 2.0  # W
MAX_SURPRISE = 3.0  # a window further off weighs less (Huber)
MIN_TIME = 60.0  # before the fit is valid [s]


class MeterFit:
    """Factor on friction and offset of the constant losses.

    Args:
        constant_loss: Of the model file, where the meter sees it. [W]

    Attributes:
        information: Normal matrix of (factor - 1, offset), without the prior, shape (2, 2).
        target: Right side, shape (2,).
        power: Mean measured power. [W]
        scale: Mean amount of the residual in standard deviations of the noise. [-]
        time: Time of the windows that were used. [s]
        refused: Windows that were not, as their residual is too large.
    """

    def __init__(self, constant_loss: float) -> None:
        self._loss = constant_loss
        self.information: Float = np.zeros((2, 2))
        self.target: Float = np.zeros(2)
        self.power = 0.0
        self.scale = 1.0
        self.time = 0.0
        self.windows = 0
        self.refused = 0

    def step(self, duration: float, measured: float, residual: float, friction: float) -> None:
        """Learn from one window.

        Args:
            duration: Its length. [s]
            measured: Measured energy. [J]
            residual: Measured minus what the model file predicts. [J]
            friction: Friction energy of the model file that the meter sees. [J]
        """
        if not np.isfinite(measured + residual + friction):
            self.refused += 1
            return
        seen = np.array([friction, duration]) / duration
        self.power += duration / (self.time + duration) * (measured / duration - self.power)
        level = max(MIN_NOISE, NOISE_SHARE * abs(self.power))
        surprise = abs(residual / duration - float(seen @ self._solution())) / level
        known = self.time >= MIN_TIME
        reach = MAX_SURPRISE * max(self.scale, 1.0)
        if known and surprise > reach:
            self.refused += 1
        keep = float(np.exp(-duration / MEMORY))
        weight = duration / level**2 * (min(1.0, reach / surprise) if known and surprise else 1.0)
        self.information = keep * self.information + weight * np.outer(seen, seen)
        self.target = keep * self.target + weight * seen * (residual / duration)
        fading = min(60.0, duration) / 300.0
        self.scale += fading * (min(surprise, 2 * reach) - self.scale)
        self.time += duration
        self.windows += 1

    def _solution(self) -> Float:
        return np.linalg.solve(self.information + self._prior(), self.target)

    def _prior(self) -> Float:
        offset = max(PRIOR_OFFSET * self._loss, LEAST_OFFSET / 2)
        return np.diag([PRIOR_FACTOR**-2, offset**-2])

    @property
    def raw(self) -> tuple[float, float]:
        """Factor and offset as fitted, without bounds. [-], [W]"""
        factor, offset = self._solution().tolist()
        return 1.0 + factor, offset

    @property
    def std(self) -> tuple[float, float]:
        """Standard deviations of `raw` as far as the spread of the windows shows. [-], [W]"""
        spread = max(self.scale, 1.0) ** 2 * np.linalg.inv(self.information + self._prior())
        factor, offset = np.sqrt(np.diag(spread)).tolist()
        return factor, offset

    @property
    def valid(self) -> bool:
        """Whether factor and offset can be used; they belong together."""
        return self.time >= MIN_TIME

    @property
    def filtered(self) -> tuple[float, float]:
        """Factor and offset within their bounds: the best pair there. [-], [W]"""
        limit = max(MAX_OFFSET * self._loss, LEAST_OFFSET)
        lower = np.array([BOUNDS[0] - 1.0, -limit])
        upper = np.array([BOUNDS[1] - 1.0, limit])
        normal = self.information + self._prior()
        found = self._solution()
        for index in np.flatnonzero((found < lower) | (found > upper)).tolist():
            other = 1 - index
            found[index] = min(max(found[index], lower[index]), upper[index])
            rest = self.target[other] - normal[other, index] * found[index]
            found[other] = min(max(rest / normal[other, other], lower[other]), upper[other])
        factor, offset = found.tolist()
        return round((1.0 + factor) / GRID) * GRID, round(offset / GRID) * GRID


WINDOW = 5.0  # shortest window [s]
METER_WAIT = 2_000_000_000  # ns
MAX_HOLE = 1_000_000_000  # between two pieces of a window [ns]
MAX_PIECES = 20_000  # that wait for samples
KEPT_NS = 120_000_000_000  # of predicted energies, behind the newest sample


class Window(NamedTuple):
    """Energies over one window."""

    stamp_ns: int
    duration: Annotated[float, "Of its pieces. [s]"]
    measured: Annotated[float, "By the meter. [J]"]
    energies: Annotated[Float, "Predicted ones, in the order they were given, shape (E,). [J]"]


class MeterWindows:
    """Predicted and measured energy over the same windows, cut at the readings of the meter.

    Each is made of whole pieces of the meter's curve, and every predicted energy is integrated
    over these. A piece counts once the samples have passed its end by ``METER_WAIT``: what the
    meter says a little late still counts in its own time.
    """

    def __init__(self, energies: int, curve: MeterCurve) -> None:
        self.location = MeterLocation.UNKNOWN
        self._curve = curve
        self._pieces = NO_PIECES
        self._begin(energies)

    def _begin(self, energies: int) -> None:
        """Forget what was predicted: the stamps have jumped, or samples are missing."""
        self._stamps: Int = np.empty(0, dtype=np.int64)  # with room behind those that are kept
        self._totals: Float = np.empty((energies, 0))  # energy up to each stamp, likewise [J]
        self._kept = slice(0, 0)
        self._power: Float = np.empty((energies, 0))  # of the newest sample
        self._segment: int | None = None
        self._drop()

    def _drop(self) -> None:
        """Begin a new window with the next piece."""
        self._end_ns = 0  # of the newest piece in it
        self._sum: Float = np.zeros(2 + len(self._totals))  # measured, duration, predicted

    def measure(self, block: MeterBlock) -> None:
        """Take readings."""
        self.location = block.location
        for number, part in enumerate(self._curve.step(block)):
            if number:
                self._pieces = NO_PIECES
            whole = CoveredPieces.concatenate([self._pieces, part])
            self._pieces = whole[slice(-MAX_PIECES, None)]

    def step(self, stamp_ns: Int, segment: Int, power: Float, until_ns: int) -> Iterator[Window]:
        """Yield the windows that are complete with these powers, in order of time.

        Args:
            stamp_ns: Rising but for jumps, shape (N,). [ns]
            segment: Shape (N,).
            power: Shape (N, E). [W]
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
        kept = self._stamps[self._kept]
        stamp = np.concatenate([kept[-1:], stamp_ns])
        value = np.concatenate([self._power, power.T], axis=1)
        half = 0.5 * NANOSECOND * np.diff(stamp)
        more: Float = np.cumsum((value[:, 1:] + value[:, :-1]) * half, axis=1)
        start = self._kept.start + int(np.searchsorted(kept, int(stamp_ns[-1]) - KEPT_NS))
        end = self._kept.stop
        base = self._totals[:, max(end - 1, 0) : end]
        if end + len(stamp_ns) > len(self._stamps):
            self._move(slice(start, end), 2 * (end - start + len(stamp_ns)))
            start, end = 0, end - start
        stop = end + len(stamp_ns)
        self._stamps[end:stop] = stamp_ns
        if len(kept):
            np.add(base, more, out=self._totals[:, end:stop])
        else:
            self._totals[:, 0], self._totals[:, 1:stop] = 0.0, more
        self._kept, self._power = slice(start, stop), value[:, -1:]

    def _move(self, kept: slice, room: int) -> None:
        """Move what is kept to the beginning of arrays with more room."""
        size = kept.stop - kept.start
        stamps, totals = np.empty(room, dtype=np.int64), np.empty((len(self._totals), room))
        stamps[:size], totals[:, :size] = self._stamps[kept], self._totals[:, kept]
        self._stamps, self._totals = stamps, totals

    def _windows(self, until_ns: int) -> Iterator[Window]:
        stamp = self._stamps[self._kept]
        if not len(stamp):
            return
        limit = min(until_ns, int(stamp[-1]))
        ready = int(np.searchsorted(self._pieces.end_ns, limit, side="right"))
        pieces, self._pieces = self._pieces[slice(0, ready)], self._pieces[slice(ready, None)]
        pieces = pieces[pieces.stamp_ns >= stamp[0]]
        if not len(pieces):
            return
        spans = np.stack([pieces.stamp_ns, pieces.end_ns])
        around = slice(
            int(np.searchsorted(stamp, int(spans[0, 0]), side="right")) - 1,
            int(np.searchsorted(stamp, int(spans[1, -1]))) + 1,
        )
        columns: list[Float] = list(self._totals[:, self._kept][:, around])
        ends = [np.interp(spans, stamp[around], total) for total in columns]
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
