"""The study of savings as one self-contained page.

The sentences are in the templates; here are the numbers and drawings that they name.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from robot_energy.report.canvas import SERIES, Target, canvas
from robot_energy_papers.judged_savings import UNCHANGED, JudgedSaving
from robot_energy_papers.pages import Piece
from robot_energy_papers.savings import OVERRIDES, STANDING, OverrideCurve, Savings
from robot_energy_papers.savings_numbers import figures


def context(result: Savings) -> dict[str, Any]:
    """Return what the expressions of the templates use.

    Args:
        result: The study.
    """
    return {"result": result, "data": figures(result), "quick": result.scale.plants < 10}


def pieces(result: Savings) -> dict[str, Piece]:
    """Return the figures of the page.

    Args:
        result: The study.
    """
    return {
        "claims": partial(claims, [row for row in result.savings if row.measure != UNCHANGED]),
        "curves": partial(curves, result.curves),
    }


def claims(rows: list[JudgedSaving], path: Target) -> None:
    """Draw true savings over claimed ones.

    Args:
        rows: Changes of programs.
        path: File to write, or a buffer.
    """
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
    """Draw energy over the override, cold and hot, with much and with little standby.

    Args:
        found: The curves.
        path: File to write, or a buffer.
    """
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
