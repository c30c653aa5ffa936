"""Finds lasting changes of friction: a generalised likelihood ratio over records of motion.

The excess of a record, ``log(measured / model friction)``, is without wear a baseline that the
test learns from the robot's own records, plus a slow wander and scatter. The baseline is linear
in the features of a record: a smooth function of temperature and speed (the error of the model's
friction law), load, difference of directions, scatter, slope and history of the temperature, each
of them also times warmth. Wear adds a step or a ramp that begins at one of the records. With K the
covariance without wear, y the excess minus its expected baseline and u the shape of a change,

``size = u' K^-1 y / u' K^-1 u``,  ``z = u' K^-1 y / sqrt(u' K^-1 u)``,

and z is standard normal without a change. How large the wander is nobody says: with log
likelihoods l(s) of its sizes s, ``sqrt(2 (max(l + z^2 / 2) - max l))`` over all sizes, shapes and
beginnings is compared with a limit of `AlarmLimits`: of a ramp, of a step, or of a step that hours
of motion have not yet confirmed: a payload differs from all before by more than it scatters.
Each program of the robot but the first has a level and slopes of its own (`programs`). A change
that was found stays in the model, so that the next one is looked for on top of it.

Old records are merged in pairs. The difference of a pair says nothing of wear, but of the
baseline and of the scatter; it is kept in the sums of `Contrasts`, so that merging loses neither.
"""

from __future__ import annotations

from math import erfc, exp, inf, sqrt
from typing import Annotated

import numpy as np

from robot_energy.condition.baseline import BRIEF_HOURS, Contrasts, correlated, scatter
from robot_energy.condition.record import STRICT, Number, Stamp
from robot_energy.condition.wear_records import (
    DIGITS,
    OWN,
    RECORD_TIME,
    ProgramTable,
    WearRecord,
    columns,
)
from robot_energy.foundation.described import Described
from robot_energy.timeline.blocks import Float

WANDERS = (0.0005, 0.00125, 0.003, 0.008, 0.016)  # of no known cause; the likeliest counts [-]
PROGRAM_WANDER = 0.05  # one more of these, once another program was seen [-]
WANDER_HOURS = 3.0  # of motion
BRIEF = 0.5  # part of the scatter, that lasts a while; share of its variance [-]
CHANGE = 1.0  # of a change that was found, before its size is known [-]

LARGE = 0.08  # of a step that is large: no payload makes it [-]
MIN_SIZE = 0.005  # of a change [-]
MIN_BEFORE, MIN_AFTER = 3, 3  # records before and after the beginning of a change
MIN_RAMP = 12.0  # shortest ramp, and reference before it; what is shorter is a step [h]
MAX_CHANGES = 8
SAME = 2.0  # two changes that are no further apart are one [h]
MAX_LEVEL = 8  # records of one length; the two oldest are then merged
LONGEST = 40_000.0  # a record that is not merged any more [s]
MAX_RECORDS = 90


class AlarmLimits(Described):
    """Deviations by which a change must exceed all other causes than wear to be an alarm. [-]

    Set by what sound robots of the virtual rig reach in thousands of hours, and changed ones do.
    """

    ramp: Annotated[float, "A change that comes slowly, among drifts of no known cause."]
    step: Annotated[float, "A step that has lasted: payloads change within hours."]
    young_large: Annotated[float, "A step of `LARGE` or more that has not lasted yet."]
    young: Annotated[float, "A smaller one, which a payload may be."]

    def of(self, ramp: bool, young: bool, large: bool) -> float:
        """Return the limit of a change. [-]"""
        if ramp or not young:
            return self.ramp if ramp else self.step
        return self.young_large if large else self.young


SEVERAL_PROGRAMS = AlarmLimits(8.0, 8.0, 12.0, 18.0)
"""Once another program was seen: it moves friction as no payload does, also by much."""


class Subject(Described):
    """What the records are of."""

    min_hours: Annotated[float, "Motion before anything is found; no payload but one was seen. [h]"]
    lasting: Annotated[float, "A step that is younger is young. [h]"]
    limits: Annotated[AlarmLimits, "While one program is known."]
    max_brief: Annotated[
        float,
        "Greatest standard deviation of what scatter lasts a while, unless it is learned as "
        "payload. [-]",
    ]


JOINT = Subject(3.0, 6.0, AlarmLimits(4.0, 5.0, 5.0, 10.0), 0.002)
ROBOT = Subject(48.0, 24.0, AlarmLimits(4.7, 5.0, 5.0, 10.0), inf)
"""By a power meter, where payloads move friction more."""
BAGS = Subject(3.0, 6.0, ROBOT.limits, inf)
"""Of one joint, one record each; they differ for many reasons."""


