"""Torque of counterbalances, joint side.

``torque = dU/dq`` is what the drive adds, with the sign of the rigid-body torque: positive where
the spring pulls the joint towards smaller q. Over a closed path its work is zero.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot_energy.model.joint import GasSpring, LeverSpring, TorsionSpring
from robot_energy.timeline.blocks import Float

AnySpring = TorsionSpring | LeverSpring | GasSpring


def counterbalance_torque(entry: AnySpring, joint_position: Float) -> Float:
    """Return what the drive adds against one counterbalance, joint side. [N m] or [N]

    Args:
        joint_position: q, shape (N,). [rad] or [m]
    """
    return torque_columns(entry, joint_position) @ coefficients(entry)


def torque_columns(entry: AnySpring, joint_position: Float) -> Float:
    """Return the torque per unit of each of the two figures that it is linear in, shape (N, 2).

    They are those of `coefficients`; the geometry of a gas spring is given.

    Args:
        joint_position: q, shape (N,). [rad] or [m]
    """
    q = np.asarray(joint_position, dtype=np.float64)
    match entry:
        case TorsionSpring():
            first, second = q, np.ones_like(q)
        case LeverSpring():
            first, second = np.cos(q), np.sin(q)
        case GasSpring():
            length, slope = _gas_length(entry, q)
            first, second = -slope, -(entry.length.value - length) * slope
    return np.stack([first, second], axis=-1)


def coefficients(entry: AnySpring) -> Float:
    """Return the two figures that the torque is linear in, shape (2,).

    Spring: k [N m/rad] and -k q0 [N m]; lever: moment times cosine and sine of its angle [N m];
    gas spring: force [N] and rate [N/m].
    """
    match entry:
        case TorsionSpring():
            stiffness = entry.stiffness.value
            return np.array([stiffness, -stiffness * entry.rest.value])
        case LeverSpring():
            angle = entry.angle.value
            return entry.moment.value * np.array([np.cos(angle), np.sin(angle)])
        case GasSpring():
            return np.array([entry.force.value, entry.rate.value])


def add_counterbalance(
    torque: Float, joint_position: Float, entries: Sequence[AnySpring | None]
) -> None:
    """Add all counterbalances to a torque, in place.

    Args:
        torque: Joint side, shape (N, n). [N m] or [N]
        joint_position: Shape (N, n). [rad] or [m]
    """
    for joint, entry in enumerate(entries):
        if entry is not None:
            torque[:, joint] += counterbalance_torque(entry, joint_position[:, joint])


def _gas_length(entry: GasSpring, q: Float) -> tuple[Float, Float]:
    """Length l and dl/dq, shape (N,) each."""
    a, b, turned = entry.a.value, entry.b.value, q - entry.angle.value
    length = np.sqrt(a * a + b * b - 2.0 * a * b * np.cos(turned))
    return length, a * b * np.sin(turned) / length
