"""The studies of paper B from end to end: identification, efficiency of drives, three machines.

The paper names an accuracy of energy and gives no formula in its text, so there is one by every
definition that it may have meant. All are one less a relative error; they differ in what is
integrated.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.model import RobotModel, load
from robot_energy.timeline.blocks import Float
from robot_energy_identify.dynamics.dynamics_model import to_model
from robot_energy_papers.drive_study import (
    DriveTest,
    StudiedDrives,
    identify_drives,
    map_tables,
    tested,
)
from robot_energy_papers.job_pool import StudyRun
from robot_energy_papers.machines import (
    ARM,
    MACHINES,
    Curve,
    Energies,
    layer,
    played,
    predicted,
    wall_motion,
)
from robot_energy_papers.mantis import (
    RATE,
    PrintRun,
    Smooth,
    excitation,
    identify_mechanics,
    read_run,
    recorded,
    slower,
)
from robot_energy_papers.sensitivity import SensitivityTable
from robot_energy_papers.wall_sensitivity import wall_tables
from robot_energy_plan.motion import JointMotion
from robot_energy_rig import RigConfig, load_profile, random_profile

Definition = Literal["net", "absolute", "positive", "pointwise"]
DEFINITIONS: dict[Definition, str] = {
    "net": "1 - |dE| / E, E the integral of the power, braking negative",
    "absolute": "the same, E the integral of the magnitude of the power",
    "positive": "the same, E the integral of the power where it is positive",
    "pointwise": "1 - integral of |dP| over integral of |P|: errors cannot cancel",
}
SLOW = 0.4  # of the speed, for the second excitation
STEPS = 11
WALL, WALL_HELD, VALIDATION = "wall, all joints", "wall, joint 1 held", "validation"
FAST, SLOWED, BOTH = "full speed", "40 % of it", "both speeds"
TRAININGS = {BOTH: (FAST, SLOWED), FAST: (FAST,), SLOWED: (SLOWED,)}
"""Excitation runs behind each identification."""
SEED_STEP = 100  # between the seeds of two studies


class Accuracy(Described):
    """Accuracy by one definition."""

    joint: Annotated[Float, "Accuracy of each joint, shape (n,). [-]"]
    total: Annotated[float, "Accuracy of the sum of the joints' energies. [-]"]
    summed: Annotated[float, "Accuracy of the energy of the summed power. [-]"]
    mean: Annotated[float, "Mean over the joints. [-]"]


def energy(power: Float, duration: Float, definition: Definition) -> Float:
    """Return the integral of power, shape (...). [J]

    Args:
        power: Shape (N, ...). [W]
        duration: That each sample stands for, shape (N,). [s]
    """
    if definition == "positive":
        power = np.maximum(power, 0.0)
    elif definition != "net":
        power = np.abs(power)
    return np.asarray(np.tensordot(duration, power, axes=1))


def accuracies(predicted: Float, measured: Float, duration: Float) -> dict[Definition, Accuracy]:
    """Return how accurate a predicted power of the joints is, by all definitions.

    Args:
        predicted: Shape (N, n). [W]
        measured: Shape (N, n). [W]
        duration: That each sample stands for, shape (N,). [s]
    """
    result: dict[Definition, Accuracy] = {}
    for definition in DEFINITIONS:
        joint, total = _one_accuracy(predicted, measured, duration, definition)
        sums = predicted.sum(axis=1, keepdims=True), measured.sum(axis=1, keepdims=True)
        _, summed = _one_accuracy(*sums, duration, definition)
        result[definition] = Accuracy(joint, total, summed, float(joint.mean()))
    return result


def _one_accuracy(
    predicted: Float, measured: Float, duration: Float, definition: Definition
) -> tuple[Float, float]:
    """1 minus the relative error of each column, and of their sum."""
    theirs = energy(measured, duration, definition)
    if definition == "pointwise":
        error = energy(predicted - measured, duration, definition)
    else:
        error = energy(predicted, duration, definition) - theirs
    joint = 1.0 - np.abs(error) / np.abs(theirs)
    return joint, float(1.0 - abs(error.sum()) / abs(theirs.sum()))


class PaperBStudySize(Described):
    """How much is done."""

    iterations: int
    plants: Annotated[int, "Plants drawn at random for the contest of maps and losses."]
    layers: Annotated[int, "Simulated layers of the wall; 0: single ones at `heights`."]
    heights: Annotated[tuple[float, ...], "Heights of single layers. [m]"]
    rate: Annotated[float, "Of the joint states of the Mantis. [Hz]"] = RATE


FULL = PaperBStudySize(100, 10, 100, (0.0, 0.25, 0.5, 0.75, 0.99))
QUICK = PaperBStudySize(25, 1, 0, (0.0, 0.99), 200.0)


@dataclass(frozen=True)
class MechanicalTest:
    """Mechanical energy of one run, predicted and measured."""

    run: PrintRun
    accuracy: dict[Definition, Accuracy]


class Trained(Described):
    """What was identified from some excitation, and how it predicts what it has not seen."""

    model: Annotated[RobotModel, "With bodies by ordinary least squares, as in the paper."]
    drives: StudiedDrives
    mechanical: dict[str, MechanicalTest]
    tests: Annotated[dict[str, DriveTest], "Tests of the drives, one per run."]


class MachineResult(Described):
    """One machine at the wall."""

    layer: Annotated[Energies, "One layer at the bottom, predicted by the shipped model."]
    curve: Curve
    rig: Annotated[Energies, "The same layer on the virtual rig."]
    heights: Annotated[tuple[Energies, ...], "One layer at each height of the scale, predicted."]
    joint_ranges: Annotated[
        tuple[Float, ...], "Least and greatest of each layer, shape (2, n). [rad] or [m]"
    ]
    wall: Annotated[Energies, "The whole wall: all layers, or those at several heights."]

    @property
    def at_heights(self) -> list[float]:
        """Electrical energy of one layer at each height. [J]"""
        return [float(energies.electrical.sum()) for energies in self.heights]


class PaperB(Described):
    """Everything the studies found."""

    seed: int
    scale: PaperBStudySize
    trained: Annotated[dict[str, Trained], "By the excitation behind it, keys of `TRAININGS`."]
    weighted: Annotated[dict[Definition, Accuracy], "Of the weighted fit on the validation run."]
    machines: dict[str, MachineResult]
    plants: Annotated[
        dict[str, dict[int, DriveTest]],
        "The wall printed by plants drawn at random, by configuration (`WALL`, `WALL_HELD`) and "
        "seed of the plant: drives identified from both excitation runs of that plant.",
    ]
    gantry: dict[str, SensitivityTable]
    maps: dict[str, SensitivityTable]

    @property
    def quick(self) -> bool:
        """Whether this is the short form."""
        return self.scale.layers == 0

    @property
    def main(self) -> Trained:
        """Identified from both excitation runs."""
        return self.trained[BOTH]

    @property
    def model(self) -> RobotModel:
        """The identified model of the Mantis."""
        return self.main.model

    def relative(self, stage: str) -> dict[str, dict[str, float]]:
        """Return the energy of every machine over that of the arm, less one, by figure. [-]"""
        energies: dict[str, Energies] = {
            key: getattr(found, stage) for key, found in self.machines.items()
        }
        arm = energies[ARM].figures
        return {
            key: {name: value / arm[name] - 1.0 for name, value in found.figures.items()}
            for key, found in energies.items()
            if key != ARM
        }


def study(options: StudyRun, scale: PaperBStudySize) -> PaperB:
    """Return what all studies find."""
    seed, folder = options.seed, options.folder
    step = options.steps(STEPS + scale.plants)
    start, profile = load("mantis"), load_profile("mantis")
    first = seed * SEED_STEP
    train = excitation(start, profile, first + 1, scale.iterations)
    other = excitation(start, profile, first + 2, scale.iterations)
    slow = slower(train, SLOW)
    step()
    motions: dict[str, tuple[JointMotion, float]] = {
        FAST: (train, train.period),
        SLOWED: (slow, slow.period),
        VALIDATION: (other, other.period),
    }
    for name, key in ((WALL, "mantis_all"), (WALL_HELD, "mantis_held")):
        motion = Smooth(layer(key))
        motions[name] = motion, motion.duration
    paths = {
        name: recorded(
            profile, motion, duration, folder / f"mantis_{number}", first + 3 + number,
            rate=scale.rate,
        )
        for number, (name, (motion, duration)) in enumerate(motions.items())
    }  # fmt: skip
    step()
    fitted = {name: read_run(paths[name], start) for name in (FAST, SLOWED)}
    trained: dict[str, Trained] = {}
    for name, parts in TRAININGS.items():
        runs = [fitted[part] for part in parts]
        model = to_model(identify_mechanics(runs, start, "ols"), ["excitation on the virtual rig"])
        drives = identify_drives(runs)
        unseen = {test: read_run(paths[test], model) for test in (WALL, WALL_HELD, VALIDATION)}
        mechanical = {test: MechanicalTest(run, _accuracy(run)) for test, run in unseen.items()}
        trained[name] = Trained(model, drives, mechanical, tested(unseen, drives))
        step()
    weighted = identify_mechanics([fitted[FAST], fitted[SLOWED]], start, "wls")
    check = read_run(paths[VALIDATION], to_model(weighted))
    machines: dict[str, MachineResult] = {}
    for number, key in enumerate(MACHINES):
        machines[key] = _machine(key, scale, first + 10 + number)
        step()
    plants: dict[str, dict[int, DriveTest]] = {WALL: {}, WALL_HELD: {}}
    for plant_seed in range(1, scale.plants + 1):
        printed = _drawn(plant_seed, start, motions, folder, first, scale.rate)
        for name, test in printed.items():
            plants[name][plant_seed] = test
        step()
    quick = scale.layers == 0
    gantry = wall_tables(quick)
    step()
    maps = map_tables(train, first + 3, quick, scale.rate)
    step()
    return PaperB(seed, scale, trained, _accuracy(check), machines, plants, gantry, maps)


def _drawn(
    plant_seed: int,
    start: RobotModel,
    motions: Mapping[str, tuple[JointMotion, float]],
    folder: Path,
    first: int,
    rate: float,
) -> dict[str, DriveTest]:
    """Identify the drives of a drawn plant with every effect of the rig, and print the wall.

    In both configurations.
    """
    profile = random_profile("mantis", plant_seed)
    paths = {
        name: recorded(
            profile, *motions[name], folder / f"plant_{plant_seed}_{number}", first + number,
            RigConfig.hard(), rate,
        )
        for number, name in enumerate((FAST, SLOWED, WALL, WALL_HELD))
    }  # fmt: skip
    runs = [read_run(paths[name], start) for name in (FAST, SLOWED)]
    model = to_model(identify_mechanics(runs, start, "ols"), ["excitation on the virtual rig"])
    walls = {name: read_run(paths[name], model) for name in (WALL, WALL_HELD)}
    return tested(walls, identify_drives(runs))


def _accuracy(run: PrintRun) -> dict[Definition, Accuracy]:
    return accuracies(run.shaft_predicted, run.shaft_measured, run.duration)


def _machine(key: str, scale: PaperBStudySize, seed: int) -> MachineResult:
    machine = MACHINES[key]
    model = load(machine.model)
    bottom, curve = predicted(model, layer(key))
    rig, _ = played(machine, layer(key), seed)
    layers = [(bottom, curve)] * len(scale.heights)
    if scale.layers or key == ARM:  # heights matter to the arm only (full form)
        layers = [
            predicted(model, wall_motion(machine, height=height).blocks())
            if height
            else (bottom, curve)
            for height in scale.heights
        ]
    heights = tuple(energies for energies, _ in layers)
    positions = [of_layer.joint_position for _, of_layer in layers]
    ranges = tuple(np.stack([one.min(axis=0), one.max(axis=0)]) for one in positions)
    if scale.layers:
        wall, _ = predicted(model, wall_motion(machine, scale.layers).blocks())
    else:
        wall = sum(heights[1:], heights[0])
    return MachineResult(bottom, curve, rig, heights, ranges, wall)
