"""A program whose moves follow time laws of their own: what comes out is a trajectory."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from robot_energy.blocks import Float
from robot_energy.motion.ptp import Trajectory
from robot_energy.optimization.candidates import STEP, Candidates, Moves
from robot_energy.optimization.program_form import ProgramForm, WrittenTrajectory

MIN_REST = 1e-4  # s; less is rounding


class TimedForm(WrittenTrajectory):
    """A program with time laws.

    Args:
        form: The program.
        moves: Its moves with their laws.
    """

    def __init__(self, form: ProgramForm, moves: Moves) -> None:
        note = "moves with a time law of their own need a controller that follows a trajectory"
        given: dict[str, Any] = {one.name: getattr(form, one.name) for one in fields(ProgramForm)}
        given |= {"moves": moves, "notes": (*form.notes, note)}
        super().__init__(**given)

    def _points(self, chosen: Candidates, rest: Float) -> tuple[Float, Trajectory]:
        length = self.moves.duration(chosen)
        clock, times, parts = 0.0, list[Float](), list[Trajectory]()
        for k, (wait, move) in enumerate(zip(rest.tolist(), length.tolist(), strict=True)):
            count = max(2, int(np.ceil(move / STEP)) + 1)
            own = np.linspace(0.0, float(move), count)
            path = self.moves.sample(chosen, np.full(count, k, dtype=np.int64), own)
            still = Trajectory(
                path.joint_position[:1], 0 * path.joint_velocity[:1], 0 * path.joint_velocity[:1]
            )
            if not times:
                times.append(np.array([clock]))
                parts.append(still)
            rows = slice(0 if wait > MIN_REST else 1, None)
            clock += wait
            times.append((clock + own)[rows])
            parts.append(path[rows])
            clock += move
        return np.concatenate(times), Trajectory.concatenate(parts)
