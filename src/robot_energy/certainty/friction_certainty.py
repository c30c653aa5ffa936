"""How certain the viscous friction is, at a measured and at an assumed temperature."""

from __future__ import annotations

import numpy as np

from robot_energy.certainty.priors import relative_std
from robot_energy.model import RobotModel
from robot_energy.model.figure import tag_of
from robot_energy.physics.friction import FrictionModel
from robot_energy.timeline.blocks import Float

COLDER, WARMER = 0.05, 0.02
"""Growth of the deviation below and above the fitted range, as a share of the coefficient. [1/K]

Viscous friction of cold gears rises by 2 to 5 % per kelvin, of warm ones it falls by 1 to 3 %,
and the value at the edge is held."""
LAW_FORM = 0.004
"""What the form of a law leaves out beyond its fitted range, as a share of the coefficient. [1/K]

Gears lag behind their motors and Coulomb friction falls with temperature; the covariance of a law
holds none of that."""


class FrictionCertainty:
    """Standard deviations of viscous coefficients.

    A law that states no deviation has that of the prior for its tag. Beyond its fitted range
    the deviation at the edge grows with the distance, unless the law itself has one there, and what
    the form of the law leaves out is added. The
    error of what an unknown temperature and the distance add is common to all joints: all are warm
    or cold together.

    Attributes:
        fallback_std: Where the fallback temperature is assumed, motor side, shape (n,).
            [N m s/rad]
        fallback_shared_std: Part whose error is common to all joints, shape (n,). [N m s/rad]
    """

    def __init__(self, model: RobotModel) -> None:
        self._friction = FrictionModel.from_model(model)
        self._edges = np.transpose(
            [(law.lower_degc, law.upper_degc) for law in self._friction.laws]
        )
        self._prior = np.asarray(
            [relative_std("viscous", tag_of(joint.friction.viscous)) for joint in model.joints]
        )
        degc = model.temperature.fallback_degc
        total, shared = (part[0] for part in self._known(np.full((1, len(model.joints)), degc)))
        self.fallback_shared_std = np.maximum(shared, self._friction.viscous_spread(degc))
        own_squared = total**2 - shared**2
        self.fallback_std = np.sqrt(own_squared + self.fallback_shared_std**2)

    def std(self, motor_temperature_degc: Float) -> tuple[Float, Float]:
        """Return the deviation of the viscous coefficients.

        Args:
            motor_temperature_degc: NaN where the fallback is used, shape (N, n). [degC]

        Returns:
            All of it, and the part whose error is common to all joints; motor side, finite,
            shape (N, n). [N m s/rad]
        """
        assumed = np.isnan(motor_temperature_degc)
        total, shared = self._known(motor_temperature_degc)
        return (
            np.where(assumed, self.fallback_std, total),
            np.where(assumed, self.fallback_shared_std, shared),
        )

    def _known(self, degc: Float) -> tuple[Float, Float]:
        """Deviations at measured temperatures."""
        friction, inside = self._friction, np.clip(degc, *self._edges)
        own, edge = friction.viscous_std(inside), None
        if np.isnan(own).any():
            edge = friction.viscous(inside)
            own = np.where(np.isnan(own), self._prior * edge, own)
        if not ((inside < degc) | (inside > degc)).any():  # all within their ranges
            return own, np.zeros_like(own)
        total = friction.viscous_std(degc)
        if np.isnan(total).any():
            edge = friction.viscous(inside) if edge is None else edge
            colder, warmer = np.maximum(inside - degc, 0.0), np.maximum(degc - inside, 0.0)
            grown = np.hypot(own, (COLDER * colder + WARMER * warmer) * edge)
            total = np.where(np.isnan(total), grown, total)
        form = LAW_FORM * np.abs(degc - inside) * friction.viscous(degc)
        total = np.hypot(total, form)
        return total, np.sqrt(np.maximum(total**2 - own**2, 0.0))
