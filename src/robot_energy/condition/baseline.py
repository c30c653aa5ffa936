"""The baseline of a joint's friction: what its own records say of it, apart from any wear.

``excess = features' b + slow + scatter``. Two neighbours in time that are merged differ by
``(x2 - x1)' b`` plus scatter; what is slow cancels. Their sums are those of a ridge regression, and
its residual says how large the scatter is. Both sums stay as small after years.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_energy.blocks import Float, Int
from robot_energy.condition.buckets import SPEED_BUCKETS
from robot_energy.condition.record import ContrastEntry, filled, flat
from robot_energy.condition.wear_records import (
    DEGC_BUCKETS,
    FEATURES,
    LOADS,
    RECORD_TIME,
    WearRecord,
    programs,
    warmths,
)

# Standard deviations of the coefficients, before any record.
LEVEL = 1.0  # the same at all speeds and temperatures [-]
LAW = 0.15  # of the error of the friction law about that level [-]
LAW_DEGC = 3.0  # buckets of temperature over which it changes [-]
LAW_SPEED = 1.5  # buckets of speed [-]
WARMER = 0.05  # of its slope over warmth at each speed [-]
NUISANCE = (0.1, 0.5, 0.2, 0.03, 0.01, 0.01)  # per load, difference, scatter, and kelvins
WARM_SHARE = 0.5  # of these, times warmth

PROGRAM = 0.03  # of what one program differs from another at equal features [-]
PROGRAM_WARMER = 0.3  # share of it that comes with warmth [-]
PROGRAM_SLOPES = (0.1, 0.5, 0.5)  # of one program, per load, difference, scatter [-]
PRIOR_PROGRAMS = 3.0  # pairs of programs that this is worth

LEAST_SCATTER = 0.001  # of a record of `RECORD_TIME` [-]
DRIFTING = 0.001  # what neighbours differ by for slow causes [-]
PRIOR_CONTRASTS = 6.0  # weight of the stated scatter against that of the contrasts
MIN_SHARE, MAX_SHARE = 0.01, 100.0  # of the stated variance


@dataclass(frozen=True)
class Baseline:
    """What is known of the baseline.

    Attributes:
        mean: Coefficients, shape (FEATURES,). [-]
        covariance: Of these, shape (FEATURES, FEATURES). [-]
        scatter: Variance of a record, in units of `scatter`. [-]
    """

    mean: Float
    covariance: Float
    scatter: float


class Contrasts:
    """Sums over pairs of records that were merged.

    Attributes:
        information: Shape (FEATURES, FEATURES). [-]
        target: Shape (FEATURES,). [-]
        square: Of the differences of the excess. [-]
        count: Pairs. [-]
        program_square: Of what programs differed by, weighted. [-]
        program_weight: Sum of the weights. [-]
    """

    def __init__(self) -> None:
        self.information: Float = np.zeros((FEATURES, FEATURES))
        self.target: Float = np.zeros(FEATURES)
        self.square = 0.0
        self.count = 0
        self.program_square = 0.0
        self.program_weight = 0.0
        self._baseline: Baseline | None = None

    def step(self, before: WearRecord, after: WearRecord) -> None:
        """Take two neighbours.

        Args:
            before: The older one.
            after: The newer one.
        """
        apart = np.subtract(after.features, before.features)
        variance = scatter(before) + scatter(after) + DRIFTING**2
        pair = [before, after]
        number = programs(pair)
        if number[1]:
            self._compare_programs(after.excess - before.excess, apart, variance)
        if self.program_weight:
            own = self.of_programs(np.array([one.features for one in pair]), number)
            variance += float(own[0, 0] + own[1, 1] - 2.0 * own[0, 1])
        weight = 1.0 / variance
        self.information += weight * np.outer(apart, apart)
        self.target += weight * (after.excess - before.excess) * apart
        self.square += weight * (after.excess - before.excess) ** 2
        self.count += 1
        self._baseline = None

    @property
    def program(self) -> float:
        """Variance of what a program adds to the baseline. [-]"""
        square = PRIOR_PROGRAMS * PROGRAM**2 + self.program_square
        return max(square / (PRIOR_PROGRAMS + self.program_weight), LEAST_SCATTER**2)

    def of_programs(self, features: Float, number: Int) -> Float:
        """Return the covariance of what programs add to the baseline.

        A payload that the model does not have leaves a part of its torque in the mean of the
        directions, another in every program: so each program has slopes of its own.

        Args:
            features: Of records, shape (N, FEATURES). [-]
            number: Of the program of each, shape (N,).

        Returns:
            Shape (N, N). [-]
        """
        level = np.sqrt(self.program) * np.ones(len(number))
        loads = features[:, LOADS] - features[:, LOADS].mean(axis=0)
        warm = PROGRAM_WARMER * level * warmths(features)
        shapes = np.column_stack([level, warm, np.array(PROGRAM_SLOPES) * loads])
        return (number[:, None] == number) * (shapes @ shapes.T)

    def _compare_programs(self, difference: float, apart: Float, variance: float) -> None:
        """Learn how far programs differ; a pair counts as far as all else in it is known."""
        known = self.baseline()
        rest = known.scatter * variance + float(apart @ known.covariance @ apart)
        weight = PROGRAM**2 / (PROGRAM**2 + rest / 2.0)
        off = difference - float(apart @ known.mean)
        self.program_square += weight * (off**2 - rest) / 2.0
        self.program_weight += weight

    def baseline(self) -> Baseline:
        """Return what is known of the baseline."""
        if self._baseline is None:
            self._baseline = self._solved()
        return self._baseline

    def state(self) -> ContrastEntry:
        """Return what must be kept across a restart."""
        return ContrastEntry(
            information=flat(self.information),
            target=flat(self.target),
            square=self.square,
            count=self.count,
            program_square=self.program_square,
            program_weight=self.program_weight,
        )

    @classmethod
    def restored(cls, entry: ContrastEntry) -> Contrasts:
        """Continue from what was kept.

        Args:
            entry: As `state` gave it.

        Returns:
            The sums.

        Raises:
            StateFileError: If an array has another size.
        """
        found = cls()
        if not entry.count:
            return found
        found.information = filled(entry.information, found.information)
        found.target = filled(entry.target, found.target)
        found.square, found.count = entry.square, entry.count
        found.program_square, found.program_weight = entry.program_square, entry.program_weight
        return found

    def _solved(self) -> Baseline:
        share = 1.0
        mean, covariance = np.zeros(FEATURES), _PRIOR
        for _ in range(3 if self.count else 0):
            precision = _PRECISION + self.information / share
            covariance = np.linalg.inv(precision)
            covariance = (covariance + covariance.T) / 2
            mean = covariance @ self.target / share
            residual = self.square - float(mean @ (2 * self.target - self.information @ mean))
            free = self.count - float(np.sum(covariance * self.information)) / share
            share = (PRIOR_CONTRASTS + max(residual, 0.0)) / (PRIOR_CONTRASTS + max(free, 0.0))
            share = min(max(share, MIN_SHARE), MAX_SHARE)
        return Baseline(mean, covariance, share)


def scatter(record: WearRecord) -> float:
    """Return the variance of a record as it states it, never zero. [-]

    Args:
        record: Of any length.
    """
    return record.variance + LEAST_SCATTER**2 * RECORD_TIME / record.time


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
