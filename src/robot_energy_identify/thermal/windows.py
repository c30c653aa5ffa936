"""What the fit of a thermal network sees: heat and temperature of motors over windows.

A window lasts 10 s, or a sixtieth of a run that lasts less than 10 min, as a small motor needs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import numpy as np

from robot_energy.condition.thermal_state import WINDOW
from robot_energy.foundation.errors import LogFormatError
from robot_energy.model import RobotModel
from robot_energy.timeline.blocks import NANOSECOND, Float, Int, Rows
from robot_energy_identify.data.recordings import Recording

if TYPE_CHECKING:
    from robot_energy_logs.recording import LogBlock

WINDOWS = 60  # of a run at least,
SHORTEST = 1.0  # s, where it is as long as sixty of these
MAX_GAP = 600.0  # s without samples, beyond which another run begins


class ThermalRun(Rows):
    """One motor during one run, in windows; those without samples have no heat."""

    time: Annotated[Float, "Start of each window, shape (N,). [s]"]
    drive_heat: Annotated[
        Float,
        "Mean loss of motor and inverter, shape (N,). [W], or of a log the squared motor current. "
        "[A^2]",
    ]
    friction_heat: Annotated[Float, "Mean friction power, shape (N,). [W]"]
    awake: Annotated[Float, "Share of the window with samples, shape (N,). [-]"]
    motor_temperature_degc: Annotated[
        Float, "Last reading in the window, NaN for none, shape (N,). [degC]"
    ]
    start_degc: Annotated[float, "First reading. [degC]"]
    window: Annotated[float, "Length of a window. [s]"] = WINDOW
    age: Annotated[
        Float | None,
        "Of the reading at the end of its window, as a share of the window; None: 0, shape (N,). "
        "[-]",
    ] = None


def without_networks(model: RobotModel) -> RobotModel:
    """Return a model that estimates no temperature, so that readings alone are seen."""
    return model.with_joints("thermal", dict.fromkeys(model.joint_names))


def runs_of_recordings(recordings: Sequence[Recording], joint: int) -> list[ThermalRun]:
    """Return the runs of one motor in recordings of the same robot.

    Args:
        recordings: Run with a model without thermal networks.
    """
    runs: list[ThermalRun] = []
    for recording in recordings:
        power = recording.power
        runs += _runs(
            power.stamp_ns,
            power.drive_loss[:, joint],
            power.friction_power[:, joint],
            power.motor_temperature_degc[:, joint],
        )
    return runs


def runs_of_log(blocks: Sequence[LogBlock], joint: int) -> list[ThermalRun]:
    """Return the runs of one motor in a log with currents and temperatures."""
    rows = blocks[0].concatenate(blocks)
    heat = rows.effort[:, joint] ** 2
    degc = rows.motor_temperature_degc[:, joint]
    for key, values in (("effort", heat), ("temperature", degc)):
        if not np.isfinite(values).any():
            raise LogFormatError(
                f"the log has no {key} of joint {joint + 1}",
                "motor currents and motor temperatures",
                f"name its column under joints.{key} in the mapping",
            )
    return _runs(rows.stamp_ns, heat, np.zeros_like(heat), degc, rows.run)


def _runs(
    stamp_ns: Int, drive: Float, friction: Float, degc: Float, run: Int | None = None
) -> list[ThermalRun]:
    """Cut samples at long gaps and between runs, and sum them over windows."""
    cut = np.abs(np.diff(stamp_ns)) > MAX_GAP / NANOSECOND
    cut |= False if run is None else np.diff(run) != 0
    cuts = np.flatnonzero(cut) + 1
    runs: list[ThermalRun] = []
    for rows in np.split(np.arange(len(stamp_ns)), cuts):
        time = (stamp_ns[rows] - stamp_ns[rows[0]]) * NANOSECOND
        known = np.flatnonzero(np.isfinite(degc[rows]))
        if not len(known):
            continue
        time, rows = time[known[0] :] - time[known[0]], rows[known[0] :]
        length = min(WINDOW, max(float(time[-1]) / WINDOWS, SHORTEST))
        window = (time // length).astype(np.int64)
        count = int(window[-1]) + 1
        duration = np.minimum(np.diff(time, append=time[-1]), length)
        awake = np.bincount(window, duration, count) / length
        heats = [
            np.bincount(window, np.nan_to_num(heat[rows]) * duration, count) / length
            for heat in (drive, friction)
        ]
        readings = np.full(count, np.nan)
        read = np.isfinite(degc[rows])
        readings[window[read]] = degc[rows][read]  # the last one stays
        new = np.flatnonzero(read)[1:][np.diff(degc[rows][read]) != 0.0]
        age = np.zeros(count)  # one that says the same again is as good as new
        age[window[new]] = window[new] + 1 - time[new] / length
        starts, first = np.arange(count) * length, float(degc[rows[0]])
        runs.append(ThermalRun(starts, heats[0], heats[1], awake, readings, first, length, age))
    return runs
