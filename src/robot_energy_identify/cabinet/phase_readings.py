"""Readings of the meter inside one phase, such as rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_energy.physics.drives_and_cabinet import FanStage
from robot_energy.timeline.blocks import Float, Int, Phase
from robot_energy.timeline.pieces import NO_PIECES, CoveredPieces
from robot_energy_identify.data.recordings import Recording
from robot_energy_identify.data.rest import still_joints, window

MILLISECOND = 1_000_000  # ns
SETTLED = 500 * MILLISECOND  # after a motion, until the DC link and the drives are at rest
BEFORE_MOTION = 50 * MILLISECOND
LINK_AT_REST = 1.0  # W
EVENT_GAP = 1_000 * MILLISECOND  # readings further apart belong to different events


def holding(recording: Recording) -> NDArray[np.bool_]:
    """Return where no joint moves in most samples around, by the noise of the velocities.

    Not while the drives feed back, nor while a DC link that the model knows takes or gives.
    """
    power = recording.power
    resting = still_joints(recording).all(axis=1) & np.isin(power.phase, (Phase.HOLD, Phase.MOTION))
    resting &= np.abs(power.capacitor_power) <= LINK_AT_REST
    held = np.concatenate([[0], np.cumsum(resting)])
    first, last = window(power.stamp_ns)
    return np.asarray(held[last] - held[first] > 0.5 * (last - first))


def readings_inside(
    recording: Recording, phase: NDArray[np.bool_], after: int, before: int
) -> CoveredPieces:
    """Return the pieces of the meter's curve that lie inside one phase, away from its ends.

    Args:
        phase: Whether each sample is in the phase, shape (N,).
        after: From the begin of the phase to a piece at least. [ns]
        before: From a piece to the end of the phase at least. [ns]
    """
    meter = recording.meter
    if meter is None:
        return NO_PIECES
    stamp, segment = recording.power.stamp_ns, recording.power.segment
    outside = np.concatenate([[0], np.cumsum(~phase)])
    kept = NO_PIECES
    for part in recording.limits.pieces(meter):
        first = np.searchsorted(stamp, part.stamp_ns - after, side="left")
        last = np.searchsorted(stamp, part.end_ns + before, side="right")
        inside = (first > 0) & (last < len(stamp)) & (last > first)
        last = np.minimum(last, len(stamp))
        inside &= outside[last] == outside[np.minimum(first, last)]
        # what the robot does while its joint states stop is not known
        inside &= segment[first - 1] == segment[np.minimum(last, len(stamp) - 1)]
        kept = CoveredPieces.concatenate([kept, part[inside]])
    return kept


def at_rest(recording: Recording, rest: NDArray[np.bool_]) -> tuple[CoveredPieces, Float]:
    """Return pieces inside rest, and their power less what the model says the drives take. [W]

    Args:
        rest: Where no joint moves, shape (N,).
    """
    pieces = readings_inside(recording, rest, SETTLED, BEFORE_MOTION)
    return pieces, pieces.mean_power - recording.power.bus_power[row_of(recording, pieces)]


def row_of(recording: Recording, pieces: CoveredPieces) -> Int:
    """Return the sample in the middle of each piece."""
    middle = (pieces.stamp_ns + pieces.end_ns) // 2
    row = np.searchsorted(recording.power.stamp_ns, middle)
    return np.minimum(row, len(recording.power) - 1)


def fan_power(recording: Recording, pieces: CoveredPieces) -> Float | float:
    """Return the power of the model's fan in each piece. [W]"""
    fan = FanStage(recording.model.cabinet).step(recording.power.motor_temperature_degc)
    return fan[row_of(recording, pieces)] if isinstance(fan, np.ndarray) else fan


def parted(pieces: CoveredPieces, values: Float) -> list[Float]:
    """Return the values of the pieces of each phase.

    Args:
        values: One for each piece, shape (pieces,). [as given]
    """
    apart = pieces.stamp_ns[1:] - pieces.end_ns[:-1] > EVENT_GAP
    return np.split(values, np.flatnonzero(apart) + 1) if len(pieces) else []
