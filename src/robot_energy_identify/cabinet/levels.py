"""A fan of the cabinet, by the levels of recordings with it and without it.

Where no recording shows the step of a fan, some may have it all the time and others never. The
power of the meter less the shaft power is, at temperature T of the warmest motor,

    P_k + sum_i k_i (1 + alpha (T_i - 20)) tau_i^2 + c1 |w| + c2 w^2

with a level P_k of its own for each recording and every 2 K in it. Levels follow
``C + b T + P (T > T_on)``. What is warm has the slope b. T_on lies between the warmest level
without the fan and the coldest with it. Levels of one recording have an error in common, as
payload, poses and program are its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_energy.physics.drives_and_cabinet import warmest_degc
from robot_energy.timeline.blocks import Float, Int
from robot_energy_identify.data.recordings import Recording
from robot_energy_identify.drives.drive_data import drive_data
from robot_energy_identify.drives.losses import fit_losses
from robot_energy_identify.drives.total_sums import sums

WIDTH = 2.0  # K of a level
BLOCKS = 3  # of 5 s, that show a level
OF_RECORDING, OF_LEVEL = 0.03, 0.005  # of the power: errors of recordings, and of levels in one
LIKELY = 2.0  # deviations by which another start may be less likely


@dataclass(frozen=True)
class FanLevels:
    """Power of the meter less that of the drives, by recording and temperature.

    Attributes:
        names: Of the recordings.
        recording: Number of each one's recording, shape (C,).
        degc: Highest that any motor had so far, shape (C,). [degC]
        power: Of the meter less that of the drives, shape (C,). [W]
        covariance: By scatter, shape (C, C). [W^2]
    """

    names: tuple[str, ...]
    recording: Int
    degc: Float
    power: Float
    covariance: Float

    def __str__(self) -> str:
        """Say the mean of each recording, and the temperatures of its levels."""
        texts: list[str] = []
        for number in np.unique(self.recording):
            own = self.recording == number
            low, high = self.degc[own].min(), self.degc[own].max()
            degc = f"{low:.0f}" if high - low < WIDTH else f"{low:.0f} to {high:.0f}"
            texts.append(f"{self.names[number]} {self.power[own].mean():.0f} W at {degc} degC")
        return ", ".join(texts)


@dataclass(frozen=True)
class LevelStep:
    """A step of levels over temperature.

    Attributes:
        power: Above it less below. [W]
        std: [W]
        score: Its size in deviations.
        below: Warmest level from which it may start. [degC]
        above: Coldest level at which it may have started. [degC]
        recordings: With levels above it.
    """

    power: float
    std: float
    score: float
    below: float
    above: float
    recordings: int


def levels_of(
    recordings: Sequence[Recording], thermometers: tuple[float, ...] | None = None
) -> FanLevels:
    """Return the levels of recordings with temperatures and a meter at the grid.

    Args:
        thermometers: As of `robot_energy.physics.drives_and_cabinet.warmest_degc`. [K]

    Raises:
        NotIdentifiableError: If readings are too few.
    """
    data = drive_data(recordings, [None] * len(recordings), measured_torque=False)
    pieces = sums(data, recordings[0].model)
    warmest = np.concatenate(
        [
            np.fmax.accumulate(warmest_degc(part.power.motor_temperature_degc, thermometers))
            for part in recordings
        ]
    )
    count = np.bincount(data.block)
    degc = (np.bincount(data.block, warmest) / np.maximum(count, 1))[pieces.block]
    names = tuple(dict.fromkeys(part.path.name for part in recordings))
    number = np.array([names.index(part.path.name) for part in recordings])[pieces.recording]
    known = np.isfinite(degc)
    place = np.column_stack([number, np.round(np.where(known, degc, 0.0) / WIDTH)])
    every, own = np.unique(place, axis=0, return_inverse=True)
    own = own.reshape(-1)
    used = [
        cell for cell in range(len(every))
        if len(np.unique(pieces.block[known & (own == cell)])) >= BLOCKS
    ]  # fmt: skip
    rows = known & np.isin(own, used)
    of_levels = own[rows, None] == np.array(used, dtype=np.int64)
    losses = [
        pieces.terms[:, 0],
        *((pieces.terms[:, k] @ pieces.scale[k])[:, None] for k in (1, 2)),
    ]
    columns = np.column_stack([of_levels, np.column_stack(losses)[rows]])
    fit = fit_losses(
        columns, (pieces.measured - pieces.shaft)[rows], pieces.block[rows],
        [str(column) for column in range(columns.shape[1])], "the meter's readings",
    ).fit  # fmt: skip
    assert fit is not None
    found = {name: at for at, name in enumerate(fit.names)}
    shown = [column for column in range(len(used)) if str(column) in found]
    at = [found[str(column)] for column in shown]
    return FanLevels(
        names,
        every[[used[column] for column in shown], 0].astype(np.int64),
        np.array([degc[rows][of_levels[:, column]].mean() for column in shown]),
        fit.values[at],
        fit.covariance[np.ix_(at, at)],
    )


def level_step(levels: FanLevels) -> LevelStep | None:
    """Return the surest step of the levels; None where they are too few.

    It is sure next to a slope, as what is warm may draw more, and without one, as a curve that
    falls and flattens looks like a slope and a step up. No recording has levels on both sides:
    what changes within one is a step at rest, or no fan.
    """
    if not len(levels.power):
        return None
    size = float(np.median(levels.power))
    same = levels.recording[:, None] == levels.recording
    errors = (OF_RECORDING * size) ** 2 * same + (OF_LEVEL * size) ** 2 * np.eye(len(same))
    weight: Float = np.asarray(np.linalg.inv(levels.covariance + errors), dtype=np.float64)
    one, slope = np.ones(len(same)), levels.degc - levels.degc.mean()
    degc = np.unique(levels.degc)
    limits = 0.5 * (degc[1:] + degc[:-1])
    best: LevelStep | None = None
    left = np.full(len(limits), np.inf)
    for place, limit in enumerate(limits):
        on = levels.degc > limit
        if np.intersect1d(levels.recording[on], levels.recording[~on]).size:
            continue
        power, std, left[place] = _step(np.column_stack([one, slope, on]), levels.power, weight)
        alone, alone_std, _ = _step(np.column_stack([one, on]), levels.power, weight)
        score = min(power / std, alone / alone_std)
        if best is None or score > best.score:
            runs = len(np.unique(levels.recording[on]))
            best = LevelStep(power, std, score, degc[place], degc[place + 1], runs)
    if best is None:
        return None
    scale = max(float(left.min()) / max(len(same) - 4, 1), 1.0)
    alike = np.flatnonzero(left <= left.min() + LIKELY**2 * scale)
    return replace(best, below=float(degc[alike[0]]), above=float(degc[alike[-1] + 1]))


def _step(columns: Float, power: Float, weight: Float) -> tuple[float, float, float]:
    """Last coefficient of weighted least squares, its deviation, and the weighted square left.

    The deviation grows where more is left than scatter. It is infinite where others explain it.
    """
    covariance = np.linalg.pinv(columns.T @ weight @ columns)
    values = covariance @ (columns.T @ weight @ power)
    rest = power - columns @ values
    square = float(rest @ weight @ rest)
    scale = max(square / max(len(power) - columns.shape[1], 1), 1.0)
    if np.linalg.matrix_rank(columns) < columns.shape[1]:
        return 0.0, np.inf, square
    return float(values[-1]), float(np.sqrt(scale * covariance[-1, -1])), square
