"""Electrical input of the drives from shaft power, motor side.

Three models: `Ideal` (paper A: the drive loses nothing), `EfficiencyMaps` (paper B,
section 6: measured efficiencies, looked up at the nearest torque and speed) and
`LossModel` (shaft power plus losses: single-valued and safe near zero speed, where an
efficiency is not).
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.errors import KindError, ModelFileError
from robot_energy.model.drive_models import DRIVE_MODELS, EfficiencyMap, LossDrive
from robot_energy.model.schema import RobotModel
from robot_energy.physics.equations import loss_model_power
from robot_energy.timeline.blocks import Float


class Drive(Protocol):
    """Turns shaft power into electrical input, for all axes of a robot."""

    def input_power(
        self,
        shaft_power: Float,
        motor_velocity: Float,
        motor_torque: Float,
        motor_temperature_degc: Float,
    ) -> tuple[Float, NDArray[np.bool_] | None]:
        """Return the electrical input.

        Args:
            shaft_power: Shape (N, n). [W]
            motor_velocity: Shape (N, n). [rad/s]
            motor_torque: Rigid plus friction, shape (N, n). [N m]
            motor_temperature_degc: Of the windings, shape (N, n). [degC]

        Returns:
            Input power, shape (N, n), and where it is extrapolated (None: nowhere). [W]
        """
        ...


class Ideal:
    """P_el = P_mech (paper A, eq. 6)."""

    def input_power(
        self,
        shaft_power: Float,
        motor_velocity: Float,
        motor_torque: Float,
        motor_temperature_degc: Float,
    ) -> tuple[Float, NDArray[np.bool_] | None]:
        """Return the shaft power itself; arguments and result as in `Drive.input_power`."""
        return shaft_power, None


class LossModel:
    """P_el = P_mech + c0 + c1 |w| + c2 w^2 + k (1 + alpha (T - 20)) tau^2.

    Args:
        entries: One per joint, in model order.
    """

    def __init__(self, entries: list[LossDrive]) -> None:
        self._constant = np.asarray([entry.constant.value for entry in entries])
        self._linear = np.asarray([entry.linear.value for entry in entries])
        self._quadratic = np.asarray([entry.quadratic.value for entry in entries])
        self._copper = np.asarray([entry.copper.value for entry in entries])
        self._alpha = np.asarray([entry.copper_temperature_coefficient.value for entry in entries])

    def input_power(
        self,
        shaft_power: Float,
        motor_velocity: Float,
        motor_torque: Float,
        motor_temperature_degc: Float,
    ) -> tuple[Float, NDArray[np.bool_] | None]:
        """Return shaft power plus losses, which are never negative.

        Arguments and result as in `Drive.input_power`.
        """
        power = loss_model_power(
            shaft_power,
            motor_velocity,
            motor_torque,
            motor_temperature_degc,
            constant=self._constant,
            linear=self._linear,
            quadratic=self._quadratic,
            copper=self._copper,
            copper_temperature_coefficient=self._alpha,
        )
        return power, None


class EfficiencyMaps:
    """P_el = P_mech / eta, eta of the nearest measured (torque, speed) (paper B, 6.2.1).

    Distances are standardised Euclidean: each coordinate is divided by its standard
    deviation over the points of the map.

    Args:
        entries: One per joint, in model order.
    """

    def __init__(self, entries: list[EfficiencyMap]) -> None:
        from scipy.spatial import KDTree  # heavy to import, needed for this model only

        self._scales: list[Float] = []
        self._trees: list[KDTree] = []
        self._efficiency: list[Float] = []
        self._reach = [entry.reach for entry in entries]
        for entry in entries:
            points = np.column_stack([entry.motor_torque, entry.motor_velocity])
            scale = points.std(axis=0, ddof=1) if len(points) > 1 else np.ones(2)
            scale = np.where(scale > 0, scale, 1.0)
            self._scales.append(scale)
            self._trees.append(KDTree(points / scale))
            self._efficiency.append(np.asarray(entry.efficiency))

    def input_power(
        self,
        shaft_power: Float,
        motor_velocity: Float,
        motor_torque: Float,
        motor_temperature_degc: Float,
    ) -> tuple[Float, NDArray[np.bool_] | None]:
        """Return shaft power over the efficiency of the nearest point of the map.

        Arguments and result as in `Drive.input_power`.
        """
        power = np.full_like(shaft_power, np.nan)
        extrapolated = np.zeros(shaft_power.shape, dtype=np.bool_)
        for joint, tree in enumerate(self._trees):
            query = np.column_stack([motor_torque[:, joint], motor_velocity[:, joint]])
            finite = np.isfinite(query).all(axis=1)
            distance, nearest = tree.query(query[finite] / self._scales[joint])
            eta = self._efficiency[joint][nearest]
            power[finite, joint] = shaft_power[finite, joint] / eta
            extrapolated[finite, joint] = np.asarray(distance) > self._reach[joint]
        return power, extrapolated


def ideal(entries: list[object]) -> Ideal:
    """Return the drives of joints that lose nothing.

    Args:
        entries: None: there is no entry.
    """
    return Ideal()


def drive_from_model(model: RobotModel) -> Drive:
    """Build the drive model that a model file names.

    Args:
        model: The robot's model.

    Returns:
        The drives of all joints, in model order.

    Raises:
        ModelFileError: If a joint lacks the figures of that model.
        KindError: If the kind has no physics.
    """
    kind = DRIVE_MODELS[model.drive]
    entries = kind.entries(model.joints)
    if kind.entry is not None and len(entries) < len(model.joints):
        raise ModelFileError(
            f"{len(entries)} of {len(model.joints)} joints have the key '{kind.key}'",
            f"it at every joint, as the drive model '{model.drive}' needs it",
        )
    if kind.physics is None:
        raise KindError(f"the drive model '{kind.name}' has no physics", "a `Drive`")
    return kind.physics(entries)
