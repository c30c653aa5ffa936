"""Cheaper programs: the same work with less energy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from robot_energy.bag.time_range import TimeRange
from robot_energy.foundation.errors import MotionError
from robot_energy.foundation.shown import Shown
from robot_energy.foundation.units import DAY
from robot_energy.model import RobotModel
from robot_energy.replay.inputs import ModelName, model_of
from robot_energy.timeline.blocks import PLAUSIBLE_DEGC, Float
from robot_energy_plan.motion.load_motion import ToolOptions, load_motion
from robot_energy_plan.motion.planned import MAX_DURATION
from robot_energy_plan.optimization.chain import PowerChain
from robot_energy_plan.optimization.forms import read_form
from robot_energy_plan.optimization.gcode_form import GcodeForm
from robot_energy_plan.optimization.measures import Optimum, optimise
from robot_energy_plan.optimization.program_form import ProgramForm
from robot_energy_plan.optimization.rest_states import ASSUMED, RestState
from robot_energy_plan.optimization.task import Task, make_task
from robot_energy_plan.optimization.timed_moves import TimedForm, law_limits, timed_moves
from robot_energy_plan.results.common_supply import supply_figures
from robot_energy_plan.results.optimization import OptimizationReport, optimization_report

TEMPERATURES = 3  # at which a range is looked at
MAX_CYCLES = 365.0 * DAY  # in a year: one a second
REGENERATION = 0.9  # share that a regenerative supply returns, assumed [-]


@dataclass(frozen=True)
class OptimizationResult(Shown):
    """A program that needs less energy for the same work.

    Attributes:
        program: Its name.
        report: All figures.
        optimum: The costs behind them.
        form: The program, which can be written in its own form.
    """

    program: str
    report: OptimizationReport
    optimum: Optimum = field(repr=False)
    form: ProgramForm = field(repr=False)

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain values: the JSON of ``robot-energy optimize``."""
        return self.report.to_dict()

    def write(self, path: str | Path) -> None:
        """Write the chosen program in the form of the one that was given.

        Args:
            path: A YAML file; for G-code such a file; for a trajectory or a recording a .csv
                file, or a folder for a bag.

        Raises:
            RobotEnergyError: If it cannot be written.
        """
        self.form.write(Path(path), self.optimum.task, self.optimum.plan)


