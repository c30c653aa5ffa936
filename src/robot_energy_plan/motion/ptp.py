"""Synchronised point-to-point motions in closed form, and loops of them.

All joints follow one profile ``s(t)`` from 0 to 1, ``q = start + s (goal - start)``, so
they start and stop together. The profile is a velocity trapezoid behind a moving average
of length ``jerk_time``, which is how controllers smooth their commands: acceleration is
continuous and jerk at most ``2 acceleration / jerk_time`` (half of it where every ramp
lasts at least ``jerk_time``), no limit is ever exceeded because an average never is, and
the motion lasts ``jerk_time`` longer. With ``jerk_time = 0`` it is the plain trapezoid.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Annotated, Protocol

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import MotionError
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import Float, Int, Rows

DEFAULT_JERK_TIME = 0.05  # s
LIMIT_TOLERANCE = 1e-9  # rad or m
MIN_DISTANCE = 1e-12  # rad; less is rounding and takes no time


class MotionLimits(Described):
    """What a motion must keep to, joint side, shape (n,) each."""

    lower: Annotated[Float, "Lower position limit. [rad] or [m]"]
    upper: Annotated[Float, "Upper position limit. [rad] or [m]"]
    velocity: Annotated[Float, "Greatest speed, > 0. [rad/s] or [m/s]"]
    acceleration: Annotated[Float, "Greatest acceleration, > 0. [rad/s^2] or [m/s^2]"]
    jerk_time: Annotated[float, "Time over which acceleration builds up, >= 0. [s]"] = (
        DEFAULT_JERK_TIME
    )

    def __post_init__(self) -> None:
        for name in ("velocity", "acceleration"):
            values: Float = getattr(self, name)
            if not ((values > 0) & np.isfinite(values)).all():
                raise MotionError(
                    f"the {name} limits are {values.tolist()}",
                    "finite values > 0",
                    "give the limits of the robot",
                )
        if not (self.lower < self.upper).all():
            raise MotionError(
                f"lower limits {self.lower.tolist()} reach upper limits {self.upper.tolist()}",
                "lower < upper",
            )
        if not 0 <= self.jerk_time < np.inf:
            raise MotionError(f"jerk_time is {self.jerk_time} s", "a time >= 0 s")

    @classmethod
    def of_robot(
        cls, robot: Robot, acceleration: Float, jerk_time: float = DEFAULT_JERK_TIME
    ) -> MotionLimits:
        """Return limits with positions and speeds of the URDF, which has no accelerations.

        Args:
            acceleration: Joint side, shape (n,). [rad/s^2] or [m/s^2]
            jerk_time: Time over which acceleration builds up. [s]
        """
        limits = robot.limits
        return cls(limits.lower, limits.upper, limits.velocity, acceleration, jerk_time)

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return len(self.lower)

    def check(self, joint_position: Float, name: str) -> None:
        """Refuse a configuration outside the position limits.

        Args:
            joint_position: Shape (n,). [rad] or [m]
        """
        bad = ~(
            (joint_position >= self.lower - LIMIT_TOLERANCE)
            & (joint_position <= self.upper + LIMIT_TOLERANCE)
        )
        if bad.any():
            joint = int(np.argmax(bad))
            raise MotionError(
                f"{name} puts joint {joint + 1} at {joint_position[joint]:.6g}",
                f"{self.lower[joint]:.6g} to {self.upper[joint]:.6g}",
            )

    def slowed(self, override: float) -> MotionLimits:
        """Return the limits of the same motions, slowed in time.

        Velocity scales with the override, acceleration with its square and the jerk time
        with its inverse, so that the path through position and time is only stretched.

        Args:
            override: Share of full speed, in (0, 1]. [-]
        """
        if not 0 < override <= 1:
            raise MotionError(f"the speed override is {override}", "a share in (0, 1]")
        return replace(
            self,
            velocity=self.velocity * override,
            acceleration=self.acceleration * override**2,
            jerk_time=self.jerk_time / override,
        )


class Trajectory(Rows):
    """Joint motion at given times, joint side, shape (N, n) each."""

    joint_position: Annotated[Float, "[rad] or [m]"]
    joint_velocity: Annotated[Float, "[rad/s] or [m/s]"]
    joint_acceleration: Annotated[Float, "[rad/s^2] or [m/s^2]"]


class SampledPath(Protocol):
    """A motion that can be evaluated at any time."""

    def sample(self, time: Float) -> Trajectory:
        """Return the motion.

        Args:
            time: Since its start, shape (N,). [s]
        """
        ...


class JointMotion(SampledPath, Protocol):
    """What a robot can be made to do: a loop that can be sampled at any time."""

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        ...


class Profile:
    """Profiles ``s(t)`` of K moves under their limits, evaluated together.

    Args:
        distance: Signed way of every joint, shape (K, n). [rad] or [m]
        speed_share: Of the velocity limits, in (0, 1], one value or shape (K,). [-]
        acceleration_share: Of the acceleration limits, in (0, 1], one value or shape (K,). [-]

    Attributes:
        duration: Duration of each move; 0 where nothing moves, shape (K,). [s]
    """

    def __init__(
        self,
        distance: Float,
        limits: MotionLimits,
        speed_share: Float | float = 1.0,
        acceleration_share: Float | float = 1.0,
    ) -> None:
        way = np.abs(distance)
        moves = way.max(axis=1) > MIN_DISTANCE
        with np.errstate(divide="ignore", over="ignore"):
            speed = speed_share * (limits.velocity / way).min(axis=1)
            rise = acceleration_share * (limits.acceleration / way).min(axis=1)
        speed = np.where(moves, speed, 1.0)
        rise = np.where(moves, rise, 1.0)
        speed = np.minimum(speed, np.sqrt(rise))  # a short move never cruises
        self._speed = speed
        self._ramp = speed / rise
        self._rise = rise
        self._end = self._ramp + 1.0 / speed
        self._jerk_time = limits.jerk_time
        self.duration = np.where(moves, self._end + limits.jerk_time, 0.0)

    def sample(self, move: Int, time: Float) -> tuple[Float, Float, Float]:
        """Return s [-], its velocity [1/s] and its acceleration [1/s^2], shape (N,) each.

        Args:
            move: Index of the move, shape (N,).
            time: Since the start of that move; before it rests at 0 and after it at 1,
                shape (N,). [s]
        """
        shape = (self._speed[move], self._rise[move], self._ramp[move], self._end[move])
        smooth = self._jerk_time
        value, velocity, acceleration, area = _trapezoid(time, *shape)
        if smooth > 0:
            value_0, velocity_0, _, area_0 = _trapezoid(time - smooth, *shape)
            value, velocity, acceleration = (
                (area - area_0) / smooth,
                (value - value_0) / smooth,
                (velocity - velocity_0) / smooth,
            )
        over = time >= self.duration[move]
        value = np.where(over, 1.0, np.clip(value, 0.0, 1.0))
        velocity = np.where(over, 0.0, velocity)
        acceleration = np.where(over, 0.0, acceleration)
        return value, velocity, acceleration


def _trapezoid(
    time: Float, speed: Float, rise: Float, ramp: Float, end: Float
) -> tuple[Float, Float, Float, Float]:
    """Way, velocity and acceleration of the velocity trapezoid, and the integral of the way."""
    inside = np.clip(time, 0.0, end)
    left = end - inside
    begins, ends = inside < ramp, left < ramp
    near = np.where(ends, left, inside)  # time to the nearer end
    edge = 0.5 * rise * near * near
    cubic = rise * near**3 / 6.0
    cruised = inside - 0.5 * ramp
    value = np.where(begins, edge, np.where(ends, 1.0 - edge, speed * cruised))
    velocity = np.where(begins | ends, rise * near, speed)
    acceleration = np.where(begins, rise, np.where(ends, -rise, 0.0))
    acceleration = np.where((time < 0) | (time >= end), 0.0, acceleration)
    # By symmetry the integral over the whole trapezoid is half its duration.
    area = np.where(
        begins,
        cubic,
        np.where(
            ends,
            0.5 * end - left + cubic,
            speed * (ramp * ramp / 6.0 + 0.5 * (cruised * cruised - 0.25 * ramp * ramp)),
        ),
    )
    return value, velocity, acceleration, area + np.maximum(time - end, 0.0)


MAX_TRIES = 10_000
CHECKED_POINTS = 9  # along each move of a random program


class Program:
    """A loop of synchronised point-to-point motions.

    It rests at the first via for its dwell time, moves to the second, and so on; after
    the last via it moves back to the first and starts again.

    Args:
        via: Configurations, joint side, shape (K, n), K >= 1. [rad] or [m]
        dwell: Rest at each via, one value or shape (K,), >= 0. [s]
        override: Share of full speed, in (0, 1], which the limits have from then on. [-]
        speed_share: Share of the speed under that override, of the move to the next via, in
            (0, 1], one value or shape (K,). [-]
        acceleration_share: The same of the acceleration, one value or shape (K,). [-]
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
        self.moves, self.n_joints = len(self.via), int(self.via.shape[1])
        for index, configuration in enumerate(self.via):
            limits.check(configuration, f"via {index + 1}")
        self.dwell, self.speed_share, self.acceleration_share = (
            np.broadcast_to(np.asarray(given, dtype=np.float64), len(self.via))
            for given in (dwell, speed_share, acceleration_share)
        )
        if not ((self.dwell >= 0) & np.isfinite(self.dwell)).all():
            found = np.asarray(dwell).tolist()
            raise MotionError(f"the dwell times are {found}", "finite times >= 0 s")
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
