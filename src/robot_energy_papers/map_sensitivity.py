"""Why reduced efficiency maps predict the print path less accurately here than in paper B."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from robot_energy.model import RobotModel, load
from robot_energy_identify.drives.efficiency import CUTOFF, POINTS
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
PLANT = ("resistance", "friction", "torque_noise")
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

Runs = tuple[list[PrintRun], RobotModel]


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
    with TemporaryDirectory() as folder:
        return sensitivity(
            _Maps(Path(folder), train, seed, rate).accuracy, FIGURES, goals, ROUGH, only
        )


class _Maps:
    """Both kinds of maps on the print path, with open figures; what does not change is kept."""

    def __init__(self, folder: Path, train: FourierMotion, seed: int, rate: float) -> None:
        self._folder, self._seed, self._rate = folder, seed, rate
        self._start, self._profile = load("mantis"), load_profile("mantis")
        self._train = train
        self._known: dict[object, Runs] = {}
        self._walls: dict[object, PrintRun] = {}
        self._bags = 0

    def accuracy(self, given: Values) -> Mapping[str, float]:
        plant = tuple(given[key] for key in PLANT)
        identified = *plant, given["slow"]
        if identified not in self._known:
            runs = [
                self._read(motion, motion.period, plant, self._start)
                for motion in (self._train, slower(self._train, given["slow"]))
            ]
            dynamics = identify_mechanics(runs, self._start, "ols")
            self._known[identified] = runs, to_model(dynamics, ["excitation on the virtual rig"])
        runs, model = self._known[identified]
        printed = *identified, given["held"]
        if printed not in self._walls:
            wall = Smooth(layer("mantis_held" if given["held"] else "mantis_all"))
            self._walls[printed] = self._read(wall, wall.duration, plant, model)
        drives = identify_drives(runs, given["cutoff"], round(given["points"]))
        ways = tested({RUN: self._walls[printed]}, drives)[RUN].ways
        return {WRITTEN: ways["written"].accuracy, MAPS: ways["map"].accuracy}

    def _read(
        self, motion: JointMotion, duration: float, plant: tuple[float, ...], model: RobotModel
    ) -> PrintRun:
        resistance, friction, noise = plant
        profile = replace(
            self._profile,
            resistance=self._profile.resistance * resistance,
            coulomb=self._profile.coulomb * friction,
            stribeck=self._profile.stribeck * friction,
        )
        config = RigConfig()
        config = replace(config, sensors=replace(config.sensors, torque_noise=noise))
        self._bags += 1
        path = self._folder / f"{self._bags}"
        return read_run(
            recorded(profile, motion, duration, path, self._seed, config, self._rate), model
        )
