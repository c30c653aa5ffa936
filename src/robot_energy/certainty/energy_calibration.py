"""Bands of energies after a meter was read: what its windows show of the model's errors.

The error of the energy of a window of 5 s is

    e = G x + f u + T dy

``G`` are the deviations of the figures, integrated over the window, and ``x`` their errors, of
variance 1 before the meter was read; ``f`` is the deviation of the form of friction and drive
losses, ``u`` what the form is off by. ``dy`` is the step of the measured power from the begin to
the end of the window, ``T`` how late the meter shows it (a delay, a low pass): that moves energy
from one window to the next and cancels over a run, so it is estimated and left out.

Over the newest ten minutes, ``u`` has a mean m (sum of e over sum of f) and a variance v. Other
work has its own; ten minutes at one piece of work are one sample of m, what is known before
(``p^2``) another, and other work is taken to have D motions of its own, however often it repeats
them: ``q^2 = (p^2 + m^2) / 2 + v / D``. What the meter shows of the figures is worth D windows
too:

    P = (1 + D <G' G> / (q^2 <f^2>))^-1,   s(E)^2 = G P G' + q^2 f^2 + s(temperature)^2

(Gaussian conditioning of x; ``<>`` are means over windows). A gain error of the meter is in
measurements and errors alike, so the band is that of what this meter will show.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from robot_energy.certainty.deviation import (
    FORM,
    LOSS_GRID,
    TEMPERATURE,
    Z90,
    energy_parts,
    figures_of,
    scores,
)
from robot_energy.timeline.blocks import Float

MAX_WINDOWS = 120  # behind the band of energies: ten minutes
MIN_WINDOWS = 12  # of them: a minute
BIAS = 0.08  # p^2: of the form, before a meter was read [-]
DISTINCT = 2.5  # D: motions that differ in other work
MAX_LAG = 1.0  # T of a meter [s]

Windows = tuple[tuple[float, float, float], ...]
Squares = tuple[tuple[float, ...], ...]


class EnergyCalibration:
    """What the windows of a meter show."""

    def __init__(self) -> None:
        self._windows: deque[tuple[float, float, float]] = deque(maxlen=MAX_WINDOWS)
        self._squares: Float | None = None  # mean of G' G [J^2]

    def take(self, deviation: Float, error: float, step: float, at_bus: bool) -> None:
        """Take one window.

        Args:
            deviation: Integrals of the deviations, shape (K,). [J]
            error: Predicted minus measured energy. [J]
            step: Measured power at the end minus that at the begin. [W]
            at_bus: Whether the meter sits on the DC bus: it shows nothing of the loss before it.
        """
        rest, temperature = energy_parts(deviation, at_bus, systematic=True)
        rest = math.hypot(rest, float(deviation[FORM]))
        if rest <= 0:
            return
        score = scores(np.array([abs(error)]), np.array([rest]), np.array([temperature]))
        shown = math.copysign(rest * float(score[0]), error)
        self._windows.append((shown, step, abs(float(deviation[FORM]))))
        known = deviation.copy()
        if at_bus:
            known[LOSS_GRID] = 0.0
        figures = figures_of(known)
        squares = np.outer(figures, figures)
        if self._squares is None or self._squares.shape != squares.shape:
            self._squares = squares
        else:
            self._squares += (squares - self._squares) / len(self._windows)

    def half(self, deviation: Float) -> float | None:
        """Return half the 90 % band of an energy from the grid [J]; None if too little was read.

        Args:
            deviation: Integrals of the deviations, shape (K,). [J]
        """
        if len(self._windows) < MIN_WINDOWS or self._squares is None:
            return None
        error, step, form = np.array(self._windows).T
        squares = float(form @ form)
        figures = figures_of(deviation)
        if squares <= 0 or len(self._squares) != len(figures):
            return None
        bias = float(error.sum() / form.sum())
        left = error - bias * form
        left = left - _lag(left, step) * step
        missed = (BIAS + bias**2) / 2.0 + float(left @ left) / squares / DISTINCT
        seen = self._squares * (DISTINCT * len(form) / (missed * squares))
        conditioned = np.linalg.solve(np.eye(len(figures)) + seen, figures)
        variance = float(figures @ conditioned)
        variance += missed * float(deviation[FORM]) ** 2 + float(deviation[TEMPERATURE]) ** 2
        return Z90 * math.sqrt(variance)

    def state(self) -> tuple[Windows, Squares]:
        """Return the windows and the squares of the figures, as they are kept."""
        rows: list[list[float]] = [] if self._squares is None else self._squares.tolist()
        return tuple(self._windows), tuple(tuple(row) for row in rows)

    def restore(self, windows: Windows, squares: Squares) -> None:
        """Go on from an earlier state; what was read since is kept."""
        if self._squares is None and squares:
            self._squares = np.array(squares)
        self._windows = deque([*windows, *self._windows], maxlen=MAX_WINDOWS)


def _lag(error: Float, step: Float) -> float:
    """Time constant by which steps of the power explain errors of windows. [s]"""
    steps = float(step @ step)
    return min(max(float(error @ step) / steps, 0.0), MAX_LAG) if steps > 0 else 0.0
