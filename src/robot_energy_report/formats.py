"""Figures as text: one way for the terminal and for pages; what is not known is a dash.

Text is written in ASCII everywhere. `typeset` turns it into true signs and units where it is
shown: on pages, in figures, and on terminals that can show them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from functools import partial

from robot_energy.foundation.time_zone import local_time
from robot_energy.foundation.units import JOULE_PER_KWH, JOULE_PER_WH
from robot_energy_report.page.energy_flow import rounded_parts

NOTHING = "-"
MAX_PLAIN = 1e9  # greater numbers have an exponent
PROSE = 24  # characters: a longer cell is prose, which reads from the left
SMALL = 1e-3  # below it figures with a standard deviation have a power of ten
RAISED = str.maketrans(
    "0123456789+-", "\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079\u207a\u207b"
)
SIGNS: tuple[tuple[str, str | Callable[[re.Match[str]], str]], ...] = (
    (r"(?<![\w/.])degC(?![\w/])", "\u00b0C"),
    (r"(?<![^\s\[(])1e(-?\d{1,2})(?= [A-Za-z])", lambda m: f"10{m[1].translate(RAISED)}"),
    (
        r"((?<![\w.,:/-])\d(?:\.\d+)?|\))e([+-]\d{1,3})(?![\w.])",
        lambda m: f"{m[1]}\u00b710{str(int(m[2])).translate(RAISED)}",
    ),
    (r"(?<![^\s(\[])\+-(?=\s|\d|$)", "\u00b1"),
    (r"(?<=[A-Za-z)])\^(-?\d)(?!\d)", lambda m: m[1].translate(RAISED)),
    (r"\b(N|kg) m(?=\u00b2|\b)", "\\1\u00b7m"),
    (r"(?<=N\u00b7m) s\b", "\u00b7s"),
    (r"(?<![\w/])(s|rad)2\b(?=/|\])", "\\1\u00b2"),
    (r"(?<=/)(s|rad)2(?=\]|\)|$)", "\\1\u00b2"),
    (r"\buJ\b", "\u00b5J"),
    (r"(?<![^\s(\[=])-(?=\.?\d)", "\u2212"),
    (r"(?<=[\w\])][ \n])-(?=[ \n][\w\[(])", "\u2212"),
    (r"\A-\Z", "\u2013"),
)


class EnergyFormat:
    """One unit and precision for all energies of a report, so that columns add up by eye.

    Args:
        largest: The largest energy. [J]
    """

    def __init__(self, largest: float) -> None:
        units = (("MJ", 1e6), ("kJ", 1e3), ("J", 1.0))
        self.unit, self.factor = next((u for u in units if largest >= u[1]), units[-1])
        lead = largest / self.factor if largest > 0 else 1.0
        self.digits = min(3, max(0, 3 - math.floor(math.log10(lead))))  # four in all

    def joule(self, energy: float | None) -> str:
        """Return an energy in the report's unit.

        Args:
            energy: None where it is not known. [J]
        """
        return NOTHING if energy is None else number(energy / self.factor, self.digits)

    def parts(self, energies: Sequence[float | None], whole: str | None = None) -> list[str]:
        """Return parts of an energy in the report's unit; arguments as in `summing`."""
        return summing(energies, self.digits, whole, self.factor)

    def text(self, energy: float | None) -> str:
        """Return an energy with the report's unit; argument as in `EnergyFormat.joule`."""
        return NOTHING if energy is None else f"{self.joule(energy)} {self.unit}"


def fixed(digits: int) -> Callable[[float | None], str]:
    """Return a format with fixed digits after the point."""
    return lambda value: NOTHING if value is None else number(value, digits)


def significant(digits: int) -> Callable[[float | None], str]:
    """Return a format with so many digits in all, or all before the point where these are more."""

    def text(value: float | None) -> str:
        if value is None:
            return NOTHING
        return f"{value:.0f}" if 10.0**digits <= abs(value) < MAX_PLAIN else f"{value:.{digits}g}"

    return text


def aligned(values: Iterable[float | None], digits: int) -> Callable[[float | None], str]:
    """Return a format of a column: the largest value, as in `summing`, has so many digits."""
    known = [abs(value) for value in values if value is not None and math.isfinite(value)]
    lead = math.floor(math.log10(max(known, default=0.0) or 1.0))
    return fixed(max(0, digits - 1 - lead))


def plus_minus(share: float | None) -> str:
    """Return the half width of a band in per cent; argument as in `percent`."""
    return NOTHING if share is None else f"+- {percent(share)}"


def number(value: float, digits: int) -> str:
    """Return a number with fixed digits, a value as in `uncertain`; never ``-0``."""
    text = f"{value:.{digits}f}"
    return text.removeprefix("-") if float(text) == 0 else text


