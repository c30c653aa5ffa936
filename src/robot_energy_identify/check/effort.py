"""Is the effort that of the instant of the motion, has it a sign, and does it go on?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from robot_energy.timeline.blocks import NANOSECOND, Float, TorqueBlock
from robot_energy_identify.check.field_lag import field_lag
from robot_energy_identify.check.finding import ERROR, Finding

SLOW = 0.02  # of the greatest speed: below it friction may have either sign
LEAST_SPEED = 0.02  # rad/s or m/s: noise of the velocity of a joint that stands is less
LATE = 0.08  # s: efforts of sound recordings are up to 0.03 s late, a low pass of 0.1 s makes 0.06
BOTH = 0.03  # share of samples to and fro in which the bodies need much torque of each sign
MUCH = 0.5  # of the RMS torque
MIN_HELD = 2.0  # s
MIN_VALUES = 3
HELD = 0.05  # of the recording


def check_effort(names: Sequence[str], torque: TorqueBlock) -> Iterator[Finding]:
    """Yield what is wrong with the measured torque of joints of these names."""
    measured, rigid = torque.motor_torque_measured, torque.motor_torque_rigid
    if not np.isfinite(rigid).any(axis=0).all():
        return
    size = MUCH * np.sqrt(np.nanmean(rigid**2, axis=0))
    speed = torque.joint_velocity
    still = SLOW * np.fmax.reduce(np.abs(speed))
    moves = np.abs(speed) > np.maximum(still, LEAST_SPEED)
    up, down = (moves & (sign * rigid > size) for sign in (1.0, -1.0))
    pairs = [(up & (way > 0.0), down & (way < 0.0)) for way in (speed, -speed)]  # gears have a sign
    both = np.max([np.minimum(*(one.mean(axis=0) for one in pair)) for pair in pairs], axis=0)
    known = (np.abs(measured) > 0.0).any(axis=0)
    one_sign = ~(measured > 0.0).any(axis=0) | ~(measured < 0.0).any(axis=0)
    unsigned = tuple(np.array(names)[(both > BOTH) & known & one_sign].tolist())
    due = np.where(moves, rigid, np.nan)  # friction holds a joint that stands
    held = {
        name: time for j, name in enumerate(names) if (time := _held(torque, j, due[:, j], size[j]))
    }
    if held:
        yield Finding(
            "effort_held", ERROR, tuple(held),
            f"the effort of {', '.join(held)} stays the same for {max(held.values()):.0f} s while "
            "the torque of the bodies changes: its sensor or its driver stands still",
            max(held.values()), "leave this recording out, or record again",
        )  # fmt: skip
    if unsigned:
        yield Finding(
            "effort_unsigned", ERROR, unsigned,
            f"the effort of {', '.join(unsigned)} never changes its sign, although the bodies need "
            "torque of both signs: it is a size without a sign",
            remedy="record the effort with its sign",
        )  # fmt: skip
    if held or unsigned:
        return
    time = (torque.stamp_ns - torque.stamp_ns[0]) * NANOSECOND
    sign = np.tanh(speed / np.where(still > 0.0, still, 1.0))
    follows = np.stack([rigid, sign, speed], axis=2)
    late = field_lag(time, ((follows[:, j], measured[:, j]) for j in range(len(names))), LATE)
    if late:
        yield Finding(
            "effort_late", ERROR, tuple(names),
            f"the effort is {abs(late):.2f} s {'behind' if late > 0.0 else 'ahead of'} positions "
            "and velocities, as a filtered or delayed one is",
            late, "record effort, position and velocity of one instant, without a filter",
        )  # fmt: skip


def _held(torque: TorqueBlock, joint: int, due: Float, much: float) -> float:
    """How long the effort of a joint stays exactly the same, 0 if hardly ever. [s]

    Args:
        due: Torque of the bodies, NaN where friction may hold them, shape (N,). [N m]
        much: Change of it, from which another effort is due. [N m]
    """
    measured, stamps = torque.motor_torque_measured[:, joint], torque.stamp_ns
    if len(np.unique(measured[np.isfinite(measured)])) < MIN_VALUES:
        return 0.0  # a driver that sends 0 for a joint that it does not measure
    begins = np.diff(measured, prepend=np.nan) != 0.0
    first = np.flatnonzero(begins | (np.diff(torque.segment, prepend=-1) != 0))
    time = (stamps[np.append(first[1:], len(stamps)) - 1] - stamps[first]) * NANOSECOND
    change = np.fmax.reduceat(due, first) - np.fmin.reduceat(due, first)
    held = float(time[(time >= MIN_HELD) & (change > much)].sum())
    return held if held > HELD * float(np.ptp(stamps)) * NANOSECOND else 0.0
