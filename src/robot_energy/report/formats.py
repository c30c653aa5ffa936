"""Figures as text: one way for the terminal and for pages; what is not known is a dash."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

NOTHING = "-"
WATT_HOUR = 3600.0  # J


class EnergyFormat:
    """One unit and precision for all energies of a report, so that columns add up by eye.

    Args:
        largest: The largest energy. [J]
    """

    def __init__(self, largest: float) -> None:
        units = (("MJ", 1e6), ("kJ", 1e3), ("J", 1.0))
        self.unit, self.factor = next((u for u in units if largest >= u[1]), units[-1])
        lead = largest / self.factor if largest > 0 else 1.0
        self.digits = max(0, 3 - math.floor(math.log10(lead)))
        self.digits = min(self.digits, 3)

    def joule(self, energy: float | None) -> str:
        """Return an energy in the report's unit. [J]"""
        return NOTHING if energy is None else number(energy / self.factor, self.digits)


def fixed(digits: int) -> Callable[[float | None], str]:
    """Return a format with fixed digits after the point."""
    return lambda value: NOTHING if value is None else number(value, digits)


def significant(digits: int) -> Callable[[float | None], str]:
    """Return a format with so many digits in all."""
    return lambda value: NOTHING if value is None else f"{value:.{digits}g}"


def aligned(values: Iterable[float | None], digits: int) -> Callable[[float | None], str]:
    """Return a format of one column: the largest value has so many digits, all end alike.

    Args:
        values: Of the column.
        digits: Of the largest, in all.
    """
    known = [abs(value) for value in values if value is not None and math.isfinite(value)]
    lead = math.floor(math.log10(max(known, default=0.0) or 1.0))
    return fixed(max(0, digits - 1 - lead))


def number(value: float, digits: int) -> str:
    """Return a number with fixed digits; never ``-0``."""
    text = f"{value:.{digits}f}"
    return text.removeprefix("-") if float(text) == 0 else text


def watt_hour(energy: float | None) -> str:
    """Return an energy in Wh, with one digit above 10 kWh. [J]"""
    if energy is None:
        return NOTHING
    return f"{number(energy / WATT_HOUR, 3 if abs(energy) < 10 * WATT_HOUR else 1)} Wh"


def energy_text(energy: float) -> str:
    """Return one energy in words, three to four digits. [J]"""
    for unit, factor in (("MJ", 1e6), ("kJ", 1e3)):
        if abs(energy) >= factor:
            return f"{energy / factor:.4g} {unit}"
    return f"{energy:.4g} J"


def percent(ratio: float | None, sign: bool = False) -> str:
    """Return a ratio in percent."""
    if ratio is None:
        return NOTHING
    text = number(100 * ratio, 1)
    return f"{'+' if sign and not text.startswith('-') else ''}{text} %"


def signed_percent(ratio: float | None) -> str:
    """Return a ratio in percent, with its sign."""
    return percent(ratio, sign=True)


def seconds(time_ns: int) -> str:
    """Return a time in s. [ns]"""
    return f"{time_ns * 1e-9:.3f} s"


def counted(count: int, one: str, many: str = "") -> str:
    """Return a count with its noun."""
    return f"{count} {one if count == 1 else many or one + 's'}"


def grouped(notes: Sequence[str]) -> list[str]:
    """Return notes of the form ``name: text`` with one line for all names of the same text.

    Args:
        notes: One sentence each; those without a name stay as they are.
    """
    names: dict[str, list[str]] = {}
    for note in notes:
        name, colon, text = note.partition(": ")
        names.setdefault(text if colon else note, []).append(name if colon else "")
    return [f"{', '.join(who)}: {text}" if who[0] else text for text, who in names.items()]


def tags_text(figures: dict[str, int]) -> str:
    """Return how many figures of a model are known in which way."""
    return ", ".join(f"{count} {tag}" for tag, count in figures.items() if count) or "none tagged"
