"""The certainty study as one self-contained page.

The sentences are in the templates; here are the numbers and drawings that they name.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from robot_energy_papers.certainty import Certainty, reliability_of
from robot_energy_papers.certainty_numbers import figures
from robot_energy_papers.drawings import reliability
from robot_energy_papers.pages import Piece


def context(result: Certainty) -> dict[str, Any]:
    """Return what the expressions of the templates use.

    Args:
        result: The study.
    """
    return {
        "result": result,
        "data": figures(result),
        "quick": result.scale.repetitions < 50,
        "hidden": [
            {
                "name": row.name,
                "warm": float(np.nanmax(row.warm_rms)),
                "early": float(np.nanmax(row.early_rms)),
                "energy_change": row.energy_change,
                "fallback_change": row.fallback_change,
                "covered": row.covered,
            }
            for row in result.thermal
        ],
    }


def pieces(result: Certainty) -> dict[str, Piece]:
    """Return the figures of the page.

    Args:
        result: The study.
    """
    found: dict[str, Piece] = {}
    for name, figures_of in (("within", result.intervals), ("hard", result.hard)):
        if curves := reliability_of(figures_of):
            found[name] = partial(reliability, curves)
    return found
