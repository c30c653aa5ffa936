"""Notices a motor temperature that stands still while the motor's own losses warm it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from robot_energy.model import RobotModel
from robot_energy.physics.urdf.checks import moved_mass, parse
from robot_energy.timeline.blocks import NANOSECOND, Float, Int, differences

HEAT_CAPACITY = 900.0  # J/(kg K), aluminium; steel and copper hold less
MIN_MASS = 0.5  # kg, where a URDF gives none
TIME_CONSTANT = 3600.0  # s, of the cooling; robots measure hours
WARMEST_AMBIENT_DEGC = 20.0  # assumed at most, for the heat that leaves
MARGIN = 5.0  # K that the surroundings may be colder still
RISE = 2.0  # K without a change: a sensor with steps of 1 K, and 1 K more
WINDOW_NS = 10_000_000_000
MICROJOULE = 1e-6  # J


class StuckTemperatureDetector:
    """Compares the losses of each motor with what its thermometer says.

    While a reading does not change at all, the losses must warm the motor by at least
    ``dx/dt = (P - G (T - T_a + x)) / C``. ``C`` and ``G`` are chosen too large: the heat
    spreads over half of the two bodies that the joint connects, or an equal share of the
    robot if that is more, all of aluminium; it leaves with a time constant of one hour, to
    surroundings 5 K colder than the coldest reading so far, than 20 degC at most. A reading
    is stuck once ``x`` exceeds 2 K, until it changes. So an idle robot, a sensor with steps
    of 1 K and a robot in thermal equilibrium are not called stuck; a thermometer stuck near
    the temperature of the hall is found within some tens of minutes of work on most axes,
    one stuck at a high temperature hardly ever.

    Losses are summed over windows of 10 s of the stamps, in whole microjoules, which
    doubles add up exactly. So any cutting into blocks gives the same verdict, and samples may wait
    until the window has ended, as long as nothing is stuck.

    Attributes:
        window: Number of the window that has not ended; None before the first sample.
        stuck: Which readings are, shape (n,).
        rise: x, what the losses must have warmed each motor since its reading last
            changed, shape (n,). [K]
    """

    def __init__(self, model: RobotModel) -> None:
        mass = np.asarray(moved_mass(parse(model.urdf_xml), model.joint_names))
        between = 0.5 * (mass + np.concatenate([mass[:1], mass[:-1]]))
        self._capacity = HEAT_CAPACITY * np.maximum(between, max(mass.mean(), MIN_MASS))
        self._conductance = self._capacity / TIME_CONSTANT
        n_joints = len(mass)
        self.stuck = np.zeros(n_joints, dtype=np.bool_)
        self.rise = np.zeros(n_joints)
        self._coldest = WARMEST_AMBIENT_DEGC
        self._reading: Float = np.full(n_joints, np.nan)  # that may be stuck
        self.window: int | None = None
        self._heat = np.zeros(n_joints)  # of the window, whole numbers [uJ]
        self._changed = np.zeros(n_joints, dtype=np.bool_)  # in the window
        self._last: Float = np.full(n_joints, np.nan)  # reading
        self._last_ns = 0
        self._segment = -1

    def step(
        self, stamp_ns: Int, segment: Int, loss: Float, temperature_degc: Float
    ) -> NDArray[np.bool_] | None:
        """Return at which samples any reading is stuck, shape (N,); None for none.

        Args:
            stamp_ns: Shape (N,), N >= 1; they may jump back. [ns]
            segment: Shape (N,); no heat counts between two segments.
            loss: Of each motor while it turns, shape (N, n); NaN counts as none. [W]
            temperature_degc: Readings in use, shape (N, n), NaN where there is none. [degC]
        """
        first = self.window is None
        elapsed = differences(stamp_ns, int(stamp_ns[0]) if first else self._last_ns)
        elapsed[differences(segment, self._segment) != 0] = 0
        heat = loss * (elapsed * (NANOSECOND / MICROJOULE))[:, None]
        if not np.isfinite(heat.sum()):
            heat[~np.isfinite(heat)] = 0.0
        np.rint(heat, out=heat)
        bounds = [0, len(stamp_ns)]
        number = stamp_ns // WINDOW_NS
        if (number != number[0]).any():
            bounds[1:1] = ((number[1:] != number[:-1]).nonzero()[0] + 1).tolist()
        marks: NDArray[np.bool_] | None = None
        for start, stop in pairwise(bounds):
            window = int(stamp_ns[start]) // WINDOW_NS
            if self.window is not None and window != self.window:
                self._close(window - self.window)
            self.window = window
            if self.stuck.any():
                marks = np.zeros(len(stamp_ns), dtype=np.bool_) if marks is None else marks
                marks[start:stop] = True
            part = temperature_degc[start:stop]
            self._heat += np.ones(stop - start) @ heat[start:stop]
            other = part != self._reading  # NaN always is
            if other.any():
                self._changed |= other.any(axis=0)
            self._last = part[-1]
        self._last_ns, self._segment = int(stamp_ns[-1]), int(segment[-1])
        return marks

    def _close(self, windows: int) -> None:
        """Judge the window that ended, and those without samples after it; < 0: a new epoch."""
        known = self._last[~np.isnan(self._last)]
        self._coldest = float(min([self._coldest, *known.tolist()]))
        again = self._changed | (windows < 0)
        above = self._reading - self._coldest + MARGIN + self.rise
        net = self._heat * MICROJOULE - self._conductance * above * max(windows, 0) * (
            WINDOW_NS * NANOSECOND
        )
        rise = np.maximum(self.rise + net / self._capacity, 0.0)
        self.rise = np.where(again, 0.0, rise)
        self.stuck = self.rise > RISE
        self._reading = self._last.copy()
        self._heat[:] = 0
        self._changed[:] = False
