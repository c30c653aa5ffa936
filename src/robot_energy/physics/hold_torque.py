"""What a motor holds at rest, where friction may carry a part of the load or add to it.

``tau = tau_r - carried sgn(tau_r) min(fc, |tau_r|) + kept fc d`` with the rigid motor torque tau_r,
the Coulomb torque fc and the direction d of the last motion: ours, next to paper A, eq. 3. A joint
that was stopped by its controller keeps some of the torque that moved it, as friction is a spring
before it slides (P. Dahl, A solid friction model, 1968); where it creeps back, friction carries
part of the load.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_energy.model import RobotModel
from robot_energy.physics.drive import Drive
from robot_energy.physics.drivetrain import motor_standstill
from robot_energy.timeline.blocks import EffortMeaning, Float

UNKNOWN = 0.58
"""Standard deviation of the torque at rest over the Coulomb torque where no recording showed it:
anywhere between plus and minus the Coulomb torque, ``1 / sqrt(3)``. [-]"""

MOVING = 5.0
"""Speed over that of standstill from which on the direction of a motion is sure. [-]"""


class HoldTorque:
    """Torque of the motors of one robot at rest.

    Args:
        effort: What the measured torque was made of; NONE if that is not known.

    Attributes:
        measurable: Motors whose measured torque is used: not a current times a torque constant
            that is assumed, shape (n,).
        coulomb: fc, motor side, shape (n,). [N m]
        kept: Share of it that stays in the direction of the last motion. [-]
        carried: Share of it by which friction carries the load. [-]
        std: Standard deviation of the torque, shape (n,). [N m]
        direction: Of the last motion of each motor, -1, 0 or 1; 0 before the first, shape (n,).
    """

    def __init__(self, model: RobotModel, effort: EffortMeaning = EffortMeaning.NONE) -> None:
        self.coulomb = np.asarray([joint.friction.coulomb.value for joint in model.joints])
        entry = model.hold
        self.kept = 0.0 if entry is None else entry.kept.value
        self.carried = 0.0 if entry is None else entry.carried.value
        self.std = (UNKNOWN if entry is None else entry.std) * self.coulomb
        constants = [joint.torque_constant for joint in model.joints]
        by_constant = effort in (EffortMeaning.NONE, EffortMeaning.MOTOR_CURRENT)
        self.measurable = np.asarray(
            [not by_constant or one is None or one.tag != "assumed" for one in constants]
        )
        self._moving = MOVING * motor_standstill(model)
        self.direction: Float = np.zeros(len(model.joints))

    def follow(self, motor_velocity: Float) -> Float:
        """Return the direction of the last motion, shape (N, n); of use where something is kept.

        Args:
            motor_velocity: Shape (N, n). [rad/s]
        """
        found = last_direction(motor_velocity, self._moving, self.direction)
        self.direction = found[-1]
        return found

    def torque(self, motor_torque_rigid: Float, direction: Float) -> Float:
        """Return the torque at rest, shape (N, n). [N m]

        Args:
            motor_torque_rigid: Shape (N, n). [N m]
            direction: Of the last motion, -1, 0 or 1, same shape. [-]
        """
        return self._loaded(motor_torque_rigid) + self.kept * self.coulomb * direction

    def typical(self, motor_torque_rigid: Float) -> Float:
        """Return the torque of which the square is the mean over both directions of arrival.

        Copper losses follow the square; shape (N, n). [N m]

        Args:
            motor_torque_rigid: Shape (N, n). [N m]
        """
        return np.hypot(self._loaded(motor_torque_rigid), self.kept * self.coulomb)

    def in_winding(
        self, motor_torque: Float, motor_torque_measured: Float, standing: NDArray[np.bool_]
    ) -> tuple[Float, Float]:
        """Return the torque that heats the windings, and the deviation of that at rest. [N m]

        At rest it is the measured torque, where one is known.

        Args:
            motor_torque: By the model, shape (N, n). [N m]
            motor_torque_measured: NaN where unknown, same shape. [N m]
            standing: Where a motor stands, same shape.
        """
        measured = standing & self.measurable & np.isfinite(motor_torque_measured)
        torque = np.where(measured, motor_torque_measured, motor_torque)
        return torque, np.where(standing & ~measured, self.std, 0.0)

    def loss_std(
        self, drive: Drive, motor_torque: Float, torque_std: Float, motor_temperature_degc: Float
    ) -> Float:
        """Return the deviation of the losses at rest that an unknown torque makes, (N, n). [W]

        Args:
            motor_torque: That heats the windings, shape (N, n). [N m]
            torque_std: Its deviation, 0 for motors that turn, same shape. [N m]
            motor_temperature_degc: Of the windings, same shape. [degC]
        """
        none, most = np.zeros_like(motor_torque), np.abs(motor_torque) + torque_std
        low, _ = drive.input_power(none, none, motor_torque, motor_temperature_degc)
        high, _ = drive.input_power(none, none, most, motor_temperature_degc)
        return high - low

    def _loaded(self, rigid: Float) -> Float:
        return rigid - self.carried * np.sign(rigid) * np.minimum(self.coulomb, np.abs(rigid))


def last_direction(motor_velocity: Float, least: Float, before: Float) -> Float:
    """Return the direction of the last motion at each sample, -1, 0 or 1, shape (N, n).

    Args:
        motor_velocity: Shape (N, n). [rad/s]
        least: Speed from which on it is a motion, shape (n,). [rad/s]
        before: Direction before the first sample, shape (n,). [-]
    """
    row = np.arange(len(motor_velocity))[:, None]
    last = np.maximum.accumulate(np.where(np.abs(motor_velocity) > least, row, -1), axis=0)
    sign = np.take_along_axis(np.sign(motor_velocity), np.maximum(last, 0), axis=0)
    return np.where(last < 0, before, sign)
