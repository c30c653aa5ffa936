"""A G-code program: all its feeds are multiplied by one factor, as by a feed override."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robot_energy.foundation.errors import MotionError
from robot_energy.foundation.files.output_files import GENERATOR, FileKind, write_file
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import Float, Int
from robot_energy_plan.motion.gcode import gcode_text, read_gcode
from robot_energy_plan.motion.gcode_words import with_feed
from robot_energy_plan.motion.joint_trajectory import JointTrajectory
from robot_energy_plan.motion.load_motion import ToolOptions, tool_program
from robot_energy_plan.motion.ptp import DEFAULT_JERK_TIME, Trajectory
from robot_energy_plan.optimization.chain import Candidates, Moves
from robot_energy_plan.optimization.program_form import WrittenTrajectory

FEEDS = np.array([0.5, 0.6, 0.7, 0.8, 0.9, 1.0])  # shares of the greatest factor [-]
MAX_FACTOR = 10.0
MARK = f"; Written by {GENERATOR}.\n"
GCODE = (FileKind("G-code", MARK.encode(), b""),)
MAX_TIME = 3600.0  # s


class _FeedMoves(Moves):
    """One move: the whole program, at every factor on its feeds up to ``fastest``."""

    count = 1

    def __init__(
        self, text: str, name: str, robot: Robot, options: ToolOptions, fastest: float
    ) -> None:
        self._text, self._name, self._robot, self._options = text, name, robot, options
        self._fastest = fastest
        self._made: dict[float, JointTrajectory] = {}

    def written(self, speed: float) -> str:
        """The program at a share of the greatest factor."""
        return with_feed(self._text, speed * self._fastest)

    def motion(self, speed: float) -> JointTrajectory:
        """The motion of the joints at a share of the greatest factor."""
        speed = round(speed, 6)
        if speed not in self._made:
            options = self._options
            program = read_gcode(
                self.written(speed), self._name, options.rapid_speed, options.flavor
            )
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
        return np.array([self.motion(speed).duration for speed in candidates.speed.tolist()])

    def instants(self, candidates: Candidates, place: int) -> Float:
        return self.motion(float(candidates.speed[place])).instants

    def sample(self, candidates: Candidates, place: Int, time: Float) -> Trajectory:
        """The motion; ``place`` rises."""
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
    """A G-code program.

    Args:
        max_feed: Greatest factor on its feeds; 1: never faster than it states. [-]
    """

    def __init__(
        self, path: Path, robot: Robot, options: ToolOptions, max_feed: float = 1.0
    ) -> None:
        if not 1.0 <= max_feed <= MAX_FACTOR:
            raise MotionError(
                f"the greatest factor on the feeds is {max_feed:g}", f"1 to {MAX_FACTOR:g}"
            )
        text = gcode_text(path)
        self._feeds = _FeedMoves(text, str(path), robot, options, max_feed)
        made = self._feeds.motion(1 / max_feed)
        if max_feed > 1.0:
            self._feeds.motion(1.0)  # that a robot cannot make is said before the search
        at = made.sample(made.instants)
        acceleration: Float = np.abs(at.joint_acceleration).max(axis=0)
        program = read_gcode(text, str(path), options.rapid_speed, options.flavor)
        loaded = tool_program(program, robot, options)
        super().__init__(
            robot=robot,
            moves=self._feeds,
            base=Candidates(np.zeros(1, dtype=np.int64), np.array([1 / max_feed]), np.ones(1)),
            needed=np.zeros(1),
            joint_position=at.joint_position[:1],
            labels=("whole program",),
            speeds=FEEDS,
            accelerations=np.ones(1),
            acceleration=acceleration,
            jerk=acceleration / DEFAULT_JERK_TIME,
            notes=(
                *loaded.notes,
                "all feeds are multiplied by one factor; the model does not know which feeds the "
                "process allows",
            ),
        )

    def _write(self, path: Path, chosen: Candidates, rest: Float) -> None:
        text = self._feeds.written(float(chosen.speed[0]))
        write_file(path, (MARK + text.removeprefix(MARK)).encode(), GCODE, "the program")
