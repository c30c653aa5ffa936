"""Candidates: each move of a program, made in every way that is compared.

A candidate is one move under a share of the speed and acceleration limits. All are laid end to end
in one array of samples, so that the power chain runs over thousands of them at once.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.timeline.blocks import Float, Int
from robot_energy_plan.motion.ptp import ArrayRecord, MotionLimits, Profile, Trajectory
from robot_energy_plan.motion.ptp_loop import Program

STEP = 4e-3  # s between samples
SAMPLES = 250  # of one candidate, at most: slow motion changes slowly
LONG_STEP = 0.02  # s between samples of moves that are longer than these
ROWS = 60_000  # samples that are worked on at a time
SPEEDS = np.array([10, 15, 20, 25, 30, 35, 40, 45, 50, 55, 60, 70, 80, 90, 100]) / 100  # [-]
ACCELERATIONS = np.array([5, 10, 20, 30, 45, 65, 100]) / 100  # [-]


@dataclass(frozen=True)
class Candidates(ArrayRecord):
    """Moves, each with its way of being made, shape (P,) each.

    Attributes:
        speed: Share of the speed limits. [-]
        acceleration: Share of the acceleration limits. [-]
        law: Time law of its own, -1 for none; left out: none at all.
    """

    move: Int
    speed: Float
    acceleration: Float
    law: Int = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def __post_init__(self) -> None:
        if len(self.law) != len(self.move):
            object.__setattr__(self, "law", np.full(len(self.move), -1))


class Samples(Described):
    """Motion of several candidates, end to end."""

    first: Annotated[Int, "Row at which each candidate begins, shape (P,)."]
    step: Annotated[Float, "Time between the samples of each candidate, shape (P,). [s]"]
    path: Annotated[Trajectory, "Motion, shape (N, n) each."]


class Moves(ABC):
    """Moves from rest to rest that can be made faster or slower.

    Attributes:
        laws: Candidates with time laws of their own; None for moves without any.
    """

    count: int
    laws: Candidates | None = None

    @abstractmethod
    def duration(self, candidates: Candidates) -> Float:
        """Return how long each candidate lasts, shape (P,). [s]"""

    @abstractmethod
    def sample(self, candidates: Candidates, place: Int, time: Float) -> Trajectory:
        """Return the motion, joint side.

        Args:
            place: Candidate of each row, shape (N,).
            time: Since the start of the move, shape (N,). [s]
        """


class PtpMoves(Moves):
    """Synchronised point-to-point moves.

    Args:
        start: Configuration before each move, shape (K, n). [rad] or [m]
        goal: Configuration after it, shape (K, n). [rad] or [m]
    """

    def __init__(self, start: Float, goal: Float, limits: MotionLimits) -> None:
        self.count = len(start)
        self._start, self._distance, self._limits = start, goal - start, limits

    @classmethod
    def of_program(cls, program: Program, limits: MotionLimits) -> PtpMoves:
        """Return the moves of a program, which can be as fast as its limits without an override.

        The jerk time is that of the program as it runs, so that what is left alone does not change.
        """
        bounds = replace(limits, jerk_time=program.limits.jerk_time)
        return cls(program.via, np.roll(program.via, -1, axis=0), bounds)

    def _profile(self, candidates: Candidates) -> Profile:
        ways = self._distance[candidates.move]
        return Profile(ways, self._limits, candidates.speed, candidates.acceleration)

    def duration(self, candidates: Candidates) -> Float:
        """Return the same as in `Moves.duration`."""
        return self._profile(candidates).duration

    def sample(self, candidates: Candidates, place: Int, time: Float) -> Trajectory:
        """Return the same as in `Moves.sample`."""
        value, velocity, acceleration = self._profile(candidates).sample(place, time)
        move = candidates.move[place]
        ways = self._distance[move]
        return Trajectory(
            self._start[move] + value[:, None] * ways,
            velocity[:, None] * ways,
            acceleration[:, None] * ways,
        )


def grid(moves: Moves, speed: Float = SPEEDS, acceleration: Float = ACCELERATIONS) -> Candidates:
    """Return every move with every pair of shares, S times A of each, move by move.

    Of two that last equally long it is the one with less speed.

    Args:
        speed: Shares of the speed limits, shape (S,). [-]
        acceleration: Shares of the acceleration limits, shape (A,). [-]
    """
    pairs = len(speed) * len(acceleration)
    move = np.repeat(np.arange(moves.count), pairs)
    fast = np.tile(np.repeat(speed, len(acceleration)), moves.count)
    rise = np.tile(acceleration, len(speed) * moves.count)
    found = Candidates(move, fast, rise)
    # A short move never cruises: a higher speed changes nothing.
    key = np.stack([move.astype(np.float64), rise, np.round(moves.duration(found), 9)], axis=1)
    _, kept = np.unique(key, axis=0, return_index=True)
    return found[np.sort(kept)]


def blocks(
    moves: Moves, candidates: Candidates, samples: int = SAMPLES
) -> Iterator[tuple[slice, Samples]]:
    """Yield the samples of all candidates, a bounded number at a time: which, and their motion."""
    duration = moves.duration(candidates)
    fine, coarse = (np.ceil(duration / step - 1e-9).astype(np.int64) for step in (STEP, LONG_STEP))
    count = np.maximum(np.clip(fine, 1, samples), coarse) + 1
    total = np.cumsum(count)
    begin = 0
    while begin < len(candidates):
        before = int(total[begin - 1]) if begin else 0
        end = max(begin + 1, int(np.searchsorted(total, before + ROWS, side="right")))
        part = slice(begin, end)
        sizes = count[part]
        first = np.concatenate([[0], np.cumsum(sizes)[:-1]])
        step = duration[part] / (sizes - 1)
        place = np.repeat(np.arange(end - begin), sizes)
        time = (np.arange(int(sizes.sum())) - first[place]) * step[place]
        yield part, Samples(first, step, moves.sample(candidates[part], place, time))
        begin = end
