"""Finds lasting changes of friction: a generalised likelihood ratio over records of motion.

The excess of a record, ``log(measured / model friction)``, is without wear a Gaussian process: a
smooth function of speed and temperature (the error of the model's friction law), plus terms that
are linear in load, difference of directions, scatter and temperature lag, plus a slow wander and
scatter. Wear adds a step or a ramp that begins at one of the records. With K the covariance
without wear, y the excess and u the shape of a change,

``size = u' K^-1 y / u' K^-1 u``,  ``z = u' K^-1 y / sqrt(u' K^-1 u)``,

and z is standard normal without a change. The largest z over all shapes and beginnings is
compared with `MIN_Z`. A change that was found stays in the model, so that the next one is
looked for on top of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import erfc, exp, sqrt

import numpy as np

from robot_energy.blocks import Float
from robot_energy.condition.buckets import DEGC_BUCKETS, SPEED_BUCKETS
from robot_energy.condition.wear_records import RECORD_TIME, WearRecord

# Standard deviations of what moves the excess without wear.
LEVEL = 1.0  # the same at all speeds and temperatures [-]
LAW = 0.15  # of the error of the friction law about that level [-]
LAW_DEGC = 3.0  # buckets of temperature over which it changes [-]
LAW_SPEED = 1.5  # buckets of speed [-]
NUISANCE = (0.1, 0.5, 0.1, 0.01, 0.01)  # per load, difference, scatter, and kelvin above means
WANDERS = (0.002, 0.004, 0.008, 0.016)  # slow, of no known cause; the likeliest counts [-]
WANDER_HOURS = 3.0  # of motion
LEAST_SCATTER = 0.001  # of a record [-]
CHANGE = 1.0  # of a change that was found, before its size is known [-]

MIN_Z = 6.5  # of a change
MIN_SIZE = 0.01  # of a change [-]
MIN_BEFORE, MIN_AFTER = 3, 3  # records before and after the beginning of a change
MIN_RAMP = 12.0  # shortest ramp; what is shorter is a step [h]
MAX_CHANGES = 8
SAME = 2.0  # two changes that are no further apart are one [h]
MAX_LEVEL = 12  # records of one length; the two oldest are then merged
LONGEST = 40_000.0  # a record that is not merged any more [s]
MAX_RECORDS = 110


@dataclass(frozen=True)
class FrictionChange:
    """A change that was found.

    Attributes:
        stamp_ns: When it began. [ns]
        hours: Hours of motion at the step that stands for it. [h]
        ramp: Whether it came slowly; the step is then in the middle of it.
        size: Logarithm of the factor when it was found. [-]
    """

    stamp_ns: int
    hours: float
    ramp: bool
    size: float


@dataclass(frozen=True)
class Drift:
    """How far friction has changed since the first records.

    Attributes:
        size: All changes together; 0 if there is none. [-]
        std: Its standard deviation; NaN if there is none. [-]
        since_ns: When the first of the latest changes of one sign began; None: none. [ns]
        sure: Probability that the newest change is no chance. [-]
        fell: Whether the newest change was a fall.
    """

    size: float = 0.0
    std: float = float("nan")
    since_ns: int | None = None
    sure: float = 0.0
    fell: bool = False


class DriftTest:
    """Tests the records of one joint, or of the whole robot.

    Attributes:
        records: Kept ones, oldest first; the older, the longer.
        changes: Found ones, oldest first.
        drift: As it stands.
        refused: Records that were no numbers.
    """

    def __init__(self) -> None:
        self.records: list[WearRecord] = []
        self.changes: list[FrictionChange] = []
        self.drift = Drift()
        self.refused = 0

    def step(self, record: WearRecord) -> bool:
        """Take a record.

        Args:
            record: Newer than all before.

        Returns:
            Whether a change was found.
        """
        if not np.isfinite([record.excess, record.variance, *record.features]).all():
            self.refused += 1
            return False
        self.records.append(record)
        self._merge()
        found = self._search()
        if found is not None:
            self._note(found)
        if self.changes:
            self.drift = self._drift()
        return found is not None

    def take(self, records: list[WearRecord]) -> None:
        """Take what is known of a robot at once, and look for changes until there is no more.

        Args:
            records: Of the whole time, oldest first; they are kept as they are.
        """
        self.records = [
            one for one in records if np.isfinite([one.excess, one.variance, *one.features]).all()
        ]
        self.refused += len(records) - len(self.records)
        for _ in range(MAX_CHANGES):
            found = self._search()
            if found is None:
                break
            self._note(found)
        if self.changes:
            self.changes.sort(key=lambda change: change.hours)
            self.drift = self._drift()

    def restore(self, records: list[WearRecord], changes: list[FrictionChange]) -> None:
        """Continue from what was kept.

        Args:
            records: Oldest first.
            changes: Oldest first.
        """
        self.records, self.changes = records, changes
        self.drift = self._drift() if changes and records else Drift()

    def _note(self, found: FrictionChange) -> None:
        """Keep a change; one of the same sign close to the last is that one, seen more clearly."""
        last = self.changes[-1] if self.changes else None
        if last and found.size * last.size > 0 and abs(found.hours - last.hours) < SAME:
            self.changes.pop()
        self.changes = [*self.changes, found][-MAX_CHANGES:]

    def _merge(self) -> None:
        """Merge the two oldest records of a length of which there are too many."""
        length = RECORD_TIME
        while length < LONGEST:
            level = [
                index
                for index, record in enumerate(self.records)
                if 0.75 * length <= record.time < 1.5 * length
            ]
            if len(level) <= MAX_LEVEL or level[1] != level[0] + 1:
                return
            first, second = level[:2]
            self.records[first] = self.records[first].merged(self.records.pop(second))
            length *= 2.0
        if len(self.records) > MAX_RECORDS:
            self.records[1] = self.records[1].merged(self.records.pop(2))

    def _search(self) -> FrictionChange | None:
        """Return the change that stands out most, if it stands out enough."""
        n = len(self.records)
        if n < MIN_BEFORE + MIN_AFTER:
            return None
        hours = self._hours()
        begins = np.arange(MIN_BEFORE, n - MIN_AFTER + 1)
        steps = (np.arange(n)[:, None] >= begins).astype(np.float64)
        ramps = np.maximum(hours[:, None] - hours[begins - 1], 0.0)
        ramps = ramps[:, hours[-1] - hours[begins - 1] >= MIN_RAMP]
        white = np.linalg.solve(self._factor(), np.column_stack([self._excess(), steps, ramps]))
        weight = (white[:, 1:] ** 2).sum(axis=0)
        z = white[:, 1:].T @ white[:, 0] / np.sqrt(weight)
        best = int(np.argmax(np.abs(z)))
        size = float(z[best] / np.sqrt(weight[best]))
        ramp = best >= len(begins)
        begin = int(begins[best % len(begins)])
        before, after = self.records[begin - 1], self.records[begin]
        size *= float(hours[-1] - before.hours) if ramp else 1.0
        if abs(z[best]) < MIN_Z or abs(size) < MIN_SIZE:
            return None
        at = (before.hours + (hours[-1] if ramp else after.hours)) / 2
        return FrictionChange((before.stamp_ns + after.stamp_ns) // 2, float(at), ramp, size)

    def _shapes(self) -> Float:
        """What each change that was found adds to the records, shape (n, changes). [-]"""
        hours = self._hours()
        begins = np.array([change.hours for change in self.changes])
        return (hours[:, None] > begins).astype(np.float64)

    def _drift(self) -> Drift:
        """Return all changes together, at the newest record."""
        shapes = self._shapes()
        now = shapes[-1]
        white = np.linalg.solve(self._factor(), np.column_stack([self._excess(), shapes]))
        each = CHANGE**2 * white[:, 1:].T @ white[:, 0]  # size of every change
        size, newest = float(now @ each), float(each[-1])
        spread = CHANGE**2 * white[:, 1:] @ now
        variance = float(CHANGE**2 * now @ now - spread @ spread)
        std = sqrt(max(variance, 0.0))
        first = len(each)
        while first and (each[first - 1] < 0) == (newest < 0):
            first -= 1
        tests = 2 * len(self.records)
        own = sqrt(max(CHANGE**2 - CHANGE**4 * float(white[:, -1] @ white[:, -1]), 1e-12))
        sure = 1.0 - min(1.0, tests * erfc(abs(newest) / own / sqrt(2.0)))
        factor = exp(size)
        since_ns = self.changes[first].stamp_ns
        return Drift(factor - 1.0, factor * std, since_ns, max(sure, 0.0), newest < 0)

    def _factor(self) -> Float:
        """Return the Cholesky factor of the likeliest covariance of the excess, shape (n, n)."""
        features = np.array([record.features for record in self.records])
        hours = self._hours()
        buckets = DEGC_BUCKETS * SPEED_BUCKETS
        shares, nuisance = features[:, :buckets], features[:, buckets:] * np.array(NUISANCE)
        covariance = shares @ _LAW_COVARIANCE @ shares.T + nuisance @ nuisance.T
        apart = np.abs(hours[:, None] - hours)
        wander = np.exp(-apart / WANDER_HOURS)
        changes = self._shapes()
        covariance += CHANGE**2 * changes @ changes.T
        scatter = LEAST_SCATTER**2 + np.array([record.variance for record in self.records])
        covariance += np.diag(scatter)
        best, likeliest = np.empty(0), -np.inf
        for size in WANDERS:
            factor = np.linalg.cholesky(covariance + size**2 * wander)
            white = np.linalg.solve(factor, self._excess())
            likelihood = -0.5 * float(white @ white) - float(np.log(np.diag(factor)).sum())
            if likelihood > likeliest:
                best, likeliest = factor, likelihood
        return best

    def _excess(self) -> Float:
        return np.array([record.excess for record in self.records])

    def _hours(self) -> Float:
        return np.array([record.hours for record in self.records])


def _law_covariance() -> Float:
    """Covariance of the excess in every pair of buckets, row by row of temperature."""
    degc, speed = np.arange(DEGC_BUCKETS), np.arange(SPEED_BUCKETS)
    near_degc = np.exp(-0.5 * ((degc[:, None] - degc) / LAW_DEGC) ** 2)
    near_speed = np.exp(-0.5 * ((speed[:, None] - speed) / LAW_SPEED) ** 2)
    return LEVEL**2 + LAW**2 * np.kron(near_degc, near_speed)


_LAW_COVARIANCE = _law_covariance()
