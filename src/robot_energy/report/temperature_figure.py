"""Figure of motor temperatures and of the friction power that follows them."""

from __future__ import annotations

from typing import Any

import numpy as np

from robot_energy.report.canvas import COLOURS, SERIES, Target, canvas
from robot_energy.time_series import TimeSeries

MIN_SPAN = 10.0  # of the axis of temperatures [K]


def temperature_and_friction(power: TimeSeries, path: Target) -> None:
    """Draw the temperature of every motor, and below it the friction power of all joints.

    Args:
        power: Power over time, with ``motor_temperature_degc`` and ``friction_power``.
        path: File to write: PNG, SVG or PDF by its suffix.

    Raises:
        ReportError: If the suffix is none of these, or the file cannot be written.
    """
    degc = power["motor_temperature_degc"]
    known = np.isfinite(degc).any(axis=0)
    with canvas(path, (8.0, 4.4 if known.any() else 2.6)) as figure:
        grid: Any = figure.subplots(2 if known.any() else 1, 1, sharex=True, squeeze=False)[:, 0]
        if known.any():
            for joint in np.flatnonzero(known).tolist():
                colour = SERIES[joint % len(SERIES)]
                label = power.joint_names[joint]
                grid[0].plot(power.time, degc[:, joint], color=colour, label=label)
            middle = 0.5 * (float(np.nanmin(degc)) + float(np.nanmax(degc)))
            low, high = grid[0].get_ylim()  # whole degrees of a sensor are no course
            grid[0].set_ylim(min(low, middle - MIN_SPAN / 2), max(high, middle + MIN_SPAN / 2))
            grid[0].set_ylabel("motor temperature [degC]")
            grid[0].legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        grid[-1].plot(power.time, power["friction_power"], color=COLOURS["predicted"])
        grid[-1].set_ylim(bottom=0.0)
        grid[-1].margins(x=0.0)
        grid[-1].set_ylabel("friction power [W]")
        grid[-1].set_xlabel("time since the start of the recording [s]")
