"""Cheaper programs: the same work with less energy."""

from __future__ import annotations

from dataclasses import field, replace
from pathlib import Path
from typing import Annotated, Any, Unpack

import numpy as np

from robot_energy.bag.reader import TimeRange
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import MotionError
from robot_energy.foundation.options import takes
from robot_energy.foundation.shown import Shown
from robot_energy.model import RobotModel
from robot_energy.physics.rigid_body import Robot
from robot_energy.replay.setup import ModelName, model_of
from robot_energy.timeline.blocks import PLAUSIBLE_DEGC, Float
from robot_energy_plan.motion.joint_trajectory import (
    holds_trajectory,
    read_bag_trajectory,
    read_csv_trajectory,
)
from robot_energy_plan.motion.load_motion import BAG, GCODE, YAML, ToolOptions, load_motion
from robot_energy_plan.optimization.chain import PowerChain
from robot_energy_plan.optimization.gcode_form import GcodeForm
from robot_energy_plan.optimization.measures import Optimum, optimise
from robot_energy_plan.optimization.program_form import ProgramForm, PtpForm
from robot_energy_plan.optimization.rest_states import ASSUMED, read_rest_states
from robot_energy_plan.optimization.task import Task, make_task
from robot_energy_plan.optimization.timed_moves import law_limits, timed_form, timed_moves
from robot_energy_plan.optimization.trajectory_form import TrajectoryForm, recorded_motion
from robot_energy_plan.options import OptimizeOptions
from robot_energy_plan.results.optimization import OptimizationReport, optimization_report
from robot_energy_plan.results.shared_bus import supply_figures

TEMPERATURES = 3  # at which a range is looked at
REGENERATION = 0.9  # share that a regenerative supply returns, assumed [-]


class OptimizationResult(Described, Shown):
    """A program that needs less energy for the same work."""

    program: Annotated[str, "Its name."]
    report: Annotated[OptimizationReport, "All figures."]
    optimum: Annotated[Optimum, "The costs behind them."] = field(repr=False)
    form: Annotated[ProgramForm, "The program, which can be written."] = field(repr=False)

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


@takes(OptimizeOptions)
def optimize(
    program: str | Path,
    model: ModelName,
    temperature: float | tuple[float, float] | None = None,
    **options: Unpack[OptimizeOptions],
) -> OptimizationResult:
    """Look for the speeds, pauses and states that cost least, and say how sure that is.

    Args:
        program: YAML of point-to-point moves, G-code, a JointTrajectory as CSV or in a bag, or a
            bag of recorded joint states.
        model: A model, its file, or the name of a shipped one.
        temperature: Of all motors, or the range in which they work; None: the reference
            temperature of the model. [degC]
        **options: What may be changed and what is kept: see `OptimizeOptions`.

    Returns:
        The choice, what each measure saves alone, and the trade-offs.

    Raises:
        MotionError: If the program cannot be made within the limits, or options exclude each
            other.
        ParameterError: If a figure makes no sense.
        RobotEnergyError: If program or model cannot be used.
    """
    used, name, notes = model_of(model), str(program), list[str]()
    if temperature is None:
        temperature = used.temperature.fallback_degc
        notes.append(f"no temperature was given: {temperature:g} degC, that of the model")
    cycle_time, level = options.get("cycle_time"), options.get("level", ())
    if level and cycle_time is None:
        raise MotionError(
            "no cycle time was given for robots on one supply", "the cycle time that all have"
        )
    if options.get("one_bus") and not level:
        raise MotionError("no other robot was named for one DC bus", "their programs")
    chain = PowerChain(used, _temperatures(temperature, used))
    form = read_form(program, used, chain.robot, options)
    if options.get("time_law") and isinstance(form, GcodeForm):
        raise MotionError(
            f"'{program}' states no time laws", "moves or a trajectory", "leave time laws out"
        )
    free = options.get("free_rests", False)
    if free and cycle_time is None:
        cycle_time = float(form.moves.duration(form.base).sum() + form.needed.sum())

    states = options.get("rest_states") or (ASSUMED if options.get("standby") else ())

    def task_of(work: ProgramForm) -> Task:
        return make_task(
            chain,
            work,
            cycle_time=cycle_time,
            free_rests=free,
            states=read_rest_states(states),
            peak_limit=options.get("peak_limit") or np.inf,
            regeneration=REGENERATION if options.get("regenerative") else None,
            progress=options.get("progress"),
        )

    task, chosen = task_of(form), form
    if options.get("time_law"):
        limits = law_limits(chain, form.acceleration, form.jerk)
        laws = timed_moves(chain, form.moves, form.base, limits, progress=options.get("progress"))
        chosen = timed_form(form, laws)
        task = task_of(chosen)
    found = optimise(task)
    report = optimization_report(found, chosen, name, notes, options.get("cycles_per_year"))
    if level and cycle_time is not None:
        others = [
            (str(one), load_motion(one, chain.robot, topic=options.get("topic")).motion)
            for one in level
        ]
        robots = [(name, chosen.motion(found.task, found.plan)), *others]
        one_bus = options.get("one_bus", False)
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


def read_form(
    path: str | Path,
    model: RobotModel,
    robot: Robot,
    options: OptimizeOptions | None = None,
) -> ProgramForm:
    """Return a program that can be made cheaper.

    Args:
        path: YAML of point-to-point moves, G-code, a JointTrajectory as CSV or in a bag, or a
            bag of recorded joint states.
    """
    file = Path(path)
    given: OptimizeOptions = options or {}
    topic, time_range = given.get("topic"), TimeRange(given.get("start"), given.get("end"))
    if not file.exists():
        raise MotionError(f"there is no program '{path}'", "a file or a bag")
    if file.suffix.lower() in YAML and file.name != "metadata.yaml":
        return PtpForm(file, robot)
    if file.suffix.lower() in GCODE:
        tool = given.get("tool") or ToolOptions()
        return GcodeForm(file, robot, tool, given.get("max_feed", 1.0))
    if file.suffix.lower() == ".csv":
        return TrajectoryForm(read_csv_trajectory(file), robot, file)
    if file.suffix.lower() in BAG or file.is_dir():
        if holds_trajectory(file, topic) and not time_range:
            return TrajectoryForm(read_bag_trajectory(file, topic), robot, file)
        motion = recorded_motion(file, model, time_range, topic)
        return TrajectoryForm(motion, robot, file, recorded=True)
    raise MotionError(
        f"the program '{path}' cannot be made cheaper",
        f"moves ({', '.join(YAML)}), G-code ({', '.join(GCODE)}), a bag or .csv with a "
        "JointTrajectory, or a bag of recorded joint states",
    )
