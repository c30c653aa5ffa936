"""Savings by moves that are new, judged on the rig: another order, another place of the work."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robot_energy.model import RobotModel
from robot_energy.motion import Program
from robot_energy.motion.ptp import MotionLimits
from robot_energy.motion.ptp_file import ProgramFile
from robot_energy.optimization.chain import PowerChain
from robot_energy.optimization.order import best_order
from robot_energy.optimization.place import best_place
from robot_energy.optimization.ptp_form import PtpForm
from robot_energy.optimization.task import Task, make_task
from robot_energy_papers.experiment import TOOL
from robot_energy_papers.judged_savings import DrawnWork, JudgedSaving

BOX = np.array([0.15, 0.0, 0.15])  # half widths: away from the robot and up [m]
ONE = np.ones(1)  # share of speed and acceleration: moves are not made at other ones here


def judge_new_moves(work: DrawnWork, model: RobotModel) -> list[JudgedSaving]:
    """Return what another order and another place of the work save, each alone, where they do.

    Args:
        work: The program and the plant.
        model: Of the plant, identified.
    """
    chain = PowerChain(model, np.full((1, len(model.joints)), work.degc))
    form = PtpForm(Path("drawn"), chain.robot, _file(work.program, work.limits, chain))
    base, energy = _task(chain, form, False), work.rig.energy(_run(form))
    before = base.table.cost(base.base)
    standing = float((base.table.held.energy * before.duration).mean() / before.energy)
    changed = {
        "order": form.reordered(best_order(form, chain)),
        "place": form.moved(best_place(form, chain, BOX, TOOL).joint_position),
    }
    found: list[JudgedSaving] = []
    for name, other in changed.items():
        if np.allclose(other.joint_position, form.joint_position):
            continue
        task = _task(chain, other, True)
        after = task.table.cost(task.base)
        found.append(work.judged(name, energy, before, after, _run(other), standing))
    return found


def _file(program: Program, limits: MotionLimits, chain: PowerChain) -> ProgramFile:
    """The program as a file of point-to-point moves."""
    names = chain.robot.joint_names
    via = [dict(zip(names, row, strict=True)) for row in program.via.tolist()]
    return ProgramFile(
        schema_version=1,
        motion="point_to_point",
        angle_unit="rad",
        via=via,
        dwell=program.dwell.tolist(),
        override=program.override,
        acceleration=dict(zip(names, limits.acceleration.tolist(), strict=True)),
        jerk_time=limits.jerk_time,
    )


def _task(chain: PowerChain, form: PtpForm, elsewhere: bool) -> Task:
    return make_task(
        chain, form.moves, form.base, form.needed, form.joint_position,
        elsewhere=elsewhere, speeds=ONE, accelerations=ONE,
    )  # fmt: skip


def _run(form: PtpForm) -> Program:
    """The moves of a form as a program for the rig."""
    return Program(
        form.joint_position, form.full_limits, form.needed, 1.0, form.base.speed,
        form.base.acceleration,
    )  # fmt: skip
