"""Programs of point-to-point moves: read, changed, and written back as the same kind of file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

from robot_energy.foundation.files.output_files import COMMENT, TEXT, write_file
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import Float
from robot_energy_plan.motion.planned import SampledMotion
from robot_energy_plan.motion.ptp import MotionLimits
from robot_energy_plan.motion.ptp_file import ProgramFile, program_for, read_program
from robot_energy_plan.optimization.candidates import ACCELERATIONS, SPEEDS, Candidates, PtpMoves
from robot_energy_plan.optimization.program_form import ProgramForm

MIN_JERK_TIME = 0.01  # s, over which a time law builds up acceleration where nothing is stated
DIGITS = 6  # of shares in a file, after the point


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
