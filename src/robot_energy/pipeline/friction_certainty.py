"""How certain the viscous friction is, at a measured and at an assumed temperature."""

from __future__ import annotations

import numpy as np

from robot_energy.blocks import Float
from robot_energy.model import RobotModel
from robot_energy.physics.friction import FrictionModel
from robot_energy.uncertainty.priors import relative_std, tag_of

GROWTH = 0.03
"""Growth of the deviation beyond the fitted range, as a share of the coefficient. [1/K]

Viscous friction of cold gears changes by 2 to 5 % per kelvin, and the value at the edge is held."""


class FrictionCertainty:
    """Standard deviations of viscous coefficients.

    A law that states no deviation has that of the prior for its tag. Beyond its fitted range
    the deviation at the edge grows with the distance, unless the law itself has one there.

    Args:
        model: The robot's model.

    Attributes:
        fallback_std: Where the fallback temperature is assumed, motor side, shape (n,).
            [N m s/rad]
    """

    def __init__(self, model: RobotModel) -> None:
        self._friction = FrictionModel.from_model(model)
        self._prior = np.asarray(
            [relative_std("viscous", tag_of(joint.friction.viscous)) for joint in model.joints]
        )
        fallback = np.full(len(model.joints), model.temperature.fallback_degc)
        own = self._friction.viscous_std(fallback)
        spread = self._friction.viscous_std_unknown(model.temperature.fallback_degc)
        prior = np.where(np.isnan(own), self._prior * self._friction.viscous(fallback), 0.0)
        self.fallback_std = np.hypot(np.where(np.isnan(spread), 0.0, spread), prior)

    def std(self, motor_temperature_degc: Float) -> Float:
        """Return the deviation of the viscous coefficients.

        Args:
            motor_temperature_degc: NaN where the fallback is used, shape (N, n). [degC]

        Returns:
            Motor side, finite, shape (N, n). [N m s/rad]
        """
        degc, friction = motor_temperature_degc, self._friction
        std = friction.viscous_std(degc)
        lacking = np.isnan(std)
        if lacking.any():
            edges = [(law.lower_degc, law.upper_degc) for law in friction.laws]
            inside = np.clip(degc, *np.transpose(edges))
            value, own = friction.viscous(inside), friction.viscous_std(inside)
            own = np.where(np.isnan(own), self._prior * value, own)
            beyond = np.hypot(own, GROWTH * np.abs(degc - inside) * value)
            std = np.where(lacking, beyond, std)
        return np.where(np.isnan(degc), self.fallback_std, std)
