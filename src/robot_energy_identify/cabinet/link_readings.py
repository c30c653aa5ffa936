"""A meter at the grid next to a cabinet that runs with one DC link after the other.

A torque constant that is off changes the shaft power and, because the losses of the drives come
from the same readings, those as well; the two partly cancel. So each error that the energy of the
link depends on comes with what it moved in the fit of the drives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from robot_energy.model.figure import PositiveFigure
from robot_energy.model.schema import Cabinet, Capacitor
from robot_energy.physics.drives_and_cabinet import CabinetStage, FanStage
from robot_energy.timeline.blocks import NANOSECOND, Float, Int
from robot_energy.timeline.pieces import CoveredPieces
from robot_energy_identify.data.recordings import Recording
from robot_energy_identify.drives.all_drives import DrivesReport
from robot_energy_identify.drives.drive_data import COOL, block_length, winding_torque
from robot_energy_identify.drives.losses import COPPER_COEFFICIENT, loss_columns
from robot_energy_identify.drives.total_sums import COEFFICIENTS, Integrals, joined
from robot_energy_identify.friction.samples import bodies_identified
from robot_energy_identify.stats.lag import minimum
from robot_energy_identify.stats.regression import SCATTER
from robot_energy_identify.stats.systematic import BODIES, METER, THERMOMETER, TORQUE

COARSE = 16  # energies tried first,
FINE = 9  # and between the neighbours of the best one, twice
MIN_SHARE = 1e-3  # of the greatest energy that was fed back at once: least energy tried
MIN_FLOW = 1.0  # W into the brake resistor, or J in the link: above it there is some
SLOPE = 5.0  # W of the constant for its effect on the meter


@dataclass(frozen=True)
class LinkReadings:
    """Readings of the meter and what several cabinets would have shown.

    Attributes:
        measured: Shape (K,). [W]
        predicted: With every cabinet, shape (K, cabinets). [W]
        slope: Change of it with the constant of the DC side, same shape. [-]
        duration: That a reading stands for, shape (K,). [s]
        recording: Number of the recording, shape (K,).
        block: Number of the contiguous block, shape (K,).
    """

    measured: Float
    predicted: Float
    slope: Float
    duration: Float
    recording: Int
    block: Int

    def squares(self) -> Float:
        """Sums by block of r^2, r d and d^2, shape (blocks, 3, energies)."""
        rest = self.measured[:, None] - self.predicted
        parts = np.stack([rest * rest, rest * self.slope, self.slope * self.slope], axis=1)
        sums = np.zeros((int(self.block.max()) + 1, *parts.shape[1:]))
        np.add.at(sums, self.block, self.duration[:, None, None] * parts)
        return sums


def with_energy(cabinet: Cabinet, loss_dc: float, energy: float) -> Cabinet:
    """Return a cabinet with another constant and another link.

    Args:
        cabinet: All else stays as in it.
        loss_dc: Constant of the DC side. [W]
        energy: Of the link; 0 for none. [J]
    """
    update: dict[str, PositiveFigure | Capacitor | None] = {
        "loss_dc": cabinet.loss_dc.model_copy(update={"value": loss_dc}),
        "capacitor": None,
    }
    if energy > 0.0:
        low, high, size = (
            PositiveFigure(value=value, tag="assumed") for value in (0.0, 1.0, 2.0 * energy)
        )
        update["capacitor"] = Capacitor(capacitance=size, nominal_voltage=low, chopper_voltage=high)
    return cabinet.model_copy(update=update)


def tried(
    metered: Sequence[Recording], cabinet: Cabinet, base: float, top: float
) -> tuple[Float, LinkReadings]:
    """Return energies (K,) [J], rising, closer and closer to the best, and the readings with each.

    Args:
        cabinet: All else stays as in it.
        base: Constant of the DC side. [W]
        top: Greatest energy to try. [J]
    """
    data: LinkReadings | None = None
    energies, least = np.empty(0), max(MIN_SHARE * top, MIN_FLOW)
    new = np.append(0.0, least * (top / least) ** (np.arange(COARSE) / (COARSE - 1)))
    for _ in range(3):
        cabinets = [with_energy(cabinet, base, energy) for energy in new.tolist()]
        more = [with_energy(cabinet, base + SLOPE, energy) for energy in new.tolist()]
        part = readings_of(metered, [*cabinets, *more])
        predicted, other = np.hsplit(part.predicted, 2)
        slope = (other - predicted) / SLOPE
        if data is not None:
            predicted = np.hstack([data.predicted, predicted])
            slope = np.hstack([data.slope, slope])
        energies = np.concatenate([energies, new])
        order = np.argsort(energies)
        energies = energies[order]
        data = replace(part, predicted=predicted[:, order], slope=slope[:, order])
        best = int(np.argmin(squared_error(data.squares().sum(axis=0))))
        low, high = energies[max(best - 1, 0)], energies[min(best + 1, len(energies) - 1)]
        new = low + (high - low) * np.arange(1, FINE) / FINE
        new = new[~np.isin(new, energies)]
    assert data is not None
    return energies, data


def readings_of(
    metered: Sequence[Recording],
    cabinets: Sequence[Cabinet],
    change: Sequence[Float] | None = None,
) -> LinkReadings:
    """Return the means of every cabinet that is run, over the same time as each reading.

    Args:
        cabinets: One after the other.
        change: Added to the power of the drives in each recording, shape (N,) each. [W]
    """
    parts: list[tuple[CoveredPieces, Float, Int]] = []
    for number, recording in enumerate(metered):
        power, meter = recording.power, recording.meter
        assert meter is not None
        stamp, segment, bus = power.stamp_ns, power.segment, power.bus_power
        if change is not None:
            bus = bus + change[number]
        fan = FanStage(cabinets[0]).step(power.motor_temperature_degc)
        grid = np.column_stack(
            [CabinetStage(entry).step(stamp, segment, bus, fan).grid_power for entry in cabinets]
        )
        integrals = Integrals(stamp, segment, grid)
        for pieces in recording.limits.pieces(meter):
            kept, means = integrals.means(pieces)
            parts.append((kept, means, np.full(len(kept), number)))
    pieces, predicted, recording = joined(parts, "the robot")
    duration = pieces.duration
    length = block_length(float(duration.sum()))
    origin = np.asarray([part.power.stamp_ns[0] for part in metered])[recording]
    place = np.stack([recording, (pieces.stamp_ns - origin) // round(length / NANOSECOND)])
    return LinkReadings(
        pieces.mean_power,
        predicted,
        predicted,
        duration,
        recording,
        np.unique(place, axis=1, return_inverse=True)[1].ravel(),
    )


def squared_error(squares: Float) -> Float:
    """Return the squared error with every energy, the constant free. [W^2 s]

    Args:
        squares: From `LinkReadings.squares`, summed over blocks, shape (3, energies).
            [W^2 s], [W s] and [s]
    """
    return squares[0] - squares[1] ** 2 / np.maximum(squares[2], np.finfo(float).tiny)


def best_energy(energies: Float, squares: Float) -> tuple[float, float]:
    """Return the energy of the least error [J] and the shift of the constant there. [W]

    Args:
        energies: Rising, shape (K,). [J]
        squares: Of each, as of `squared_error`, shape (3, K). [W^2 s]
    """
    error = squared_error(squares)
    shift = squares[1] / np.maximum(squares[2], np.finfo(float).tiny)
    return minimum(energies, error)[0], float(shift[np.argmin(error)])


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
