"""Errors of meter, torque constants and losses of the drives, as far as a DC link depends on them.

A torque constant that is off changes the shaft power and, because the losses of the drives come
from the same readings, those as well; the two partly cancel. So each error comes with what
it moved in the fit of the drives.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from robot_energy.model.schema import Cabinet
from robot_energy.timeline.blocks import Float
from robot_energy_identify.cabinet.link_readings import LinkReadings, readings_of
from robot_energy_identify.data.recordings import Recording
from robot_energy_identify.drives.all_drives import DrivesReport
from robot_energy_identify.drives.drive_data import COOL, winding_torque
from robot_energy_identify.drives.losses import COPPER_COEFFICIENT, loss_columns
from robot_energy_identify.drives.total_sums import COEFFICIENTS
from robot_energy_identify.friction.samples import bodies_identified
from robot_energy_identify.stats.regression import SCATTER
from robot_energy_identify.stats.systematic import BODIES, METER, THERMOMETER, TORQUE

DRIVES = "drives"  # the scatter of their fit


class _Error(NamedTuple):
    """One independent error, by one standard deviation.

    ``joint`` is that whose torque constant or thermometer is off, None for other causes;
    ``coefficients`` is what it moves of the copper, linear and quadratic ones, shape (3, n).
    """

    cause: str
    joint: int | None
    coefficients: Float


def energy_errors(
    metered: Sequence[Recording],
    cabinet: Cabinet,
    energies: Float,
    data: LinkReadings,
    drives: DrivesReport | None,
) -> dict[str, float]:
    """Return the deviations of the energy of a DC link that errors make, by cause. [J]

    Gauss-Newton about the best cabinet, its constant free: ``(dE, dc) = (D' D)^-1 D' (dm - dp)``
    with D the slopes of the readings, dm the change of the readings and dp what the change of
    the drives makes of their prediction.

    Args:
        energies: Tried, rising, shape (K,). [J]
        data: Readings with each of them.
        drives: Found in these recordings; None if they are given.
    """
    size = 0.0 if cabinet.capacitor is None else cabinet.capacitor.swing
    place = int(np.clip(np.searchsorted(energies, size), 1, len(energies) - 2))
    low, high = place - 1, place + 1
    slope = (data.predicted[:, high] - data.predicted[:, low]) / (energies[high] - energies[low])
    root = np.sqrt(data.duration)
    columns = np.stack([slope, data.slope[:, place]], axis=1) * root[:, None]
    own = readings_of(metered, [cabinet]).predicted[:, 0]
    parts: dict[str, float] = {}
    for error in _errors(drives, len(metered[0].model.joints)):
        change = [_change_of_drives(part, error) for part in metered]
        gain = metered[0].sensors.std.meter if error.cause == METER else 0.0
        shown = readings_of(metered, [cabinet], change).predicted[:, 0] - own
        rest = gain * data.measured - shown
        move = float(np.linalg.lstsq(columns, root * rest, rcond=None)[0][0])
        cause = DRIVES if error.cause == SCATTER else error.cause
        parts[cause] = float(np.hypot(parts.get(cause, 0.0), move))
    return parts


def _errors(found: DrivesReport | None, n_joints: int) -> list[_Error]:
    """Errors of a robot whose drives were found in these recordings, if they were."""
    errors = {
        (TORQUE, joint): _Error(TORQUE, joint, np.zeros((3, n_joints))) for joint in range(n_joints)
    }
    errors[METER, 0] = _Error(METER, None, np.zeros((3, n_joints)))
    if found is not None and found.drives is not None:
        for joint, axis in enumerate(found.drives.axes):
            if axis.losses is None or axis.losses.fit is None:
                continue
            fit = axis.losses.fit
            for cause, moves in fit.errors().items():
                for number, move in enumerate(moves.T):
                    own = np.zeros((3, n_joints))
                    for name, by in zip(fit.names, move.tolist(), strict=True):
                        if name in COEFFICIENTS:
                            own[COEFFICIENTS.index(name), joint] = by
                    place = (cause, joint if cause == TORQUE else 100 * joint + number)
                    errors[place] = _Error(cause, joint, own)
    elif found is not None and found.total is not None and found.total.fit.losses.fit is not None:
        total = found.total.fit
        for cause, moves in found.total.fit.losses.fit.errors().items():
            for number, move in enumerate(moves.T):
                joint = number if cause in (TORQUE, THERMOMETER) else None
                errors[cause, number] = _Error(cause, joint, total.spread @ move)
    return list(errors.values())


def _change_of_drives(part: Recording, error: _Error) -> Float:
    """What an error makes of the power of the drives of a recording, shape (N,). [W]"""
    std, power = part.sensors.std, part.power
    degc = power.motor_temperature_degc
    heating = winding_torque(part, power.motor_torque)
    columns = loss_columns(power.motor_velocity, heating, np.where(np.isfinite(degc), degc, COOL))[
        ..., 1:
    ]
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
    return np.nan_to_num(change)
