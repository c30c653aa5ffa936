"""A G-code program: all its feeds are multiplied by one factor, as by a feed override."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robot_energy.blocks import Float, Int
from robot_energy.errors import MotionError
from robot_energy.files.output_files import GENERATOR, FileKind, write_file
from robot_energy.files.regular_file import read_regular
from robot_energy.motion.gcode import MAX_BYTES, read_gcode
from robot_energy.motion.gcode_feed import with_feed
from robot_energy.motion.joint_trajectory import JointTrajectory
from robot_energy.motion.load_motion import ToolOptions, tool_program
from robot_energy.motion.ptp import DEFAULT_JERK_TIME, Trajectory
from robot_energy.optimization.candidates import Candidates
from robot_energy.optimization.plan import CyclePlan
from robot_energy.optimization.task import Task
from robot_energy.optimization.written_trajectory import WrittenTrajectory
from robot_energy.physics.rigid_body import Robot

FEEDS = np.array([0.5, 0.6, 0.7, 0.8, 0.9, 1.0])  # shares of the greatest factor [-]
MAX_FACTOR = 10.0
MARK = f"; Written by {GENERATOR}.\n"
GCODE = (FileKind("G-code", MARK.encode(), b""),)
MAX_TIME = 3600.0  # s


class FeedMoves:
    """One move: the whole program, at every factor on its feeds.

    Args:
        text: The program.
        name: Its name.
        robot: The robot.
        options: What the program does not state.
        fastest: Greatest factor. [-]

    Attributes:
        count: 1.
        fastest: As given. [-]
    """

    count = 1

    def __init__(
        self, text: str, name: str, robot: Robot, options: ToolOptions, fastest: float
    ) -> None:
        self._text, self._name, self._robot, self._options = text, name, robot, options
        self.fastest = fastest
        self._made: dict[float, JointTrajectory] = {}

    def written(self, speed: float) -> str:
        """Return the program at a share of the greatest factor.

        Args:
            speed: The share. [-]
        """
        return with_feed(self._text, speed * self.fastest)

    def motion(self, speed: float) -> JointTrajectory:
        """Return the motion of the joints at a share of the greatest factor.

        Args:
            speed: The share. [-]

        Raises:
            MotionError: If the robot cannot make it.
        """
        speed = round(speed, 6)
        if speed not in self._made:
            program = read_gcode(self.written(speed), self._name, self._options.rapid_speed)
            planned = tool_program(program, self._robot, self._options).motion
            if planned.duration > MAX_TIME:
                raise MotionError(
                    f"{self._name} lasts {planned.duration:.4g} s",
                    f"at most {MAX_TIME:g} s",
                    "take one layer, or a few",
                )
            parts = list(planned.blocks())
            path = Trajectory.concatenate([part for _, part in parts])
            self._made[speed] = JointTrajectory(
                self._robot.joint_names, np.concatenate([time for time, _ in parts]),
                path.joint_position, path.joint_velocity, path.joint_acceleration, self._name,
            )  # fmt: skip
        return self._made[speed]

    def duration(self, candidates: Candidates) -> Float:
        """Return how long each candidate lasts.

        Args:
            candidates: Which.

        Returns:
            Shape (P,). [s]
        """
        return np.array([self.motion(speed).duration for speed in candidates.speed.tolist()])

    def sample(self, candidates: Candidates, place: Int, time: Float) -> Trajectory:
        """Return the motion.

        Args:
            candidates: Which.
            place: Candidate of each row, rising, shape (N,).
            time: Since the start of the program, shape (N,). [s]

        Returns:
            Position, velocity and acceleration, joint side.
        """
        cuts = np.searchsorted(place, np.arange(len(candidates) + 1))
        return Trajectory.concatenate(
            [
                self.motion(speed).sample(time[first:last])
                for speed, first, last in zip(
                    candidates.speed.tolist(), cuts[:-1].tolist(), cuts[1:].tolist(), strict=True
                )
            ]
        )


class GcodeForm(WrittenTrajectory):
    """A G-code program. Attributes as those of `PtpForm`.

    Args:
        path: The file.
        robot: That runs it.
        options: What the program does not state.
        max_feed: Greatest factor on its feeds; 1: never faster than it states. [-]

    Raises:
        MotionError: If it cannot be read, or the robot cannot make it.
    """

    def __init__(
        self, path: Path, robot: Robot, options: ToolOptions, max_feed: float = 1.0
    ) -> None:
        if not 1.0 <= max_feed <= MAX_FACTOR:
            raise MotionError(
                f"the greatest factor on the feeds is {max_feed:g}", f"1 to {MAX_FACTOR:g}"
            )
        super().__init__(robot)
        text = read_regular(path, MAX_BYTES).decode("utf-8", "replace")
        self.moves = FeedMoves(text, str(path), robot, options, max_feed)
        self.base = Candidates(np.zeros(1, dtype=np.int64), np.array([1 / max_feed]), np.ones(1))
        made = self.moves.motion(1 / max_feed)
        if max_feed > 1.0:
            self.moves.motion(1.0)  # that a robot cannot make is said before the search
        self.needed: Float = np.zeros(1)
        at = made.sample(made.instants)
        self.joint_position: Float = at.joint_position[:1]
        self.labels: tuple[str, ...] = ("whole program",)
        self.speeds: Float = FEEDS
        self.accelerations: Float = np.ones(1)
        self.acceleration: Float = np.abs(at.joint_acceleration).max(axis=0)
        self.jerk: Float = self.acceleration / DEFAULT_JERK_TIME
        self.recorded = False
        loaded = tool_program(read_gcode(text, str(path), options.rapid_speed), robot, options)
        self.notes = (
            *loaded.notes,
            "all feeds are multiplied by one factor; what the process allows, the model cannot say",
        )

    def points(self, task: Task, plan: CyclePlan) -> tuple[Float, Trajectory]:
        """Return the points of a plan, after its wait.

        Args:
            task: The task.
            plan: A plan of it.

        Returns:
            Times from 0 on, shape (K,) [s], and the points.
        """
        made = self.moves.motion(float(task.table.candidates[plan.row].speed[0]))
        rest, path = float(plan.rest[0]), made.sample(made.instants)
        if rest <= 0.0:
            return made.instants, path
        waited = Trajectory.concatenate([path.rows(slice(0, 1)), path])
        return np.concatenate([[0.0], made.instants + rest]), waited

    def write(self, path: Path, task: Task, plan: CyclePlan) -> None:
        """Write a plan as G-code.

        Args:
            path: The file.
            task: The task.
            plan: A plan of it.

        Raises:
            ReportError: If it cannot be written.
        """
        text = self.moves.written(float(task.table.candidates[plan.row].speed[0]))
        write_file(path, (MARK + text.removeprefix(MARK)).encode(), GCODE, "the program")
