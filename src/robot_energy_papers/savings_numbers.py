"""The figures of the study of savings as plain numbers: for JSON, and for the page."""

from __future__ import annotations

from typing import Any

import numpy as np

from robot_energy.results.base import json_value
from robot_energy_papers.judged_savings import UNCHANGED, JudgedSaving
from robot_energy_papers.savings import OVERRIDES, Savings

LABEL = "virtual rig, plants drawn at random; nothing here was measured on a robot"


def figures(result: Savings) -> dict[str, Any]:
    """Return every figure of the study, ready for JSON; shares are 0 to 1.

    Args:
        result: The study.
    """
    rows = [row for row in result.savings if row.measure != UNCHANGED]
    control = [row for row in result.savings if row.measure == UNCHANGED]
    regret = np.array([choice.regret for choice in result.choices])
    names = list(dict.fromkeys(row.measure for row in rows))
    degc = sorted({row.degc for row in rows})
    return {
        "label": LABEL,
        "seed": result.seed,
        "by_measure": {
            "all": _shares(rows),
            **{name: _shares([r for r in rows if r.measure == name]) for name in names},
        },
        "by_temperature": {f"{t:g} degC": _shares([r for r in rows if r.degc == t]) for t in degc},
        "regret": {
            "choices": len(regret),
            "median": float(np.median(regret)) if len(regret) else None,
            "mean": float(regret.mean()) if len(regret) else None,
            "at_most_2_percent": float((regret <= 0.02).mean()) if len(regret) else None,
            "greatest": float(regret.max()) if len(regret) else None,
        },
        "unchanged": {
            "programs": len(control),
            "predicted": max((abs(row.claim) / row.base for row in control), default=None),
            "on_the_rig": max((abs(row.truth) / row.base for row in control), default=None),
        },
        "limits": {"programs": result.checked, "exceeded": result.exceeded},
        "overrides": OVERRIDES.tolist(),
        "curves": [{**json_value(curve), "best": curve.best} for curve in result.curves],
        "savings": [json_value(row) for row in rows],
        "choices": [json_value(choice) for choice in result.choices],
    }


def _shares(rows: list[JudgedSaving]) -> dict[str, Any]:
    claimed = [row for row in rows if row.claimed]

    def share(of: list[JudgedSaving], true: list[bool]) -> float | None:
        return sum(true) / len(of) if of else None

    return {
        "changes": len(rows),
        "claimed": len(claimed),
        "sign_right": share(claimed, [row.truth > 0 for row in claimed]),
        "inside": share(rows, [row.inside for row in rows]),
        "inside_claimed": share(claimed, [row.inside for row in claimed]),
        "median_claim": _median([row.claim / row.base for row in claimed]),
        "median_truth": _median([row.truth / row.base for row in claimed]),
        "median_half": _median([row.half / row.base for row in claimed]),
    }


def _median(values: list[float]) -> float | None:
    return float(np.median(values)) if values else None
