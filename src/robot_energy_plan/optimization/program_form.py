"""Programs that are changed and written back in their own form; point-to-point moves."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import yaml

from robot_energy.foundation.files.output_files import COMMENT, TEXT, write_file
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import Float
from robot_energy_plan.motion.joint_trajectory import JointTrajectory, write_csv, write_trajectory
from robot_energy_plan.motion.planned import SampledMotion
from robot_energy_plan.motion.ptp import MotionLimits, Trajectory
from robot_energy_plan.motion.ptp_file import ProgramFile, program_for, read_program
from robot_energy_plan.optimization.chain import ACCELERATIONS, SPEEDS, Candidates, PtpMoves
from robot_energy_plan.optimization.search import CyclePlan
from robot_energy_plan.optimization.task import ProgramMoves, Task

MIN_REST = 1e-4  # s; less is rounding
MIN_JERK_TIME = 0.01  # s, over which a time law builds up acceleration where nothing is stated
DIGITS = 6  # of shares in a file, after the point


@dataclass(kw_only=True)
class ProgramForm(ProgramMoves, ABC):
    """A program of one robot."""

    robot: Robot
    labels: tuple[str, ...]
    acceleration: Annotated[Float, "Limits of acceleration, shape (n,). [rad/s^2] or [m/s^2]"]
    jerk: Annotated[Float, "Limits of jerk, shape (n,). [rad/s^3] or [m/s^3]"]
    notes: tuple[str, ...]
    recorded: Annotated[bool, "Whether it is a recording of what the robot has done."] = False

    def motion(self, task: Task, plan: CyclePlan) -> SampledMotion:
        """Return a plan as a motion for a prediction."""
        return self._motion(task.table.candidates[plan.row], plan.rest)

    def write(self, path: Path, task: Task, plan: CyclePlan) -> None:
        """Write a plan as a program of the same kind.

        Args:
            path: The file; of a trajectory a name with .csv makes a table, any other a bag.
        """
        self._write(path, task.table.candidates[plan.row], plan.rest)

    @abstractmethod
    def _motion(self, chosen: Candidates, rest: Float) -> SampledMotion:
        """The motion with a candidate of each move, and a rest before it."""

    @abstractmethod
    def _write(self, path: Path, chosen: Candidates, rest: Float) -> None: ...


class WrittenTrajectory(ProgramForm):
    """A program whose changed form is points of a trajectory."""

    def _points(self, chosen: Candidates, rest: Float) -> tuple[Float, Trajectory]:
        """Times from 0 on, shape (K,) [s], and the points."""
        clock, times, parts = 0.0, list[Float](), list[Trajectory]()
        for place, wait in enumerate(rest.tolist()):
            own = self.moves.instants(chosen, place)
            path = self.moves.sample(chosen, np.full(len(own), place, dtype=np.int64), own)
            waits = wait > MIN_REST
            if waits and not times:
                times.append(np.zeros(1))
                still = np.zeros_like(path.joint_position[:1])
                parts.append(Trajectory(path.joint_position[:1], still, still))
            rows = slice(0 if waits or not times else 1, None)
            clock += wait if times else 0.0  # a first rest below that is left out
            times.append((clock + own)[rows])
            parts.append(path[rows])
            clock += float(own[-1])
        return np.concatenate(times), Trajectory.concatenate(parts)

    def _motion(self, chosen: Candidates, rest: Float) -> SampledMotion:
        time, path = self._points(chosen, rest)
        return JointTrajectory(
            self.robot.joint_names, time, path.joint_position, path.joint_velocity,
            path.joint_acceleration,
        ).planned()  # fmt: skip

    def _write(self, path: Path, chosen: Candidates, rest: Float) -> None:
        time, motion = self._points(chosen, rest)
        if path.suffix.lower() == ".csv":
            write_csv(path, self.robot.joint_names, time, motion)
        else:
            write_trajectory(path, self.robot.joint_names, time, motion, overwrite=True)


class PtpForm(ProgramForm):
    """A YAML file of point-to-point moves.

    Attributes:
        full_limits: Limits of speed and acceleration at shares of 1, with the jerk time of the
            program.
    """

    def __init__(self, path: str | Path, robot: Robot) -> None:
        self._path = path
        self._file: ProgramFile = read_program(path)
        loaded = program_for(self._file, robot.limits, str(path))
        full = program_for(
            self._file.model_copy(
                update={"override": 1.0, "speed_share": 1.0, "acceleration_share": 1.0}
            ),
            robot.limits,
            str(path),
        )
        program, count = loaded.program, loaded.program.moves
        jerk_time = program.limits.jerk_time
        self.full_limits: MotionLimits = replace(full.program.limits, jerk_time=jerk_time)
        acceleration = self.full_limits.acceleration
        super().__init__(
            robot=robot,
            moves=PtpMoves.of_program(program, self.full_limits),
            base=Candidates(
                np.arange(count),
                program.override * program.speed_share,
                program.override**2 * program.acceleration_share,
            ),
            needed=program.dwell.copy(),
            joint_position=program.via,
            labels=tuple(f"{k + 1} to {(k + 1) % count + 1}" for k in range(count)),
            speeds=SPEEDS,
            accelerations=ACCELERATIONS,
            acceleration=acceleration,
            jerk=2.0 * acceleration / max(jerk_time, MIN_JERK_TIME),
            notes=loaded.notes,
        )

    def _changed(self, chosen: Candidates, rest: Float) -> ProgramFile:
        return self._file.model_copy(
            update={
                "override": 1.0,
                "speed_share": np.round(chosen.speed, DIGITS).tolist(),
                "acceleration_share": np.round(chosen.acceleration, DIGITS).tolist(),
                "jerk_time": float(self.full_limits.jerk_time),
                "dwell": np.round(rest, DIGITS).tolist(),
            }
        )

    def _motion(self, chosen: Candidates, rest: Float) -> SampledMotion:
        program = program_for(self._changed(chosen, rest), self.robot.limits).program
        return SampledMotion(
            program, self.robot.joint_names, program.period, instants=program.instants.tolist()
        )

    def _write(self, path: Path, chosen: Candidates, rest: Float) -> None:
        document = self._changed(chosen, rest).model_dump(mode="json", exclude_none=True)
        text = yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)
        write_file(path, (COMMENT + text).encode(), TEXT, "the program")
