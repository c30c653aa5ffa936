"""What the words of reports mean: one table for hints, the list of terms and the glossary."""

from __future__ import annotations

import re

TERMS = {
    "90 % band": "range that should hold the true value in nine of ten cases",
    "brake resistor": "turns braking energy that nothing else takes into heat",
    "capacitor": "the store of the DC bus: takes braking energy and gives it back",
    "constant losses": "power of the cabinet that does not depend on motion, on the grid side and "
    "on the DC side",
    "Coulomb": "friction torque that does not depend on speed",
    "DC bus": "the direct-current circuit between the rectifier and the drives",
    "drive loss": "electrical input of a drive minus its shaft power",
    "gap": "a time span without valid samples; nothing is integrated over it",
    "held out": "not seen by the fit, so that the error is that of new data",
    "hold": "phase at rest with active drives: no joint moves",
    "lifting, accelerating": "what moves the bodies: rigid-body torque times velocity; comes back "
    "when they are lowered or braked",
    "measured": "read from a meter, a drive or a sensor",
    "predicted": "computed by the model from joint states and temperatures",
    "RMS": "root mean square: a typical size that counts large errors more",
    "residual": "predicted minus measured",
    "standby": "rest with the drives on for a minute or more",
    "tag": "how a figure is known: published, identified, derived, assumed",
    "viscous": "friction torque that grows with speed and falls with temperature",
}
"""Meaning by term, as in the glossary."""

ENDINGS = {"drive loss": "(?:es)?", "gap": "s?", "residual": "s?", "tag": "s?"}
_TERM = re.compile(
    r"(?<![\w-])(?:"
    + "|".join(
        f"({re.escape(term)}{ENDINGS.get(term, '')})"
        for term in sorted(TERMS, key=len, reverse=True)
    )
    + r")(?![\w-])",
    re.IGNORECASE,
)
_BY_GROUP = sorted(TERMS, key=len, reverse=True)
_TAG = re.compile(r"(<[^>]*>)")
LEFT_AS_THEY_ARE = (
    *("a", "abbr", "button", "code", "figure", "h1", "h2", "h3", "h4", "option", "pre", "script"),
    *("style", "title"),
)


def with_hints(html: str) -> tuple[str, list[str]]:
    """Return HTML with a hint at the first place of each term, and the terms that occur.

    Args:
        html: Well formed; titles, code, links and figures are left as they are.
    """
    found: list[str] = []
    inside: list[str] = []
    parts = _TAG.split(html)
    for place, part in enumerate(parts):
        if place % 2:
            name = part.strip("</>").split(maxsplit=1)[0].lower() if part.strip("</>") else ""
            if name in LEFT_AS_THEY_ARE:
                if part.startswith("</"):
                    inside.pop()
                elif not part.endswith("/>"):
                    inside.append(name)
        elif part and not inside:
            parts[place] = _TERM.sub(lambda match: _hinted(match, found), part)
    return "".join(parts), sorted(found, key=str.lower)


def _hinted(match: re.Match[str], found: list[str]) -> str:
    term = _BY_GROUP[(match.lastindex or 1) - 1]
    if term in found:
        return match[0]
    found.append(term)
    return f'<abbr title="{TERMS[term]}">{match[0]}</abbr>'
