"""One point-to-point motion, to look at profiles move by move."""

import numpy as np

from robot_energy.timeline.blocks import Float
from robot_energy_plan.motion import MotionLimits, Profile, Trajectory


class PointToPoint:
    """One synchronised motion between two configurations.

    Args:
        start: Joint side, shape (n,). [rad] or [m]
        goal: Joint side, shape (n,). [rad] or [m]
        limits: Limits kept throughout.
        override: Share of full speed, in (0, 1]. [-]

    Attributes:
        duration: [s]

    Raises:
        MotionError: If start or goal break the limits, or the override makes no sense.
    """

    def __init__(
        self, start: Float, goal: Float, limits: MotionLimits, override: float = 1.0
    ) -> None:
        self._start = np.array(start, dtype=np.float64)
        goal = np.array(goal, dtype=np.float64)
        limits.check(self._start, "the start")
        limits.check(goal, "the goal")
        self._distance = goal - self._start
        self._goal = goal
        self._profile = Profile(self._distance[None, :], limits.slowed(override))
        self.duration = float(self._profile.duration[0])

    def sample(self, time: Float) -> Trajectory:
        """Evaluate the motion; it rests before its start and after its end.

        Args:
            time: Since the start, shape (N,). [s]

        Returns:
            Position, velocity and acceleration.
        """
        time = np.atleast_1d(np.asarray(time, dtype=np.float64))
        move = np.zeros(len(time), dtype=np.int64)
        value, velocity, acceleration = self._profile.sample(move, time)
        position = self._start + value[:, None] * self._distance
        position[value == 1.0] = self._goal
        return Trajectory(
            position,
            velocity[:, None] * self._distance,
            acceleration[:, None] * self._distance,
        )
