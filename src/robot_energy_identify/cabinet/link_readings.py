"""A meter at the grid next to a cabinet that runs with one DC link after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_energy.model.figure import PositiveFigure
from robot_energy.model.schema import Cabinet, Capacitor
from robot_energy.physics.drives_and_cabinet import CabinetStage, FanStage
from robot_energy.timeline.blocks import NANOSECOND, Float, Int
from robot_energy.timeline.pieces import CoveredPieces
from robot_energy_identify.data.recordings import Recording
from robot_energy_identify.drives.drive_data import block_length
from robot_energy_identify.drives.total_sums import Integrals, joined
from robot_energy_identify.stats.lag import minimum

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
