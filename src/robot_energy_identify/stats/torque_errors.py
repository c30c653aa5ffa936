"""Torque error of a model that runs as the monitor: as it is, and below 10 Hz.

Identification passes both sides of its equation through one low-pass without delay, so the noise
of accelerations and of torque sensors counts on neither. The monitor has no such filter. Both
errors are of use; only figures behind the same filter F can be compared:

    e = |F (tau_predicted - tau_measured)| / |F tau_measured|, joint side, rows in motion

F and the rows are those of `robot_energy_identify.data.observations`.
"""

from __future__ import annotations

from copy import copy

import numpy as np
from numpy.typing import NDArray

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

    Attributes:
        samples: How many counted, all and moving, shape (2, n).
        squares: Of error and of measured torque: over all samples, while moving, and joint side
            behind the low-pass while moving; shape (2, 3, n). [(N m)^2]
    """

    def __init__(self, model: RobotModel) -> None:
        self._filters = Filters()
        self._drivetrain = Drivetrain.from_model(model)
        self._standstill = np.array([joint.standstill_velocity for joint in model.joints])
        count = len(model.joints)
        self.samples: Int = np.zeros((2, count), dtype=np.int64)
        self.squares: Float = np.zeros((2, 3, count))
        self._stamp_ns = np.zeros(0, dtype=np.int64)
        self._waiting = np.zeros((0, 3, count))  # predicted, measured, velocity; joint side

    def step(self, block: PowerBlock) -> None:
        """Take power samples."""
        measured, sound = block.motor_torque_measured, (block.quality & np.uint32(DOUBTFUL)) == 0
        error = block.motor_torque - measured
        known = np.isfinite(error) & sound[:, None]
        speed = self._drivetrain.joint_velocity_from_motor(block.motor_velocity)
        for place, rows in enumerate((known, known & (np.abs(speed) > self._standstill))):
            self.samples[place] += rows.sum(axis=0)
            self._add(place, rows, error, measured)
        kept = known.all(axis=1)
        if not kept.any():
            return
        torque = np.stack([block.motor_torque[kept], measured[kept]], axis=1)
        joint = torque @ self._drivetrain.transmission
        fresh = np.concatenate([joint, speed[kept][:, None]], axis=1)
        self._stamp_ns = np.concatenate([self._stamp_ns, block.stamp_ns[kept]])
        self._waiting = np.concatenate([self._waiting, fresh])
        cuts = np.flatnonzero(np.diff(self._stamp_ns) > MAX_STEP / NANOSECOND) + 1
        for cut in np.diff(cuts, prepend=0).tolist():
            self._filter(cut)
        stamp = self._stamp_ns
        if len(stamp) and (stamp[-1] - stamp[0]) * NANOSECOND >= PIECE:
            self.finish()

    def finish(self) -> None:
        """Take what waits for the low-pass, as at the end of a recording."""
        self._filter(len(self._stamp_ns))

    def add(self, other: TorqueErrorSums) -> None:
        """Take all samples of another recording, which has ended."""
        self.samples += other.samples
        self.squares += other.squares

    @property
    def of_nothing(self) -> TorqueErrorSums:
        """The errors of a prediction of 0 N m."""
        found = copy(self)
        found.squares = self.squares[[1, 1]]
        return found

    @property
    def rms(self) -> Float:
        """Of predicted minus measured torque, all and moving, shape (2, n). [N m]"""
        count = np.where(self.samples > 0, self.samples, 1)
        return np.where(self.samples > 0, np.sqrt(self.squares[0, :2] / count), np.nan)

    @property
    def relative(self) -> Float:
        """Norm of the error over that of the measured torque, as of `squares`, shape (3, n). [-]"""
        return _ratio(*self.squares)

    @property
    def relative_of_all(self) -> Float:
        """The same of all joints together, shape (3,). [-]"""
        return _ratio(*self.squares.sum(axis=2))

    def _add(self, place: int, rows: NDArray[np.bool_], error: Float, measured: Float) -> None:
        for part, values in enumerate((error, measured)):
            self.squares[part, place] += (np.where(rows, values, 0.0) ** 2).sum(axis=0)

    def _filter(self, count: int) -> None:
        """Add the first rows that wait, behind the low-pass, and forget them."""
        stamp, values = self._stamp_ns[:count], self._waiting[:count]
        self._stamp_ns, self._waiting = self._stamp_ns[count:], self._waiting[count:]
        if count < 2 or (stamp[-1] - stamp[0]) * NANOSECOND < MIN_LENGTH:
            return
        rate = float(1.0 / (np.median(np.diff(stamp)) * NANOSECOND))
        if self._filters.cutoff >= 0.5 * rate:
            return
        even = uniform(stamp, values.reshape(count, -1), rate).reshape(-1, *values.shape[1:])
        predicted, measured = low_pass(even[:, :2], rate, self._filters.cutoff).swapaxes(0, 1)
        used, _ = usable(even[:, 2], rate, self._drivetrain.transmission, self._filters)
        self._add(2, used, predicted - measured, measured)


def _ratio(error: Float, measured: Float) -> Float:
    known = measured > 0
    return np.where(known, np.sqrt(error / np.where(known, measured, 1.0)), np.nan)