def summing(
    values: Sequence[float | None], digits: int, total: str | None = None, unit: float = 1.0
) -> list[str]:
    """Return numbers with fixed digits whose sum, as shown, is the rounded sum of the values.

    The numbers that lie nearest to the next digit are rounded to it, so none is off by one or more.

    Args:
        values: Parts of a whole, in one unit; None for a part that is not known: a dash. [-]
        total: What they sum to, as it is shown; None: the rounded sum of the values.
        unit: Of the numbers, in that of the values. [-]
    """
    aim = None if total is None else round(float(total) * 10.0**digits)
    known = [value / unit for value in values if value is not None]
    whole = iter(rounded_parts(known, 10.0**-digits, aim))
    return [
        NOTHING if value is None else number(next(whole) * 10.0**-digits, digits)
        for value in values
    ]


def energy_text(energy: float) -> str:
    """Return one energy in words, three to four digits; it is as in `EnergyFormat.joule`."""
    for unit, factor in (("MJ", 1e6), ("kJ", 1e3)):
        if abs(energy) >= factor:
            return f"{energy / factor:.4g} {unit}"
    return f"{energy:.4g} J"


def watt_hours(energy: float) -> str:
    """Return one energy as meters and the live page show it; it is as in `EnergyFormat.joule`."""
    unit, factor = ("kWh", JOULE_PER_KWH) if abs(energy) >= JOULE_PER_KWH else ("Wh", JOULE_PER_WH)
    return f"{energy / factor:.4g} {unit}"


def percent(ratio: float | None, sign: bool = False, digits: int = 1) -> str:
    """Return a ratio in percent.

    Args:
        ratio: None where it is not known. [-]
    """
    if ratio is None:
        return NOTHING
    text = number(100 * ratio, digits)
    return f"{'+' if sign and not text.startswith('-') else ''}{text} %"


signed_percent: Callable[[float | None], str] = partial(percent, sign=True)
"""A ratio in percent, with its sign."""


def seconds(time_ns: int) -> str:
    """Return a time in s."""
    return f"{time_ns * 1e-9:.3f} s"


def utc(stamp_ns: int | None, form: str = "%F %R") -> str:
    """Return a stamp as date and time."""
    if stamp_ns is None:
        return NOTHING
    return f"{local_time(stamp_ns):{form}}"


def uncertain(value: float, std: float) -> str:
    """Return a value with its standard deviation: that with two digits, both to the same place.

    Args:
        value: Any figure. [-]
        std: Its standard deviation, same unit; 0 or not finite where it is not known. [-]
    """
    if not (math.isfinite(value) and math.isfinite(std)) or std <= 0:
        return f"{value:.3g}"
    size = max(abs(value), std)
    if size < SMALL:
        power = math.floor(math.log10(size))
        return f"({uncertain(value / 10.0**power, std / 10.0**power)})e{power:+03d}"
    place = 1 - math.floor(math.log10(std))
    place = 1 - math.floor(math.log10(round(std, place)))  # 0.0996 is 0.10
    return " +- ".join(number(round(each, place), max(0, place)) for each in (value, std))


def typeset(text: str) -> str:
    """Return a text of ASCII with true signs and units: minus, plus-minus, degrees, powers.

    It changes numbers and units only: a ``-`` before a digit, not one inside of a name.
    """
    for pattern, sign in SIGNS:
        text = re.sub(pattern, sign, text)
    return text


def counted(count: int, one: str, many: str = "") -> str:
    """Return a count with its noun."""
    return f"{count} {one if count == 1 else many or one + 's'}"


def some_names(names: Iterable[str], limit: int = 5) -> str:
    """Return names in one line, each once; how many more there are beyond a limit."""
    once = list(dict.fromkeys(names))
    more = [f"{len(once) - limit} more"] if len(once) > limit else []
    return ", ".join([*once[:limit], *more])


def jobs_left_out(count: int) -> str:
    """Return that jobs which no bag holds whole do not count."""
    return f"jobs that are not in a bag from beginning to end, left out: {count}"


def grouped(notes: Sequence[str]) -> list[str]:
    """Return notes of the form ``name: text`` with one line for all names of the same text."""
    names: dict[str, list[str]] = {}
    for note in notes:
        name, colon, text = note.partition(": ")
        names.setdefault(text if colon else note, []).append(name if colon else "")
    return [f"{', '.join(who)}: {text}" if who[0] else text for text, who in names.items()]


def tags_text(figures: dict[str, int]) -> str:
    """Return how many figures of a model are known in which way."""
    return ", ".join(f"{count} {tag}" for tag, count in figures.items() if count) or "none tagged"
