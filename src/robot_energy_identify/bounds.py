"""Figures that stop at a bound: what physics forbids below 0 and came out there.

Such a figure says that the data do not show the quantity, not that it is 0. So it is never
tagged as identified.
"""

from __future__ import annotations

import math

from robot_energy.model.figure import Figure, PositiveFigure

AT_BOUND = "at the bound 0"
NO_INFORMATION = "the recordings hold no information about it; taken as 0"


def at_bound(source: str, value: float = 0.0) -> PositiveFigure:
    """Return a figure that no data may make negative; a bound has no standard deviation.

    Args:
        value: 0, or what rounding of a solver left of it. [of the figure]
    """
    text = f"{AT_BOUND}: {source}" if source else AT_BOUND
    return PositiveFigure(value=value, tag="assumed", source=text)


def is_at_bound(figure: Figure) -> bool:
    """Whether a figure was written by `at_bound`."""
    return figure.source.startswith(AT_BOUND)


def not_identified(figure: Figure) -> str:
    """Return why a fitted figure is not identified, or nothing."""
    if is_at_bound(figure):
        return "at its bound"
    return "no information" if figure.source.startswith(NO_INFORMATION) else ""


def identified(value: float, std: float | None, source: str) -> PositiveFigure:
    """Return an identified figure, or the bound where it is not above 0.

    Args:
        value: As fitted. [of the figure]
        std: Its standard deviation; None or not finite where it is unknown. [of the figure]
    """
    if not value > 0.0:
        return at_bound(source)
    known = std is not None and math.isfinite(std)
    return PositiveFigure(value=value, tag="identified", std=std if known else None, source=source)


def only_the_sum(value: float, of: str, source: str) -> PositiveFigure:
    """Return a figure of which the data show only the sum with others; it has no deviation.

    Args:
        value: Its share. [of the figure]
    """
    text = f"only the sum of {of}, is identified"
    return PositiveFigure(
        value=max(value, 0.0), tag="derived", source=f"{text}: {source}" if source else text
    )
