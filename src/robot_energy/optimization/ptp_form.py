"""Programs of point-to-point moves: read, changed, and written back as the same kind of file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

from robot_energy.blocks import Float, Int
from robot_energy.files.output_files import COMMENT, TEXT, write_file
from robot_energy.motion.planned import SampledMotion
from robot_energy.motion.ptp import MotionLimits
from robot_energy.motion.ptp_file import DEGREE, ProgramFile, program_for, read_program
from robot_energy.motion.ptp_loop import Program
from robot_energy.optimization.candidates import ACCELERATIONS, SPEEDS, Candidates, PtpMoves
from robot_energy.optimization.plan import CyclePlan
from robot_energy.optimization.task import Task
from robot_energy.physics.rigid_body import Robot

MIN_JERK_TIME = 0.01  # s, over which a time law builds up acceleration where nothing is stated
DIGITS = 6  # of shares in a file, after the point
ANGLE_DIGITS = 9  # of configurations


class PtpForm:
    """A YAML file of point-to-point moves.

    Args:
        path: The file.
        robot: That runs it.
        file: Its content, where it was changed.

    Attributes:
        moves: Its moves.
        base: How they are made now.
        needed: Rest before each move, shape (K,). [s]
        joint_position: Where, shape (K, n). [rad] or [m]
        labels: Of the moves.
        speeds: Shares of speed that are tried. [-]
        accelerations: Shares of acceleration that are tried. [-]
        acceleration: Limits of acceleration, shape (n,). [rad/s^2] or [m/s^2]
        jerk: Limits of jerk, shape (n,). [rad/s^3] or [m/s^3]
        notes: What was assumed, one sentence each.
        recorded: Whether it is a recording of what the robot has done.
        full_limits: Limits of speed and acceleration at shares of 1, with the jerk time of the
            program.

    Raises:
        MotionError: If it cannot be read or run by this robot.
    """

    def __init__(self, path: str | Path, robot: Robot, file: ProgramFile | None = None) -> None:
        self._path = path
        self._file: ProgramFile = read_program(path) if file is None else file
        loaded = program_for(self._file, robot.limits, str(path))
        full = program_for(
            self._file.model_copy(
                update={"override": 1.0, "speed_share": 1.0, "acceleration_share": 1.0}
            ),
            robot.limits,
            str(path),
        )
        self._names = robot.joint_names
        self._program: Program = loaded.program
        program = self._program
        self.full_limits: MotionLimits = replace(
            full.program.limits, jerk_time=program.limits.jerk_time
        )
        self.moves = PtpMoves(program.via, np.roll(program.via, -1, axis=0), self.full_limits)
        self.base = Candidates(
            np.arange(program.moves),
            program.override * program.speed_share,
            program.override**2 * program.acceleration_share,
        )
        self.needed: Float = program.dwell.copy()
        self.joint_position: Float = program.via
        count = program.moves
        self.labels = tuple(f"{k + 1} to {(k + 1) % count + 1}" for k in range(count))
        self.speeds: Float = SPEEDS
        self.accelerations: Float = ACCELERATIONS
        self.acceleration: Float = self.full_limits.acceleration
        self.jerk: Float = 2.0 * self.acceleration / max(self.full_limits.jerk_time, MIN_JERK_TIME)
        self.notes = loaded.notes
        self.recorded = False

    def moved(self, joint_position: Float, robot: Robot) -> PtpForm:
        """Return the same program with other configurations.

        Args:
            joint_position: Configurations, shape (K, n). [rad] or [m]
            robot: The robot.

        Returns:
            The program.

        Raises:
            MotionError: If a configuration breaks a limit.
        """
        degrees = self._file.angle_unit == "deg"
        unit = np.where(robot.limits.prismatic, 1.0, DEGREE if degrees else 1.0)
        rows = np.round(joint_position / unit, ANGLE_DIGITS).tolist()
        via = [dict(zip(self._names, row, strict=True)) for row in rows]
        return PtpForm(self._path, robot, self._file.model_copy(update={"via": via}))

    def reordered(self, order: Int, robot: Robot) -> PtpForm:
        """Return the same program with its configurations in another order, each with its rest.

        Args:
            order: Indices of the configurations, shape (K,).
            robot: The robot.

        Returns:
            The program.
        """
        chosen: list[int] = order.tolist()
        via = [self._file.via[k] for k in chosen]
        dwell: list[float] = self.needed[order].tolist()
        update = {"via": via, "dwell": dwell}
        return PtpForm(self._path, robot, self._file.model_copy(update=update))

    def _changed(self, task: Task, plan: CyclePlan) -> ProgramFile:
        chosen = task.table.candidates[plan.row]
        return self._file.model_copy(
            update={
                "override": 1.0,
                "speed_share": np.round(chosen.speed, DIGITS).tolist(),
                "acceleration_share": np.round(chosen.acceleration, DIGITS).tolist(),
                "jerk_time": float(self._program.limits.jerk_time),
                "dwell": np.round(plan.rest, DIGITS).tolist(),
            }
        )

    def motion(self, task: Task, plan: CyclePlan, robot: Robot) -> SampledMotion:
        """Return a plan as a motion for a prediction.

        Args:
            task: The task.
            plan: A plan of it.
            robot: The robot.

        Returns:
            The motion.
        """
        program = program_for(self._changed(task, plan), robot.limits).program
        return SampledMotion(
            program, self._names, program.period, instants=program.instants.tolist()
        )

    def write(self, path: Path, task: Task, plan: CyclePlan) -> None:
        """Write a plan as a program of the same kind.

        Args:
            path: The file.
            task: The task.
            plan: A plan of it.

        Raises:
            ReportError: If it cannot be written.
        """
        document = self._changed(task, plan).model_dump(mode="json", exclude_none=True)
        text = yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)
        write_file(path, (COMMENT + text).encode(), TEXT, "the program")
