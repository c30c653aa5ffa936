"""What motors hold at rest in addition to the load, from measured torque (`physics.hold_torque`).

Each rest of a joint gives one equation, ``(tau - tau_r) / fs = kept d - carried c + e`` with
``c = sgn(tau_r) min(1, |tau_r| / fs)``, the Coulomb torque fs under the load and the direction d of
the motion before. The errors e of
the bodies differ by joint, so joints are weighted by what they leave. Both stay 0 unless they
predict rests that the fit has not seen better than the load alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_energy.model.figure import Figure
from robot_energy.model.schema import Hold, RobotModel
from robot_energy.physics.hold_torque import HoldTorque
from robot_energy.timeline.blocks import NANOSECOND, Float, Int
from robot_energy_identify.data.recordings import Recording
from robot_energy_identify.data.rest import still_joints
from robot_energy_identify.stats.cross_validation import FOLDS, GAIN

SETTLED = 0.3  # s at rest before the torque is taken
SHORTEST = 0.3  # s of a rest after that
MIN_RESTS = 20  # of all joints
PASSES = 5


@dataclass(frozen=True)
class HoldFit:
    """What motors hold at rest, over the Coulomb torque.

    Attributes:
        kept: Share in the direction of the last motion, and its standard deviation. [-]
        carried: Share by which friction carries the load, and its standard deviation. [-]
        std: Standard deviation of the torque at one place. [-]
        load_std: The same if motors held the load alone. [-]
        rests: Number of equations.
    """

    kept: tuple[float, float]
    carried: tuple[float, float]
    std: float
    load_std: float
    rests: int

    def write(self, model: RobotModel, source: str) -> RobotModel:
        """Return a model with these figures.

        Args:
            model: Any model of the same robot.
            source: Where the data come from.
        """
        kept, carried = (
            Figure(value=float(np.clip(value, -1.0, 1.0)), std=std, tag="identified", source=source)
            for value, std in (self.kept, self.carried)
        )
        return model.changed(hold=Hold(kept=kept, carried=carried, std=self.std))


@dataclass(frozen=True)
class _Rests:
    """Rests of joints, shape (K,) each: joint, direction, carried load, torque minus the load."""

    joint: Int
    direction: Float
    load: Float
    excess: Float

    @property
    def table(self) -> Float:
        """Columns of both figures, shape (K, 2)."""
        return np.stack([self.direction, -self.load], axis=1)


def fit_hold(recordings: Sequence[Recording], model: RobotModel) -> HoldFit | None:
    """Return what the motors of a robot hold at rest; None where too few rests show it.

    Args:
        model: With the friction that they show.
    """
    rests = _rests(recordings, model)
    count = len(rests.joint)
    if count < MIN_RESTS:
        return None
    table, target = rests.table, rests.excess
    fold = np.arange(count) * FOLDS // count
    weight = _weights(rests, target)
    own, load = np.zeros(count), target
    for number in range(FOLDS):
        test = fold == number
        found, _ = _solve(table[~test], target[~test], weight[~test])
        own[test] = target[test] - table[test] @ found
    better = float(weight @ own**2) < GAIN**2 * float(weight @ load**2)
    load_std = float(np.sqrt(weight @ load**2 / weight.sum()))
    if not better:
        none = (0.0, load_std / np.sqrt(count))
        return HoldFit(none, none, load_std, load_std, count)
    found, covariance = np.zeros(2), np.zeros((2, 2))
    for _ in range(PASSES):
        found, covariance = _solve(table, target, weight)
        weight = _weights(rests, target - table @ found)
    std = float(np.sqrt(weight @ own**2 / weight.sum()))
    kept, carried = zip(found.tolist(), np.sqrt(np.diag(covariance)).tolist(), strict=True)
    return HoldFit(kept, carried, std, load_std, count)


def _solve(table: Float, target: Float, weight: Float) -> tuple[Float, Float]:
    root = np.sqrt(weight)[:, None]
    found = np.linalg.lstsq(root * table, root[:, 0] * target, rcond=None)[0]
    left = root[:, 0] * (target - table @ found)
    scale = float(left @ left) / max(len(target) - 2, 1)
    return found, scale * np.linalg.pinv((root * table).T @ (root * table))


def _weights(rests: _Rests, left: Float) -> Float:
    """One over the mean square of what each joint leaves, shape (K,)."""
    size = int(rests.joint.max()) + 1
    counts = np.bincount(rests.joint, minlength=size)
    squares = np.bincount(rests.joint, left**2, size) / np.maximum(counts, 1)
    return 1.0 / np.maximum(squares[rests.joint], 1e-4)


def _rests(recordings: Sequence[Recording], model: RobotModel) -> _Rests:
    parts: list[tuple[int, float, float, float]] = []
    for recording in recordings:
        hold, block = HoldTorque(model), recording.torque
        measured, rigid = block.motor_torque_measured, block.motor_torque_rigid
        stands = still_joints(recording)
        coulomb = np.broadcast_to(hold.coulomb(rigid), rigid.shape)
        direction = hold.last_motion.follow(block.stamp_ns, block.motor_velocity)
        for joint in range(rigid.shape[1]):
            usable = np.isfinite(measured[:, joint] + rigid[:, joint]) & recording.sound
            for first, last in _stretches(stands[:, joint]):
                begin = int(block.stamp_ns[first]) + round(SETTLED / NANOSECOND)
                rows = slice(int(np.searchsorted(block.stamp_ns[:last], begin)), last)
                span = (int(block.stamp_ns[last - 1]) - begin) * NANOSECOND
                moved, torque = float(direction[first, joint]), float(coulomb[last - 1, joint])
                if not moved or not torque > 0.0 or span < SHORTEST or not usable[rows].all():
                    continue
                load = float(rigid[rows, joint].mean()) / torque
                excess = float((measured[rows, joint] - rigid[rows, joint]).mean()) / torque
                parts.append((joint, moved, float(np.clip(load, -1, 1)), excess))
    columns = np.array(parts).reshape(-1, 4).T
    return _Rests(columns[0].astype(np.int64), *columns[1:])


def _stretches(stands: np.ndarray) -> list[tuple[int, int]]:
    """First sample of each rest and the one behind its last."""
    edges = np.diff(stands.astype(np.int8), prepend=0, append=0)
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return list(zip(starts.tolist(), ends.tolist(), strict=True))