def optimize(
    program: str | Path,
    model: ModelName,
    temperature: float | tuple[float, float] | None = None,
    *,
    cycle_time: float | None = None,
    standby: bool | Sequence[RestState] = False,
    regenerative: bool = False,
    peak_limit: float | None = None,
    cycles_per_year: float | None = None,
    time_law: bool = False,
    level: Sequence[str | Path] = (),
    one_bus: bool = False,
    topic: str | None = None,
    start: float | None = None,
    end: float | None = None,
    free_rests: bool = False,
    tool: ToolOptions | None = None,
    max_feed: float = 1.0,
    progress: Callable[[float], None] | None = None,
) -> OptimizationResult:
    """Look for the speeds, pauses and states that cost least, and say how sure that is.

    Args:
        program: YAML of point-to-point moves, G-code, a JointTrajectory as CSV or in a bag, or a
            bag of recorded joint states.
        model: A model, its file, or the name of a shipped one.
        temperature: Of all motors, or the range in which they work; None: the reference
            temperature of the model. [degC]
        cycle_time: Of one cycle, which includes a wait; None: the next one begins at once. [s]
        standby: Whether rests may be spent on brakes, in standby or hibernation, with assumed
            figures; or the states of this robot.
        regenerative: Whether a regenerative supply is judged as well.
        peak_limit: Of the power from the grid. [W]
        cycles_per_year: How many there are; None: nothing is said of a year. [1]
        time_law: Whether moves may follow time laws of their own; what is written is a trajectory
            then.
        level: Programs of further robots of this model on the same supply, whose starts within
            the cycle time are shifted so that the peak is least.
        one_bus: Whether these share one DC bus: starts are shifted so that least energy is needed.
        topic: Of the JointTrajectory, or of the joint states, in a bag.
        start: Of one recorded cycle in the bag, after its start; negative: before its end. [s]
        end: Of the same cycle, likewise. [s]
        free_rests: Whether the work needs none of the rests of the program: the cycle, as long as
            now unless ``cycle_time`` is given, may be filled with slower moves.
        tool: What G-code does not state.
        max_feed: Greatest factor on the feeds of G-code; 1: never faster than it states. [-]
        progress: Called with the share done, 0 to 1.

    Returns:
        The choice, what each measure saves alone, and the trade-offs.

    Raises:
        MotionError: If the program cannot be made within the limits, or a figure makes no sense.
        RobotEnergyError: If program or model cannot be used.
    """
    used = model_of(model)
    notes: list[str] = []
    if temperature is None:
        temperature = used.temperature.fallback_degc
        notes.append(f"no temperature was given: {temperature:g} degC, that of the model")
    for name, value, most in (
        ("cycle time", cycle_time, MAX_DURATION),
        ("peak limit", peak_limit, np.inf),
        ("number of cycles in a year", cycles_per_year, MAX_CYCLES),
    ):
        if value is not None and not 0 < value <= most:
            raise MotionError(f"the {name} is {value}", "a value > 0")
    if level and cycle_time is None:
        raise MotionError(
            "no cycle time was given for robots on one supply", "the cycle time that all have"
        )
    if one_bus and not level:
        raise MotionError("no other robot was named for one DC bus", "their programs")
    chain = PowerChain(used, _temperatures(temperature, used))
    form = read_form(program, used, chain.robot, topic, TimeRange(start, end), tool, max_feed)
    if time_law and isinstance(form, GcodeForm):
        raise MotionError(
            f"'{program}' states no time laws", "moves or a trajectory", "leave time laws out"
        )
    if free_rests and cycle_time is None:
        cycle_time = float(form.moves.duration(form.base).sum() + form.needed.sum())
    states = (ASSUMED if standby else ()) if isinstance(standby, bool) else tuple(standby)

    def task_of(one: ProgramForm) -> Task:
        return make_task(
            chain,
            one.moves,
            one.base,
            np.zeros_like(one.needed) if free_rests else one.needed,
            one.joint_position,
            cycle_time=cycle_time,
            states=states,
            peak_limit=np.inf if peak_limit is None else peak_limit,
            regeneration=REGENERATION if regenerative else None,
            speeds=one.speeds,
            accelerations=one.accelerations,
            progress=progress,
        )

    task, chosen = task_of(form), form
    if time_law:
        limits = law_limits(chain, form.acceleration, form.jerk)
        laws = timed_moves(chain, form.moves, form.base, limits, progress=progress)
        chosen = TimedForm(form, laws)
        task = task_of(chosen)
    name = str(program)
    found = optimise(task)
    report = optimization_report(found, chosen, name, notes, cycles_per_year)
    if level and cycle_time is not None:
        others = [(str(one), load_motion(one, chain.robot, topic=topic).motion) for one in level]
        robots = [(name, chosen.motion(found.task, found.plan)), *others]
        report = replace(report, **supply_figures(found.task, robots, cycle_time, one_bus))
    return OptimizationResult(name, report, found, chosen)


def _temperatures(given: float | tuple[float, float], model: RobotModel) -> Float:
    try:
        ends = np.atleast_1d(np.asarray(given, dtype=np.float64))
    except (TypeError, ValueError) as error:
        raise MotionError(f"the motor temperature is {given!r}", "numbers in degC") from error
    low, high = PLAUSIBLE_DEGC
    if ends.size > 2 or not ((ends >= low) & (ends <= high)).all() or ends[-1] < ends[0]:
        raise MotionError(
            f"the motor temperature is {ends.tolist()} degC",
            f"one value, or two that rise, in {low:g} to {high:g} degC",
        )
    first, last = float(ends[0]), float(ends[-1])
    points = ends if first == last else np.linspace(first, last, TEMPERATURES)
    return np.repeat(np.unique(points)[:, None], len(model.joints), axis=1)
