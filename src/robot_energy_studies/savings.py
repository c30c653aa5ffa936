"""How often a claimed saving is right: all on the virtual rig, which the optimiser has not seen."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.results.base import json_value
from robot_energy_papers.job_pool import StudyRun, job_pool
from robot_energy_papers.pages import Piece
from robot_energy_plan.motion import Program, random_program
from robot_energy_report.canvas import SERIES, Target, canvas
from robot_energy_rig import load_profile
from robot_energy_studies.band_coverage import BODY, LABEL, SHORT_TRAINING, TRAINING
from robot_energy_studies.savings_study import (
    JudgedChoice,
    JudgedSaving,
    PlantAtWork,
    SavingsStudySize,
    judge_plant,
)

FRESH = 500  # first plant on which no constant of the bands was chosen
STANDING = (1.0, 0.1)  # share of the constant losses of the plant that is left
COLD, HOT = 10.0, 70.0  # degC
OVERRIDES = np.array([0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0])  # [-]


FULL = SavingsStudySize(24, TRAINING, (22.0, 40.0, 62.0), 2, True)
WAITS = SavingsStudySize(12, TRAINING, (22.0, 40.0, 62.0), 1, False, waits=True)
QUICK = SavingsStudySize(1, SHORT_TRAINING, (40.0,), 1, False)


class OverrideCurve(Described):
    """Energy of one program on the rig over its override."""

    degc: Annotated[float, "Temperature of motors and gears. [degC]"]
    standing: Annotated[float, "Share of the constant losses that is left. [-]"]
    energy: Annotated[list[float], "At each of `OVERRIDES`. [J]"]

    @property
    def best(self) -> float:
        """The override that needs least energy. [-]"""
        return float(OVERRIDES[int(np.argmin(self.energy))])


@dataclass(frozen=True)
class Savings:
    """Everything the study found."""

    seed: int
    scale: SavingsStudySize
    savings: list[JudgedSaving]
    choices: list[JudgedChoice]
    curves: list[OverrideCurve]


def study(options: StudyRun, scale: SavingsStudySize) -> Savings:
    """Return what the whole study finds."""
    seed = options.seed
    first = 1000 * seed + FRESH
    with job_pool(options, scale.plants + 1) as run:
        judged = [run(judge_plant, first + k, scale) for k in range(scale.plants)]
        curves = run(_override_curves, seed)
        return Savings(
            seed,
            scale,
            [row for job in judged for row in job.result()[0]],
            [row for job in judged for row in job.result()[1]],
            curves.result(),
        )


def _override_curves(seed: int) -> list[OverrideCurve]:
    """Run one program of the standard plant at several overrides, cold and hot, on the rig itself.

    A curve for each temperature and each share of the constant losses.
    """
    plant = load_profile(BODY)
    robot, _ = plant.mechanics()
    limits = plant.motion_limits(robot)
    drawn = random_program(limits, seed, 6, dwell=0.2)
    curves: list[OverrideCurve] = []
    for share in STANDING:
        supply = replace(
            plant.supply,
            loss_dc=share * plant.supply.loss_dc,
            loss_grid=share * plant.supply.loss_grid,
        )
        for degc in (COLD, HOT):
            work = PlantAtWork(replace(plant, supply=supply), degc)
            energy = [work.energy(Program(drawn.via, limits, drawn.dwell, o)) for o in OVERRIDES]
            curves.append(OverrideCurve(degc, share, energy))
    return curves


def figures(result: Savings) -> dict[str, Any]:
    """Return every figure of the study, ready for JSON; shares are 0 to 1."""
    rows = result.savings
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
        "claims": partial(claims, result.savings),
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
