"""Why reduced efficiency maps predict the print path less accurately here than in paper B."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory

from robot_energy.model import RobotModel, load
from robot_energy_identify.drives.efficiency_map import CUTOFF, POINTS
from robot_energy_identify.dynamics.dynamics_model import to_model
from robot_energy_papers.drive_study import PAPER, identify_drives, tested
from robot_energy_papers.machines import layer
from robot_energy_papers.mantis import (
    PrintRun,
    Smooth,
    identify_mechanics,
    read_run,
    recorded,
    slower,
)
from robot_energy_papers.sensitivity import (
    OpenFigure,
    SensitivityTable,
    Values,
    open_figures,
    sensitivity,
)
from robot_energy_plan.motion import FourierMotion, JointMotion
from robot_energy_rig import RigConfig, load_profile

WRITTEN, MAPS = STAGES = "maps as written in the paper", "our maps"
ROUGH = 0.02  # of the values that are sought: maps are made of noisy samples
RUN = "wall"
IN_BOTH_FORMS = ("held", "cutoff")
HELD = OpenFigure(
    "held", "joint 1 (0: moves, 1: held)", "", 0.0, 0.0, 1.0,
    "the paper prints in both configurations and does not say which this accuracy is of",
    switch=True,
)  # fmt: skip
FIGURES = (HELD, *open_figures(
    ("cutoff", "low-pass of the efficiencies", "Hz", 1.0, CUTOFF, 20.0,
     "the paper names the filter, not its cut-off"),
    ("points", "points of a map", "", 100.0, float(POINTS), 2000.0,
     "the paper shows maps, not their grid"),
    ("slow", "speed of the second excitation over the first", "", 0.15, 0.4, 0.8,
     "whether the excitation contains print speed is not stated"),
    ("resistance", "winding resistance, factor", "", 0.5, 1.0, 1.5,
     "drives of 50 to 30 % efficiency while printing, as published"),
    ("friction", "Coulomb friction, factor", "", 0.5, 1.0, 2.0,
     "harmonic gears, new to worn or stiffly preloaded"),
    ("torque_noise", "noise of the reported torque", "N m", 0.0, 0.02, 0.06,
     "up to 2 % of the rated torque, usual for current sensors"),
))  # fmt: skip

Plant = tuple[float, float, float]
"""Factors of winding resistance and Coulomb friction [-], and noise of the torque [N m]."""


def map_tables(
    train: FourierMotion, seed: int, quick: bool, rate: float
) -> dict[str, SensitivityTable]:
    """Return what the accuracy of electrical energy with maps owes to open figures.

    Of the method as written and of our maps, from both excitation runs; print path of all joints.

    Args:
        rate: Of the joint states. [Hz]
    """
    goals: dict[str, float] = dict.fromkeys(STAGES, PAPER["written"])
    only = IN_BOTH_FORMS if quick else None
    start, nominal, bags = load("mantis"), load_profile("mantis"), count(1)
    with TemporaryDirectory() as folder:

        def played(
            motion: JointMotion, duration: float, plant: Plant, model: RobotModel
        ) -> PrintRun:
            resistance, friction, noise = plant
            profile = replace(
                nominal,
                resistance=nominal.resistance * resistance,
                coulomb=nominal.coulomb * friction,
                stribeck=nominal.stribeck * friction,
            )
            sensors = replace(RigConfig().sensors, torque_noise=noise)
            config, path = RigConfig(sensors=sensors), Path(folder) / f"{next(bags)}"
            return read_run(recorded(profile, motion, duration, path, seed, config, rate), model)

        @cache
        def identified(plant: Plant, slow: float) -> tuple[list[PrintRun], RobotModel]:
            runs = [played(one, one.period, plant, start) for one in (train, slower(train, slow))]
            dynamics = identify_mechanics(runs, start, "ols")
            return runs, to_model(dynamics, ["excitation on the virtual rig"])

        @cache
        def printed(plant: Plant, slow: float, held: float) -> PrintRun:
            wall = Smooth(layer("mantis_held" if held else "mantis_all"))
            return played(wall, wall.duration, plant, identified(plant, slow)[1])

        def accuracy(given: Values) -> dict[str, float]:
            plant = given["resistance"], given["friction"], given["torque_noise"]
            runs, _ = identified(plant, given["slow"])
            drives = identify_drives(runs, given["cutoff"], round(given["points"]))
            wall = printed(plant, given["slow"], given["held"])
            ways = tested({RUN: wall}, drives)[RUN].ways
            return {WRITTEN: ways["written"].accuracy, MAPS: ways["map"].accuracy}

        return sensitivity(accuracy, FIGURES, goals, ROUGH, only)
