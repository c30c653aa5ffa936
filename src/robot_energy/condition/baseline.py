"""The baseline of a joint's friction: what its own records say of it, apart from any wear.

``excess = features' b + slow + scatter``. Two neighbours in time that are merged differ by
``(x2 - x1)' b`` plus scatter; what is slow cancels. Their sums are those of a ridge regression, and
its residual says how large the scatter is. Both sums stay as small after years.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from robot_energy.condition.joint_friction import SPEED_BUCKETS
from robot_energy.condition.record import ContrastEntry, filled
from robot_energy.condition.wear_records import (
    DEGC_BUCKETS,
    FEATURES,
    OWN,
    RECORD_TIME,
    WearRecord,
    columns,
)
from robot_energy.foundation.described import Described
from robot_energy.timeline.blocks import Float

# Standard deviations of the coefficients, before any record.
LEVEL = 1.0  # the same at all speeds and temperatures [-]
LAW = 0.45  # of the error of the friction law about that level [-]
LAW_DEGC = 3.0  # buckets of temperature over which it changes [-]
LAW_SPEED = 1.5  # buckets of speed [-]
WARMER = 0.25  # of its slope over warmth at each speed [-]
NUISANCE = (0.3, 2.5, 1.0, 0.03, 0.01, 0.01)  # per load, difference, scatter, and kelvins
WARM_SHARE = 0.5  # of these, times warmth

PROGRAM = (0.05, 0.1, 0.5, 0.5)  # of one program: level, slopes of load, difference, scatter [-]
PRIOR_PROGRAMS = 3.0  # programs that this level is worth

LEAST_SCATTER = 0.001  # of a record of `RECORD_TIME` [-]
DRIFTING = 0.001  # what neighbours differ by for slow causes [-]
PAYLOAD = 0.003  # what no feature says of a payload, before any record [-]
PRIOR_PAIRS = (6.0, 10.0)  # pairs that the stated scatter and this are worth
LEVELS = 8  # lengths of records, each twice the one before
ROUNDS = 5
MIN_PAYLOAD = 0.003  # where programs change [-]
BRIEF_HOURS = 0.5  # how long it is the same, of motion
MAX_OFF = 4.0  # standard deviations of a pair; what is farther off counts as much
PRIOR_CONTRASTS = 6.0  # weight of the stated scatter against that of the contrasts
MIN_SHARE, MAX_SHARE = 0.01, 100.0  # of the stated variance


class Baseline(Described):
    """What is known of the baseline."""

    mean: Annotated[Float, "Coefficients, shape (m,). [-]"]
    covariance: Annotated[Float, "Of these, shape (m, m). [-]"]
    scatter: Annotated[float, "Variance of a record, in units of `scatter`. [-]"]


class Contrasts:
    """Sums over pairs of records that were merged.

    Attributes:
        information: Shape (m, m), m coefficients: `FEATURES`, and those of the programs. [-]
        target: Shape (m,). [-]
        square: Of the differences of the excess. [-]
        count: Pairs. [-]
        levels: Of the pairs of each length of record: weight, weighted square of what nothing known
            explains, weighted variance by scatter of one, weighted share of a payload in it, shape
            (LEVELS, 4). [-]
    """

    def __init__(self) -> None:
        self.information: Float = np.zeros((FEATURES, FEATURES))
        self.target: Float = np.zeros(FEATURES)
        self.square = 0.0
        self.count = 0
        self.levels: Float = np.zeros((LEVELS, 4))
        self._baseline: Baseline | None = None
        self._payload: float | None = None

    def rows(self, records: Sequence[WearRecord]) -> Float:
        """Return what coefficients are multiplied by, shape (N, m); makes room for programs. [-]"""
        more = FEATURES + max(len(record.program) for record in records) - len(self.target)
        if more > 0:
            self.information = np.pad(self.information, ((0, more), (0, more)))
            self.target = np.pad(self.target, (0, more))
            self._baseline = self._payload = None
        found = np.zeros((len(records), len(self.target)))
        found[:, :FEATURES] = [record.features for record in records]
        for row, record in zip(found, records, strict=True):
            row[FEATURES : FEATURES + len(record.program)] = record.program
        return found

    def step(self, before: WearRecord, after: WearRecord) -> None:
        """Take two neighbours."""
        rows = self.rows([before, after])
        apart = rows[1] - rows[0]
        hours, time = np.array([[one.hours, one.time] for one in (before, after)]).T
        shared = correlated(hours, time, BRIEF_HOURS)
        share = float(shared[0, 0] + shared[1, 1] - 2.0 * shared[0, 1])
        self._learn_payload(before, after, apart, share)
        own = scatter(before) + scatter(after)
        weight = 1.0 / (own + DRIFTING**2 + self.payload * share)
        self.information += weight * np.outer(apart, apart)
        self.target += weight * (after.excess - before.excess) * apart
        self.square += weight * (after.excess - before.excess) ** 2
        self.count += 1
        self._baseline = None

    @property
    def programs(self) -> int:
        """Programs with coefficients of their own."""
        return (len(self.target) - FEATURES) // OWN

    @property
    def payload(self) -> float:
        """Variance of what no feature says of a payload. [-]

        Records of length T differ by ``scatter s(T) + payload h(T)`` in variance. Scatter falls
        with the length, a payload does not until it changes, so pairs of several lengths
        separate the two: least squares over the lengths, errors in proportion to what is expected.
        """
        if self._payload is not None:
            return self._payload
        found = np.array([1.0, PAYLOAD**2])
        weight, square, own, share = self.levels.T
        rows = np.stack([own, share])
        for _ in range(ROUNDS):
            expected = found @ rows + DRIFTING**2 * weight
            gain = np.divide(weight, expected**2, out=np.zeros(LEVELS), where=weight > 0)
            prior = PRIOR_PAIRS / np.maximum(found, [1.0, PAYLOAD**2]) ** 2
            inner = (rows * gain) @ rows.T + np.diag(prior)
            outer = (rows * gain) @ square + prior * [1.0, PAYLOAD**2]
            found = _not_negative(inner, outer)
        self._payload = max(float(found[1]), MIN_PAYLOAD**2 if self.programs else 0.0)
        return self._payload

    def _learn_payload(
        self, before: WearRecord, after: WearRecord, apart: Float, share: float
    ) -> None:
        """A pair counts as far as all else in it is known."""
        known = self.baseline()
        own = scatter(before) + scatter(after)
        unknown = DRIFTING**2 + float(apart @ known.covariance @ apart)
        now = known.scatter * own + self.payload * share
        weight = (now / (now + unknown)) ** 2
        off = after.excess - before.excess - float(apart @ known.mean)
        square = min(off**2, MAX_OFF**2 * (unknown + now)) - unknown
        length = (before.time + after.time) / 2.0 / RECORD_TIME
        level = min(max(round(np.log2(length)), 0), LEVELS - 1)
        self.levels[level] += weight * np.array([1.0, square, own, share])
        self._payload = None

    def forget(self, number: int) -> Float:
        """Return coefficients of a program, from 1, shape (OWN,), and forget them. [-]"""
        own = columns(number)
        gone = slice(FEATURES + own.start, FEATURES + own.stop)
        mean = self.baseline().mean[gone]
        inner = self.information[gone, gone] + np.diag(1.0 / np.square(PROGRAM))
        shared = np.linalg.solve(inner, self.information[gone])
        level = np.linalg.solve(inner, self.target[gone])
        self.square -= float(self.target[gone] @ level)
        self.target -= self.information[:, gone] @ level
        self.information -= self.information[:, gone] @ shared
        self.information[gone] = self.information[:, gone] = self.target[gone] = 0.0
        self._baseline = None
        return mean

    def baseline(self) -> Baseline:
        """Return what is known of the baseline."""
        if self._baseline is None:
            self._baseline = self._solved()
        return self._baseline

    @classmethod
    def restored(cls, entry: ContrastEntry) -> Contrasts:
        """Return the sums that were kept."""
        found = cls()
        if not entry.count:
            return found
        size = max(len(entry.target), FEATURES)
        found.information = filled(entry.information, np.zeros((size, size)))
        found.target = filled(entry.target, np.zeros(size))
        found.square, found.count = entry.square, entry.count
        if entry.levels:
            found.levels = filled(entry.levels, found.levels)
        return found

    def _solved(self) -> Baseline:
        size = len(self.target)
        own = np.tile(np.square(PROGRAM), self.programs)
        levels = np.arange(FEATURES, size, OWN)
        share = 1.0
        mean = np.zeros(size)
        covariance = np.diag(np.concatenate([np.zeros(FEATURES), own]))
        covariance[:FEATURES, :FEATURES] = _PRIOR
        for _ in range(3 if self.count else 0):
            precision = self.information / share
            precision[:FEATURES, :FEATURES] += _PRECISION
            precision[range(FEATURES, size), range(FEATURES, size)] += 1.0 / own
            covariance = np.linalg.inv(precision)
            covariance = (covariance + covariance.T) / 2
            mean = covariance @ self.target / share
            residual = self.square - float(mean @ (2 * self.target - self.information @ mean))
            free = self.count - float(np.sum(covariance * self.information)) / share
            share = (PRIOR_CONTRASTS + max(residual, 0.0)) / (PRIOR_CONTRASTS + max(free, 0.0))
            share = min(max(share, MIN_SHARE), MAX_SHARE)
            found = float(np.sum(mean[levels] ** 2 + covariance[levels, levels]))
            own[::OWN] = (PRIOR_PROGRAMS * PROGRAM[0] ** 2 + found) / (
                PRIOR_PROGRAMS + self.programs
            )
        return Baseline(mean, covariance, share)


def _not_negative(inner: Float, outer: Float) -> Float:
    """Least squares of two figures, neither below zero."""
    found = np.linalg.solve(inner, outer)
    if (found >= 0).all():
        return np.asarray(found)
    alone = np.maximum(outer / np.diag(inner), 0.0)
    return np.where(found < 0, 0.0, alone)


def scatter(record: WearRecord) -> float:
    """Return the variance of a record as it states it, never zero. [-]"""
    return record.variance + LEAST_SCATTER**2 * RECORD_TIME / record.time


def correlated(hours: Float, time: Float, memory: float) -> Float:
    """Return the covariance (n, n) of the means of what forgets exponentially; variance one. [-]

    Args:
        hours: Middle of each record, shape (n,). [h]
        time: Its length, shape (n,). [s]
        memory: Correlation time. [h]
    """
    length = time / 3600.0 / memory
    spread = np.sqrt(2.0 * (length - 1.0 + np.exp(-length))) / length
    return np.exp(-np.abs(hours[:, None] - hours) / memory) * spread[:, None] * spread


def _prior() -> Float:
    """Covariance of the coefficients before any record."""
    degc, speed = np.arange(DEGC_BUCKETS), np.arange(SPEED_BUCKETS)
    covariance = np.zeros((FEATURES, FEATURES))
    laws = slice(0, DEGC_BUCKETS)
    covariance[laws, laws] = LEVEL**2 + LAW**2 * np.exp(
        -0.5 * ((degc[:, None] - degc) / LAW_DEGC) ** 2
    )
    speeds = slice(DEGC_BUCKETS, DEGC_BUCKETS + SPEED_BUCKETS)
    near = np.exp(-0.5 * ((speed[:, None] - speed) / LAW_SPEED) ** 2)
    covariance[speeds, speeds] = LAW**2 * near
    rest = [WARMER] * SPEED_BUCKETS + list(NUISANCE) + [WARM_SHARE * one for one in NUISANCE]
    first = DEGC_BUCKETS + SPEED_BUCKETS
    covariance[range(first, FEATURES), range(first, FEATURES)] = np.square(rest)
    return covariance + 1e-8 * np.eye(FEATURES)


_PRIOR = _prior()
_PRECISION = np.linalg.inv(_PRIOR)
