"""Finite Fourier series per joint, at rest at both ends (paper B, section 4.3.2).

``q(t) = c + sum over l of a_l sin(l w t) / (l w) - b_l cos(l w t) / (l w)``, so the velocity
is ``sum a_l cos + b_l sin``. One period begins and ends at rest where ``sum a_l = 0``
(velocity) and ``sum l b_l = 0`` (acceleration); the space of such coefficients is spanned
by columns once, and every choice of weights of these columns is at rest at both ends.
"""

from __future__ import annotations

import numpy as np

from robot_energy.foundation.errors import MotionError
from robot_energy.timeline.blocks import Float
from robot_energy_plan.motion.ptp import Trajectory

MIN_HARMONICS = 2  # one alone cannot begin at rest
MAX_HARMONICS = 50


class FourierBasis:
    """Motions of one period that begin and end at rest.

    Args:
        harmonics: L, 2 to 50.
        period: Length of the motion; the base frequency is one over it. [s]

    Attributes:
        size: Number of weights per joint, 2 L - 1: the middle, and the rest.
    """

    def __init__(self, harmonics: int, period: float) -> None:
        if not MIN_HARMONICS <= harmonics <= MAX_HARMONICS:
            raise MotionError(
                f"{harmonics} harmonics were asked for", f"{MIN_HARMONICS} to {MAX_HARMONICS}"
            )
        if not 0 < period < np.inf:
            raise MotionError(f"the period is {period} s", "a finite time > 0 s")
        self.harmonics = harmonics
        self.period = period
        order = np.arange(1, harmonics + 1, dtype=np.float64)
        self._omega = 2.0 * np.pi * order / period
        self._cosine = _orthogonal_to(np.ones(harmonics))  # of the velocity: a
        self._sine = _orthogonal_to(order)  # b
        self.size = 2 * harmonics - 1

    def sample(self, time: Float) -> tuple[Float, Float, Float]:
        """Return position, velocity and acceleration per unit of each weight.

        Args:
            time: Since the start, shape (N,). [s]

        Returns:
            Shape (N, 2 L - 1) each: the middle [-], then the weights, which are speeds.
        """
        angle = np.multiply.outer(time, self._omega)
        sine, cosine = np.sin(angle), np.cos(angle)
        still = np.zeros((len(time), 1))
        position = (sine / self._omega) @ self._cosine, -(cosine / self._omega) @ self._sine
        velocity = cosine @ self._cosine, sine @ self._sine
        acceleration = -(sine * self._omega) @ self._cosine, (cosine * self._omega) @ self._sine
        return (
            np.hstack([still + 1.0, *position]),
            np.hstack([still, *velocity]),
            np.hstack([still, *acceleration]),
        )


class FourierMotion:
    """One Fourier series per joint, repeated without end.

    Args:
        weights: Weights of the basis, shape (2 L - 1, n): the middle of each joint [rad] or [m],
            then speeds [rad/s] or [m/s].

    Attributes:
        period: Length of one loop. [s]
    """

    def __init__(self, basis: FourierBasis, weights: Float) -> None:
        self.basis = basis
        self.weights = weights.copy()
        self.n_joints, self.period = weights.shape[1], basis.period

    def sample(self, time: Float) -> Trajectory:
        """Return the motion, joint side; before its start it rests.

        Args:
            time: Since the start of the first loop, shape (N,). [s]
        """
        time = np.atleast_1d(np.asarray(time, dtype=np.float64))
        phase = np.where(time > 0, np.remainder(time, self.period), 0.0)
        position, velocity, acceleration = self.basis.sample(phase)
        return Trajectory(
            position @ self.weights, velocity @ self.weights, acceleration @ self.weights
        )


def _orthogonal_to(direction: Float) -> Float:
    """Orthonormal columns that span everything orthogonal to a direction, shape (L, L - 1)."""
    complete, _ = np.linalg.qr(np.column_stack([direction, np.eye(len(direction))[:, 1:]]))
    return np.asarray(complete[:, 1:], dtype=np.float64)