class FrictionChange(Described):
    """A change that was found."""

    __pydantic_config__ = STRICT  # it is kept as it is

    stamp_ns: Stamp
    hours: Annotated[Number, "Hours of motion when it began. [h]"]
    until: Annotated[
        Number, "Hours of motion when it was complete, or found; those of the step. [h]"
    ]
    size: Annotated[Number, "Logarithm of the factor when it was found. [-]"]

    @property
    def ramp(self) -> bool:
        """Whether it came slowly."""
        return self.until > self.hours


class Drift(Described):
    """How far friction has changed since the first records."""

    size: Annotated[float, "All changes together; 0 if there is none. [-]"] = 0.0
    std: Annotated[float, "Its standard deviation; NaN if there is none. [-]"] = float("nan")
    since_ns: Annotated[
        int | None, "When the first of the latest changes of one sign began; None: none. [ns]"
    ] = None
    sure: Annotated[float, "Probability that the newest change is not chance. [-]"] = 0.0
    fell: Annotated[bool, "Whether the newest change was a fall."] = False


class DriftTest:
    """Tests the records of one joint, or of the whole robot."""

    def __init__(self, subject: Subject = JOINT) -> None:
        self._subject = subject
        self.records: list[WearRecord] = []
        self.changes: list[FrictionChange] = []
        self.contrasts = Contrasts()
        self.programs = ProgramTable()
        self.drift = Drift()
        self.refused = 0  # records that were not numbers

    def step(self, record: WearRecord) -> bool:
        """Return whether a change is found with one more record."""
        if not np.isfinite([record.excess, record.variance, *record.features]).all():
            self.refused += 1
            return False
        known, forgotten = self.programs.step(record)
        if forgotten is not None:
            self._forget(forgotten)
        if known is None:
            return False
        self.records.append(known)
        self._merge()
        found = self._search()
        if found is not None:
            self._note(found)
        elif self.changes and record.hours - self.changes[-1].until < SAME:
            self._look_again()
        if self.changes:
            self.drift = self._drift()
        return found is not None

    def _forget(self, number: int) -> None:
        """Take out what the coefficients of a program have added to the records."""
        own = columns(number)
        mean = self.contrasts.forget(number)
        for index, record in enumerate(self.records):
            share = record.program[own]
            if any(share):
                program = (*record.program[: own.start], *(0.0,) * OWN, *record.program[own.stop :])
                excess = round(record.excess - float(mean @ share), DIGITS)
                self.records[index] = record._replace(excess=excess, program=program)

    def _look_again(self) -> None:
        """Date the newest change by what has come since."""
        kept = self.changes
        self.changes = kept[:-1]
        found = self._search()
        same = found is not None and found.size * kept[-1].size > 0
        self.changes = [*self.changes, found] if found is not None and same else kept

    def take(self, records: list[WearRecord]) -> None:
        """Take all records of a robot as they are, oldest first, and look for all changes."""
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

    def restore(
        self,
        records: list[WearRecord],
        changes: list[FrictionChange],
        contrasts: Contrasts,
        programs: ProgramTable,
    ) -> None:
        """Continue from what was kept."""
        self.records, self.changes = records, changes
        self.contrasts, self.programs = contrasts, programs
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
            self._join(first, second)
            length *= 2.0
        if len(self.records) > MAX_RECORDS:
            self._join(1, 2)

    def _join(self, first: int, second: int) -> None:
        """Merge two neighbours; what they differ by is learned from unless friction changed."""
        before, after = self.records[first], self.records.pop(second)
        shapes = self._shapes([before, after])
        if (shapes[0] == shapes[1]).all():
            self.contrasts.step(before, after)
        self.records[first] = before.merged(after)

    def _search(self) -> FrictionChange | None:
        """Return the change that stands out most, if it stands out enough."""
        n = len(self.records)
        hours = self._hours()
        if n < MIN_BEFORE + MIN_AFTER or hours[-1] < self._subject.min_hours:
            return None
        begins = np.arange(MIN_BEFORE, n)
        steps = (np.arange(n)[:, None] >= begins).astype(np.float64)
        before = hours[begins - 1]
        slow = begins[(before >= MIN_RAMP) & (hours[-1] - before >= MIN_RAMP)]
        ramps = np.maximum(hours[:, None] - hours[slow - 1], 0.0)
        factors, likelihood, excess = self._factors()
        white = np.linalg.solve(factors, np.column_stack([excess, steps, ramps]))
        weight = (white[:, :, 1:] ** 2).sum(axis=1)
        z = np.einsum("stm,st->sm", white[:, :, 1:], white[:, :, 0]) / np.sqrt(weight)
        gain = likelihood[:, None] + z**2 / 2.0
        surprise = np.sqrt(2.0 * np.maximum(gain.max(axis=0) - likelihood.max(), 0.0))
        best = int(np.argmax(surprise))
        if best < len(begins) and not self._confirmed(int(begins[best])):
            return None
        wander = int(np.argmax(gain[:, best]))
        size = float(z[wander, best] / np.sqrt(weight[wander, best]))
        ramp = best >= len(begins)
        begin = int(np.concatenate([begins, slow])[best])
        before, after = self.records[begin - 1], self.records[begin]
        young = hours[-1] - before.hours < self._subject.lasting
        limits = SEVERAL_PROGRAMS if self.contrasts.programs else self._subject.limits
        least = limits.of(ramp, bool(young), abs(size) >= LARGE)
        if surprise[best] < least or begin > n - MIN_AFTER:
            return None
        size *= float(hours[-1] - before.hours) if ramp else 1.0
        if abs(size) < MIN_SIZE:
            return None
        share = before.time / (before.time + after.time)  # so it falls between two neighbours
        start = float(before.hours + (0.0 if ramp else share * (after.hours - before.hours)))
        stamp_ns = before.stamp_ns + round(share * (after.stamp_ns - before.stamp_ns))
        return FrictionChange(stamp_ns, start, float(hours[-1]) if ramp else start, size)

    def _confirmed(self, begin: int) -> bool:
        """Whether records after a step are of programs that were seen before it."""
        later = np.zeros((len(self.records), 1 + self.contrasts.programs))
        for row, record in zip(later, self.records, strict=True):
            levels = record.program[::OWN]
            row[1 : 1 + len(levels)] = levels
        later[:, 0] = 1.0 - later.sum(axis=1)
        known = (later[:begin] > 0.0).any(axis=0)
        return int((later[begin:, known].sum(axis=1) > 0.5).sum()) >= MIN_AFTER

    def _shapes(self, records: list[WearRecord]) -> Float:
        """What each change that was found adds to records, means, shape (n, changes). [-]"""
        middle = np.array([record.hours for record in records])[:, None]
        half = np.array([record.time for record in records])[:, None] / 7200.0
        begun = np.array([change.hours for change in self.changes])
        length = np.array([change.until for change in self.changes]) - begun

        def summed(hours: Float) -> Float:
            passed = hours - begun
            rising = np.clip(passed, 0.0, length) ** 2 / (2.0 * np.maximum(length, 1e-9))
            return rising + np.maximum(passed - length, 0.0)

        share = (summed(middle + half) - summed(middle - half)) / (2.0 * half)
        return np.round(np.clip(share, 0.0, 1.0), 9)

    def _drift(self) -> Drift:
        """Return all changes together, at the newest record."""
        shapes = self._shapes(self.records)
        now = shapes[-1]
        factors, likelihood, excess = self._factors()
        factor = factors[int(np.argmax(likelihood))]
        white = np.asarray(np.linalg.solve(factor, np.column_stack([excess, shapes])), np.float64)
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
        ratio = exp(size)
        since_ns = self.changes[first].stamp_ns
        return Drift(ratio - 1.0, ratio * std, since_ns, max(sure, 0.0), newest < 0)

    def _factors(self) -> tuple[Float, Float, Float]:
        """Covariance by size of the wander (Cholesky factors), its likelihood, and the excess.

        Shapes (S, n, n), (S,) and (n,); the excess is that above its expected baseline.
        """
        rows = self.contrasts.rows(self.records)
        hours = self._hours()
        baseline = self.contrasts.baseline()
        excess = np.array([record.excess for record in self.records]) - rows @ baseline.mean
        covariance = rows @ baseline.covariance @ rows.T
        changes = self._shapes(self.records)
        covariance += CHANGE**2 * changes @ changes.T
        time = np.array([record.time for record in self.records])
        own = baseline.scatter * np.array([scatter(one) for one in self.records])
        typical = float(np.median(own * time)) / RECORD_TIME
        brief = min(BRIEF * typical, self._subject.max_brief**2) + self.contrasts.payload
        covariance += np.diag(own) + brief * correlated(hours, time, BRIEF_HOURS)
        wander = correlated(hours, time, WANDER_HOURS)
        wanders = (*WANDERS, PROGRAM_WANDER) if self.contrasts.programs else WANDERS
        sizes = np.square(wanders)[:, None, None]
        factors = np.linalg.cholesky(covariance + sizes * wander)
        white = np.linalg.solve(factors, excess[:, None])[:, :, 0]
        likelihood = -0.5 * (white**2).sum(axis=1)
        likelihood -= np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)
        return factors, likelihood, excess

    def _hours(self) -> Float:
        return np.array([record.hours for record in self.records])
