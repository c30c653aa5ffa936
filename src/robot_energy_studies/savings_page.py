"""The study of savings as JSON, and what its templates name: numbers and drawings."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from robot_energy.results.base import json_value
from robot_energy_papers.pages import Piece
from robot_energy_report.canvas import SERIES, Target, canvas
from robot_energy_studies.certainty_page import LABEL
from robot_energy_studies.judged_savings import UNCHANGED, JudgedSaving
from robot_energy_studies.savings import OVERRIDES, STANDING, OverrideCurve, Savings


def figures(result: Savings) -> dict[str, Any]:
    """Return every figure of the study, ready for JSON; shares are 0 to 1."""
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
        "savings": json_value(rows),
        "choices": json_value(result.choices),
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


def context(result: Savings) -> dict[str, Any]:
    """Return what the expressions of the templates use."""
    return {"result": result, "data": figures(result), "quick": result.scale.plants < 10}


def pieces(result: Savings) -> dict[str, Piece]:
    """Return the figures of the page."""
    return {
        "claims": partial(claims, [row for row in result.savings if row.measure != UNCHANGED]),
        "curves": partial(curves, result.curves),
    }


def claims(rows: list[JudgedSaving], path: Target) -> None:
    """Draw true savings over claimed ones."""
    with canvas(path, (7.0, 5.0), "saving on the rig over the predicted one") as figure:
        axes: Any = figure.subplots()
        for name, wanted, colour in (
            ("claimed", True, SERIES[2]),
            ("not claimed", False, SERIES[6]),
        ):
            part = [row for row in rows if row.claimed is wanted]
            base = np.array([row.base for row in part])
            if not part:
                continue
            axes.errorbar(
                100 * np.array([row.claim for row in part]) / base,
                100 * np.array([row.truth for row in part]) / base,
                xerr=100 * np.array([row.half for row in part]) / base,
                fmt="o", markersize=3, linewidth=0.4, color=colour, label=name,
            )  # fmt: skip
        ends = np.array(axes.get_xlim())
        axes.plot(ends, ends, color="#16202b", linewidth=0.8)
        axes.axhline(0.0, color="#51606f", linewidth=0.6)
        axes.set_xlabel("predicted saving with its 90 % band [% of a cycle]")
        axes.set_ylabel("saving on the rig [% of a cycle]")
        axes.legend(loc="upper left")


def curves(found: list[OverrideCurve], path: Target) -> None:
    """Draw energy over the override, cold and hot, with much and with little standby."""
    with canvas(path, (8.0, 3.4), "energy of one program on the rig") as figure:
        axes: Any = figure.subplots(1, len(STANDING))
        for place, share in zip(axes, STANDING, strict=True):
            for curve, colour in zip(
                [one for one in found if one.standing == share], (SERIES[0], SERIES[1]), strict=True
            ):
                kilo = np.array(curve.energy) * 1e-3
                place.plot(100 * OVERRIDES, kilo, "-o", markersize=3, color=colour,
                           label=f"{curve.degc:g} degC")  # fmt: skip
                best = int(np.argmin(kilo))
                place.plot(100 * OVERRIDES[best], kilo[best], "D", markersize=8, color=colour,
                           markerfacecolor="none")  # fmt: skip
            place.set_title(f"{100 * share:g} % of the constant losses")
            place.set_xlabel("override [%]")
            place.set_ylabel("energy of a cycle [kJ]")
            place.legend(loc="upper right")
