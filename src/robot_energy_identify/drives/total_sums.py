"""One power meter and all drives, brought to the same pieces of time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.physics.drivetrain import motor_standstill
from robot_energy.timeline.blocks import NANOSECOND, Float, Int, MeterLocation, Rows
from robot_energy.timeline.pieces import NO_PIECES, CoveredPieces
from robot_energy_identify.data.thinned import few
from robot_energy_identify.drives.drive_data import DriveData, location
from robot_energy_identify.stats.cross_validation import averaged
from robot_energy_identify.stats.systematic import DEFAULT_LIMITS, SensorLimits

COEFFICIENTS = ("copper", "linear", "quadratic")
MIN_READINGS = 20


class Sums(Rows):
    """Pieces between readings of the meter, with the means of what the drives do in them."""

    names: tuple[str, ...]
    location: Annotated[MeterLocation, "Where the meter sits."]
    duration: Annotated[Float, "Shape (K,). [s]"]
    measured: Annotated[Float, "Mean power less that of the fan, shape (K,). [W]"]
    shaft: Annotated[Float, "Sum of the shaft powers, shape (K,). [W]"]
    terms: Annotated[Float, "Copper, linear and quadratic column of every joint, shape (K, 3, n)."]
    given: Annotated[
        Float,
        "What the model's own drives draw, without cabinet, shape (K,). NaN without a model. [W]",
    ]
    drives: Annotated[
        Float, "Sum of the measured powers of the drives, shape (K,); NaN where unknown. [W]"
    ]
    recording: Annotated[Int, "Shape (K,)."]
    block: Annotated[Int, "Shape (K,)."]
    scale: Annotated[
        tuple[Float, ...], "Of each joint's coefficients where axes share them, shape (n,) each."
    ]
    shares: Annotated[
        Float, "Shaft power of every joint by `DriveData.torque_share`, shape (K, n). [W]"
    ]
    sensors: SensorLimits = DEFAULT_LIMITS
    deviations: Annotated[
        bool, "Whether a fit of it needs them, or only predicts what was held out."
    ] = True
    viscous: Annotated[
        Float | None,
        "Power by which the viscous friction of every joint is off at one deviation of its "
        "law, shape (K, n); None where the torque is measured. [W]",
    ] = None
    fan: Annotated[
        Float | None, "Power of the fan, shape (K,); None without one that the meter sees. [W]"
    ] = None


def sums(data: DriveData, model: RobotModel | None) -> Sums:
    """Return meter and drives on the same pieces of time; of many pieces some, evenly taken.

    Args:
        model: Where coefficients are shared between axes, its own losses say in which
            ratio, else its torque constants, else they are alike. None for a log.
    """
    place = location(data)
    if place is None:
        raise NotIdentifiableError(
            "the recordings have no power meter, or meters in different places",
            "measured power of all drives at the DC bus or the grid",
            "record the meter's topic, or name its columns in the mapping",
        )
    columns = _columns(data, model)
    parts: list[tuple[CoveredPieces, Float, Int]] = []
    for number, meter in enumerate(data.meters):
        samples = data.samples_of(number)
        stamp = data.stamp_ns[samples]
        if meter is None or len(stamp) < 2:
            continue
        integrals = Integrals(stamp, data.stretch[samples], columns[samples])
        for pieces in data.limits[number].pieces(meter):
            kept, means = integrals.means(pieces)
            middle = np.searchsorted(stamp, (kept.stamp_ns + kept.end_ns) // 2)
            parts.append((kept, means, samples.start + np.clip(middle, 0, len(stamp) - 1)))
    pieces, means, rows = joined(parts, "the drives")
    window, recording = data.window[rows], data.recording[rows]
    first = np.diff(window, prepend=-1) != 0
    span = pieces.duration
    duration = averaged(span, window)

    def mean(values: Float) -> Float:
        weight = span if values.ndim == 1 else span[:, None]
        total = averaged(values * weight, window)
        return total / (duration if values.ndim == 1 else duration[:, None])

    means = mean(means)
    seen = data.fan_power is not None and place is MeterLocation.GRID
    fan = means[:, -1] if seen else None
    measured = mean(pieces.mean_power)
    shares, viscous = (
        slice(3 + count * len(data.names), 3 + (count + 1) * len(data.names)) for count in (3, 4)
    )
    found = Sums(
        data.names,
        place,
        duration * np.diff(np.append(np.flatnonzero(first), len(window))),
        measured if fan is None else measured - fan,
        means[:, 0],
        means[:, 3 : 3 + 3 * len(data.names)].reshape(-1, 3, len(data.names)),
        means[:, 1],
        means[:, 2],
        recording[first],
        data.block[rows][first],
        tuple(_scale(data, model)),
        means[:, shares],
        data.sensors,
        viscous=None if data.viscous_off is None else means[:, viscous],
        fan=fan,
    )
    return found[few(len(found))]


def resting(data: Sums, model: RobotModel) -> NDArray[np.bool_]:
    """Return the pieces in which no motor moves, shape (K,)."""
    speed = data.terms[:, COEFFICIENTS.index("linear")]
    return np.asarray((speed <= motor_standstill(model)).all(axis=1))


def _columns(data: DriveData, model: RobotModel | None) -> Float:
    """Shaft power, drives as given and measured, terms, shares, viscous, fan; (N, 4 + 5 n)."""
    given = np.full(len(data), np.nan)
    if model is not None:
        from robot_energy.physics.drives_and_cabinet import drive_from_model

        given = data.input_power(drive_from_model(model)).sum(axis=1)
    measured = data.drive_power.sum(axis=1)
    terms = data.loss_columns()[:, :, 1:].swapaxes(1, 2).reshape(len(data), -1)
    shares = data.torque_share * data.motor_velocity
    every = [data.supplied_power, given, measured, terms, shares]
    if data.viscous_off is not None:
        every.append(data.viscous_off)
    if data.fan_power is not None:
        every.append(data.fan_power)
    return np.column_stack(every)


def joined(
    parts: Sequence[tuple[CoveredPieces, Float, Int]], of: str
) -> tuple[CoveredPieces, Float, Int]:
    """Return pieces, means over them and a number of each, all put together.

    Args:
        parts: Pieces, means of shape (K, columns) and numbers of shape (K,), in the order of
            time. [W]
    """
    pieces = NO_PIECES
    for part, _, _ in parts:
        pieces = CoveredPieces.concatenate([pieces, part])
    if len(pieces) < MIN_READINGS:
        raise NotIdentifiableError(
            f"{len(pieces)} readings of the meter lie inside the samples of {of}",
            f"at least {MIN_READINGS}",
            "record longer, with the meter running",
        )
    means = np.concatenate([means for _, means, _ in parts])
    return pieces, means, np.concatenate([numbers for _, _, numbers in parts])


class InsidePieces(Described):
    """Pieces inside samples."""

    pieces: CoveredPieces
    gone: Annotated[NDArray[np.bool_], "Whether a column is unknown in a piece, (pieces, K)."]
    begin: Annotated[tuple[Int, Float], "Sample before the begin of each; share of a step after."]
    end: Annotated[tuple[Int, Float], "The same of its end."]


class Integrals:
    """Integrals of columns over time by trapezoids, from which means over any pieces follow.

    Args:
        stamp: Of the samples, shape (N,). [ns]
        stretch: Number of the uninterrupted stretch of each sample, shape (N,).
        columns: Shape (N, K); a piece with a NaN in the first column is left out.
            [W] or [W/coefficient]
    """

    def __init__(self, stamp: Int, stretch: Int, columns: Float) -> None:
        self._stamp, self._stretch = stamp, stretch
        step = np.diff(stamp)[:, None] * NANOSECOND
        self._area = np.zeros(columns.shape)
        known = np.add(columns[1:], columns[:-1], out=self._area[1:])  # in place, as all below
        known *= 0.5
        known *= step
        np.nan_to_num(known, copy=False)  # a gap must not spread
        np.cumsum(known, axis=0, out=known)
        unknown = np.isnan(columns)
        unknown[:, 0] = ~np.isfinite(columns[:, 0])
        self._gone = np.zeros((len(columns) + 1, columns.shape[1]), dtype=np.int32)
        np.cumsum(unknown, axis=0, out=self._gone[1:])

    def means(self, pieces: CoveredPieces) -> tuple[CoveredPieces, Float]:
        """Return the pieces inside the samples and the mean of every column over each.

        Returns:
            The pieces that are left, and means, shape (pieces, K); NaN where another column is
            NaN.
        """
        inside = self.inside(pieces)
        return inside.pieces, self.means_of(inside)

    def inside(self, pieces: CoveredPieces) -> InsidePieces:
        """Return the pieces inside the samples; the same for columns unknown in the same places."""
        stamp = self._stamp
        first = np.searchsorted(stamp, pieces.stamp_ns, side="right") - 1
        last = np.searchsorted(stamp, pieces.end_ns, side="left")
        inside = (first >= 0) & (last < len(stamp))
        first, last = np.clip(first, 0, len(stamp) - 1), np.clip(last, 0, len(stamp) - 1)
        gone = self._gone[last + 1] - self._gone[first] > 0
        inside &= (self._stretch[first] == self._stretch[last]) & ~gone[:, 0]
        kept = pieces[inside]
        begin, end = self._at(kept.stamp_ns, first[inside]), self._at(kept.end_ns, last[inside])
        return InsidePieces(kept, gone[inside], begin, end)

    def means_of(self, inside: InsidePieces) -> Float:
        """Return the mean of every column over each piece, shape (pieces, K)."""
        area = self._until(*inside.end) - self._until(*inside.begin)
        return np.where(inside.gone, np.nan, area / inside.pieces.duration[:, None])

    def _at(self, at: Int, near: Int) -> tuple[Int, Float]:
        """The samples before instants, of which that before or behind is known; share after it."""
        before = np.clip(np.where(self._stamp[near] > at, near - 1, near), 0, len(self._stamp) - 2)
        low, high = self._stamp[before], self._stamp[before + 1]
        return before, ((at - low) / np.maximum(high - low, 1))[:, None]

    def _until(self, before: Int, share: Float) -> Float:
        """The integrals up to instants."""
        return self._area[before] * (1.0 - share) + self._area[before + 1] * share


def _scale(data: DriveData, model: RobotModel | None) -> Float:
    """Ratio of the coefficients between axes, from what the model knows."""
    scale = np.ones((3, len(data.names)))
    if model is None:
        return scale
    losses = [joint.losses for joint in model.joints]
    if all(entry is not None for entry in losses):
        for row, name in enumerate(COEFFICIENTS):
            values = np.asarray([getattr(entry, name).value for entry in losses])
            if values.max() > 0:
                scale[row] = values
        return scale
    constants = [joint.torque_constant for joint in model.joints]
    known = [figure.value for figure in constants if figure is not None]
    if len(known) == len(constants):
        scale[0] = 1.0 / np.asarray(known) ** 2
    return scale
