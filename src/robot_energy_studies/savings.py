"""How often a claimed saving is right: all on the virtual rig, which the optimiser has not seen."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.model import load
from robot_energy.physics.rigid_body import Robot
from robot_energy_papers.job_pool import Steps, StudyRun, job_pool
from robot_energy_plan.motion import Program, random_program
from robot_energy_plan.motion.ptp import MotionLimits
from robot_energy_plan.optimization.chain import TORQUE_SHARE
from robot_energy_plan.optimization.search import cheapest
from robot_energy_rig import load_profile
from robot_energy_studies.band_coverage import BODY, SHORT_TRAINING, TRAINING
from robot_energy_studies.judged_savings import JudgedChoice, JudgedSaving, PlantAtWork
from robot_energy_studies.savings_study import SavingsStudySize, judge_plant, run_as, task_of

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
