"""What a result owes to figures that a paper leaves open: one table for every study.

Each open figure has a nominal value and a range with a physical reason. The result is computed at
both ends, all else nominal. Then values are sought that give the published result: of one figure
alone, and of as few figures together as possible, all the same share of the way to their ends.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from robot_energy.results.base import Number, Result

Values = Mapping[str, float]
Evaluate = Callable[[Values], Mapping[str, float]]
"""Values of all open figures by key -> results by quantity. It raises where a motion is refused."""

TOLERANCE = 1e-3  # of the way from nominal to an end, of the values that are sought


@dataclass(frozen=True)
class OpenFigure:
    """A figure that the paper does not publish.

    Attributes:
        key: By which `Evaluate` takes it.
        unit: Empty for a factor.
        low: Lower end of what is plausible.
        nominal: As the study has it.
        high: Upper end.
        switch: Whether nothing lies between its values.
    """

    key: str
    name: str
    unit: str
    low: float
    nominal: float
    high: float
    reason: str
    switch: bool = False

    def __post_init__(self) -> None:
        if not self.low <= self.nominal <= self.high or self.low == self.high:
            raise ValueError(f"{self.key}: {self.low}, {self.nominal}, {self.high} do not rise")


def open_figures(*rows: tuple[str, str, str, float, float, float, str]) -> tuple[OpenFigure, ...]:
    """Return open figures of a table.

    Args:
        rows: Key, name, unit; lower end, nominal and upper end [unit]; reason.
    """
    return tuple(OpenFigure(*row) for row in rows)


class SensitivityRow(Result):
    """One open figure.

    Attributes:
        figure: The figure.
        at_low: Result at the lower end.
        at_high: Result at the upper end.
        elasticity: Relative change of the result per relative change of the figure: mean slope
            over the range times nominal figure over nominal result; None where the nominal
            figure is 0. [-]
        reproduces: The value inside the range that gives the published result, all else
            nominal; None where there is none.
    """

    figure: OpenFigure
    at_low: float
    at_high: float
    elasticity: Number
    reproduces: Number


class Combination(Result):
    """Several figures that give the published result together.

    Attributes:
        share: Of the way of each from nominal to the end that helps. [-]
        values: By key.
        result: What they give.
    """

    share: float
    values: dict[str, float]
    result: float


class SensitivityTable(Result):
    """What one quantity owes to the open figures.

    Attributes:
        quantity: What it is.
        published: As in the paper.
        nominal: Of the study.
        rows: One per figure.
        reach: With every figure at the end that helps; None where the published result is reached.
        combination: The fewest figures that reach the published result together, the strongest
            first; None where one alone does, or where all of them do not.
    """

    quantity: str
    published: float
    nominal: float
    rows: tuple[SensitivityRow, ...]
    reach: Number
    combination: Combination | None

    @property
    def alone(self) -> list[SensitivityRow]:
        """Figures that give the published result alone."""
        return [row for row in self.rows if row.reproduces is not None]

    def named(self, key: str) -> OpenFigure:
        """Return the figure of a key."""
        return next(row.figure for row in self.rows if row.figure.key == key)


def sensitivity(
    evaluate: Evaluate,
    figures: Sequence[OpenFigure],
    published: Mapping[str, float],
    tolerance: float = TOLERANCE,
    only: Sequence[str] | None = None,
) -> dict[str, SensitivityTable]:
    """Return a table for every quantity that the paper publishes.

    Args:
        published: Results of the paper by quantity. [any unit]
        tolerance: Of values that are sought, share of the way to an end. [-]
        only: Keys of the figures that are changed; None for all.
    """
    nominal = {figure.key: figure.nominal for figure in figures}
    figures = [figure for figure in figures if only is None or figure.key in only]
    base = evaluate(nominal)
    ends = {
        (figure.key, end): evaluate({**nominal, figure.key: end})
        for figure in figures
        for end in (figure.low, figure.high)
        if end != figure.nominal
    }
    return {
        quantity: _Sought(evaluate, figures, quantity, goal, tolerance, nominal).table(base, ends)
        for quantity, goal in published.items()
    }


@dataclass(frozen=True)
class _Sought:
    """The search for one published result."""

    evaluate: Evaluate
    figures: Sequence[OpenFigure]
    quantity: str
    goal: float
    tolerance: float
    nominal: dict[str, float]

    def table(
        self, base: Mapping[str, float], ends: Mapping[tuple[str, float], Mapping[str, float]]
    ) -> SensitivityTable:
        start = base[self.quantity]
        sign = 1.0 if self.goal > start else -1.0
        rows: list[SensitivityRow] = []
        helps: dict[str, tuple[float, float]] = {}  # result and value at the end that helps more
        for figure in self.figures:
            at = {
                end: ends[figure.key, end][self.quantity] if end != figure.nominal else start
                for end in (figure.low, figure.high)
            }
            gain, end = max(((result - start) * sign, end) for end, result in at.items())
            if gain > 0:
                helps[figure.key] = at[end], end
            slope = (at[figure.high] - at[figure.low]) / (figure.high - figure.low)
            rows.append(
                SensitivityRow(
                    figure,
                    at[figure.low],
                    at[figure.high],
                    slope * figure.nominal / start if figure.nominal and start else None,
                    self._alone(figure, start, at),
                )
            )
        reach: float | None = None
        combination = None
        if all(row.reproduces is None for row in rows):
            order = sorted(helps, key=lambda key: abs(helps[key][0] - start), reverse=True)
            strongest = helps[order[0]][0] if order else start
            ends_of = {key: helps[key][1] for key in order}
            reach, combination = self._together(ends_of, start, strongest)
        return SensitivityTable(self.quantity, self.goal, start, tuple(rows), reach, combination)

    def _alone(self, figure: OpenFigure, start: float, at: Mapping[float, float]) -> float | None:
        """The value between nominal and an end that gives the goal, where the end is beyond it."""
        for end, result in at.items():
            if end != figure.nominal and (start - self.goal) * (result - self.goal) <= 0:
                if figure.switch:
                    return end
                return self._root({figure.key: end}, start, result).values[figure.key]
        return None

    def _together(
        self, ends: Mapping[str, float], start: float, strongest: float
    ) -> tuple[float | None, Combination | None]:
        """Add figures, strongest first, until the goal is passed."""
        keys, result = list(ends), strongest
        for count in range(2, len(keys) + 1):
            chosen = {key: ends[key] for key in keys[:count]}
            result = self._at(chosen, 1.0)
            if (start - self.goal) * (result - self.goal) <= 0:
                return None, self._root(chosen, start, result)
        return result, None

    def _root(self, ends: Mapping[str, float], start: float, result: float) -> Combination:
        from scipy.optimize import brentq

        known = {1.0: result - self.goal}
        if not any(figure.switch for figure in self.figures if figure.key in ends):
            known[0.0] = start - self.goal

        def off(share: float) -> float:
            if share not in known:
                known[share] = self._at(ends, share) - self.goal
            return known[share]

        share = float(brentq(off, 0.0, 1.0, xtol=self.tolerance, rtol=self.tolerance))
        return Combination(share, self._values(ends, share), off(share) + self.goal)

    def _values(self, ends: Mapping[str, float], share: float) -> dict[str, float]:
        """Values on the way to the ends; a switch is there at once."""
        switched = {figure.key for figure in self.figures if figure.switch}
        return {
            key: end if key in switched else (1 - share) * self.nominal[key] + share * end
            for key, end in ends.items()
        }

    def _at(self, ends: Mapping[str, float], share: float) -> float:
        return self.evaluate({**self.nominal, **self._values(ends, share)})[self.quantity]
