"""How often a claimed saving is right: all on the virtual rig, which the optimiser has not seen."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.model import load
from robot_energy.physics.rigid_body import Robot
from robot_energy.results.base import json_value
from robot_energy_papers.job_pool import Steps, StudyRun, job_pool
from robot_energy_papers.pages import Piece
from robot_energy_plan.motion import Program, random_program
from robot_energy_plan.motion.ptp import MotionLimits
from robot_energy_plan.optimization.chain import TORQUE_SHARE
from robot_energy_plan.optimization.search import cheapest
from robot_energy_report.canvas import SERIES, Target, canvas
from robot_energy_rig import load_profile
from robot_energy_studies.band_coverage import BODY, LABEL, SHORT_TRAINING, TRAINING
from robot_energy_studies.savings_study import (
    UNCHANGED,
    JudgedChoice,
    JudgedSaving,
    PlantAtWork,
    SavingsStudySize,
    judge_plant,
    run_as,
    task_of,
)

FRESH = 500  # first plant on which no constant of the bands was chosen
PER_JOB = 50  # programs whose limits are checked in one job
STANDING = (1.0, 0.1)  # share of the constant losses of the plant that is left
COLD, HOT = 10.0, 70.0  # degC
OVERRIDES = np.array([0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0])  # [-]
EXACT = 1e-6  # by which a limit may be exceeded in rounding [-]


FULL = SavingsStudySize(24, TRAINING, (22.0, 40.0, 62.0), 2, True, 1000)
WAITS = SavingsStudySize(12, TRAINING, (22.0, 40.0, 62.0), 1, False, 0, waits=True)
QUICK = SavingsStudySize(1, SHORT_TRAINING, (40.0,), 1, False, 5)


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
    checked: int
    exceeded: int
    curves: list[OverrideCurve]


def study(options: StudyRun, scale: SavingsStudySize) -> Savings:
    """Return what the whole study finds."""
    seed = options.seed
    first = 1000 * seed + FRESH
    parts = -(-scale.limits // PER_JOB)
    steps = Steps(scale.plants + parts + 1, options.progress)
    with job_pool(options.workers, steps.done) as run:
        judged = [run(judge_plant, first + k, scale) for k in range(scale.plants)]
        checked = [
            run(
                exceeded_limits, 1000 * seed + k * PER_JOB, min(PER_JOB, scale.limits - k * PER_JOB)
            )
            for k in range(parts)
        ]
        curves = run(_override_curves, seed)
        return Savings(
            seed,
            scale,
            [row for job in judged for row in job.result()[0]],
            [row for job in judged for row in job.result()[1]],
            scale.limits,
            sum(job.result() for job in checked),
            curves.result(),
        )


def exceeded_limits(seed: int, count: int) -> int:
    """Return how many random programs, made cheaper, are beyond a limit.

    Limits are those of position, speed, acceleration, jerk, torque and cycle time, by differences
    of positions; from one end of an acceleration to the other takes at least the jerk time.
    """
    model = load(BODY)
    robot = Robot.from_model(model)
    limits = MotionLimits.of_robot(robot, robot.limits.velocity / 0.3)
    found = 0
    for number in range(seed, seed + count):
        random = np.random.default_rng(np.random.SeedSequence(number, spawn_key=(0x6C696D,)))
        program = random_program(
            limits, int(random.integers(1 << 30)), 3, dwell=0.2,
            override=float(random.uniform(0.2, 0.9)),
        )  # fmt: skip
        stretch = float(random.uniform(1.0, 2.0)) * program.period
        task = task_of(model, program, limits, float(random.uniform(0.0, 80.0)), stretch)
        plan = task.plan(cheapest(task.table, task.allowed, task.time, task.wait_power))
        cheap = run_as(task, plan, program, limits)
        changed = plan.row != task.base.row
        torque = task.table.use.torque_use[plan.row][changed]
        found += cheap.period > stretch * (1 + EXACT) or bool((torque > TORQUE_SHARE).any())
        found += _beyond(cheap, limits)
    return found


def _beyond(program: Program, limits: MotionLimits) -> bool:
    """Whether differences of positions exceed a limit; a mean never exceeds what it is of."""
    step = 2e-3
    position = program.sample(np.arange(0.0, program.period, step)).joint_position
    speed = np.abs(np.diff(position, axis=0)).max(axis=0) / step
    acceleration = np.abs(np.diff(position, n=2, axis=0)).max(axis=0) / step**2
    jerk = np.abs(np.diff(position, n=3, axis=0)).max(axis=0) / step**3
    outside = (position < limits.lower - EXACT) | (position > limits.upper + EXACT)
    return bool(
        outside.any()
        or (speed > limits.velocity * (1 + EXACT)).any()
        or (acceleration > limits.acceleration * (1 + EXACT)).any()
        or (jerk * limits.jerk_time > 2.0 * limits.acceleration * (1 + 1e-3)).any()
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
