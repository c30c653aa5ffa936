"""Figure of motor temperatures and of the friction power that follows them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot_energy.blocks import Float
from robot_energy.page.history import HistoryRing
from robot_energy.pipeline import Output
from robot_energy.report.canvas import COLOURS, SERIES, Target, canvas

MIN_SPAN = 10.0  # of the axis of temperatures [K]
MIN_WIDTH = 0.5  # of a mean; longer recordings have wider ones [s]


class TemperatureHistory:
    """Means of motor temperatures and friction power over a whole recording, in bounded memory.

    Args:
        joint_names: In model order.
    """

    def __init__(self, joint_names: Sequence[str]) -> None:
        self.joint_names = tuple(joint_names)
        self._ring = HistoryRing(MIN_WIDTH, len(self.joint_names) + 1, whole=True)

    def take(self, output: Output) -> None:
        """Take what one step of the pipeline gave.

        Args:
            output: Of the step.
        """
        power = output.power
        if power is not None and len(power):
            friction = power.friction_power.sum(axis=1, keepdims=True)
            values = np.hstack([power.motor_temperature_degc, friction])
            self._ring.add(power.stamp_ns, values, np.ones(len(power)))

    def means(self) -> tuple[Float, Float]:
        """Return times and means.

        Returns:
            Since the start, shape (W,) [s]; temperatures, NaN where unknown, and last the
            friction power of all joints, shape (W, n + 1) [degC, W].
        """
        table = self._ring.table()
        number = np.asarray(table["number"], dtype=np.float64)
        means = np.array(table["mean"], dtype=np.float64).T
        return (number - number[:1] + 0.5) * table["width"], means


def temperature_and_friction(history: TemperatureHistory, path: Target) -> None:
    """Draw the temperature of every motor, and below it the friction power of all joints.

    Args:
        history: Of a recording.
        path: File to write: PNG, SVG or PDF by its suffix.
    """
    time, means = history.means()
    degc, friction = means[:, :-1], means[:, -1]
    known = np.isfinite(degc).any(axis=0)
    with canvas(path, (8.0, 4.4 if known.any() else 2.6)) as figure:
        grid: Any = figure.subplots(2 if known.any() else 1, 1, sharex=True, squeeze=False)[:, 0]
        if known.any():
            for joint in np.flatnonzero(known).tolist():
                colour = SERIES[joint % len(SERIES)]
                label = history.joint_names[joint]
                grid[0].plot(time, degc[:, joint], color=colour, label=label)
            middle = 0.5 * (float(np.nanmin(degc)) + float(np.nanmax(degc)))
            low, high = grid[0].get_ylim()  # whole degrees of a sensor are no course
            grid[0].set_ylim(min(low, middle - MIN_SPAN / 2), max(high, middle + MIN_SPAN / 2))
            grid[0].set_ylabel("motor temperature [degC]")
            grid[0].legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        grid[-1].plot(time, friction, color=COLOURS["predicted"])
        grid[-1].set_ylim(bottom=0.0)
        grid[-1].margins(x=0.0)
        grid[-1].set_ylabel("friction power [W]")
        grid[-1].set_xlabel("time since the start of the recording [s]")
