"""What a result owes to figures that a paper leaves open: one table for every study.

Each open figure has a nominal value and a range with a physical reason. The result is computed at
both ends, all else nominal, and the value of one figure alone is sought that gives the published
result. Then all figures are drawn at once from their ranges: the spread of the result, and the
share of the draws that reach the published one, say what the paper leaves open.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated

import numpy as np

from robot_energy.foundation.errors import MotionError
from robot_energy.results.base import Number, Result
from robot_energy.timeline.blocks import Float

Values = Mapping[str, float]
Evaluate = Callable[[Values], Mapping[str, float]]
"""Values of all open figures by key -> results by quantity. It raises where a motion is refused."""

QUANTILES = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)  # of a spread
TOGETHER = 25  # draws that share the values of slow figures
TOLERANCE = 1e-3  # of the way from nominal to an end, of the values that are sought


@dataclass(frozen=True)
class OpenFigure:
    """A figure that the paper does not publish."""

    key: str
    name: str
    unit: str
    low: float
    nominal: float
    high: float
    reason: str
    switch: bool = False


def open_figures(*rows: tuple[str, str, str, float, float, float, str]) -> tuple[OpenFigure, ...]:
    """Return open figures of a table.

    Args:
        rows: Key, name, unit; lower end, nominal and upper end [unit]; reason.
    """
    return tuple(OpenFigure(*row) for row in rows)


class SensitivityRow(Result):
    """One open figure."""

    figure: Annotated[OpenFigure, "Its name, unit and range."]
    at_low: Annotated[float, "Result with it at its lower end, all else nominal."]
    at_high: Annotated[float, "Result with it at its upper end, all else nominal."]
    elasticity: Annotated[
        Number,
        "Relative change of the result per relative change of the figure: mean slope over the "
        "range times nominal figure over nominal result; None where the nominal figure is 0. [-]",
    ]
    reproduces: Annotated[
        Number, "What gives the published result, all else nominal; None: nothing."
    ]


class Spread(Result):
    """All open figures drawn at once, each from its range.

    A figure lies below its nominal value in one half of the draws and above it in the other,
    uniformly; uniformly over its range where the nominal value is an end. A switch is on in half.
    """

    draws: Annotated[int, "Number of draws, without those in which no motion is possible."]
    seed: Annotated[int, "Of the draws."]
    quantiles: Annotated[tuple[float, ...], "Least, 5 %, 25 %, median, 75 %, 95 %, greatest."]
    reaching: Annotated[float, "Share of the draws at least as far off as the paper. [-]"]


class SensitivityTable(Result):
    """What one quantity owes to the open figures."""

    quantity: Annotated[str, "Name of the result."]
    published: Annotated[float, "As in the paper."]
    nominal: Annotated[float, "With all figures nominal."]
    rows: Annotated[tuple[SensitivityRow, ...], "Of each open figure."]
    spread: Annotated[Spread | None, "With all figures drawn at once; None where none were drawn."]

    @property
    def alone(self) -> list[SensitivityRow]:
        """Figures that give the published result alone."""
        return [row for row in self.rows if row.reproduces is not None]


def sensitivity(
    evaluate: Evaluate,
    figures: Sequence[OpenFigure],
    published: Mapping[str, float],
    tolerance: float = TOLERANCE,
    only: Sequence[str] | None = None,
    draws: int = 0,
    seed: int = 0,
    slow: Sequence[str] = (),
) -> dict[str, SensitivityTable]:
    """Return a table for every quantity that the paper publishes.

    Args:
        published: Results of the paper by quantity. [any unit]
        tolerance: Of values that are sought, share of the way to an end. [-]
        slow: Keys of figures that are drawn again every `TOGETHER` draws only: they take long.
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
    drawn = [
        result
        for values in _drawn(figures, draws, seed, slow)
        if (result := _possible(evaluate, {**nominal, **values})) is not None
    ]
    tables: dict[str, SensitivityTable] = {}
    for quantity, goal in published.items():
        start, rows = base[quantity], list[SensitivityRow]()

        def off(key: str, value: float, quantity: str = quantity, goal: float = goal) -> float:
            return evaluate({**nominal, key: value})[quantity] - goal

        for figure in figures:
            at = {end: ends[figure.key, end][quantity] if end != figure.nominal else start
                  for end in (figure.low, figure.high)}  # fmt: skip
            slope = (at[figure.high] - at[figure.low]) / (figure.high - figure.low)
            elasticity = slope * figure.nominal / start if figure.nominal and start else None
            beyond = (end for end in at if (start - goal) * (at[end] - goal) <= 0)
            alone = next((end for end in beyond if end != figure.nominal), None)
            if alone is not None and not figure.switch:
                known = {0.0: start - goal, 1.0: at[alone] - goal}
                alone = _root(partial(off, figure.key), figure.nominal, alone, known, tolerance)
            rows.append(SensitivityRow(figure, at[figure.low], at[figure.high], elasticity, alone))
        results = np.array([result[quantity] for result in drawn])
        spread = _spread(results, start, goal, seed) if drawn else None
        tables[quantity] = SensitivityTable(quantity, goal, start, tuple(rows), spread)
    return tables


def _root(
    off: Callable[[float], float],
    nominal: float,
    end: float,
    known: dict[float, float],
    tolerance: float,
) -> float:
    """The value between nominal and an end that gives the goal, which lies between them."""
    from scipy.optimize import brentq

    def value(share: float) -> float:
        return (1 - share) * nominal + share * end

    def missed(share: float) -> float:
        return known[share] if share in known else off(value(share))

    return value(float(brentq(missed, 0.0, 1.0, xtol=tolerance, rtol=tolerance)))


def _possible(evaluate: Evaluate, values: Values) -> Mapping[str, float] | None:
    """Results; None where figures drawn together leave no motion, such as a wall out of reach."""
    try:
        return evaluate(values)
    except MotionError:
        return None


def _drawn(
    figures: Sequence[OpenFigure], draws: int, seed: int, slow: Sequence[str]
) -> Iterator[dict[str, float]]:
    random = np.random.default_rng(seed)
    values: dict[str, float] = {}
    for number in range(draws):
        for figure in figures:
            if number % TOGETHER and figure.key in slow:
                continue
            values[figure.key] = _prior(figure, float(random.uniform()))
        yield dict(values)


def _prior(figure: OpenFigure, share: float) -> float:
    """The value below which a figure lies in a share of the draws."""
    if figure.switch:
        return figure.low if share < 0.5 else figure.high
    ends = figure.low, figure.nominal, figure.high
    if figure.nominal in (figure.low, figure.high):
        return figure.low + share * (figure.high - figure.low)
    return float(np.interp(share, (0.0, 0.5, 1.0), ends))


def _spread(results: Float, nominal: float, goal: float, seed: int) -> Spread:
    side = 1.0 if goal > nominal else -1.0
    reaching = float(np.mean((results - goal) * side >= 0.0))
    quantiles = tuple(np.quantile(results, QUANTILES).tolist())
    return Spread(len(results), seed, quantiles, reaching)
