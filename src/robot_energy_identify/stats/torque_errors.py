"""Torque error of a model that runs as the monitor: as it is, and below 10 Hz.

Identification passes both sides of its equation through one low-pass without delay, so the noise
of accelerations and of torque sensors counts on neither. The monitor has no such filter. Both
errors are of use; only figures behind the same filter F can be compared:

    e = |F (tau_predicted - tau_measured)| / |F tau_measured|, joint side, rows in motion

F and the rows are those of `robot_energy_identify.data.observations`.
"""

from __future__ import annotations

import numpy as np

from robot_energy.model import RobotModel
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.timeline.blocks import DOUBTFUL, NANOSECOND, Float, Int, PowerBlock
from robot_energy_identify.data.observations import Filters, usable
from robot_energy_plan.motion.sampled_motion import low_pass, uniform

PIECE = 60.0  # filtered at once, so that memory does not grow [s]
MIN_LENGTH = 1.0  # of a piece [s]
MAX_STEP = 0.1  # between samples of one stretch [s]


class TorqueErrorSums:
    """Error of the motor torque of each joint, over all samples and while the joint moves.

    A sample counts for a joint where its torque was measured and its acceleration comes from
    a full window. At rest friction is anything up to its Coulomb value, which no model can
    predict; therefore the moving samples count once more for themselves.
    """

    def __init__(self, model: RobotModel) -> None:
        self._drivetrain = Drivetrain.from_model(model)
        self._standstill = np.array([joint.standstill_velocity for joint in model.joints])
        count = len(model.joints)
        self._samples: Int = np.zeros((2, count), dtype=np.int64)  # all, moving
        self._squares = np.zeros((2, 2, count))  # error, measured; all, moving [(N m)^2]

    def step(self, block: PowerBlock) -> None:
        """Take power samples."""
        measured = block.motor_torque_measured
        error = block.motor_torque - measured
        sound = (block.quality & np.uint32(DOUBTFUL)) == 0
        known = np.isfinite(error) & sound[:, None]
        speed = self._drivetrain.joint_velocity_from_motor(block.motor_velocity)
        moving = known & (np.abs(speed) > self._standstill)
        for place, rows in enumerate((known, moving)):
            self._samples[place] += rows.sum(axis=0)
            for part, values in enumerate((error, measured)):
                self._squares[part, place] += (np.where(rows, values, 0.0) ** 2).sum(axis=0)

    def add(self, other: TorqueErrorSums) -> None:
        """Take all samples of another recording."""
        self._samples += other._samples
        self._squares += other._squares

    @property
    def samples(self) -> Int:
        """How many counted, all and moving, shape (2, n)."""
        return self._samples

    @property
    def rms(self) -> Float:
        """Of predicted minus measured torque, all and moving, shape (2, n). [N m]"""
        return self._mean_root(0)

    @property
    def measured_rms(self) -> Float:
        """Of the measured torque: the error of a prediction of 0 N m, shape (2, n). [N m]"""
        return self._mean_root(1)

    @property
    def relative(self) -> Float:
        """Norm of the error over that of the measured torque, shape (2, n). [-]"""
        return _ratio(self._squares[0], self._squares[1])

    @property
    def relative_of_all(self) -> Float:
        """The same of all joints together, shape (2,). [-]"""
        return _ratio(self._squares[0].sum(axis=1), self._squares[1].sum(axis=1))

    def _mean_root(self, part: int) -> Float:
        count = np.where(self._samples > 0, self._samples, 1)
        return np.where(self._samples > 0, np.sqrt(self._squares[part] / count), np.nan)


class LowPassTorqueError:
    """Sums of squares over recordings, from blocks of samples."""

    def __init__(self, model: RobotModel) -> None:
        self.filters = Filters()
        self._drivetrain = Drivetrain.from_model(model)
        count = len(model.joints)
        self._squares = np.zeros((2, count))  # error, measured [(N m)^2]
        self._stamp_ns = np.zeros(0, dtype=np.int64)
        self._values = np.zeros((0, 3, count))  # predicted, measured, velocity; joint side

    def step(self, block: PowerBlock) -> None:
        """Take power samples."""
        sound = (block.quality & np.uint32(DOUBTFUL)) == 0
        torque = np.stack([block.motor_torque, block.motor_torque_measured], axis=1)
        kept = sound & np.isfinite(torque).all(axis=(1, 2))
        if not kept.any():
            return
        velocity = self._drivetrain.joint_velocity_from_motor(block.motor_velocity[kept])
        joint = torque[kept] @ self._drivetrain.transmission
        fresh = np.concatenate([joint, velocity[:, None]], axis=1)
        self._stamp_ns = np.concatenate([self._stamp_ns, block.stamp_ns[kept]])
        self._values = np.concatenate([self._values, fresh])
        cuts = np.flatnonzero(np.diff(self._stamp_ns) > MAX_STEP / NANOSECOND) + 1
        for cut in np.diff(cuts, prepend=0).tolist():
            self._take(cut)
        stamp = self._stamp_ns
        if len(stamp) and (stamp[-1] - stamp[0]) * NANOSECOND >= PIECE:
            self.finish()

    def finish(self) -> None:
        """Take what waits, as at the end of a recording."""
        self._take(len(self._stamp_ns))

    def add(self, other: LowPassTorqueError) -> None:
        """Take all samples of another recording, which has ended."""
        self._squares += other._squares

    @property
    def relative(self) -> Float:
        """Of each joint, shape (n,); NaN where nothing moved. [-]"""
        return _ratio(*self._squares)

    @property
    def relative_of_all(self) -> float:
        """Of all joints together. [-]"""
        return float(_ratio(*self._squares.sum(axis=1)))

    def _take(self, count: int) -> None:
        """Add the first rows that wait, and forget them."""
        stamp, values = self._stamp_ns[:count], self._values[:count]
        self._stamp_ns, self._values = self._stamp_ns[count:], self._values[count:]
        if count < 2 or (stamp[-1] - stamp[0]) * NANOSECOND < MIN_LENGTH:
            return
        rate = float(1.0 / (np.median(np.diff(stamp)) * NANOSECOND))
        if self.filters.cutoff >= 0.5 * rate:
            return
        even = uniform(stamp, values.reshape(count, -1), rate).reshape(-1, *values.shape[1:])
        predicted, measured = low_pass(even[:, :2], rate, self.filters.cutoff).swapaxes(0, 1)
        used, _ = usable(even[:, 2], rate, self._drivetrain.transmission, self.filters)
        for part, torque in enumerate((predicted - measured, measured)):
            self._squares[part] += (np.where(used, torque, 0.0) ** 2).sum(axis=0)


def _ratio(error: Float, measured: Float) -> Float:
    known = measured > 0
    return np.where(known, np.sqrt(error / np.where(known, measured, 1.0)), np.nan)
