"""How often the band of a saving holds it, and how often one is claimed where none is.

Days of a robot are drawn by known rules: parts of the day by weekday, hours switched on, ambient
temperature of a year. Its energy follows these, with scatter, alike from day to day in some rows.
60 days make the baseline, 30 days are reported, with 5 % saved or nothing. The last rows show what
happens where the ambient temperature explains energy and nobody knew it.
Usage: ``python test/soak/savings_of_months.py [--repeats 1000]``.
"""

from __future__ import annotations

import argparse

import numpy as np

from robot_energy_history.savings import compare, fit_baseline

KINDS = {
    "scatter 2 %": (0.02, 0.0, True),
    "scatter 2 %, alike from day to day": (0.02, 0.3, True),
    "scatter 5 %": (0.05, 0.0, True),
    "scatter 2 %, ambient not known": (0.02, 0.0, False),
}


def drawn(draw: np.random.Generator, days: int, scatter: float, alike: float, first: int):
    """Energy and what explains it, of days from one on."""
    day = first + np.arange(days)
    works = day % 7 < 5
    parts = np.where(works, draw.integers(300, 700, days), 0).astype(float)
    hours = np.where(works, 16.0, 0.0) + draw.integers(0, 2, days)
    ambient = 18.0 + 6.0 * np.sin(2 * np.pi * day / 365) + draw.normal(0, 2, days)
    expected = 0.8 + 0.35 * hours + 0.02 * parts * (1.0 - 0.006 * (ambient - 20.0))
    noise = draw.normal(0, 1, days)
    for place in range(1, days):
        noise[place] = alike * noise[place - 1] + np.sqrt(1 - alike**2) * noise[place]
    energy = expected * (1.0 + scatter * noise)
    return energy, expected, {"parts": parts, "on_hours": hours, "ambient": ambient}


def counts(
    repeats: int, scatter: float, alike: float, ambient: bool, saving: float
) -> tuple[float, float, float]:
    """Share of truths within the band, share of claims, and half width of the band, over energy."""
    draw = np.random.default_rng(35)
    within = claimed = 0
    widths = []
    for _ in range(repeats):
        first = int(draw.integers(0, 365))
        energy, _, drivers = drawn(draw, 60, scatter, alike, first)
        later, would, reported = drawn(draw, 30, scatter, alike, first + 60)
        if not ambient:
            del drivers["ambient"], reported["ambient"]
        found = compare(fit_baseline(energy, drivers), later * (1.0 - saving), reported)
        within += abs(found.saved[-1] - saving * would.sum()) <= found.band[-1]
        claimed += found.claimed
        widths.append(found.band[-1] / would.sum())
    return within / repeats, claimed / repeats, float(np.median(widths))


def main() -> None:
    """Print the shares."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=1000)
    repeats = parser.parse_args().repeats
    for name, kind in KINDS.items():
        for saving in (0.05, 0.0):
            within, claimed, width = counts(repeats, *kind, saving)
            print(
                f"{name}, saved {saving:.0%}: within the band {within:.1%}, claimed {claimed:.1%}, "
                f"band +-{width:.1%}"
            )


if __name__ == "__main__":
    main()
