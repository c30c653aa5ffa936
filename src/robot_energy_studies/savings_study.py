"""Claimed savings against the virtual rig, which the optimiser has not seen.

Plants are drawn at random and have every effect of the rig. Each is identified from recordings,
so the model errs as an identified one does; its standard deviations are those of the
identification. Random programs are made cheaper with that model, cold, warm and hot, and the rig
runs the program as it was and as it was changed: its own energy is the truth. Temperatures are
held on the rig, and its motor temperatures are known. Simulated throughout: nothing was measured
on a robot.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.files.temporary_folder import TemporaryFolder
from robot_energy.model import RobotModel
from robot_energy.timeline.blocks import Float
from robot_energy_papers.experiment import MIN_HEIGHT, TOOL
from robot_energy_plan.motion import Program, random_program, tool_above
from robot_energy_plan.motion.ptp import MotionLimits
from robot_energy_plan.optimization.chain import (
    TORQUE_SHARE,
    Candidates,
    PowerChain,
    PtpMoves,
    Use,
    grid,
)
from robot_energy_plan.optimization.measures import Optimum, optimise
from robot_energy_plan.optimization.search import Cost, CostTable, CyclePlan, cheapest, saving
from robot_energy_plan.optimization.task import ProgramMoves, Task, make_task
from robot_energy_rig import PlantProfile, RigConfig, VirtualRig, random_profile
from robot_energy_studies.band_coverage import AMBIENT, BODY, DrawnRig, Recorded

RATE = 250.0  # Hz


class JudgedClaim:
    """A claim with its band, and the truth; a base of dataclasses with these three fields. [J]"""

    claim: float
    half: float
    truth: float

    @property
    def claimed(self) -> bool:
        """Whether the tool claims it."""
        return self.claim > self.half > 0

    @property
    def inside(self) -> bool:
        """Whether the band holds the truth."""
        return abs(self.truth - self.claim) <= self.half


class JudgedSaving(Described, JudgedClaim):
    """One change of one program at one temperature."""

    plant: int
    degc: Annotated[float, "Temperature of motors and gears. [degC]"]
    measure: str
    base: Annotated[float, "Energy of a cycle on the rig as it was. [J]"]
    claim: Annotated[float, "Saving that the model predicts. [J]"]
    half: Annotated[float, "Half width of its 90 % band. [J]"]
    truth: Annotated[float, "Saving on the rig. [J]"]
    faster: Annotated[float, "Time that a cycle lasts less. [s]"]
    standing: Annotated[float, "Share of losses at rest in the energy, by the model. [-]"]


class JudgedChoice(Described):
    """The choice of the model against the best that the rig itself allows."""

    plant: int
    degc: Annotated[float, "Temperature of motors and gears. [degC]"]
    free: Annotated[bool, "Whether cycles follow each other at once."]
    chosen: Annotated[float, "Energy on the rig of what the model chose. [J]"]
    best: Annotated[float, "Least energy on the rig, of every combination. [J]"]

    @property
    def regret(self) -> float:
        """What the choice costs more. [-]"""
        return self.chosen / self.best - 1.0


class PlantAtWork:
    """A plant that runs programs at one temperature.

    Args:
        degc: Of motors and gears. [degC]
        cycles: Run in turn, of which the last one counts: rests begin as motions left them.
    """

    def __init__(
        self, profile: PlantProfile, degc: float, config: RigConfig | None = None, cycles: int = 1
    ) -> None:
        self._profile, self._degc, self._cycles = profile, degc, cycles
        self._config = (config or RigConfig.hard()).without("warming")

    def power(self, program: Program) -> Float:
        """Return the power from the grid over one cycle, shape (N,). [W]"""
        rig = VirtualRig(self._profile, program, self._config, 0, self._degc, AMBIENT, rate_hz=RATE)
        count = max(1, round(program.period * RATE))
        return rig.step(self._cycles * count).truth.grid_power[-count:]

    def energy(self, program: Program) -> float:
        """Return the energy of one cycle from the grid. [J]"""
        return float(self.power(program).mean()) * program.period


class DrawnWork(Described):
    """One program of one plant at one temperature."""

    plant: int
    degc: Annotated[float, "Temperature of motors and gears. [degC]"]
    program: Program
    limits: MotionLimits
    rig: PlantAtWork

    def judged(
        self,
        measure: str,
        base: float,
        before: Cost,
        after: Cost,
        changed: Program,
        standing: float,
    ) -> JudgedSaving:
        """Return what is claimed of a changed program, and what the rig saves with it.

        Args:
            base: Energy of a cycle on the rig as it was. [J]
            standing: Share of losses at rest in the energy, by the model. [-]
        """
        truth, claim = base - self.rig.energy(changed), saving(before, after)
        return JudgedSaving(
            self.plant, self.degc, measure, base, claim.energy, claim.half, truth,
            before.duration - after.duration, standing,
        )  # fmt: skip


MOVES = 8  # of a program
WAITING = (3.0, 8.0)  # s of a cycle, where waits are judged
SPEEDS = np.array([0.15, 0.25, 0.35, 0.45, 0.6, 0.8, 1.0])  # of the brute force [-]
ACCELERATIONS = np.array([0.1, 0.3, 1.0])


class SavingsStudySize(Described):
    """How much is done."""

    plants: int
    training: tuple[Recorded, ...]
    temperatures: Annotated[tuple[float, ...], "Of motors and gears. [degC]"]
    programs: int
    brute: Annotated[bool, "Whether the best choice on the rig is looked for."]
    waits: Annotated[
        bool,
        "Whether only cycles with 3 to 8 s of waiting are judged. Joints of every second plant "
        "then creep at rest until friction carries a part of the load.",
    ] = False


def judge_plant(
    seed: int, scale: SavingsStudySize
) -> tuple[list[JudgedSaving], list[JudgedChoice]]:
    """Return what is claimed to make programs of one plant cheaper, and what was chosen."""
    profile = random_profile(BODY, seed)
    config = RigConfig.hard().having(*(["creep"] if scale.waits and seed % 2 else []))
    with TemporaryFolder() as place:
        model = DrawnRig(profile, config, place.path).identified(scale.training)
    robot, _ = profile.mechanics()
    limits = profile.motion_limits(robot)
    above = tool_above(robot, TOOL, MIN_HEIGHT)
    random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0x73617665,)))
    savings: list[JudgedSaving] = []
    choices: list[JudgedChoice] = []
    for degc in scale.temperatures:
        rig = PlantAtWork(profile, degc, config, 2 if scale.waits else 1)
        for _ in range(scale.programs):
            program = random_program(
                limits, int(random.integers(1 << 30)), MOVES, dwell=float(random.uniform(0.1, 1.0)),
                override=float(random.uniform(0.35, 0.95)), accept=above,
            )  # fmt: skip
            work = DrawnWork(seed, degc, program, limits, rig)
            if scale.waits:
                cycle_time = program.period + float(random.uniform(*WAITING))
                savings += _savings(work, task_of(model, program, limits, degc, cycle_time))
                continue
            stretch = float(random.uniform(1.05, 2.0))
            for cycle_time in (None, stretch * program.period):
                task = task_of(model, program, limits, degc, cycle_time)
                savings += _savings(work, task)
            if scale.brute:
                choices += _choices(work, model, stretch)
    return savings, choices


def task_of(
    model: RobotModel,
    program: Program,
    limits: MotionLimits,
    degc: float,
    cycle_time: float | None,
) -> Task:
    """Return the task to make a program cheaper.

    Args:
        degc: Of all motors. [degC]
        cycle_time: None: the next cycle begins at once. [s]
    """
    chain = PowerChain(model, np.full((1, len(model.joints)), degc))
    base = Candidates(
        np.arange(program.moves),
        program.override * program.speed_share,
        program.override**2 * program.acceleration_share,
    )
    work = ProgramMoves(
        moves=PtpMoves.of_program(program, limits),
        base=base,
        needed=program.dwell.copy(),
        joint_position=program.via,
    )
    return make_task(chain, work, cycle_time=cycle_time)


def run_as(task: Task, plan: CyclePlan, program: Program, limits: MotionLimits) -> Program:
    """Return a plan as a program for the rig."""
    chosen = task.table.candidates[plan.row]
    bounds = replace(limits, jerk_time=program.limits.jerk_time)
    return Program(program.via, bounds, plan.rest, 1.0, chosen.speed, chosen.acceleration)


def _savings(work: DrawnWork, task: Task) -> list[JudgedSaving]:
    found: Optimum = optimise(task)
    base = work.rig.energy(run_as(found.task, found.task.base, work.program, work.limits))
    standing = float((task.table.held.energy * found.base.duration).mean() / found.base.energy)
    rows: list[JudgedSaving] = []
    plans = {one.measure.name: one.plan for one in found.tried if one.plan is not None}
    plans["together"] = found.plan
    for name, plan in plans.items():
        if (plan.row == found.task.base.row).all():
            continue
        after = found.task.table.cost(plan)
        changed = run_as(found.task, plan, work.program, work.limits)
        rows.append(work.judged(name, base, found.base, after, changed, standing))
    return rows


def _choices(work: DrawnWork, model: RobotModel, stretch: float) -> list[JudgedChoice]:
    """Choose by the model and by the rig among the same candidates."""
    program = work.program
    chain = PowerChain(model, np.full((1, len(model.joints)), work.degc))
    moves = PtpMoves.of_program(program, work.limits)
    found = grid(moves, SPEEDS, ACCELERATIONS)
    use = chain.moves(moves, found)
    real, held = _by_the_rig(found, use, work)
    braked = chain.rests(program.via)
    table = CostTable(found, use, braked, braked)
    true_table = CostTable(found, real, held, held)
    allowed = use.torque_use <= TORQUE_SHARE
    moving = program.period - float(program.dwell.sum())
    resting = float((held.energy * program.dwell).sum())
    rows: list[JudgedChoice] = []
    # The few candidates of the brute force need not be as fast as the program.
    fastest = sum(
        float(use.duration[allowed & (found.move == move)].min()) for move in np.unique(found.move)
    )
    for free in (True, False):
        time = max(moving if free else (stretch * program.period - program.dwell.sum()), fastest)
        waits = [0.0 if free else float(one.energy[0]) for one in (braked, held)]
        picked = [
            cheapest(one, allowed, time, wait)
            for one, wait in zip((table, true_table), waits, strict=True)
        ]
        chosen, best = (
            float(real.energy[row].sum())
            + resting
            + waits[1] * (time - float(real.duration[row].sum()))
            for row in picked
        )
        rows.append(JudgedChoice(work.plant, work.degc, free, chosen, best))
    return rows


def _by_the_rig(found: Candidates, use: Use, work: DrawnWork) -> tuple[Use, Use]:
    """What each candidate and a second at rest need on the rig."""
    program = work.program
    energy = np.full(len(found), np.nan)
    hold = np.zeros(program.moves)
    runs = 0
    bounds = replace(work.limits, jerk_time=program.limits.jerk_time)
    dwell = np.full(program.moves, 0.4)
    for speed in SPEEDS:
        for rise in ACCELERATIONS:
            rows = np.flatnonzero((found.speed == speed) & (found.acceleration == rise))
            if not len(rows):
                continue
            same = Program(program.via, bounds, dwell, 1.0, speed, rise)
            power = work.rig.power(same)
            total = np.concatenate([[0.0], np.cumsum(power) / RATE])
            clock = np.arange(len(total)) / RATE
            begin, end = same.instants.reshape(-1, 2).T
            per_move = np.interp(end, clock, total) - np.interp(begin, clock, total)
            energy[rows] = per_move[found.move[rows]]
            rest = np.interp(begin, clock, total) - np.interp(begin - 0.1, clock, total)
            hold, runs = hold + rest / 0.1, runs + 1
    hold = hold / runs
    real = replace(use, energy=energy, by_temperature=energy[:, None])
    count = program.moves
    held = Use(
        np.ones(count), hold, hold, np.zeros(count), np.zeros((count, 1)), np.zeros(count),
        hold[:, None],
    )  # fmt: skip
    return real, held
