"""Electrical energy of the Mantis's drives: no efficiency, a constant, reduced maps, our losses.

Maps and losses are identified from excitation runs with the measured power of each drive, as in
section 6 of paper B. Tested are runs that no fit has seen; torque is that of the identified model,
not the measured one (section 6.2). Maps stand here twice: as the paper writes them, and as the
monitor runs them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from functools import cache
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel, load
from robot_energy.model.drive_models import EfficiencyMap, LossMap
from robot_energy.physics.drives_and_cabinet import Drive, EfficiencyMaps, LossMaps, LossModel
from robot_energy.timeline.blocks import Float
from robot_energy_identify.drives.drive_data import drive_data
from robot_energy_identify.drives.drives import (
    CONSTANT_EFFICIENCY,
    DrivesFit,
    Way,
    fit_drives,
)
from robot_energy_identify.drives.efficiency_map import (
    CUTOFF,
    POINTS,
    at_efficiency,
    fitted_efficiency,
    processed,
)
from robot_energy_identify.drives.losses import fitted_loss_map
from robot_energy_identify.dynamics.dynamics_model import to_model
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

WAY_NAMES: dict[Way, str] = {
    "none": "no efficiency",
    "constant": "constant 87.5 %",
    "constant_fitted": "constant, fitted to all drives",
    "written": "maps as written in the paper",
    "map": "our maps",
    "map_processed": "our maps, second stage",
    "losses": "loss model",
    "loss_map": "loss map",
}
PAPER: dict[Way, float] = {"none": 0.386, "constant": 0.435, "written": 0.903}
SMALLEST = 1e-3  # efficiency of a model file; what a smaller one gives is a peak


class WayResult(Described):
    """One way on one run."""

    power: Annotated[Float, "Predicted input of each drive, shape (N, n). [W]"] = field(repr=False)
    energy: Annotated[Float, "Energy of each drive, shape (n,). [J]"]
    accuracy: Annotated[float, "Accuracy of the energy of all drives, 1 - |dE| / E_measured. [-]"]
    joint: Annotated[Float, "The same of each drive, shape (n,). [-]"]
    rms: Annotated[float, "Error of the power of a drive, over all drives. [W]"]


class DriveTest(Described):
    """All ways on one run."""

    name: str
    time: Annotated[Float, "Shape (N,). [s]"] = field(repr=False)
    measured: Annotated[Float, "Input of each drive, shape (N, n). [W]"] = field(repr=False)
    shaft: Annotated[Float, "Measured torque times speed, shape (N, n). [W]"] = field(repr=False)
    energy: Annotated[Float, "Measured, of each drive, shape (n,). [J]"]
    efficiency: Annotated[float, "Shaft over input, energies of all drives. [-]"]
    joint_efficiency: Annotated[Float, "The same of each drive, shape (n,). [-]"]
    outside: Annotated[float, "Share of the samples beyond the reach of a map. [-]"]
    ways: dict[Way, WayResult]


class StudiedDrives(Described):
    """What was identified of the drives from excitation runs."""

    fit: DrivesFit
    written: Annotated[tuple[EfficiencyMap, ...], "Maps as the paper writes them, one per joint."]
    loss_maps: Annotated[tuple[LossMap, ...], "One per joint."]


def identify_drives(
    runs: Sequence[PrintRun], cutoff: float = CUTOFF, points: int = POINTS
) -> StudiedDrives:
    """Return maps and losses of every drive, identified from excitation runs.

    Args:
        cutoff: Of the low-pass of the maps. [Hz]
    """
    recordings, powers = [run.recording for run in runs], [run.power for run in runs]
    data = drive_data(recordings, powers, measured_torque=True)
    fit = fit_drives(
        data, "excitation", cutoff, points, compare=False
    )  # other runs are held out here
    for axis in fit.axes:
        if axis.map is None or axis.losses is None:
            raise NotIdentifiableError(axis.notes[0], "an excitation that moves every drive")
    loss_maps = tuple(one for axis in fit.axes if (one := fitted_loss_map(axis, "")) is not None)
    return StudiedDrives(fit, maps_as_written(runs, cutoff), loss_maps)


def maps_as_written(runs: Sequence[PrintRun], cutoff: float) -> tuple[EfficiencyMap, ...]:
    """Return the maps of section 6.1 of paper B, one per joint: every sample is a point.

    ``eta = tau w / P_el`` of the raw samples, three scaled MADs, straight lines over the gaps,
    Butterworth low-pass forward and backward; nothing is left out and nothing is put together.

    Args:
        cutoff: Of the low-pass; the paper gives neither it nor the order. [Hz]
    """
    torque = np.concatenate([run.recording.torque.motor_torque_measured[run.rows] for run in runs])
    speed = np.concatenate([run.recording.power.motor_velocity[run.rows] for run in runs])
    with np.errstate(divide="ignore", invalid="ignore"):
        raw = np.concatenate([run.shaft_measured / run.electrical for run in runs])
    period = float(np.median(runs[0].duration))
    run = np.repeat(np.arange(len(runs)), [int(run.rows.sum()) for run in runs])
    maps: list[EfficiencyMap] = []
    for joint, column in enumerate(raw.T):
        eta = processed(column, run, period, cutoff)
        held = np.where(eta < 0, -1.0, 1.0) * np.maximum(np.abs(eta), SMALLEST)
        entry = EfficiencyMap(
            motor_torque=torque[:, joint].tolist(),
            motor_velocity=speed[:, joint].tolist(),
            efficiency=held.tolist(),
            tag="identified",
        )
        maps.append(entry)
    return tuple(maps)


def tested(runs: Mapping[str, PrintRun], drives: StudiedDrives) -> dict[str, DriveTest]:
    """Return the electrical power, by the names of runs that the fit has not seen."""
    fit = drives.fit
    models: dict[Way, Drive] = {
        "written": EfficiencyMaps(list(drives.written)),
        "map": EfficiencyMaps([a.map.entry for a in fit.axes if a.map is not None]),
        "losses": LossModel([a.losses.entry() for a in fit.axes if a.losses is not None]),
        "loss_map": LossMaps(list(drives.loss_maps)),
    }
    seen = [axis.samples for axis in fit.axes if axis.samples is not None]
    constant = fitted_efficiency(
        np.concatenate([one.motor_velocity * one.motor_torque for one in seen]),
        np.concatenate([one.drive_power for one in seen]),
    )
    return {name: _test(name, run, models, constant, fit.cutoff) for name, run in runs.items()}


def _test(
    name: str, run: PrintRun, drives: Mapping[Way, Drive], constant: float, cutoff: float
) -> DriveTest:
    shaft, block = run.shaft_predicted, run.recording.power[run.rows]
    given = shaft, block.motor_velocity, block.motor_torque, block.motor_temperature_degc
    found = {way: drive.input_power(*given) for way, drive in drives.items()}
    power, outside = {way: one for way, (one, _) in found.items()}, found["map"][1]
    period = float(np.median(run.duration))
    by_way: dict[Way, Float] = {
        "none": shaft,
        "constant": at_efficiency(shaft, CONSTANT_EFFICIENCY),
        "constant_fitted": at_efficiency(shaft, constant),
        **power,
        "written": _second_stage(power["written"], period, cutoff),
        "map_processed": _second_stage(power["map"], period, cutoff),
    }
    measured, duration = run.electrical, run.duration
    energy = duration @ measured
    done = duration @ run.shaft_measured
    return DriveTest(
        name,
        run.time,
        measured,
        run.shaft_measured,
        energy,
        float(done.sum() / energy.sum()),
        done / energy,
        0.0 if outside is None else float(outside.mean()),
        {way: _result(by_way[way], measured, duration) for way in WAY_NAMES},
    )


def _second_stage(power: Float, period: float, cutoff: float) -> Float:
    """Power without peaks, smoothed (section 6.2.2), shape (N, n). [W]"""
    together = np.zeros(len(power), dtype=np.int64)
    columns = [processed(column, together, period, cutoff) for column in power.T]
    smooth = np.stack(columns, axis=1)
    return np.where(np.isfinite(smooth), smooth, power)


def _result(power: Float, measured: Float, duration: Float) -> WayResult:
    ours, theirs = duration @ power, duration @ measured
    return WayResult(
        power,
        ours,
        float(1.0 - abs(ours.sum() - theirs.sum()) / theirs.sum()),
        1.0 - np.abs(ours - theirs) / np.abs(theirs),
        float(np.sqrt(np.mean((power - measured) ** 2))),
    )


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
