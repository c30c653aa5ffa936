"""`robot-energy identify excitation`: a motion that makes a robot's parameters identifiable."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_energy.cli.numbers import number, whole
from robot_energy.cli.terminal import (
    add_command,
    add_json,
    check_bag,
    check_outputs,
    present,
    progress,
)

if TYPE_CHECKING:
    from robot_energy.identify.excitation.limits import Floor
    from robot_energy.model import RobotModel

TOOL = "tool0"
CSV, BAG = "excitation.csv", "excitation_bag"

DESCRIPTION = """\
Make a motion for `identify dynamics`: one finite Fourier series per joint that begins and
ends at rest (paper B, 4.3.2), optimised so that torque determines the base parameters,
within the limits of position, velocity, acceleration and torque. The result is a CSV
file and a bag with one trajectory_msgs/JointTrajectory.

Move the robot to the start pose first. Collisions are not checked.
"""
EPILOG = """\
examples:
  robot-energy identify excitation --model kr16 --floor 0.2 --out motion
  robot-energy identify excitation --model my_robot.yaml --period 20 --criterion condition \\
      --acceleration 10 8 20 40 40 60 --out motion
"""


def add_parser(subjects: Any) -> None:
    """Add the subject.

    Args:
        subjects: Sub-parsers of ``identify``.
    """
    text = "a motion to record for the dynamics"
    parser = add_command(subjects, "excitation", run, text, DESCRIPTION, EPILOG)
    parser.add_argument("--model", required=True, metavar="FILE|NAME", help="model of the robot")
    parser.add_argument("--out", required=True, metavar="FOLDER", help="folder of the files")
    add_json(parser)
    parser.add_argument("--overwrite", action="store_true", help="replace files of an earlier run")
    shape = parser.add_argument_group("the motion")
    shape.add_argument(
        "--period",
        type=number,
        default=10.0,
        metavar="S",
        help="length; the base frequency is one over it (default 10 s)",
    )
    shape.add_argument("--harmonics", type=whole, default=5, metavar="N", help="default 5")
    shape.add_argument(
        "--rate", type=number, default=125.0, metavar="HZ", help="of the points (default 125)"
    )
    shape.add_argument(
        "--loops", type=whole, default=1, metavar="N", help="periods in the files (default 1)"
    )
    search = parser.add_argument_group("the search")
    search.add_argument(
        "--criterion",
        choices=("determinant", "condition"),
        default="determinant",
        help="greatest determinant (D-optimal, default), or least condition number",
    )
    search.add_argument("--starts", type=whole, default=3, metavar="N", help="default 3")
    search.add_argument(
        "--iterations", type=whole, default=100, metavar="N", help="of each start (default 100)"
    )
    search.add_argument(
        "--seed", type=whole, default=0, metavar="N", help="the same seed gives the same motion"
    )
    limits = parser.add_argument_group("limits, in addition to those of the URDF")
    limits.add_argument(
        "--margin",
        type=number,
        default=0.9,
        metavar="SHARE",
        help="share of every limit that may be used (default 0.9)",
    )
    limits.add_argument(
        "--acceleration",
        type=number,
        nargs="+",
        metavar="A",
        help="one value or one per joint [rad/s^2] (default: full speed in 0.5 s)",
    )
    floor = limits.add_mutually_exclusive_group()
    floor.add_argument(
        "--floor",
        type=number,
        metavar="M",
        help="the tool stays above this height in the base frame (default: 0, where there is one)",
    )
    floor.add_argument(
        "--no-floor", action="store_true", help="do not limit the height of the tool"
    )
    limits.add_argument(
        "--tool",
        metavar="LINK",
        help=f"link that stays above the floor (default: payload, or {TOOL})",
    )


def run(args: Namespace) -> int:
    """Find the motion and write it.

    Args:
        args: Of the command.

    Returns:
        Exit code 0.

    Raises:
        RobotEnergyError: If the model cannot be used or no motion is found.
    """
    import numpy as np

    from robot_energy.files.placement import all_or_none
    from robot_energy.identify.excitation.excitation import ExcitationSettings, optimise_excitation
    from robot_energy.identify.excitation.limits import ExcitationLimits
    from robot_energy.model import load
    from robot_energy.motion.trajectory_io import (
        check_sampling,
        points,
        write_csv,
        write_trajectory,
    )
    from robot_energy.report.document import Document
    from robot_energy.report.excitation import excitation_document
    from robot_energy.results.excitation import excitation_report

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
    report, page = excitation_report(found), Document()
    excitation_document(report, page)
    with all_or_none():
        write_trajectory(folder / BAG, names, time, path, args.overwrite)
        write_csv(folder / CSV, names, time, path)
        present(args, report, page, f"{CSV} and {BAG}, {len(time)} points")
    return 0


def _folder(args: Namespace, model: RobotModel) -> Path:
    """Refuse what cannot be written before the search."""
    from robot_energy.errors import ReportError
    from robot_energy.files.output_files import check_file
    from robot_energy.files.output_folder import folder_path
    from robot_energy.motion.trajectory_io import csv_kind
    from robot_energy.shown_text import shown

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
    from robot_energy.identify.excitation.limits import Floor
    from robot_energy.physics.rigid_body import Robot

    if args.no_floor:
        return None
    link = args.tool or (model.payload[0].link if model.payload else TOOL)
    if args.tool is None and args.floor is None and not Robot.from_model(model).has_link(link):
        return None
    return Floor(link, 0.0 if args.floor is None else args.floor)
