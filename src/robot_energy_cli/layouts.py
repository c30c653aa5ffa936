"""`robot-energy layouts`: write layouts for Foxglove, Lichtblick, PlotJuggler, rqt.

Write layouts that show every number of the energy topics: for Foxglove, Lichtblick, PlotJuggler
3 and rqt. They are made from the message definitions and the joints of the model.
"""

from __future__ import annotations

from argparse import Namespace

from robot_energy_cli.command import REQUIRED, Command, Options

OPTIONS: Options = {
    "--out FOLDER": ("folder for the files", REQUIRED),
    "--model FILE|NAME": ("whose joints are shown (%(default)s)", {"default": "kr16"}),
}


def _run(args: Namespace) -> int:
    from robot_energy.model import load
    from robot_energy_report.layouts import write_layouts

    for path in write_layouts(args.out, load(args.model).joint_names):
        print(path)
    return 0


COMMAND = Command.of(__doc__, _run, OPTIONS)
