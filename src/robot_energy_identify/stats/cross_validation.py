"""How recordings are split for the test of a fit, and how good it is on what it has not seen.

Held-out data are contiguous: neighbouring samples are alike, so a random split would test
on what it trained on. Energy errors of fitted data are zero by construction wherever a
viscous column is fitted, and are therefore never given.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Annotated, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import Described
from robot_energy.timeline.blocks import NANOSECOND, Float, Int

Mask = NDArray[np.bool_]
Kind = Literal["recordings", "blocks"]
Name = TypeVar("Name", bound=str)
FOLDS = 5
UNRESOLVED = 0.0025
"""Share of an energy: half of what a meter of class 0.5 may be off. [-]"""
GAIN = 0.98  # what has more parameters, or replaces figures, must be better by this factor


class HeldOut(Described):
    """Errors on held-out data."""

    folds: Annotated[int, "Number of folds."]
    rms: Annotated[float, "Root mean square of the error, in the unit of the target."]
    relative: Annotated[float, "Norm of the error over the norm of the target. [-]"]


class EnergyScore(Described):
    """A prediction of a meter, on held-out readings."""

    rms: Annotated[float, "Of predicted minus measured power. [W]"]
    energy_error: Annotated[float, "Predicted over measured energy - 1, mean size of folds. [-]"]
    worst: Annotated[float, "The greatest of them in size. [-]"]
    shares: Annotated[tuple[float, ...], "Of each fold, signed. [-]"] = ()

    def beats(self, given: EnergyScore) -> bool:
        """Whether figures of this prediction may replace those of another one.

        They must predict power better, and energy as well.
        """
        return self.rms < GAIN * given.rms and self.as_good_as(given)

    def as_good_as(self, given: EnergyScore) -> bool:
        """Whether this prediction is not worse than another one.

        Energy may be worse by what the folds cannot determine: one standard error of the
        difference, fold by fold, or `UNRESOLVED`.
        """
        sure = UNRESOLVED
        if len(self.shares) == len(given.shares) > 1:
            apart = np.abs(self.shares) - np.abs(given.shares)
            sure = max(sure, float(np.std(apart, ddof=1)) / len(apart) ** 0.5)
        return self.rms <= given.rms and self.energy_error <= given.energy_error + sure


def contiguous_blocks(stamp_ns: Int, segment: Int, length: float) -> Int:
    """Return the block of each sample, rising from 0 in order of first appearance, shape (N,).

    Args:
        stamp_ns: Shape (N,). [ns]
        segment: No block spans two of them, shape (N,).
        length: Of a block, at most. [s]
    """
    if not len(stamp_ns):
        return np.empty(0, dtype=np.int64)
    starts = np.flatnonzero(np.diff(segment, prepend=segment[0] - 1) != 0)
    origin = stamp_ns[starts][np.searchsorted(starts, np.arange(len(stamp_ns)), side="right") - 1]
    within = (stamp_ns - origin) // round(length / NANOSECOND)
    change = (np.diff(segment, prepend=segment[0]) != 0) | (np.diff(within, prepend=0) != 0)
    return np.cumsum(change).astype(np.int64)


def averaged(values: Float, window: Int) -> Float:
    """Return the mean of every window.

    Args:
        values: Shape (N, K) or (N,). [any unit]
        window: Number of the window of each row, rising, shape (N,).
    """
    first = np.flatnonzero(np.diff(window, prepend=window[:1] - 1))
    size = np.diff(np.append(first, len(window)))
    total = np.add.reduceat(values, first, axis=0)
    return total / (size if values.ndim == 1 else size[:, None])


def contiguous_folds(count: int, folds: int = FOLDS) -> Int:
    """Return the fold of each of some samples, contiguous and of equal size, shape (count,)."""
    return np.minimum(np.arange(count) * folds // max(count, 1), folds - 1).astype(np.int64)


def folds_by_value(values: Float, folds: int = FOLDS) -> Int:
    """Return folds of equal size by a quantity, such as the temperature, rising, shape (N,).

    Args:
        values: Of each sample, shape (N,), finite. [any unit]
    """
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, folds + 1)[1:-1]))
    return np.searchsorted(edges, values, side="right").astype(np.int64)


def recordings_or_blocks(recording: Int, block: Int | None = None) -> tuple[Kind, Int]:
    """Return what is held out, and the fold of each sample, shape (N,).

    Whole recordings where there are several, else contiguous parts of the only one.

    Args:
        recording: Number of the recording of each sample, rising, shape (N,).
        block: Blocks that no two folds may share, from 0 on, shape (N,); None: each sample.
    """
    if recording[0] != recording[-1]:
        return "recordings", recording
    if block is None:
        return "blocks", contiguous_folds(len(recording))
    return "blocks", contiguous_folds(int(block.max()) + 1)[block]


def splits(fold: Int, guard: int = 0) -> Iterator[tuple[Mask, Mask]]:
    """Yield training and test samples of every fold.

    Args:
        fold: Fold of each sample, shape (N,); contiguous where there is a guard.
        guard: Samples left out of the training on both sides of the fold.
    """
    for name in np.unique(fold):
        test = fold == name
        train = ~test
        if guard:
            rows = np.flatnonzero(test)
            train[max(int(rows[0]) - guard, 0) : int(rows[-1]) + guard + 1] = False
        yield train, test


def predict_held_out(fold: Int, predict: Callable[[Mask, Mask], Float], guard: int = 0) -> Float:
    """Return predictions of every fold from the others, shape (N, ...), folds as in `splits`.

    ``predict`` gets the masks of training and test samples, and returns the latter predicted.
    """
    parts = [(test, predict(train, test)) for train, test in splits(fold, guard)]
    predicted = np.empty((len(fold), *parts[0][1].shape[1:]))
    for test, part in parts:
        predicted[test] = part
    return predicted


def held_out(target: Float, fold: Int, predict: Callable[[Mask, Mask], Float]) -> HeldOut:
    """Return the error over all folds, each predicted from the others.

    Args:
        target: Shape (N,) or (N, n). [any unit]
        fold: Fold of each sample, shape (N,).
        predict: As of `predict_held_out`.
    """
    error = predict_held_out(fold, predict) - target
    return HeldOut(
        len(np.unique(fold)),
        float(np.linalg.norm(error)) / np.sqrt(target.size),
        relative_error(error, target),
    )


def simplest(errors: Mapping[Name, float]) -> Name:
    """Return the first of some models that no later one beats by a margin.

    Args:
        errors: Held-out error of each, the simplest first. [any unit]
    """
    chosen, *others = errors
    for name in others:
        if errors[name] < GAIN * errors[chosen]:
            chosen = name
    return chosen


def rms_of(values: Float) -> float:
    """Return the root mean square of some values; NaN of none.

    Args:
        values: Any shape. [any unit]
    """
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def relative_error(error: Float, reference: Float) -> float:
    """Return the norm of an error over that of its reference; NaN where that is 0.

    Args:
        error: Any shape. [any unit]
        reference: Same shape. [any unit]
    """
    size = float(np.linalg.norm(reference))
    return float(np.linalg.norm(error)) / size if size > 0 else float("nan")


def energy_score(
    predicted: Float, measured: Float, duration: Float, fold: Int, weight: Float | None = None
) -> EnergyScore:
    """Return the score of a prediction of a meter.

    Args:
        predicted: Shape (N,). [W]
        measured: Shape (N,). [W]
        duration: That each stands for, shape (N,). [s]
        fold: Shape (N,).
        weight: Of each in the RMS error; None for all alike, shape (N,). [-]
    """
    error, place = predicted - measured, np.unique(fold, return_inverse=True)[1]
    share = np.bincount(place, error * duration) / np.bincount(place, measured * duration)
    return EnergyScore(
        float(np.sqrt(np.average(error**2, weights=weight))),
        float(np.abs(share).mean()),
        float(share[np.argmax(np.abs(share))]),
        tuple(share.tolist()),
    )


def jackknife_std(left_out: Float) -> Float:
    """Return deviations of figures from what they are with each block left out.

    Args:
        left_out: Figures, of shape (blocks,) or (blocks, K). [any unit]
    """
    return np.sqrt((len(left_out) - 1) * np.var(left_out, axis=0))
