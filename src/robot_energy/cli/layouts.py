"""`robot-energy layouts`: layouts of Foxglove, Lichtblick, PlotJuggler and rqt."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from robot_energy.cli.command import Command, add_option

DESCRIPTION = """\
Write layouts that show every number of the energy topics: for Foxglove, Lichtblick,
PlotJuggler 3 and rqt. They are made from the message definitions and the joints of the model.
"""


def _options(parser: ArgumentParser) -> None:
    add_option(parser, "--out FOLDER", "folder for the files", required=True)
    add_option(parser, "--model FILE|NAME", "whose joints are shown (%(default)s)", default="kr16")


def _run(args: Namespace) -> int:
    from robot_energy.layouts import write_layouts
    from robot_energy.model import load

    for path in write_layouts(args.out, load(args.model).joint_names):
        print(path)
    return 0


COMMAND = Command(
    "layouts",
    "write layouts for Foxglove, Lichtblick, PlotJuggler, rqt",
    _run,
    _options,
    DESCRIPTION,
)
