"""Errors that stay the same in all recordings, and what they do to a linear fit.

No scatter shows a wrong gain of the meter. So such errors are stated: a limit +- l of a data
sheet is a standard deviation of ``l / sqrt(3)``, every value within it as likely as another
(JCGM 100:2008, 4.3.7). A fit ``A v = X' W^2 y`` moves by ``A^-1 X' W^2 dy`` if its target does by
dy, so one refit gives the deviation that one error leaves in every figure.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import exp, isfinite, pi, sqrt
from typing import Annotated

import numpy as np

from robot_energy.certainty.deviation import Z95
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import ModelFileError
from robot_energy.timeline.blocks import Float
from robot_energy_identify.stats.regression import CHUNK, CONFIDENCE, Fit

ROOT3 = sqrt(3.0)
SMALL = 1e-3  # of the greatest part: less does not count
METER, TORQUE, THERMOMETER, BODIES, DRIVE_POWER = (
    "meter", "torque", "thermometer", "bodies", "drive power"
)  # fmt: skip
Changes = Mapping[str, Sequence[Float]]
"""Change of a target by one standard deviation of each of several independent errors, by cause."""


class SensorLimits(Described):
    """Limits of constant errors of the sensors, and of bodies that are given, +-."""

    meter: Annotated[float, "Of the gain of the power meter: class 1 of IEC 62053-21. [-]"] = 0.01
    torque: Annotated[float, "Of each torque constant or torque sensor, by data sheets. [-]"] = 0.05
    thermometer: Annotated[float, "Of a motor temperature, as in windings. [K]"] = 2.0
    bodies: Annotated[float, "Of the torque by which given bodies load a joint. [-]"] = 0.05
    drive_power: Annotated[float, "Of the gain of each drive's own power reading. [-]"] = 0.02

    def __post_init__(self) -> None:
        for name, value in self.__dict__.items():
            if not (isfinite(value) and value >= 0.0):
                raise ModelFileError(f"the limit of {name} is {value}", "a finite figure >= 0")

    @property
    def std(self) -> SensorLimits:
        """The same errors as standard deviations."""
        return SensorLimits(**{name: value / ROOT3 for name, value in self.__dict__.items()})


DEFAULT_LIMITS = SensorLimits()


def with_systematic(fit: Fit, columns: Float, changes: Changes) -> Fit:
    """Return a fit whose covariance holds constant errors as well.

    Args:
        columns: Of the fit, shape (N, P) or (N, n, P). [target/parameter]
        changes: Of its target, each of the shape of the target, by cause.
    """
    size = columns.shape[-1]
    every = [change for own in changes.values() for change in own]
    if not every:
        return fit
    normal, right = np.zeros((size, size)), np.zeros((size, len(every)))
    for first in range(0, len(columns), CHUNK):  # so that no copy of all of them is made
        part = slice(first, first + CHUNK)
        flat = columns[part].reshape(-1, size)
        weighted = (flat * fit.weight[part].reshape(-1, 1) ** 2).T
        normal += weighted @ flat
        right += weighted @ np.stack([change[part].ravel() for change in every], axis=1)
    moves = iter(np.linalg.lstsq(normal, right, rcond=None)[0].T)
    for cause, own in changes.items():
        fit = moved_by(fit, cause, np.stack([next(moves) for _ in own], axis=1))
    return fit


def total(parts: Mapping[str, float]) -> float:
    """Return the deviation that independent parts make together.

    The gain of a meter is uniform within its class, and where it is the greatest part, 1.96 of
    its deviations would hold the truth always. So the 95 % interval is that of the sum of a normal
    and a uniform error, and the deviation is the one whose 1.96 make this interval.

    Args:
        parts: Deviations by cause. [any unit]
    """
    from scipy.optimize import brentq
    from scipy.special import ndtr

    reach = ROOT3 * parts.get(METER, 0.0)
    rest = float(np.linalg.norm([part for cause, part in parts.items() if cause != METER]))
    if not (np.isfinite(rest) and rest > SMALL * reach > 0.0):
        return rest if rest > SMALL * reach else CONFIDENCE * reach / Z95

    def beyond(half: float) -> float:
        """Share above ``half``, less what is wanted: the mean of the normal distribution."""
        low, high = (half - reach) / rest, (half + reach) / rest
        below = [u * float(ndtr(u)) + exp(-0.5 * u * u) / sqrt(2.0 * pi) for u in (low, high)]
        return (below[1] - below[0]) * rest / (2.0 * reach) - (0.5 + 0.5 * CONFIDENCE)

    return float(brentq(beyond, 0.0, reach + 10.0 * rest)) / Z95


def moved_by(fit: Fit, cause: str, moves: Float) -> Fit:
    """Return a fit with more constant errors whose effects on the figures are known.

    Args:
        moves: Of the figures by one standard deviation of each, shape (P,) or (P, errors).
            [of the figures]
    """
    moves = moves.reshape(len(moves), -1)
    part = np.hypot(fit.parts.get(cause, 0.0), np.linalg.norm(moves, axis=1))
    own = np.hstack([fit.moves[cause], moves]) if cause in fit.moves else moves
    return replace(
        fit,
        covariance=fit.covariance + moves @ moves.T,
        parts={**fit.parts, cause: part},
        moves={**fit.moves, cause: own},
    )
