"""`robot-energy fleet identify`: one friction model from all bags.

Identify one model of friction over temperature from all bags of a fleet, through the sums that
`fleet run` has kept: no bag is read again. Robots that differ from their sisters, or have
changed, are left out. Figures on the newest fifth of the bags, which their fit has not seen,
say how good it is.

example:
  robot-energy fleet identify dataset --model kr16 --out fleet.yaml
"""

from __future__ import annotations

from argparse import Namespace

from robot_energy_cli.command import REQUIRED, Command, Options
from robot_energy_cli.identify_inputs import SENSOR_OPTIONS, IdentifyInputs, result_options
from robot_energy_cli.terminal import present


def _run(args: Namespace) -> int:
    from robot_energy.model import load
    from robot_energy_fleet.dataset import read_tables
    from robot_energy_fleet.identify import identify_fleet
    from robot_energy_report.identification import friction_over_temperature

    IdentifyInputs(args).check_results()
    tables = read_tables(args.dataset)
    found, model = identify_fleet(
        tables, load(args.model), args.dataset, IdentifyInputs(args).sensor_limits()
    )
    present(
        args,
        found,
        "Friction of a fleet",
        f"Identified from {args.dataset}.",
        plot=lambda path: friction_over_temperature(found.axes, path, title=args.dataset),
        model=model,
    )
    return 0


OPTIONS: Options = {
    "dataset": "folder that `fleet run` wrote",
    "--model FILE|NAME": ("model file or shipped model with which the bags were run", REQUIRED),
    **SENSOR_OPTIONS,
    **result_options("this friction", "write the laws over temperature as a figure"),
}
COMMAND = Command.of(__doc__, _run, OPTIONS)
