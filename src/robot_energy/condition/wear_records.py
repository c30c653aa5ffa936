"""Gathers what measured torque says of a joint's friction into records of minutes of motion.

A record holds how far measured friction lies above the model's, and all that moves this figure
without wear: at which temperatures and speeds the joint ran, how much load it carried, how far
the residual differs between the directions (a payload that the model does not have), how much
it scatters, how fast its motor warms, and how far this is above its mean temperature of the last
hours. The last three stand for the gear: with motor heat q, conductance k and capacity C it is
colder than its motor by (q - C dT/dt) / k. What one of these does depends on the temperature,
so each stands a second time, times warmth. Parts that lie far from the others, as in a collision,
weigh less (Huber).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import starmap, zip_longest
from math import log
from typing import Annotated, NamedTuple

import numpy as np

from robot_energy.certainty.deviation import MEDIAN_TO_STD
from robot_energy.condition.joint_friction import DEGC_STEP, SPEED_BUCKETS, MotionSums, shares
from robot_energy.condition.record import STRICT, Number, Numbers, Stamp
from robot_energy.timeline.blocks import NANOSECOND, Float

RECORD_TIME = 300.0  # motion of a record [s]
MIN_DIRECTION = 60.0  # of it in each direction [s]
MIN_OPEN = 15.0  # the same of the last record of a recording, which may be shorter [s]
MAX_PARTS = 2000  # that wait for motion in the other direction
HUBER = 2.5  # parts further from the median, in robust standard deviations, weigh less
LAGS = (1200.0, 7200.0)  # means of the motor temperature, time constants [s]
DEGC_BUCKETS = 16  # 0 to 150 degC, as far as readings are believed
MIDDLE_DEGC, DEGC_SCALE = 50.0, 20.0  # warmth is (temperature - middle) / scale
NUISANCES = 4 + len(LAGS)  # load, difference of directions, scatter, slope, above means
SLOPE_TIME = 1000.0  # the slope of the temperature is what it rises in this time [s]
MAX_SLOPE = 50.0  # more is a faulty sensor [K]
FEATURES = DEGC_BUCKETS + 2 * SPEED_BUCKETS + 2 * NUISANCES
LOADS = slice(DEGC_BUCKETS + 2 * SPEED_BUCKETS, DEGC_BUCKETS + 2 * SPEED_BUCKETS + 3)
MIN_RATIO = 0.05  # of measured over model friction
LONGEST = 3600.0  # of a record by the meter; a slope that is no surer by then is dropped [s]
MAX_STD = 0.1  # of that slope [-]
MIN_NOISE = 1.0  # W
DIGITS = 6  # kept of each figure, so that a record is the same after a restart


class WearRecord(NamedTuple):
    """Minutes of motion of one joint, or of the whole robot."""

    stamp_ns: Stamp
    hours: Annotated[Number, "Hours of motion up to the middle. [h]"]
    time: Annotated[Number, "Motion. [s]"]
    excess: Annotated[Number, "Logarithm of measured over model friction. [-]"]
    variance: Annotated[Number, "Of the excess by scatter alone. [-]"]
    features: Annotated[
        Numbers,
        "Shares of the friction torque in each bucket of temperature, in each bucket of speed, "
        "these times warmth, nuisances, these times warmth, shape (FEATURES,).",
    ]
    work: Annotated[
        Numbers,
        "Time of every joint in each bucket of speed over `time`; it belongs to the program, "
        "whatever the robot carries and however warm it is. Empty once the program is known.",
    ] = ()
    program: Annotated[
        Numbers,
        "What the coefficients of each program are multiplied by; those that are missing are zero.",
    ] = ()

    def merged(self, later: WearRecord) -> WearRecord:
        """Return this and a later record as one; all its figures are means over time."""
        time = self.time + later.time
        share = later.time / time

        def mean(first: float, second: float) -> float:
            return round(first + share * (second - first), DIGITS)

        return WearRecord(
            self.stamp_ns + round(share * (later.stamp_ns - self.stamp_ns)),
            mean(self.hours, later.hours),
            time,
            mean(self.excess, later.excess),
            (1.0 - share) ** 2 * self.variance + share**2 * later.variance,
            tuple(map(mean, self.features, later.features)),
            (),
            tuple(starmap(mean, zip_longest(self.program, later.program, fillvalue=0.0))),
        )


class MotionGatherer:
    """Gathers the parts of every joint until they make a record.

    Attributes:
        hours: Motion of each joint so far, shape (n,). [h]
        means: Mean motor temperatures, shape (2, n); NaN before the first part. [degC]
        stamp_ns: Newest part; None before the first. [ns]
    """

    def __init__(self, n_joints: int) -> None:
        self.hours: Float = np.zeros(n_joints)
        self.means: Float = np.full((len(LAGS), n_joints), np.nan)
        self.stamp_ns: int | None = None
        self._parts: list[list[tuple[MotionSums, Float]]] = [[] for _ in range(n_joints)]
        self._times: Float = np.zeros((2, n_joints))

    def step(self, part: MotionSums) -> dict[int, WearRecord]:
        """Return the records that a part completes, by joint."""
        above = self._above_means(part)
        moved = part.time.sum(axis=2)
        self._times += moved
        self.hours += moved.sum(axis=0) / 3600.0
        found: dict[int, WearRecord] = {}
        whole = self._times.sum(axis=0) >= RECORD_TIME
        whole &= self._times.min(axis=0) >= MIN_DIRECTION
        for joint in np.flatnonzero(moved.any(axis=0)).tolist():
            parts = self._parts[joint]
            parts.append((part, above[:, joint]))
            if whole[joint]:
                found[joint] = self._record(joint)
            elif len(parts) <= MAX_PARTS:
                continue
            parts.clear()
            self._times[:, joint] = 0.0
        return found

    def open_records(self) -> dict[int, WearRecord]:
        """Return the records that are not complete, but say something already, by joint."""
        enough = self._times.min(axis=0) >= MIN_OPEN
        return {joint: self._record(joint) for joint in np.flatnonzero(enough).tolist()}

    def _above_means(self, part: MotionSums) -> Float:
        """How far the motors are above their mean temperatures, shape (2, n). [K]"""
        before = part.stamp_ns if self.stamp_ns is None else self.stamp_ns
        passed = max(part.stamp_ns - before, 0) * NANOSECOND
        self.stamp_ns = part.stamp_ns
        gain = 1.0 - np.exp(-passed / np.array(LAGS))
        start = np.isnan(self.means)
        self.means = np.where(
            start, part.degc, self.means + gain[:, None] * (part.degc - self.means)
        )
        return part.degc - self.means

    def _record(self, joint: int) -> WearRecord:
        parts = self._parts[joint]
        sums = [part for part, _ in parts]
        model = np.array([part.model[:, joint] for part in sums])  # (P, 2, SPEED_BUCKETS)
        measured = np.array([part.measured[:, joint].sum(axis=1) for part in sums])
        load = np.array([part.load[:, joint] for part in sums])
        degc = np.array([part.degc[joint] for part in sums])
        ways = [_one_way(model[:, way], measured[:, way], load[:, way], degc) for way in range(2)]
        forward, backward = (way.ratio for way in ways)
        ratio = (forward + backward) / 2
        above = np.array([values for _, values in parts]).mean(axis=0)
        stamps = np.array([part.stamp_ns - sums[0].stamp_ns for part in sums]) * NANOSECOND
        features = features_of(
            np.mean([way.degc for way in ways], axis=0),
            np.mean([way.speed for way in ways], axis=0),
            [
                float(np.mean([way.load for way in ways])),
                (forward - backward) / 2,
                float(np.mean([way.scatter for way in ways])),
                _slope(stamps, degc),
                *above.tolist(),
            ],
        )
        time = float(self._times[:, joint].sum())
        work = np.sum([part.time.sum(axis=0) for part in sums], axis=0).reshape(-1) / time
        return WearRecord(
            round(np.mean([part.stamp_ns for part in sums])),
            round(float(self.hours[joint]) - time / 7200.0, DIGITS),
            time,
            round(log(max(ratio, MIN_RATIO)), DIGITS),
            sum(way.variance for way in ways) / (2.0 * max(ratio, MIN_RATIO)) ** 2,
            features,
            tuple(round(share, DIGITS) for share in work.tolist()),
        )


def features_of(degc: Float, speed: Float, nuisances: list[float]) -> tuple[float, ...]:
    """Return the features of a record.

    Args:
        degc: Shares in the buckets of temperature, shape (DEGC_BUCKETS,). [-]
        speed: Shares in those of speed, shape (SPEED_BUCKETS,). [-]
        nuisances: Load, difference, scatter, slope [K], temperatures above the means [K].
    """
    warmth = (DEGC_STEP * float(degc @ np.arange(DEGC_BUCKETS)) - MIDDLE_DEGC) / DEGC_SCALE
    both = [*speed.tolist(), *(warmth * speed).tolist()]
    values = [*degc.tolist(), *both, *nuisances, *(warmth * value for value in nuisances)]
    return tuple(round(value, DIGITS) for value in values)


def degc_shares(motor_temperature_degc: Float) -> Float:
    """Return the weights of the buckets of temperature, shape (..., DEGC_BUCKETS). [-]

    Args:
        motor_temperature_degc: Shape (...). [degC]
    """
    place = np.clip(motor_temperature_degc / DEGC_STEP, 0.0, DEGC_BUCKETS - 1.0)
    return shares(place, DEGC_BUCKETS)


def _slope(time: Float, degc: Float) -> float:
    """Rise of the temperature in `SLOPE_TIME`. [K]"""
    time = time - time.mean()
    rise = SLOPE_TIME * float(time @ degc) / max(float(time @ time), 1e-9)
    return min(max(rise, -MAX_SLOPE), MAX_SLOPE)


class _Way(NamedTuple):
    """One direction of a record: ratio, its variance, shares of buckets, load and scatter."""

    ratio: float
    variance: float
    degc: Float
    speed: Float
    load: float
    scatter: float


def _one_way(model: Float, measured: Float, load: Float, degc: Float) -> _Way:
    """Return the robust ratio of measured to model friction of parts in one direction."""
    amount = model.sum(axis=1)
    moved = amount > 0
    amount, measured = amount[moved], measured[moved]
    ratio = measured / amount
    middle = _median(ratio, amount)
    off = np.abs(ratio - middle)
    scatter = MEDIAN_TO_STD * _median(off, amount) + 1e-6
    weight = np.minimum(1.0, HUBER * scatter / np.maximum(off, 1e-12))
    total = float(weight @ amount)
    return _Way(
        float(weight @ measured) / total,
        scatter**2 * float((weight * amount) @ (weight * amount)) / total**2,
        (weight * amount) @ degc_shares(degc[moved]) / total,
        weight @ model[moved] / total,
        float(weight @ load[moved]) / total,
        scatter,
    )


def _median(values: Float, weight: Float) -> float:
    """Weighted median."""
    order = np.argsort(values, kind="stable")
    reached = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(reached, 0.5 * reached[-1])])


class MeterGatherer:
    """Gathers windows of the power meter into records of the friction of the whole robot.

    Over a record the residual is a line in friction power: its slope is how far friction lies
    above the model's, whatever the constant losses do meanwhile. Windows are gathered until it is
    known well enough.
    """

    def __init__(self) -> None:
        self.hours = 0.0  # time of all windows so far [h]
        self._rows: list[tuple[float, float, float, float, int]] = []

    def step(
        self, stamp_ns: int, duration: float, residual: float, friction: float, degc: float
    ) -> WearRecord | None:
        """Return the record that a window completes, or None.

        Args:
            duration: [s]
            residual: Measured minus what the model file predicts. [J]
            friction: Friction energy of the model file that the meter sees. [J]
            degc: Mean motor temperature. [degC]
        """
        if not np.isfinite(residual + friction + degc):
            return None
        self.hours += duration / 3600.0
        self._rows.append((duration, residual / duration, friction / duration, degc, stamp_ns))
        time = sum(row[0] for row in self._rows)
        if time < RECORD_TIME:
            return None
        found = self._record(time)
        if found is not None or time >= LONGEST:
            self._rows.clear()
        return found

    def _record(self, time: float) -> WearRecord | None:
        rows: Float = np.array([row[:4] for row in self._rows])
        duration, residual, friction, degc = rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3]
        slope, off, noise, weight = 0.0, residual, np.inf, duration
        for _ in range(4):
            near = np.minimum(1.0, HUBER * noise / np.maximum(np.abs(off), 1e-9))
            weight = duration * near
            slope, off = _line(friction, residual, weight)
            noise = max(MEDIAN_TO_STD * float(np.median(np.abs(off))), MIN_NOISE)
        spread = float(weight @ (friction - weight @ friction / weight.sum()) ** 2)
        variance = noise**2 * float(np.mean(duration)) / max(spread, 1e-9)
        if not variance < MAX_STD**2:
            return None
        ratio = max(1.0 + slope, MIN_RATIO)
        return WearRecord(
            round(np.mean([row[4] for row in self._rows])),
            round(self.hours - time / 7200.0, DIGITS),
            time,
            round(log(ratio), DIGITS),
            variance / ratio**2,
            features_of(degc_shares(degc).mean(axis=0), np.zeros(SPEED_BUCKETS), [0.0] * NUISANCES),
        )


def _line(friction: Float, residual: Float, weight: Float) -> tuple[float, Float]:
    """Slope of the residual over friction power, and how far each point is off the line."""
    total = weight.sum()
    x = friction - weight @ friction / total
    y = residual - weight @ residual / total
    slope = float((weight * x) @ y / max(float((weight * x) @ x), 1e-9))
    return slope, y - slope * x


SAME_PROGRAM = 0.05  # by how much the times of one program may differ [-]
OWN = 1 + LOADS.stop - LOADS.start  # coefficients of a program: level and slopes
MAX_PROGRAMS = 20  # with coefficients of their own; the one not seen for longest is forgotten


@dataclass
class KnownProgram:
    """A program that was seen."""

    __pydantic_config__ = STRICT  # it is kept as it is

    work: Annotated[Numbers, "That of its first record. [-]"]
    loads: Annotated[
        Numbers, "Load, difference and scatter of its first record; its level is at these. [-]"
    ]
    hours: Annotated[Number, "Hours of motion when it was last seen. [h]"]


class ProgramTable:
    """Finds to which program of a robot a record belongs.

    Two programs load a gear in other poses. So at equal features their friction differs, and a
    payload that the model does not have leaves another part of its torque in the mean of the
    directions. Each program but the first therefore has coefficients of its own in the baseline:
    a level, and slopes of load, difference of the directions and scatter. A program is recognised
    by how long every joint moves at each speed, which neither load nor temperature changes.
    """

    def __init__(self, known: Sequence[KnownProgram] = ()) -> None:
        self.known = list(known)  # in the order of their coefficients; the first has none
        self._new: tuple[float, ...] = ()

    def step(self, record: WearRecord) -> tuple[WearRecord | None, int | None]:
        """Take a record.

        Args:
            record: Newer than all before, of any program.

        Returns:
            The record with what its own coefficients are multiplied by; None if it is of no
            program, as when the program changed meanwhile. And which program had to be forgotten
            for it; None if none.
        """
        if not record.work:
            return record, None
        forgotten: int | None = None
        number = _nearest(record.work, [one.work for one in self.known])
        before, self._new = self._new, ()
        if number is None and self.known and _nearest(record.work, [before]) is None:
            self._new = record.work
            return None, None  # of a new program once the next record agrees
        if number is None:
            new = KnownProgram(record.work, record.features[LOADS], record.hours)
            if len(self.known) <= MAX_PROGRAMS:
                number = len(self.known)
                self.known.append(new)
            else:
                hours = [one.hours for one in self.known[1:]]
                number = forgotten = 1 + int(np.argmin(hours))
                self.known[number] = new
        known = self.known[number]
        known.hours = record.hours
        if number == 0:
            return record._replace(program=(), work=()), None
        before = (0.0,) * (OWN * (number - 1))
        off = np.subtract(record.features[LOADS], known.loads)
        own = (1.0, *(round(value, DIGITS) for value in off.tolist()))
        return record._replace(program=before + own, work=()), forgotten


def _nearest(work: tuple[float, ...], known: Sequence[tuple[float, ...]]) -> int | None:
    """The one that hardly differs."""
    apart = [float(np.abs(np.subtract(one, work)).max()) for one in known if one]
    number = int(np.argmin(apart)) if apart else None
    return None if number is None or apart[number] > SAME_PROGRAM else number


def columns(number: int) -> slice:
    """Return where the coefficients of a program, from 1, stand among those of all programs."""
    return slice(OWN * (number - 1), OWN * number)
