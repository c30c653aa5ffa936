"""Delay of one channel behind another: the lag of least held-out error, and whether to believe it.

Every lag in a range is tried on blocks that the fit has not seen, so that a delay cannot be
taken up by parameters that nothing else needs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.timeline.blocks import Float
from robot_energy_identify.stats.cross_validation import jackknife_std
from robot_energy_identify.stats.regression import qr_r

SIGNIFICANT = 3.0  # standard deviations


class Delay(Described):
    """The estimate and what it rests on."""

    value: Annotated[float, "By which the channel lags, at the least held-out error. [s]"]
    std: Annotated[float, "From leaving out each block in turn. [s]"]
    gain: Annotated[float, "Share of the held-out error it takes away. [-]"]
    applied: Annotated[float, "The value where it is sure and inside of the range; else 0. [s]"]
    at_edge: Annotated[bool, "Whether the least error is at the end of the range."]
    span: Annotated[float, "Delays up to this were tried. [s]"]


MeterDelay = Annotated[
    Delay | None, "Lag of the meter behind the joint states; None where it cannot be determined."
]
MeterTimeConstant = Annotated[
    Delay | None, "Time constant of a low pass in the meter; None where it cannot be determined."
]


def applied(delay: Delay | None) -> float:
    """Return what is to be undone of a delay; 0 where it is not sure or not determined. [s]"""
    return 0.0 if delay is None else delay.applied


NO_DELAY = Delay(0.0, 0.0, 0.0, 0.0, False, 0.0)


def held_out_errors(triangles: Sequence[Float], width: int, known: Float | None = None) -> Float:
    """Return squared errors (blocks, targets) of every target on each block, fitted to the others.

    Args:
        triangles: Of each block, with the sums of squares of ``[columns, targets]``, shape
            (., width + targets).
        known: Rows like those of a triangle that belong to every fit, such as a prior; shape
            (., width + targets), None for none. [any unit]
    """
    error: list[Float] = []
    for number, held in enumerate(triangles):
        train = [part for other, part in enumerate(triangles) if other != number]
        triangle = qr_r(np.concatenate(train if known is None else [*train, known]))
        values = np.linalg.lstsq(triangle[:width, :width], triangle[:width, width:], rcond=None)[0]
        error.append(((held[:, :width] @ values - held[:, width:]) ** 2).sum(axis=0))
    return np.array(error)


def best_delay(
    delays: Float, error: Float, undelayed: Float, span: float, least_gain: float
) -> Delay:
    """Return the delay of least error and whether to believe it.

    Args:
        delays: Rising, shape (K,). [s]
        error: Squared held-out error by block and delay, shape (blocks, K).
            [squared unit of the target]
        undelayed: Squared held-out error without a delay, shape (blocks,).
            [squared unit of the target]
        span: Delays up to this were tried. [s]
        least_gain: Share of the held-out error that a delay must take away. [-]
    """
    total = error.sum(axis=0)
    value, least = minimum(delays, total)
    std = float(jackknife_std(np.array([minimum(delays, total - part)[0] for part in error])))
    without = float(undelayed.sum())
    gain = 1.0 - float(np.sqrt(max(least, 0.0) / without)) if without > 0.0 else 0.0
    at_edge = value in (delays[0], delays[-1])
    believed = gain >= least_gain and abs(value) > SIGNIFICANT * std and not at_edge
    return Delay(value, std, gain, value if believed else 0.0, at_edge, span)


def minimum(place: Float, error: Float) -> tuple[float, float]:
    """Return where an error is least and the error there.

    That is the lowest point of the parabola through the least error and its neighbours; the
    least error itself at an end of the range.

    Args:
        place: Rising, shape (K,). [any unit]
        error: At each place, shape (K,). [any unit]
    """
    best = int(np.argmin(error))
    x, y = float(place[best]), float(error[best])
    if not 0 < best < len(error) - 1:
        return x, y
    before, after = float(place[best - 1]) - x, float(place[best + 1]) - x
    rise, fall = float(error[best - 1]) - y, float(error[best + 1]) - y
    bend = rise * after - fall * before
    if bend <= 0.0:
        return x, y
    slope = rise * after * after - fall * before * before
    move = 0.5 * slope / bend
    return x + move, y + 0.5 * move * slope / (before * after * (after - before))
