"""A meter at the grid beside a cabinet that runs with one DC link after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from robot_energy.blocks import NANOSECOND, Float, Int
from robot_energy.identify.data.recordings import Recording
from robot_energy.identify.drives.drive_data import block_length, held_energy
from robot_energy.identify.drives.total_sums import joined, piece_means
from robot_energy.identify.stats.lag import minimum
from robot_energy.model.figure import PositiveFigure
from robot_energy.model.schema import Cabinet, Capacitor
from robot_energy.physics.cabinet import CabinetStage
from robot_energy.timeline.pieces import CoveredPieces

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


def rebalanced(recording: Recording, cabinet: Cabinet) -> Recording:
    """Return a recording as if its model had another cabinet; what was compared stays out.

    Args:
        recording: Run with a model.
        cabinet: The other one.
    """
    power = recording.power
    flows = CabinetStage(cabinet).step(power.stamp_ns, power.segment, power.bus_power)
    return replace(
        recording,
        model=recording.model.model_copy(update={"cabinet": cabinet}),
        power=replace(power, **flows.__dict__),
        compared=(),
    )


def fed_at_once(part: Recording, loss_dc: float) -> float:
    """Return the most energy that was fed back and not yet drawn again. [J]

    Args:
        part: A recording.
        loss_dc: Constant of the DC side. [W]
    """
    power = part.power
    return float(held_energy(power.bus_power + loss_dc, power.stamp_ns, power.segment).max())


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
    """Try energies, closer and closer to the best, with a constant and a little more of it.

    Args:
        metered: Recordings with a meter.
        cabinet: All else stays as in it.
        base: Constant of the DC side. [W]
        top: Greatest energy to try. [J]

    Returns:
        Energies, rising, shape (K,) [J], and the readings with each of them.
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
    """Run every cabinet, and take the means over the same time as each reading.

    Args:
        metered: Recordings with a meter.
        cabinets: One after the other.
        change: Added to the power of the drives in each recording, shape (N,) each. [W]

    Returns:
        The readings, with one prediction for every cabinet.
    """
    parts: list[tuple[CoveredPieces, Float, Int]] = []
    for number, recording in enumerate(metered):
        power, meter = recording.power, recording.meter
        assert meter is not None
        stamp, segment, bus = power.stamp_ns, power.segment, power.bus_power
        if change is not None:
            bus = bus + change[number]
        grid = np.column_stack(
            [CabinetStage(entry).step(stamp, segment, bus).grid_power for entry in cabinets]
        )
        for pieces in recording.limits.pieces(meter):
            kept, means = piece_means(pieces, stamp, segment, grid)
            parts.append((kept, means, np.full(len(kept), number)))
    pieces, predicted, recording = joined(parts, "the robot")
    duration = pieces.duration
    length = block_length(float(duration.sum()))
    origin = np.asarray([part.power.stamp_ns[0] for part in metered])[recording]
    place = np.stack([recording, (pieces.start_ns - origin) // round(length / NANOSECOND)])
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


def energy_moves(
    metered: Sequence[Recording],
    cabinet: Cabinet,
    energies: Float,
    data: LinkReadings,
    changes: Sequence[tuple[Sequence[Float], float]],
) -> Float:
    """Return by how much the best energy moves if the power of the drives or the meter is off.

    Gauss-Newton about the best cabinet, its constant free: ``(dE, dc) = (D' D)^-1 D' (dm - dp)``
    with D the slopes of the readings, dm the change of the readings and dp what the change of
    the drives makes of their prediction.

    Args:
        metered: Recordings with a meter.
        cabinet: The best one.
        energies: Tried, rising, shape (K,). [J]
        data: Readings with each of them.
        changes: For each error, of the power of the drives by recording, shape (N,) each [W],
            and of the gain of the meter [-].

    Returns:
        One for each error. [J]
    """
    size = 0.0 if cabinet.capacitor is None else cabinet.capacitor.swing
    place = int(np.clip(np.searchsorted(energies, size), 1, len(energies) - 2))
    low, high = place - 1, place + 1
    slope = (data.predicted[:, high] - data.predicted[:, low]) / (energies[high] - energies[low])
    root = np.sqrt(data.duration)
    columns = np.stack([slope, data.slope[:, place]], axis=1) * root[:, None]
    own = readings_of(metered, [cabinet]).predicted[:, 0]
    moves: list[float] = []
    for change, gain in changes:
        shown = readings_of(metered, [cabinet], change).predicted[:, 0] - own
        rest = gain * data.measured - shown
        moves.append(float(np.linalg.lstsq(columns, root * rest, rcond=None)[0][0]))
    return np.asarray(moves)


def braking_time(metered: Sequence[Recording], loss_dc: float) -> float:
    """Return the median time for which the drives feed back more than the DC side uses. [s]

    Args:
        metered: Recordings.
        loss_dc: Constant of the DC side. [W]
    """
    times = [
        (part.power.stamp_ns[last - 1] - part.power.stamp_ns[first]) * NANOSECOND
        for part in metered
        for first, last in _runs(part.power.bus_power + loss_dc < 0.0)
    ]
    return float(np.median([time for time in times if time > 0.0] or [0.0]))


def use_of(metered: Sequence[Recording], cabinet: Cabinet) -> tuple[int, float]:
    """Return how often a link was full, and the median time for which it holds energy. [s]

    Args:
        metered: Recordings.
        cabinet: With the link.
    """
    events, times = 0, [0.0]
    for part in metered:
        power = part.power
        stamp, segment = power.stamp_ns, power.segment
        flows = CabinetStage(cabinet).step(stamp, segment, power.bus_power)
        step = np.diff(stamp, prepend=stamp[:1]) * NANOSECOND
        stored = np.cumsum(np.nan_to_num(flows.capacitor_power) * step)
        first = np.flatnonzero(np.diff(segment, prepend=segment[0] - 1))  # empty there
        stored -= np.repeat(stored[first], np.diff(np.append(first, len(stored))))
        holds = _runs(stored > MIN_FLOW)
        full = np.concatenate([[0], np.cumsum(flows.brake_power > MIN_FLOW)])
        events += sum(bool(full[last] > full[first]) for first, last in holds)
        times += [(stamp[last - 1] - stamp[first]) * NANOSECOND for first, last in holds]
    return events, float(np.median(times[1:] or times))


def _runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(first), int(last)) for first, last in edges.reshape(-1, 2)]
