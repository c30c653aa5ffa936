"""Electrical input of the drives from shaft power, motor side.

Four models: `Ideal` (paper A: the drive loses nothing), `EfficiencyMaps` (paper B,
section 6: measured efficiencies, looked up at the nearest torque and speed), `LossModel`
(shaft power plus losses: single-valued and safe near zero speed, where an efficiency is
not) and `LossMaps` (the same with losses of any form that rise with speed and torque).
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.errors import KindError, ModelFileError
from robot_energy.model.drive_models import (
    DRIVE_MODELS,
    DriveModel,
    EfficiencyMap,
    LossDrive,
    LossMap,
)
from robot_energy.model.schema import RobotModel
from robot_energy.physics.equations import REFERENCE_DEGC, loss_model_power
from robot_energy.physics.torque_constant import TorqueConstants
from robot_energy.timeline.blocks import Float, Int

COPPER_KEY = "copper_temperature_coefficient"  # of entries whose losses follow the windings


class Drive(Protocol):
    """Turns shaft power into electrical input, for all axes of a robot."""

    def input_power(
        self,
        shaft_power: Float,
        motor_velocity: Float,
        motor_torque: Float,
        motor_temperature_degc: Float,
    ) -> tuple[Float, NDArray[np.bool_] | None]:
        """Return the electrical input, shape (N, n) [W], and where it is extrapolated, if at all.

        Args:
            shaft_power: Shape (N, n). [W]
            motor_velocity: Shape (N, n). [rad/s]
            motor_torque: Rigid plus friction, shape (N, n). [N m]
            motor_temperature_degc: Of the windings, shape (N, n). [degC]
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
    """P_el = P_mech + c0 + c1 |w| + c2 w^2 + k (1 + alpha (T - 20)) tau^2."""

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


class LossMaps:
    """P_el = P_mech + L(|w|, |tau| sqrt(1 + alpha (T - 20))), L bilinear between knots."""

    def __init__(self, entries: list[LossMap]) -> None:
        self._maps = [
            tuple(np.asarray(part) for part in (one.motor_velocity, one.motor_torque, one.loss))
            for one in entries
        ]
        # Rises of the last cells beyond the knots, no more than where the other axis is higher: or
        # losses would fall along that axis out there.
        self._beyond = [
            tuple(
                np.minimum.accumulate(rises[::-1])[::-1]
                for rises in (loss[-1] - loss[-2], loss[:, -1] - loss[:, -2])
            )
            for _, _, loss in self._maps
        ]
        self._alpha = [entry.copper_temperature_coefficient.value for entry in entries]

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
        power, extrapolated = shaft_power.copy(), np.zeros(shaft_power.shape, dtype=np.bool_)
        for joint, (speeds, loads, loss) in enumerate(self._maps):
            faster, heavier = self._beyond[joint]
            speed = np.abs(motor_velocity[:, joint])
            degc = motor_temperature_degc[:, joint]
            load = equal_heat_torque(motor_torque[:, joint], degc, self._alpha[joint])
            (i, x), (j, y) = knot_cells(speeds, speed), knot_cells(loads, load)
            outside = (x > 1.0) | (y > 1.0)
            low, high = loss[i, j], loss[i + 1, j]
            inside_x, inside_y = np.minimum(x, 1.0), np.minimum(y, 1.0)
            by_speed = high - low + inside_y * (loss[i + 1, j + 1] - high - loss[i, j + 1] + low)
            power[:, joint] += low + inside_x * by_speed + inside_y * (loss[i, j + 1] - low)
            along_speed = faster[j] + inside_y * (faster[j + 1] - faster[j])
            along_load = heavier[i] + inside_x * (heavier[i + 1] - heavier[i])
            power[:, joint] += (x - inside_x) * along_speed + (y - inside_y) * along_load
            extrapolated[:, joint] = outside
        return power, extrapolated


class WarmMagnets:
    """Drives whose windings take more current where warm magnets are weaker.

    Args:
        drive: Whose losses follow the torque.
    """

    def __init__(self, drive: Drive, constants: TorqueConstants) -> None:
        self._drive, self._constants = drive, constants

    def input_power(
        self,
        shaft_power: Float,
        motor_velocity: Float,
        motor_torque: Float,
        motor_temperature_degc: Float,
    ) -> tuple[Float, NDArray[np.bool_] | None]:
        """Return shaft power plus losses at the current that the torque takes.

        Arguments and result as in `Drive.input_power`.
        """
        torque = motor_torque / self._constants.left(motor_temperature_degc)
        return self._drive.input_power(shaft_power, motor_velocity, torque, motor_temperature_degc)


def equal_heat_torque(torque: Float, degc: Float, alpha: float) -> Float:
    """Return the torque that heats windings at 20 degC as a torque at T does, >= 0. [N m]

    ``|tau| sqrt(1 + alpha (T - 20))``: the copper loss is ``k (1 + alpha (T - 20)) tau^2``.

    Args:
        torque: Any shape. [N m]
        degc: T, same shape. [degC]
        alpha: Of the resistance. [1/K]
    """
    rise = 1.0 + alpha * (degc - REFERENCE_DEGC)
    return np.abs(torque) * np.sqrt(np.maximum(rise, 0.0))


def knot_cells(knots: Float, values: Float) -> tuple[Int, Float]:
    """Return the cell of each value and its place in it: 0 to 1, above 1 beyond the last knot.

    Args:
        knots: From 0, rising, shape (K,). [any unit]
        values: Not negative; NaN gives the last cell and NaN, shape (N,). [any unit]
    """
    cell = np.clip(np.searchsorted(knots, values, side="right") - 1, 0, len(knots) - 2)
    return cell, (values - knots[cell]) / np.diff(knots)[cell]


def ideal(entries: list[object]) -> Ideal:
    """Return the drives of joints that lose nothing.

    Args:
        entries: None: there is no entry.
    """
    return Ideal()


def drive_from_model(model: RobotModel) -> Drive:
    """Return the drives that a model file names, joints in model order."""
    kind = DRIVE_MODELS[model.drive]
    entries = kind.entries(model.joints)
    if kind.entry is not None and len(entries) < len(model.joints):
        raise ModelFileError(
            f"{len(entries)} of {len(model.joints)} joints have the key '{kind.key}'",
            f"it at every joint, as the drive model '{model.drive}' needs it",
        )
    if kind.physics is None:
        raise KindError(f"the drive model '{kind.name}' has no physics", "a `Drive`")
    return with_warm_magnets(kind, kind.physics(entries), TorqueConstants.of(model.joints))


def with_warm_magnets(kind: DriveModel, drive: Drive, constants: TorqueConstants | None) -> Drive:
    """Return drives whose losses follow warm magnets where they follow the temperature at all.

    Args:
        constants: Of their motors; None where no torque constant falls.
    """
    warms = kind.entry is not None and COPPER_KEY in kind.entry.model_fields
    return drive if constants is None or not warms else WarmMagnets(drive, constants)
