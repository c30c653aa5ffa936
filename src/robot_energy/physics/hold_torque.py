"""What a motor holds at rest, where friction may carry a part of the load or add to it.

``tau = tau_r - carried sgn(tau_r) min(fs, |tau_r|) + kept fs d`` with the rigid motor torque tau_r,
the static friction ``fs = static (fc + load min(|tau_r|, taus))`` and the direction d of the last
motion: ours, next to paper A, eq. 3. A joint that was stopped by its controller keeps some of the
torque that moved it, as friction is a spring before it slides (P. Dahl, A solid friction model,
1968); where it creeps back, friction carries part of the load.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_energy.model import RobotModel
from robot_energy.physics.drives_and_cabinet import Drive
from robot_energy.physics.drivetrain import motor_standstill
from robot_energy.physics.friction import FrictionModel
from robot_energy.timeline.blocks import NANOSECOND, EffortMeaning, Float, Int

UNKNOWN = 0.58
"""Standard deviation of the torque at rest over the Coulomb torque where no recording showed it:
anywhere between plus and minus the Coulomb torque, ``1 / sqrt(3)``. [-]"""

MOVING = 5.0  # speed over that of standstill from which on the direction of a motion is sure [-]

REVERSED = 0.2
"""Time in which the slowest such motion goes so far that friction follows its direction. [s]"""

PARTS = 2.0**26
"""Parts of that angle, whole numbers of which are summed: exact, however a motion is cut."""

LONGEST_STEP = 0.1  # time between samples for which a motion goes on at most [s]


class HoldTorque:
    """Torque of the motors of one robot at rest.

    Attributes:
        measurable: Motors whose measured torque is used: not a current times a torque constant
            that is assumed, shape (n,).
        kept: Share of static friction that stays in the direction of the last motion. [-]
        carried: Share of it by which friction carries the load. [-]
        last_motion: Of each motor.
    """

    def __init__(self, model: RobotModel, effort: EffortMeaning = EffortMeaning.NONE) -> None:
        entry = model.hold
        self._friction = FrictionModel.from_model(model)
        static = None if entry is None else entry.static
        self._static = 1.0 if static is None else np.asarray(static)
        self.kept = 0.0 if entry is None else entry.kept.value
        self.carried = 0.0 if entry is None else entry.carried.value
        self._std = UNKNOWN if entry is None else entry.std
        constants = [joint.torque_constant for joint in model.joints]
        by_constant = effort in (EffortMeaning.NONE, EffortMeaning.MOTOR_CURRENT)
        self.measurable = np.asarray(
            [not by_constant or one is None or one.tag != "assumed" for one in constants]
        )
        self.last_motion = LastMotion(MOVING * motor_standstill(model))

    def torque(self, motor_torque_rigid: Float, direction: Float) -> Float:
        """Return the torque at rest, shape (N, n). [N m]

        Args:
            motor_torque_rigid: Shape (N, n). [N m]
            direction: Of the last motion, -1, 0 or 1, same shape. [-]
        """
        static = self.static(motor_torque_rigid)
        return self._less_carried(motor_torque_rigid) + self.kept * static * direction

    def typical(self, motor_torque_rigid: Float) -> Float:
        """Return the torque of which the square is the mean over both directions of arrival.

        Copper losses follow the square; shape (N, n). [N m]

        Args:
            motor_torque_rigid: Shape (N, n). [N m]
        """
        static = self.static(motor_torque_rigid)
        return np.hypot(self._less_carried(motor_torque_rigid), self.kept * static)

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
        return torque, np.where(standing & ~measured, self.std(torque), 0.0)

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

    def static(self, motor_torque: Float) -> Float:
        """Return the static friction: the Coulomb torque under the load by its share. [N m]

        Args:
            motor_torque: The load, shape (N, n). [N m]
        """
        return self._static * self._friction.loaded_coulomb(motor_torque)

    def std(self, motor_torque: Float) -> Float:
        """Return the standard deviation of the torque at rest, shape (N, n) or (n,). [N m]

        Args:
            motor_torque: About which, shape (N, n). [N m]
        """
        return self._std * self._friction.loaded_coulomb(motor_torque)

    def _less_carried(self, rigid: Float) -> Float:
        share = self.carried * np.sign(rigid)
        return rigid - share * np.minimum(self.static(rigid), np.abs(rigid))


class LastMotion:
    """Direction of the last motion of each motor, as it goes on in time.

    A motor that stops hard moves back a little, as its gear was wound up. Friction is a spring
    before it slides, so that such a motion turns it hardly: it must go as far as the slowest motion
    that counts does in `REVERSED`.

    Args:
        least: Speed from which on it is a motion, shape (n,). [rad/s]

    Attributes:
        direction: -1, 0 or 1; 0 before the first motion, shape (n,).
    """

    def __init__(self, least: Float) -> None:
        self._least = least
        self.direction: Float = np.zeros(len(least))
        self._sign, self._angle = self.direction, self.direction  # of what goes on, and how far
        self._last_ns: int | None = None

    def follow(self, stamp_ns: Int, motor_velocity: Float) -> Float:
        """Return the direction at each sample, shape (N, n).

        Args:
            stamp_ns: Shape (N,). [ns]
            motor_velocity: Shape (N, n). [rad/s]
        """
        before = int(stamp_ns[0]) if self._last_ns is None else self._last_ns
        step = np.clip(np.diff(stamp_ns, prepend=before) * NANOSECOND, 0.0, LONGEST_STEP)[:, None]
        moving = np.abs(motor_velocity) > self._least
        sign = _held(np.sign(motor_velocity), moving, self._sign)
        turned = sign != np.vstack([self._sign, sign[:-1]])
        share = np.abs(motor_velocity) * step / (REVERSED * self._least)
        angle = np.rint(np.where(moving, np.fmin(share, 1.0), 0.0) * PARTS)
        total = np.minimum(self._angle, PARTS) + np.cumsum(angle, axis=0)
        angle = total - _held(total - angle, turned, np.zeros_like(self._angle))
        direction = _held(sign, angle >= PARTS, self.direction)
        self.direction, self._sign, self._angle = direction[-1], sign[-1], angle[-1]
        self._last_ns = int(stamp_ns[-1])
        return direction


def _held(values: Float, taken: NDArray[np.bool_], before: Float) -> Float:
    """Return the last value that is taken at each sample, shape (N, n)."""
    row = np.arange(len(values))[:, None]
    last = np.maximum.accumulate(np.where(taken, row, -1), axis=0)
    return np.where(last < 0, before, np.take_along_axis(values, np.maximum(last, 0), axis=0))
