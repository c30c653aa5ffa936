"""`robot-energy layouts`: layouts of Foxglove, Lichtblick, PlotJuggler and rqt."""

from __future__ import annotations

from argparse import Namespace
from typing import Any

from robot_energy.cli.terminal import add_command

DESCRIPTION = """\
Write layouts that show every number of the energy topics: for Foxglove, Lichtblick,
PlotJuggler 3 and rqt. They are made from the message definitions and the joints of the model.
"""


def add_parser(commands: Any) -> None:
    """Add the sub-command.

    Args:
        commands: What `ArgumentParser.add_subparsers` returned.
    """
    text = "write layouts for Foxglove, Lichtblick, PlotJuggler, rqt"
    parser = add_command(commands, "layouts", run, text, DESCRIPTION)
    parser.add_argument("--out", metavar="FOLDER", required=True, help="folder for the files")
    parser.add_argument(
        "--model", metavar="FILE|NAME", default="kr16", help="whose joints are shown (%(default)s)"
    )


def run(args: Namespace) -> int:
    """Write the files and name them.

    Args:
        args: Of the sub-command.

    Returns:
        0.

    Raises:
        RobotEnergyError: If the model cannot be read or a file not be written.
    """
    from robot_energy.layouts import write_layouts
    from robot_energy.model import load

    for path in write_layouts(args.out, load(args.model).joint_names):
        print(path)
    return 0
