"""Electrical energy of the Mantis's drives: no efficiency, a constant, reduced maps, our losses.

Maps and losses are identified from one excitation run with the measured power of each drive, as in
section 6 of paper B. Tested are runs that no fit has seen; torque is that of the identified model,
not the measured one (section 6.2).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.physics.drive import Drive, EfficiencyMaps, LossModel
from robot_energy.timeline.blocks import Float
from robot_energy_identify.drives.drive_data import drive_data
from robot_energy_identify.drives.drives import (
    CONSTANT_EFFICIENCY,
    WAYS,
    DrivesFit,
    Way,
    fit_drives,
)
from robot_energy_identify.drives.efficiency import (
    CUTOFF,
    POINTS,
    at_efficiency,
    fitted_efficiency,
    processed,
)
from robot_energy_papers.mantis import RATE, PrintRun

WAY_NAMES: dict[Way, str] = {
    "none": "no efficiency",
    "constant": "constant 87.5 %",
    "constant_fitted": "constant, fitted to all drives",
    "map": "reduced maps",
    "map_processed": "reduced maps, second stage",
    "losses": "loss model (ours)",
}
PAPER: dict[Way, float] = {"none": 0.386, "constant": 0.435, "map_processed": 0.903}


@dataclass(frozen=True)
class WayResult:
    """One way on one run.

    Attributes:
        power: Predicted input of each drive, shape (N, n). [W]
        energy: Energy of each drive, shape (n,). [J]
        accuracy: Accuracy of the energy of all drives, 1 - |E - E_measured| / E_measured. [-]
        joint: The same of each drive, shape (n,). [-]
        rms: Error of the power of a drive, over all drives. [W]
    """

    power: Float
    energy: Float
    accuracy: float
    joint: Float
    rms: float


@dataclass(frozen=True)
class DriveTest:
    """All ways on one run.

    Attributes:
        time: Shape (N,). [s]
        measured: Input of each drive, shape (N, n). [W]
        shaft: Measured torque times speed, shape (N, n). [W]
        energy: Measured, of each drive, shape (n,). [J]
        efficiency: Shaft over input, energies of all drives. [-]
        joint_efficiency: The same of each drive, shape (n,). [-]
        outside: Share of the samples further from all points of a map than its reach. [-]
    """

    name: str
    time: Float
    measured: Float
    shaft: Float
    energy: Float
    efficiency: float
    joint_efficiency: Float
    outside: float
    ways: dict[Way, WayResult]


def identify_drives(
    runs: Sequence[PrintRun], cutoff: float = CUTOFF, points: int = POINTS
) -> DrivesFit:
    """Return maps and losses of every drive, identified from excitation runs.

    Args:
        cutoff: Of the low-pass of the maps. [Hz]

    Raises:
        NotIdentifiableError: If a drive cannot be identified from the runs.
    """
    recordings, powers = [run.recording for run in runs], [run.power for run in runs]
    data = drive_data(recordings, powers, measured_torque=True)
    fit = fit_drives(
        data, "excitation", cutoff, points, compare=False
    )  # other runs are held out here
    for axis in fit.axes:
        if axis.map is None or axis.losses is None:
            raise NotIdentifiableError(axis.notes[0], "an excitation that moves every drive")
    return fit


def tested(runs: Mapping[str, PrintRun], fit: DrivesFit) -> dict[str, DriveTest]:
    """Return the electrical power, by the names of runs that the fit has not seen.

    Args:
        runs: By name, read with the identified model.
    """
    drives: dict[Way, Drive] = {
        "map": EfficiencyMaps([a.map.entry for a in fit.axes if a.map is not None]),
        "losses": LossModel([a.losses.entry() for a in fit.axes if a.losses is not None]),
    }
    seen = [axis.samples for axis in fit.axes if axis.samples is not None]
    constant = fitted_efficiency(
        np.concatenate([one.motor_velocity * one.motor_torque for one in seen]),
        np.concatenate([one.drive_power for one in seen]),
    )
    return {name: _test(name, run, drives, constant, fit.cutoff) for name, run in runs.items()}


def _test(
    name: str, run: PrintRun, drives: Mapping[Way, Drive], constant: float, cutoff: float
) -> DriveTest:
    rows = run.rows
    power = run.recording.power
    shaft, velocity = run.shaft_predicted, power.motor_velocity[rows]
    given = shaft, velocity, power.motor_torque[rows], power.motor_temperature_degc[rows]
    mapped, outside = drives["map"].input_power(*given)
    losses, _ = drives["losses"].input_power(*given)
    together = np.zeros(len(shaft), dtype=np.int64)
    smooth = np.stack(
        [processed(column, together, 1.0 / RATE, cutoff) for column in mapped.T], axis=1
    )
    by_way: dict[Way, Float] = {
        "none": shaft,
        "constant": at_efficiency(shaft, CONSTANT_EFFICIENCY),
        "constant_fitted": at_efficiency(shaft, constant),
        "map": mapped,
        "map_processed": np.where(np.isfinite(smooth), smooth, mapped),
        "losses": losses,
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
        {way: _result(by_way[way], measured, duration) for way in WAYS},
    )


def _result(power: Float, measured: Float, duration: Float) -> WayResult:
    ours, theirs = duration @ power, duration @ measured
    return WayResult(
        power,
        ours,
        float(1.0 - abs(ours.sum() - theirs.sum()) / theirs.sum()),
        1.0 - np.abs(ours - theirs) / np.abs(theirs),
        float(np.sqrt(np.mean((power - measured) ** 2))),
    )
