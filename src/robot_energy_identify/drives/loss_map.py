"""Loss of one drive over speed and torque, without an assumed form.

``P_el - P_mech = L(|w|, |tau|)``, bilinear between knots, fitted by least squares under
``L >= 0``, ``dL/d|w| >= 0`` and ``dL/d|tau| >= 0``: iron loss rises with speed, copper and inverter
loss with current, whatever their form. At rest nothing is divided, so it is as well defined there
as anywhere. A weak penalty on curvature carries the map into corners without samples.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model.drive_models import LossMap
from robot_energy.physics.drives_and_cabinet import equal_heat_torque, knot_cells
from robot_energy.timeline.blocks import Float
from robot_energy_identify.drives.losses import COPPER_COEFFICIENT

if TYPE_CHECKING:
    from robot_energy_identify.drives.drives import AxisFit, AxisSamples

KNOTS = 7  # along speed and along torque
MIN_WINDOWS = 2 * KNOTS**2
CURVATURE = 5e-3  # weight against the RMS error: sixths of a parabola of 100 W cost 0.16 W
SLOPE = 1e-5  # the same, where nothing else says anything


def fit_loss_map(seen: AxisSamples, source: str = "") -> LossMap:
    """Return the loss map of one drive, motor side."""
    velocity, torque = seen.motor_velocity, seen.motor_torque
    speed = np.abs(velocity)
    degc = seen.motor_temperature_degc
    heating = torque if seen.constants is None else torque / seen.constants.left(degc)
    load = equal_heat_torque(heating, degc, COPPER_COEFFICIENT)
    row = np.unique(seen.window, return_inverse=True)[1]
    count = int(row.max()) + 1 if len(row) else 0
    if count < MIN_WINDOWS or not (speed.any() and load.any()):
        raise NotIdentifiableError(
            f"a loss map has {count} averages over 0.1 s",
            f"at least {MIN_WINDOWS}, in motion under load",
            "record longer, at several speeds and loads",
        )
    share = np.linspace(0.0, 1.0, KNOTS)
    speeds = float(speed.max()) * share**2  # fine near rest, where programs of work are
    loads = float(load.max()) * share
    size = np.bincount(row)
    columns = np.zeros((count, KNOTS * KNOTS))
    (i, x), (j, y) = knot_cells(speeds, speed), knot_cells(loads, load)
    for di, wx in ((0, 1.0 - x), (1, x)):
        for dj, wy in ((0, 1.0 - y), (1, y)):
            place = row * columns.shape[1] + (i + di) * KNOTS + j + dj
            columns += np.bincount(place, wx * wy, columns.size).reshape(columns.shape)
    target = np.bincount(row, seen.drive_power - velocity * torque) / size
    found = _monotone(columns / size[:, None], target, speeds, loads)
    return LossMap(
        motor_velocity=[float(f"{value:.6g}") for value in speeds],
        motor_torque=[float(f"{value:.6g}") for value in loads],
        loss=np.round(found, 4).tolist(),
        tag="identified",
        source=source,
    )


def _monotone(columns: Float, target: Float, speeds: Float, loads: Float) -> Float:
    """Least squares under ``L >= 0`` and rises along both axes, shape (KNOTS, KNOTS). [W]

    ``min |A x - b|, G x >= 0`` is a least distance problem in ``y = R x - Q' b``, which its dual,
    a fit with coefficients >= 0, solves exactly (Lawson and Hanson 1974, chapter 23).
    """
    from scipy.linalg import solve_triangular
    from scipy.optimize import nnls

    eye = np.eye(KNOTS)
    rises = [np.kron(np.diff(eye, axis=0), eye), np.kron(eye, np.diff(eye, axis=0))]
    bends = [np.kron(_bend(speeds), eye), np.kron(eye, _bend(loads))]
    scale = len(target) ** 0.5
    rows = [columns / scale, *(CURVATURE * part for part in bends)]
    rows += [SLOPE * part for part in rises]
    rows.append(SLOPE * np.eye(1, KNOTS * KNOTS))
    given = np.concatenate([target / scale, np.zeros(sum(len(part) for part in rows[1:]))])
    q, r = np.linalg.qr(np.vstack(rows))
    start = cast(Float, solve_triangular(r, q.T @ given))
    bounds = np.vstack([np.eye(1, KNOTS * KNOTS), *rises])
    inverse = solve_triangular(r, bounds.T, trans="T").T
    dual = np.vstack([inverse.T, -(bounds @ start)[None, :]])
    goal = np.append(np.zeros(len(dual) - 1), 1.0)
    away = dual @ nnls(dual, goal)[0] - goal
    moved = cast(Float, solve_triangular(r, -away[:-1] / away[-1]))
    found = (start + moved).reshape(KNOTS, KNOTS)
    # rounding leaves 1e-12 of the bounds open
    return np.maximum.accumulate(np.maximum.accumulate(np.maximum(found, 0.0), axis=0), axis=1)


def _bend(knots: Float) -> Float:
    """Change of slope at every inner knot times the mean width of its cells, (KNOTS - 2, KNOTS)."""
    width = np.diff(knots)
    slope = np.diff(np.eye(len(knots)), axis=0) / width[:, None]
    return np.diff(slope, axis=0) * (0.5 * (width[1:] + width[:-1]))[:, None]


def fitted_loss_map(axis: AxisFit, source: str) -> LossMap | None:
    """Return the entry of the loss map; None where the data do not determine it."""
    return None if axis.samples is None else fit_loss_map(axis.samples, source)
