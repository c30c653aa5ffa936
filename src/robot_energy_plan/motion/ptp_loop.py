"""Programs: via configurations with dwell times, repeated in a loop."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from robot_energy.foundation.errors import MotionError
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import Float
from robot_energy_plan.motion.ptp import MotionLimits, Profile, Trajectory

MAX_TRIES = 10_000
CHECKED_POINTS = 9  # along each move of a random program


class Program:
    """A loop of synchronised point-to-point motions.

    It rests at the first via for its dwell time, moves to the second, and so on; after
    the last via it moves back to the first and starts again.

    Args:
        via: Configurations, joint side, shape (K, n), K >= 1. [rad] or [m]
        dwell: Rest at each via, one value or shape (K,), >= 0. [s]
        override: Share of full speed, in (0, 1]. [-]
        speed_share: Share of the speed under that override, of the move to the next via, in
            (0, 1], one value or shape (K,). [-]
        acceleration_share: The same of the acceleration, one value or shape (K,). [-]

    Attributes:
        via: As given, shape (K, n). [rad] or [m]
        dwell: Rest at each via, shape (K,). [s]
        limits: Limits under the override.
        speed_share: Of each move, shape (K,). [-]
        acceleration_share: Of each move, shape (K,). [-]
        moves: Number of motions in one loop.
        period: Length of one loop. [s]
    """

    def __init__(
        self,
        via: Float,
        limits: MotionLimits,
        dwell: float | Sequence[float] | Float = 0.2,
        override: float = 1.0,
        speed_share: float | Sequence[float] | Float = 1.0,
        acceleration_share: float | Sequence[float] | Float = 1.0,
    ) -> None:
        self.via = np.array(via, dtype=np.float64)
        if self.via.ndim != 2 or len(self.via) == 0:
            raise MotionError(
                f"the via configurations have shape {self.via.shape}",
                "(number of vias, number of joints)",
            )
        self.moves, self.n_joints = len(self.via), int(self.via.shape[1])
        for index, configuration in enumerate(self.via):
            limits.check(configuration, f"via {index + 1}")
        self.dwell = self._each(dwell, "dwell times")
        if not ((self.dwell >= 0) & np.isfinite(self.dwell)).all():
            found = np.asarray(dwell).tolist()
            raise MotionError(f"the dwell times are {found}", "finite times >= 0 s")
        self.speed_share = self._each(speed_share, "speed shares")
        self.acceleration_share = self._each(acceleration_share, "acceleration shares")
        for share in (self.speed_share, self.acceleration_share):
            if not ((share > 0) & (share <= 1)).all():
                raise MotionError(f"shares of speed are {share.tolist()}", "shares in (0, 1]")
        self.override = override
        self.limits = limits.slowed(override)
        self._distance = np.roll(self.via, -1, axis=0) - self.via
        self._profile = Profile(
            self._distance, self.limits, self.speed_share, self.acceleration_share
        )
        length = self.dwell + self._profile.duration
        self.period = float(length.sum())
        if not self.period > 0:
            raise MotionError(
                "the program neither moves nor rests", "vias that differ or a dwell time > 0 s"
            )
        self._begin = np.concatenate([[0.0], np.cumsum(length)[:-1]])

    def _each(self, given: float | Sequence[float] | Float, what: str) -> Float:
        """One value of each via, or one for all of them, shape (K,)."""
        values = np.asarray(given, dtype=np.float64)
        if values.ndim > 1 or (values.ndim == 1 and len(values) != len(self.via)):
            raise MotionError(
                f"the {what} have shape {values.shape}", f"one value or {len(self.via)}"
            )
        return np.broadcast_to(values, len(self.via))

    @property
    def instants(self) -> Float:
        """Begin and end of every move within the first loop, shape (2 K,). [s]"""
        ends = np.append(self._begin[1:], self.period)
        return np.stack([self._begin + self.dwell, ends], axis=1).ravel()

    def sample(self, time: Float) -> Trajectory:
        """Return the motion, joint side.

        Args:
            time: Since the start of the first loop; before it the robot rests at the
                first via, shape (N,). [s]
        """
        time = np.atleast_1d(np.asarray(time, dtype=np.float64))
        phase = np.where(time > 0, np.remainder(time, self.period), 0.0)
        move = np.searchsorted(self._begin, phase, side="right") - 1
        local = phase - self._begin[move] - self.dwell[move]
        value, velocity, acceleration = self._profile.sample(move, local)
        distance = self._distance[move]
        return Trajectory(
            self.via[move] + value[:, None] * distance,
            velocity[:, None] * distance,
            acceleration[:, None] * distance,
        )


def random_program(
    limits: MotionLimits,
    seed: int,
    moves: int = 20,
    zone: float | Sequence[float] | Float = 0.8,
    dwell: float = 0.2,
    override: float = 1.0,
    accept: Callable[[Float], bool] | None = None,
    start: Float | None = None,
) -> Program:
    """Return a program of random configurations, the same for the same seed.

    Args:
        moves: Number of motions in a loop (paper A: 20).
        zone: Share of each joint's range around its middle that may be used, one value
            or shape (n,), in (0, 1]. [-]
        dwell: Rest at each via. [s]
        override: Share of full speed. [-]
        accept: Whether a configuration, shape (n,), is allowed; asked at points along
            every motion, the way back to the first via included. See `tool_above`.
        start: First via, so that programs can follow one another, shape (n,); default: drawn
            like the others. [rad] or [m]
    """
    share = np.broadcast_to(np.asarray(zone, dtype=np.float64), limits.lower.shape)
    if not ((share > 0) & (share <= 1)).all():
        raise MotionError(f"the zone is {zone}", "shares of the joint ranges in (0, 1]")
    if moves < 2:
        raise MotionError(f"a program of {moves} motions was asked for", "at least 2")
    if not (np.isfinite(limits.lower).all() and np.isfinite(limits.upper).all()):
        raise MotionError(
            "a joint has no position limits",
            "finite limits on every joint",
            "give limits to continuous joints before drawing random motions",
        )
    generator = np.random.default_rng(seed)
    middle = 0.5 * (limits.lower + limits.upper)
    reach = 0.5 * share * (limits.upper - limits.lower)
    via: list[Float] = [] if start is None else [np.array(start, dtype=np.float64)]
    for _ in range(MAX_TRIES):
        candidate = middle + reach * generator.uniform(-1.0, 1.0, limits.n_joints)
        last = len(via) == moves - 1
        if accept is not None and not (
            (not via or _clear(via[-1], candidate, accept))
            and (not last or _clear(candidate, via[0], accept))
            and accept(candidate)
        ):
            continue
        via.append(candidate)
        if last:
            return Program(np.stack(via), limits, dwell, override)
    raise MotionError(
        f"only {len(via)} of {moves} allowed motions were found in {MAX_TRIES} tries",
        "a zone in which most motions are allowed",
        "reduce the zone or relax the condition",
    )


def tool_above(robot: Robot, link: str, height: float) -> Callable[[Float], bool]:
    """Return a condition for `random_program`: a link stays above a height.

    Args:
        height: In the base frame. [m]
    """
    return lambda joint_position: bool(robot.link_position(joint_position, link)[2] >= height)


def _clear(start: Float, goal: Float, accept: Callable[[Float], bool]) -> bool:
    return all(
        accept(start + share * (goal - start))
        for share in np.linspace(0.0, 1.0, CHECKED_POINTS)[1:-1]
    )
