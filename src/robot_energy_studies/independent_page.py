"""Paper A on the second simulator as JSON, and what its templates name: numbers and a drawing."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from robot_energy.results.base import json_value
from robot_energy_papers.models import FIXED_DEGC, FOLLOWS, fixed_name
from robot_energy_papers.pages import Piece
from robot_energy_papers.soaked_rigs import error_spreads
from robot_energy_report.canvas import COLOURS, SERIES, Target, canvas
from robot_energy_studies.independent import FULL_MODEL, Independent, IndependentRow

LABEL = "second simulator (MuJoCo), robots drawn at random; nothing here was measured on a robot"
NAMES = {
    fixed_name(FIXED_DEGC[0]): "friction fixed, of the coldest set",
    fixed_name(FIXED_DEGC[1]): "friction fixed, of the set nearest to 60 degC",
    FOLLOWS: "friction follows motor temperature (paper A)",
    FULL_MODEL: "all that identify all finds",
}
DRAWN = {fixed_name(FIXED_DEGC[0]): COLOURS["fixed"], FOLLOWS: SERIES[1], FULL_MODEL: SERIES[0]}


def figures(result: Independent) -> dict[str, Any]:
    """Return every figure of the study, ready for JSON; shares are 0 to 1."""
    return {
        "label": LABEL,
        "seed": result.seed,
        "plants": [row.plant_seed for row in result.rows],
        "error": json_value(error_spreads(result.rows)),
        "worst_by_plant": {name: _worst(result.rows, name) for name in NAMES},
        "refused": [row.refused for row in result.rows if row.refused],
        "imbalance": max(row.imbalance for row in result.rows),
        "rows": json_value(result.rows),
    }


def _worst(rows: list[IndependentRow], name: str) -> dict[str, float] | None:
    """Quantiles over plants of the greatest error in size over temperatures."""
    worst = [max(map(abs, row.error[name])) for row in rows if name in row.error]
    if not worst:
        return None
    shares = {"least": 0.0, "quarter": 0.25, "median": 0.5, "three_quarters": 0.75, "greatest": 1.0}
    return {word: float(np.quantile(worst, share)) for word, share in shares.items()}


def context(result: Independent) -> dict[str, Any]:
    """Return what the expressions of the templates use."""
    degc = [value for row in result.rows for value in row.robot_degc]
    return {
        "result": result,
        "data": figures(result),
        "errors": error_spreads(result.rows),
        "names": NAMES,
        "degc": (min(degc), max(degc)),
        "quick": len(result.rows) < 10,
    }


def pieces(result: Independent) -> dict[str, Piece]:
    """Return the figures of the page."""
    return {"errors": partial(errors, result.rows)}


def errors(rows: list[IndependentRow], path: Target) -> None:
    """Draw the error of every plant over robot temperature."""
    with canvas(path, (7.0, 4.0), "error of grid energy over robot temperature") as figure:
        axes: Any = figure.subplots()
        for name, colour in DRAWN.items():
            label = NAMES[name]
            for row in rows:
                if name in row.error:
                    percent = 100 * np.array(row.error[name])
                    axes.plot(row.robot_degc, percent, "-o", markersize=3, linewidth=0.8,
                              color=colour, label=label)  # fmt: skip
                    label = None
        axes.axhline(0.0, color="#16202b", linewidth=0.8)
        axes.set_xlabel("mean temperature of the motors [degC]")
        axes.set_ylabel("predicted grid energy over measured, less 1 [%]")
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0))
