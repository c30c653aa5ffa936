"""Friction of gears, motor side: bristles, a lubricant film and teeth under load.

The bristles of LuGre carry boundary friction: ``dz/dt = w - s0 |w| z / g`` with their deflection
z and the greatest force ``g(w, load, T)``, and give ``s0 z + s1 dz/dt``. The film gives
``film |w / rated|^p sgn(w)`` times its viscosity to a power. The oil thins by Vogel's law,
``viscosity = exp(B / (T + C) - B / (40 + C))``, relative to 40 degC. A film that carries more at
higher viscosity takes over from the boundary at a lower speed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_energy.timeline.blocks import Float

REFERENCE_DEGC = 40.0
LEAST_SHARE = 0.3  # of boundary friction, however hot the oil is


@dataclass(frozen=True)
class GearFriction:
    """Figures of all gears, motor side, shape (n,) each."""

    boundary: Float  # sliding friction without load at 40 degC [N m]
    boundary_fall: Float  # share of it lost per kelvin [1/K]
    breakaway: Float  # added at standstill, share of the boundary friction [-]
    film_speed: Float  # speed at which the film takes over at 40 degC [rad/s]
    film_shape: Float  # exponent of that transition [-]
    teeth: Float  # friction at rated load [N m]
    teeth_exponent: Float  # of the load [-]
    film: Float  # friction of the film at rated speed and 40 degC [N m]
    film_exponent: Float  # of the speed [-]
    viscosity_exponent: Float  # of the viscosity [-]
    vogel_b: Float  # B [K]
    vogel_c: Float  # C [K]
    bristle: Float  # motor angle at which the bristles slide [rad]
    rated_torque: Float  # [N m]
    rated_speed: Float  # [rad/s]

    def viscosity(self, oil_degc: Float) -> Float:
        """Return the viscosity relative to 40 degC, same shape. [-]

        Args:
            oil_degc: Shape (..., n). [degC]
        """
        cold = self.vogel_b / (oil_degc + self.vogel_c)
        return np.exp(cold - self.vogel_b / (REFERENCE_DEGC + self.vogel_c))


class SlidingGears:
    """The gears of K robots of one kind at work.

    Args:
        step: Between two calls. [s]
        oil_degc: At the start, shape (K, n). [degC]
        damping: Of the bristles, shape (n,). [N m s/rad]
    """

    def __init__(self, figures: GearFriction, step: float, oil_degc: Float, damping: Float) -> None:
        self._figures = figures
        self._step = step
        self._stiffness = figures.boundary / figures.bristle
        self._damping = damping / step
        self.deflection: Float = np.zeros_like(oil_degc)
        self.set_oil(oil_degc)

    def set_oil(self, oil_degc: Float) -> None:
        """Change the temperature of the oil, which holds until the next change.

        Args:
            oil_degc: Shape (K, n). [degC]
        """
        figures = self._figures
        viscosity = figures.viscosity(oil_degc)
        warmer = 1.0 - figures.boundary_fall * (oil_degc - REFERENCE_DEGC)
        self._boundary = figures.boundary * np.maximum(warmer, LEAST_SHARE)
        self._breakaway = self._boundary * figures.breakaway
        self._slowness = np.sqrt(viscosity) / figures.film_speed
        self._film = figures.film * viscosity**figures.viscosity_exponent

    def torque(self, motor_velocity: Float, gear_torque: Float) -> Float:
        """Return the friction of the next step, which has the sign of the velocity, shape (K, n).

        Args:
            motor_velocity: Shape (K, n). [rad/s]
            gear_torque: Carried by the teeth, motor side, shape (K, n). [N m]
        """
        figures = self._figures
        speed = np.abs(motor_velocity)
        load = np.abs(gear_torque) / figures.rated_torque
        greatest = (
            self._boundary
            + self._breakaway * np.exp(-((speed * self._slowness) ** figures.film_shape))
            + figures.teeth * load**figures.teeth_exponent
        )
        before = self.deflection
        slid = self._stiffness * speed * self._step / greatest
        full = np.sign(motor_velocity) * greatest / self._stiffness
        # Exact for a speed that is constant over the step; a bristle at rest keeps its place.
        self.deflection = full + (before - full) * np.exp(-slid)
        moving = np.copysign((speed / figures.rated_speed) ** figures.film_exponent, motor_velocity)
        return (
            0.5 * self._stiffness * (before + self.deflection)
            + self._damping * (self.deflection - before)
            + self._film * moving
        )

    @property
    def stored(self) -> Float:
        """Energy in the bristles, shape (K, n). [J]"""
        return 0.5 * self._stiffness * self.deflection**2
