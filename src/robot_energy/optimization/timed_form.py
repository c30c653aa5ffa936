"""A program whose moves follow time laws of their own: what comes out is a trajectory."""

from __future__ import annotations

import numpy as np

from robot_energy.blocks import Float
from robot_energy.motion.ptp import Trajectory
from robot_energy.optimization.candidates import STEP
from robot_energy.optimization.forms import ProgramForm
from robot_energy.optimization.plan import CyclePlan
from robot_energy.optimization.task import Task
from robot_energy.optimization.timed_moves import TimedMoves
from robot_energy.optimization.written_trajectory import WrittenTrajectory
from robot_energy.physics.rigid_body import Robot

MIN_REST = 1e-4  # s; less is rounding


class TimedForm(WrittenTrajectory):
    """A program with time laws; attributes as those of `PtpForm`.

    Args:
        form: The program.
        moves: Its moves with their laws.
        robot: The robot.
    """

    def __init__(self, form: ProgramForm, moves: TimedMoves, robot: Robot) -> None:
        super().__init__(robot)
        self.moves = moves
        self.base, self.needed, self.joint_position = form.base, form.needed, form.joint_position
        self.labels, self.speeds, self.accelerations = form.labels, form.speeds, form.accelerations
        self.acceleration, self.jerk = form.acceleration, form.jerk
        self.recorded = form.recorded
        self.notes = (
            *form.notes,
            "moves with a time law of their own need a controller that follows a trajectory",
        )

    def points(self, task: Task, plan: CyclePlan) -> tuple[Float, Trajectory]:
        """Return the points of a plan.

        Args:
            task: The task.
            plan: A plan of it.

        Returns:
            Times from 0 on, shape (K,) [s], and the points.
        """
        chosen = task.table.candidates[plan.row]
        length = self.moves.duration(chosen)
        clock, times, parts = 0.0, list[Float](), list[Trajectory]()
        for k, (rest, move) in enumerate(zip(plan.rest.tolist(), length.tolist(), strict=True)):
            count = max(2, int(np.ceil(move / STEP)) + 1)
            own = np.linspace(0.0, float(move), count)
            path = self.moves.sample(chosen, np.full(count, k, dtype=np.int64), own)
            still = Trajectory(
                path.joint_position[:1], 0 * path.joint_velocity[:1], 0 * path.joint_velocity[:1]
            )
            if not times:
                times.append(np.array([clock]))
                parts.append(still)
            rows = slice(0 if rest > MIN_REST else 1, None)
            clock += rest
            times.append((clock + own)[rows])
            parts.append(path.rows(rows))
            clock += move
        return np.concatenate(times), Trajectory.concatenate(parts)
