"""Errors of meter, torque constants and losses of the drives, as far as a DC link depends on them.

A torque constant that is off changes the shaft power and, because the losses of the drives come
from the same readings, those as well; the two partly cancel. So each error comes with what
it moved in the fit of the drives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_energy.blocks import Float
from robot_energy.identify.data.recordings import Recording
from robot_energy.identify.drives.all_drives import DrivesFound
from robot_energy.identify.drives.losses import COPPER_COEFFICIENT, loss_columns
from robot_energy.identify.friction.samples import bodies_identified
from robot_energy.identify.stats.regression import SCATTER
from robot_energy.identify.stats.systematic import BODIES, METER, THERMOMETER, TORQUE

DRIVES = "drives"  # the scatter of their fit
COOL = 20.0  # degC, where no temperature of a winding is known
TERMS = ("copper", "linear", "quadratic")


@dataclass(frozen=True)
class DriveError:
    """One independent error, by one standard deviation.

    Attributes:
        cause: Of it.
        joint: Whose torque constant or thermometer is off; None for other causes.
        coefficients: What it moves of the copper, linear and quadratic coefficients, shape (3, n).
    """

    cause: str
    joint: int | None
    coefficients: Float


def drive_errors(found: DrivesFound | None, n_joints: int) -> list[DriveError]:
    """Return the errors of a robot whose drives were found in these recordings.

    Args:
        found: The drives; None if they are given.
        n_joints: Of the robot.
    """
    errors: dict[tuple[str, int], DriveError] = {
        (TORQUE, joint): DriveError(TORQUE, joint, np.zeros((3, n_joints)))
        for joint in range(n_joints)
    }
    errors[METER, 0] = DriveError(METER, None, np.zeros((3, n_joints)))
    if found is not None and found.drives is not None:
        for joint, axis in enumerate(found.drives.axes):
            if axis.losses is None or axis.losses.fit is None:
                continue
            fit = axis.losses.fit
            for cause, moves in fit.errors().items():
                for number, move in enumerate(moves.T):
                    own = np.zeros((3, n_joints))
                    for name, by in zip(fit.names, move.tolist(), strict=True):
                        if name in TERMS:
                            own[TERMS.index(name), joint] = by
                    place = (cause, joint if cause == TORQUE else 100 * joint + number)
                    errors[place] = DriveError(cause, joint, own)
    elif found is not None and found.total is not None and found.total.fit.losses.fit is not None:
        total = found.total.fit
        for cause, moves in found.total.fit.losses.fit.errors().items():
            for number, move in enumerate(moves.T):
                joint = number if cause in (TORQUE, THERMOMETER) else None
                errors[cause, number] = DriveError(cause, joint, total.spread @ move)
    return list(errors.values())


def energy_changes(metered: Sequence[Recording], error: DriveError) -> tuple[list[Float], float]:
    """Return what an error makes of the power of the drives and of the meter.

    Args:
        metered: Recordings with a meter, run with one model.
        error: The error.

    Returns:
        Change of the power of the drives by recording, shape (N,) each [W], and of the gain of the
        meter [-].
    """
    std = metered[0].sensors.std
    changes: list[Float] = []
    for part in metered:
        power = part.power
        degc = power.motor_temperature_degc
        columns = loss_columns(
            power.motor_velocity, power.motor_torque, np.where(np.isfinite(degc), degc, COOL)
        )[..., 1:]
        change = np.einsum("njr,rj->n", columns, error.coefficients)
        identified = bodies_identified(part.model)
        if error.joint is not None and error.cause in (TORQUE, THERMOMETER):
            losses = part.model.joints[error.joint].losses
            copper = 0.0 if losses is None else losses.copper.value
            heat = copper * columns[:, error.joint, 0]
            if error.cause == THERMOMETER:
                change = change + std.thermometer * COPPER_COEFFICIENT * heat
            else:
                shaft = power.friction_power[:, error.joint]
                if identified:
                    shaft = shaft + power.rigid_power[:, error.joint]
                change = change + std.torque * (shaft + 2.0 * heat)
        elif error.cause == BODIES and not identified:
            change = change + std.bodies * power.rigid_power.sum(axis=1)
        changes.append(np.nan_to_num(change))
    return changes, std.meter if error.cause == METER else 0.0


def by_cause(errors: Sequence[DriveError], moves: Float) -> dict[str, float]:
    """Return the deviations that errors make, by cause.

    Args:
        errors: Independent ones.
        moves: Of the figure by each, shape (errors,). [of the figure]
    """
    parts: dict[str, float] = {}
    for error, move in zip(errors, moves.tolist(), strict=True):
        cause = DRIVES if error.cause == SCATTER else error.cause
        parts[cause] = float(np.hypot(parts.get(cause, 0.0), move))
    return parts
