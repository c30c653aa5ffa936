r"""`robot-energy identify excitation`: a motion to record for the dynamics.

Make a motion for `identify dynamics`: one finite Fourier series per joint that begins and
ends at rest (paper B, 4.3.2), optimised so that torque determines the base parameters,
within the limits of position, velocity, acceleration and torque. The result is a CSV
file and a bag with one trajectory_msgs/JointTrajectory.

Move the robot to the start pose first. Collisions are not checked.

examples:
  robot-energy identify excitation --model kr16 --floor 0.2 --out motion
  robot-energy identify excitation --model my_robot.yaml --period 20 --criterion condition \
      --acceleration 10 8 20 40 40 60 --out motion
"""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from robot_energy.foundation.errors import ReportError
from robot_energy.foundation.files.output_files import check_file
from robot_energy.foundation.files.output_folder import folder_path
from robot_energy.foundation.files.placement import all_or_none
from robot_energy.foundation.shown_text import shown
from robot_energy_cli.command import LIST, ONE_OF, REQUIRED, Command, Options
from robot_energy_cli.terminal import (
    JSON_OPTION,
    check_bag,
    check_outputs,
    present,
    progress,
)

if TYPE_CHECKING:
    from robot_energy.model import RobotModel
    from robot_energy_identify.excitation.limits import Floor

TOOL = "tool0"
CSV, BAG = "excitation.csv", "excitation_bag"


OPTIONS: Options = {
    "--model FILE|NAME": ("model of the robot", REQUIRED),
    "--out FOLDER": ("folder of the files", REQUIRED),
    **JSON_OPTION,
    "--overwrite": "replace files of an earlier run",
    "the motion": {
        "--period S": ("length of the motion; its base frequency is 1 / length (default 10 s)",
                       {"default": 10.0}),
        "--harmonics N": ("of each series (default 5)", {"default": 5}),
        "--rate HZ": ("of the points (default 125)", {"default": 125.0}),
        "--loops N": ("periods in the files (default 1)", {"default": 1}),
    },
    "the search": {
        "--criterion": (
            "greatest determinant (D-optimal, default), or least condition number",
            {"choices": ("determinant", "condition"), "default": "determinant"},
        ),
        "--starts N": ("motions to begin with, drawn at random (default 3)", {"default": 3}),
        "--iterations N": ("of each start (default 100)", {"default": 100}),
        "--seed N": ("the same seed gives the same motion", {"default": 0}),
    },
    "limits, in addition to those of the URDF": {
        "--margin SHARE": ("share of every limit that may be used (default 0.9)",
                           {"default": 0.9}),
        "--acceleration A": (
            "limit of the acceleration, one value or one per joint [rad/s^2] (default: full speed "
            "in 0.5 s)",
            LIST,
        ),
        ONE_OF: {
            "--floor M": "the tool stays above this height in the base frame (default: 0, where "
            "there is one)",
            "--no-floor": "do not limit the height of the tool",
        },
        "--tool LINK": f"link that stays above the floor (default: payload, or {TOOL})",
    },
}  # fmt: skip


def _run(args: Namespace) -> int:
    import numpy as np

    from robot_energy.model import load
    from robot_energy_identify.excitation.excitation import ExcitationSettings, optimise_excitation
    from robot_energy_identify.excitation.limits import ExcitationLimits
    from robot_energy_plan.motion.joint_trajectory import (
        check_sampling,
        points,
        write_csv,
        write_trajectory,
    )

    check_outputs(args, [args.model])
    model = load(args.model)
    folder = _folder(args, model)
    acceleration = None if args.acceleration is None else np.asarray(args.acceleration)
    limits = ExcitationLimits(model, acceleration, args.margin, _floor(args, model))
    settings = ExcitationSettings(
        criterion=args.criterion,
        harmonics=args.harmonics,
        period=args.period,
        starts=args.starts,
        iterations=args.iterations,
        seed=args.seed,
    )
    check_sampling(args.rate, args.loops)
    with progress("looking for a motion") as report:
        found = optimise_excitation(model, limits, settings, report)
    time, path = points(found.motion, args.rate, args.loops)
    names = limits.robot.joint_names
    with all_or_none():
        write_trajectory(folder / BAG, names, time, path, args.overwrite)
        write_csv(folder / CSV, names, time, path)
        made = f"{CSV} and {BAG}, {len(time)} points"
        present(args, found, made=made)
    return 0


def _folder(args: Namespace, model: RobotModel) -> Path:
    """Refuse what cannot be written before the search."""
    from robot_energy_plan.motion.joint_trajectory import csv_kind

    folder = folder_path(args.out)
    inputs = [args.model]
    check_bag(str(folder / BAG), args.overwrite, inputs, [args.json])
    if not folder.exists():
        return folder
    check_file(folder / CSV, csv_kind(model.joint_names), "the trajectory", inputs)
    if (folder / CSV).exists() and not args.overwrite:
        raise ReportError(
            f"the folder '{shown(str(folder))}' holds {CSV} already",
            "a new folder",
            "choose another, or give --overwrite",
        )
    return folder


def _floor(args: Namespace, model: RobotModel) -> Floor | None:
    """The tool's floor; by default only where the robot has such a tool."""
    from robot_energy.physics.rigid_body import Robot
    from robot_energy_identify.excitation.limits import Floor

    if args.no_floor:
        return None
    link = args.tool or (model.payload[0].link if model.payload else TOOL)
    if args.tool is None and args.floor is None and not Robot.from_model(model).has_link(link):
        return None
    return Floor(link, 0.0 if args.floor is None else args.floor)


COMMAND = Command.of(__doc__, _run, OPTIONS)
