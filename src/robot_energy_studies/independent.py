"""Paper A on the second simulator: plants that share no code with the model.

Bodies move by MuJoCo, and friction, motors, heat and cabinet have laws of `simulator`. The model
begins with the manufacturer's bodies, gear ratios and the rotor inertias of a data sheet. Each set
of motions starts from the temperatures to which a warm-up of its length takes the robot, so gears
lag behind motors and every axis has its own. Held-out sets have other motions, another warm-up,
another hall and another meter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import ImplausibleIdentificationError, NotIdentifiableError
from robot_energy.foundation.extras import require
from robot_energy.foundation.files.temporary_folder import TemporaryFolder
from robot_energy.model import RobotModel, load
from robot_energy.physics.rigid_body import Robot
from robot_energy.results.base import json_value
from robot_energy.timeline.blocks import Float
from robot_energy_identify.api.identify import identify_all
from robot_energy_papers.experiment import (
    DWELL,
    LEAD,
    MIN_HEIGHT,
    POSE_DWELL,
    POSES,
    TOOL,
    MotionSet,
)
from robot_energy_papers.job_pool import StudyRun, job_pool
from robot_energy_papers.models import (
    FIXED_DEGC,
    FOLLOWS,
    fixed_name,
    held_out,
    identify,
    with_values,
    without_knowledge,
)
from robot_energy_papers.pages import Piece
from robot_energy_papers.soaked_rigs import PlantRow, error_spreads
from robot_energy_plan.motion import MotionLimits, Program, random_program, tool_above
from robot_energy_report.canvas import COLOURS, SERIES, Target, canvas
from robot_energy_studies.simulator.drawn import DrawnRobot, drawn_robot
from robot_energy_studies.simulator.heat import WINDING, HeatNetwork
from robot_energy_studies.simulator.recording import drawn_sensors, record
from robot_energy_studies.simulator.robots import Robots, even

BODY = "kr16"
FULL_MODEL = "full"  # all that `robot-energy identify all` finds
HALLS = 20.0, 25.0  # degC: of identification, of the test
WARM_UP, MINUTE = 300, 60.0  # minutes; s
DUTIES = np.linspace(0.05, 2.0, 79)  # heat of the warm-up, by that of continuous work
MEAN_DEGC, HOTTEST_DEGC = 78.0, 100.0  # of windings in the mean, and of any part, at most
WORK, WORK_DEGC = 10.0, 50.0  # s and degC of the work whose heat warms up
LEAST_SHARE = 0.6  # of the heat of an axis in the warm-up of the test


class IndependentStudySize(Described):
    """How much is done."""

    plants: int
    train: Annotated[tuple[float, ...], "When sets are recorded, shares of the rise of windings."]
    test: tuple[float, ...]
    moves: int


FULL = IndependentStudySize(10, (0.0, 0.25, 0.5, 0.75, 1.0), (0.1, 0.35, 0.65, 0.9), 20)
QUICK = IndependentStudySize(2, (0.0, 0.5, 1.0), (0.3, 0.9), 12)


class IndependentRow(PlantRow):
    """One plant of the second simulator."""

    robot_degc: Annotated[tuple[float, ...], "Mean of the motors in each held-out set. [degC]"] = ()
    mean_power: Annotated[tuple[float, ...], "Measured in each. [W]"] = ()
    imbalance: Annotated[float, "Greatest imbalance of the simulation, relative. [-]"] = 0.0


@dataclass(frozen=True)
class Independent:
    """Everything the study found."""

    seed: int
    scale: IndependentStudySize
    rows: list[IndependentRow]


def study(options: StudyRun, scale: IndependentStudySize) -> Independent:
    """Return what the whole study finds."""
    require("mujoco", "the second simulator")
    first = 1000 * options.seed + 1
    with job_pool(options, scale.plants) as run:
        jobs = [run(independent_row, first + number, scale) for number in range(scale.plants)]
        return Independent(options.seed, scale, [job.result() for job in jobs])


def published(robot: DrawnRobot) -> RobotModel:
    """Return what is published of a robot: bodies that are off, gears, rotors, the test weight."""
    model = without_knowledge(load(BODY))
    joints = [
        with_values(joint, gear_ratio=float(ratio), rotor_inertia=float(inertia))
        for joint, ratio, inertia in zip(
            model.joints, robot.arm.gear_ratio, robot.plate_inertia, strict=True
        )
    ]
    return model.changed(joints=joints)


class Experiment(Described):
    """Recorded sets of one robot: for identification, for the test, and at rest."""

    train: list[MotionSet]
    test: list[MotionSet]
    rest: Path
    imbalance: Annotated[float, "Greatest imbalance of the simulation, relative. [-]"]


def independent_row(plant_seed: int, scale: IndependentStudySize) -> IndependentRow:
    """Return what comes out on one plant."""
    robot = drawn_robot(plant_seed)
    with TemporaryFolder() as place:
        made = recorded_sets(robot, plant_seed, scale, place.path)
        start, bags = published(robot), [entry.path for entry in made.train]
        models: dict[str, RobotModel] = {}
        notes: list[str] = []
        try:
            models |= identify(bags, made.rest, start, None, FIXED_DEGC, beyond=False).models
        except (NotIdentifiableError, ImplausibleIdentificationError) as error:
            notes.append(error.found)
        try:
            cabinet = robot.cabinet
            models[FULL_MODEL] = identify_all(
                [*bags, made.rest],
                start,
                "motor_torque",
                held_out=False,
                link_voltages=(cabinet.open_voltage, cabinet.chopper_on),
            ).model
        except (NotIdentifiableError, ImplausibleIdentificationError) as error:
            notes.append(error.found)
        rows = held_out(made.test, models, next(iter(models))) if models else []
    return IndependentRow(
        plant_seed,
        {name: tuple(row.error(name) for row in rows) for name in models},
        " ".join(notes),
        tuple(row.robot_degc for row in rows),
        tuple(row.mean_power for row in rows),
        made.imbalance,
    )


def recorded_sets(
    robot: DrawnRobot, seed: int, scale: IndependentStudySize, folder: Path
) -> Experiment:
    """Return what a robot records."""
    train, test, hold = _programs(robot, seed, scale.moves)
    n_joints, random = len(robot.joint_names), np.random.default_rng([0x6865, seed])
    work = Robots(robot, (train, test), even(2, WORK_DEGC, n_joints), np.full(2, WORK_DEGC))
    heat = work.run(WORK).node_heat
    heat[1] *= random.uniform(LEAST_SHARE, 1.0, n_joints)
    trained, tested = (
        warmed(robot.heat, heat[part], HALLS[part], shares)
        for part, shares in enumerate((scale.train, scale.test))
    )
    motions = [*(train for _ in trained), *(test for _ in tested), hold]
    halls = np.repeat([*HALLS, HALLS[0]], [len(trained), len(tested), 1])
    middle = trained[len(trained) // 2]
    robots = Robots(robot, motions, np.concatenate([trained, tested, middle[None]]), halls)
    run = robots.run(max(motion.period for motion in motions))
    sensors = [drawn_sensors(2 * seed + part, n_joints) for part in range(2)]
    sets = [
        MotionSet(
            record(
                run, index, motion.period, robot, sensors[motion is test], folder / f"set{index}"
            ),
            0.0,
            "heating",
        )
        for index, motion in enumerate(motions)
    ]
    first = len(trained)
    return Experiment(
        sets[:first], sets[first:-1], sets[-1].path, float(np.abs(run.imbalance).max())
    )


def _programs(robot: DrawnRobot, seed: int, moves: int) -> tuple[Program, Program, Program]:
    """Return the motions of identification and test, and poses to rest in."""
    arm = Robot.from_model(load(BODY))
    limits = MotionLimits.of_robot(arm, robot.acceleration)
    above = tool_above(arm, TOOL, MIN_HEIGHT)
    train, test = (
        random_program(limits, 2 * seed + part, moves, accept=above) for part in range(2)
    )
    hold = random_program(limits, 2 * seed, POSES, 0.8, POSE_DWELL, accept=above)
    dwell = [LEAD, *(DWELL for _ in range(len(train.via) - 1))]
    return Program(train.via, limits, dwell), Program(test.via, limits, dwell), hold


def warmed(network: HeatNetwork, heat: Float, hall_degc: float, shares: Sequence[float]) -> Float:
    """Return the temperatures on the way of a warm-up, shape (len(shares), 4, n). [degC]

    The heat is the greatest at which the windings stay below `MEAN_DEGC` in the mean, and every
    part below `HOTTEST_DEGC`.

    Args:
        heat: Of continuous work, shape (4, n). [W]
        hall_degc: Of the hall, and of all parts at the start. [degC]
        shares: Of the rise of the mean winding. [-]
    """
    degc = np.full((len(DUTIES), *heat.shape), hall_degc)
    duty = DUTIES[:, None, None]
    path = [degc]
    for _ in range(WARM_UP):
        degc = network.step(degc, duty * heat, hall_degc, MINUTE)
        path.append(degc)
    cold = degc[:, WINDING].mean(axis=-1) < MEAN_DEGC
    cold &= degc.max(axis=(1, 2)) < HOTTEST_DEGC
    chosen = np.array(path)[:, max(int(cold.sum()) - 1, 0)]
    mean = chosen[:, WINDING].mean(axis=-1)
    goals = mean[0] + np.array(shares) * (mean[-1] - mean[0])
    return chosen[np.abs(mean[:, None] - goals).argmin(axis=0)]


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
