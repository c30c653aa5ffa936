"""Motions that are known before they are made, from start to end, in blocks of samples."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np

from robot_energy.foundation.errors import MotionError
from robot_energy.foundation.units import SECOND_NS
from robot_energy.timeline.blocks import Float, Int
from robot_energy_plan.motion.ptp import SampledPath, Trajectory

BLOCK = 4096  # samples
STEP = 5e-3  # s between samples, unless something else is asked for
MIN_DURATION, MAX_DURATION = 1e-6, 1e7  # s; the longest is some four months
MAX_SAMPLES = 1_000_000_000
CLOSED_TOLERANCE = 1e-6  # rad or m, by which start and end of a repeated motion may differ


class PlannedMotion(Protocol):
    """What can be predicted: a motion of named joints over a known time."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, in the order of the arrays."""
        ...

    @property
    def duration(self) -> float:
        """From start to end. [s]"""
        ...

    @property
    def sample_count(self) -> int:
        """Number of samples that ``blocks`` gives, or a few more."""
        ...

    def blocks(self) -> Iterator[tuple[Float, Trajectory]]:
        """Yield rising times, (N,) [s], from 0 to the end, and the motion at them, joint side."""
        ...


class SampledMotion:
    """A motion in closed form, sampled at equal steps.

    Args:
        duration: Time from start to end, at least 1 us. [s]
        step: Between samples, at most; the end is always one. [s]
        instants: Times that are samples as well, where the motion has kinks. [s]
    """

    def __init__(
        self,
        motion: SampledPath,
        joint_names: Sequence[str],
        duration: float,
        step: float = STEP,
        instants: Sequence[float] = (),
    ) -> None:
        if not MIN_DURATION <= duration <= MAX_DURATION:
            raise MotionError(
                f"the motion lasts {duration:.4g} s", f"{MIN_DURATION:g} to {MAX_DURATION:g} s"
            )
        if not 0 < step < math.inf or duration / step > MAX_SAMPLES:
            raise MotionError(f"the step is {step} s", f"a time > 0 s, {MAX_SAMPLES} at most")
        self._motion = motion
        self.joint_names = tuple(joint_names)
        self.duration = duration
        self._count = grid_steps(duration, step)
        self._instants = np.asarray(instants, dtype=np.float64)
        self.sample_count = self._count + 1 + len(self._instants)

    def blocks(self) -> Iterator[tuple[Float, Trajectory]]:
        """See `PlannedMotion.blocks`."""
        for begin in range(0, self._count + 1, BLOCK):
            index = np.arange(begin, min(begin + BLOCK, self._count + 1))
            time = index * (self.duration / self._count)
            later = (begin + BLOCK) * (self.duration / self._count)
            inside = (self._instants > time[0]) & (self._instants < min(later, self.duration))
            if inside.any():
                time = np.union1d(time, self._instants[inside])
            yield time, self._motion.sample(time)


def grid_steps(duration: float, step: float = STEP) -> int:
    """Return into how many equal steps a motion is cut.

    Args:
        duration: From start to end. [s]
        step: Longest step. [s]
    """
    return max(1, math.ceil(duration / step - 1e-9))


def repeated(motion: PlannedMotion, times: int) -> Iterator[tuple[Float, Trajectory]]:
    """Yield the blocks of a motion that is made several times without a pause.

    Times that fall on the same nanosecond, such as a point and a grid instant next to it, are
    one sample: nothing between them lasts.

    Yields:
        Times since the start, shape (N,) [s], rising throughout by a nanosecond at least, and
        the motion at them, joint side.
    """
    first = last = np.empty(0)
    held: list[tuple[Float, Trajectory]] = []  # short turns are handed out together
    count, newest = 0, -1
    for turn in range(times):
        for index, (time, path) in enumerate(motion.blocks()):
            if turn == 0 and index == 0:
                first = path.joint_position[0]
            again = turn > 0 and index == 0  # the sample that ended the last turn
            if again:
                _check_closed(first, last, motion.joint_names)
            last = path.joint_position[-1]
            since = time + turn * motion.duration
            stamp_ns = planned_ns(since)
            later = np.diff(stamp_ns, prepend=newest) > 0
            later[0] &= not again
            if later.any():
                held.append((since[later], path if later.all() else path[later]))
                count += int(later.sum())
                newest = int(stamp_ns[later][-1])
            if count >= BLOCK:
                yield _joined(held)
                held, count = [], 0
    if held:
        yield _joined(held)


def planned_ns(time: Float) -> Int:
    """Return times as stamps, same shape. [ns]

    Args:
        time: Since the start, any shape. [s]
    """
    return np.rint(time * SECOND_NS).astype(np.int64)


def _joined(parts: Sequence[tuple[Float, Trajectory]]) -> tuple[Float, Trajectory]:
    times, paths = zip(*parts, strict=True)
    return np.concatenate(times), Trajectory.concatenate(paths)


def _check_closed(first: Float, last: Float, names: Sequence[str]) -> None:
    apart = np.abs(first - last)
    if apart.max() > CLOSED_TOLERANCE:
        joint = int(np.argmax(apart))
        raise MotionError(
            f"the motion is to be repeated, but joint '{names[joint]}' ends {apart[joint]:.4g} "
            "rad or m from where it began",
            "an end at the start",
            "add a move back, or predict the motion once",
        )
