"""What motors hold at rest in addition to the load, from measured torque (`physics.hold_torque`).

Each rest of a joint gives one equation, ``(tau - tau_r) / fc = static kept d - carried c + e`` with
``c = sgn(tau_r) min(static, |tau_r| / fc)``, the Coulomb torque fc under the load, the static
friction over it, one for each joint, and the direction d of the motion before. The errors e of the
bodies differ by joint, so joints are weighted by what they leave. Shares stay 0 unless they predict
rests that the fit has not seen better than the load alone, and ``static`` stays 1 unless it
predicts them better than the shares.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.model.figure import Figure
from robot_energy.model.schema import Hold, RobotModel
from robot_energy.physics.friction import FrictionModel
from robot_energy.physics.hold_torque import HoldTorque
from robot_energy.timeline.blocks import NANOSECOND, Float, Int, Rows
from robot_energy_identify.data.recordings import Recording
from robot_energy_identify.data.rest import still_joints
from robot_energy_identify.stats.cross_validation import FOLDS, GAIN

SETTLED = 0.3  # s at rest before the torque is taken
SHORTEST = 0.3  # s of a rest after that
MIN_RESTS = 20  # of all joints
STATIC = 0.3  # by which static friction differs from the Coulomb torque, before rests show it
PASSES = 5


class HoldFit(Described):
    """What motors hold at rest, over the Coulomb torque."""

    kept: Annotated[
        tuple[float, float],
        "Share in the direction of the last motion, and its standard deviation. [-]",
    ]
    carried: Annotated[
        tuple[float, float],
        "Share by which friction carries the load, and its standard deviation. [-]",
    ]
    static: Annotated[
        tuple[float, ...] | None,
        "Static friction of each joint; None where rests are predicted no better with it. [-]",
    ]
    std: Annotated[float, "Standard deviation of the torque at one place. [-]"]
    load_std: Annotated[float, "The same if motors held the load alone. [-]"]
    rests: Annotated[int, "Number of equations."]

    def write(self, model: RobotModel, source: str) -> RobotModel:
        """Return a model with these figures."""
        kept, carried = (
            Figure(value=float(np.clip(value, -1.0, 1.0)), std=std, tag="identified", source=source)
            for value, std in (self.kept, self.carried)
        )
        hold = Hold(kept=kept, carried=carried, static=self.static, std=self.std)
        return model.changed(hold=hold)


class _Rests(Rows):
    """Rests of joints, shape (K,) each: joint, direction, carried load, torque minus the load."""

    joint: Int
    direction: Float
    load: Float
    excess: Float
    joints: int

    def table(self, static: Float) -> Float:
        """Columns of both figures with the static friction of each joint, shape (K, 2)."""
        most = static[self.joint]
        carried = np.clip(self.load, -most, most)
        return np.stack([most * self.direction, -carried], axis=1)


def fit_hold(recordings: Sequence[Recording], model: RobotModel) -> HoldFit | None:
    """Return what the motors of a robot hold at rest; None where too few rests show it."""
    rests = _rests(recordings, model)
    count = len(rests)
    if count < MIN_RESTS:
        return None
    target = rests.excess
    fold = np.arange(count) * FOLDS // count
    weight = _weights(rests, target)
    load_std = float(np.sqrt(weight @ target**2 / weight.sum()))
    left = {own: _held_out(rests, fold, weight, own) for own in (False, True)}
    squares = {own: float(weight @ error**2) for own, error in left.items()}
    own = squares[True] < GAIN**2 * squares[False]
    if not squares[own] < GAIN**2 * float(weight @ target**2):
        none = (0.0, load_std / np.sqrt(count))
        return HoldFit(none, none, None, load_std, load_std, count)
    found, covariance, static, weight = _solve(rests, weight, own)
    std = float(np.sqrt(weight @ left[own] ** 2 / weight.sum()))
    kept, carried = zip(found.tolist(), np.sqrt(np.diag(covariance)).tolist(), strict=True)
    return HoldFit(kept, carried, tuple(static.tolist()) if own else None, std, load_std, count)


def _held_out(rests: _Rests, fold: Int, weight: Float, own: bool) -> Float:
    """What a fit of the other folds leaves of each rest, shape (K,)."""
    left = np.empty(len(fold))
    for number in range(FOLDS):
        test = fold == number
        found, _, static, _ = _solve(rests[~test], weight[~test], own)
        held = rests[test]
        left[test] = held.excess - held.table(static) @ found
    return left


def _solve(rests: _Rests, weight: Float, own: bool) -> tuple[Float, Float, Float, Float]:
    """Return both shares, their covariance, static friction of each joint and the weights."""
    static = np.ones(rests.joints)
    found, covariance = np.zeros(2), np.zeros((2, 2))
    for _ in range(PASSES):
        table, target = rests.table(static), rests.excess
        root = np.sqrt(weight)[:, None]
        found = np.linalg.lstsq(root * table, root[:, 0] * target, rcond=None)[0]
        left = root[:, 0] * (target - table @ found)
        scale = float(left @ left) / max(len(target) - 2, 1)
        covariance = scale * np.linalg.pinv((root * table).T @ (root * table))
        if own:
            static = _static(rests, weight, found, static)
        weight = _weights(rests, rests.excess - rests.table(static) @ found)
    if own and found[0] > 1.0:  # no more is kept than there is
        static, found = static * found[0], np.array([1.0, found[1]])
    return found, covariance, static, weight


def _static(rests: _Rests, weight: Float, found: Float, before: Float) -> Float:
    """Return the most likely static friction of each joint, over its Coulomb torque."""
    kept, carried = found.tolist()
    size, sign = np.abs(rests.load), np.sign(rests.load)
    slides = size > before[rests.joint]
    column = kept * rests.direction - carried * sign * slides
    rest = rests.excess + carried * sign * np.where(slides, 0.0, size) - column
    pull = np.bincount(rests.joint, weight * column * rest, rests.joints)
    known = np.bincount(rests.joint, weight * column * column, rests.joints)
    return np.maximum(1.0 + pull / (known + STATIC**-2), 0.0)


def _weights(rests: _Rests, left: Float) -> Float:
    """One over the mean square of what each joint leaves, shape (K,)."""
    counts = np.bincount(rests.joint, minlength=rests.joints)
    squares = np.bincount(rests.joint, left**2, rests.joints) / np.maximum(counts, 1)
    return 1.0 / np.maximum(squares[rests.joint], 1e-4)


def _rests(recordings: Sequence[Recording], model: RobotModel) -> _Rests:
    friction, parts = FrictionModel.from_model(model), list[tuple[int, float, float, float]]()
    for recording in recordings:
        block = recording.torque
        measured, rigid = block.motor_torque_measured, block.motor_torque_rigid
        stands, own = still_joints(recording), list[tuple[int, int, float, float, float]]()
        coulomb = np.broadcast_to(friction.loaded_coulomb(rigid), rigid.shape)
        direction = HoldTorque(model).last_motion.follow(block.stamp_ns, block.motor_velocity)
        for joint in range(rigid.shape[1]):
            usable = np.isfinite(measured[:, joint] + rigid[:, joint]) & recording.sound
            edges = np.flatnonzero(np.diff(stands[:, joint], prepend=False, append=False))
            for first, last in edges.reshape(-1, 2).tolist():
                begin = int(block.stamp_ns[first]) + round(SETTLED / NANOSECOND)
                rows = slice(int(np.searchsorted(block.stamp_ns[:last], begin)), last)
                span = (int(block.stamp_ns[last - 1]) - begin) * NANOSECOND
                moved, torque = float(direction[first, joint]), float(coulomb[last - 1, joint])
                if not moved or not torque > 0.0 or span < SHORTEST or not usable[rows].all():
                    continue
                load = float(rigid[rows, joint].mean()) / torque
                excess = float((measured[rows, joint] - rigid[rows, joint]).mean()) / torque
                own.append((begin, joint, moved, load, excess))
        parts += [row[1:] for row in sorted(own)]
    joint, *others = np.array(parts).reshape(-1, 4).T
    direction, load, excess = others
    return _Rests(joint.astype(np.int64), direction, load, excess, len(model.joints))
