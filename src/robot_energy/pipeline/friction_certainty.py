"""How certain the viscous friction is, at a measured and at an assumed temperature."""

from __future__ import annotations

import numpy as np

from robot_energy.blocks import Float, FrictionBlock
from robot_energy.model import RobotModel
from robot_energy.physics.friction import FrictionModel


class FrictionCertainty:
    """Standard deviations of viscous coefficients.

    Args:
        model: The robot's model.

    Attributes:
        fallback_std: Where the fallback temperature is assumed, motor side, shape (n,); NaN
            where nothing is known of it. [N m s/rad]
    """

    def __init__(self, model: RobotModel) -> None:
        self._friction = FrictionModel.from_model(model)
        self.fallback_std = self._friction.viscous_std_unknown(model.temperature.fallback_degc)

    def std(self, block: FrictionBlock) -> Float:
        """Return the deviation of ``viscous`` in every row.

        Args:
            block: N rows.

        Returns:
            Motor side, shape (N, n); NaN where none is known. [N m s/rad]
        """
        degc = block.motor_temperature_degc
        return np.where(np.isnan(degc), self.fallback_std, self._friction.viscous_std(degc))
