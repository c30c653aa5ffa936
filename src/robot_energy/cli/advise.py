"""`robot-energy advise`: what would save how much, from recordings alone."""

from __future__ import annotations

from argparse import Namespace
from typing import Any

from robot_energy.cli.numbers import number
from robot_energy.cli.replay_options import BAG, DAMAGED, add_replay, options_of
from robot_energy.cli.robots import model_named
from robot_energy.cli.terminal import add_command, add_json, check_outputs, present, progress
from robot_energy.freed_memory import keep_freed_memory

DESCRIPTION = """\
Rank what would save energy, from recordings alone: standby in breaks and at night, a supply that
returns braking energy, a warmer start, other speeds, other places to wait. Each has a 90 % band and
says what it rests on; a saving smaller than its band is listed apart, as not proven.
"""
EPILOG = """\
examples:
  robot-energy advise monday tuesday --model my_robot.yaml --price 0.25 --co2 0.38
  robot-energy advise dataset --model my_robot.yaml --report advice.html
  robot-energy advise bag --model m.yaml --rest-states states.yaml --hours-per-day 16
"""


def add_parser(commands: Any) -> None:
    """Add the sub-command.

    Args:
        commands: Sub-parsers of the command.
    """
    text = "what would save how much energy, from recordings alone"
    parser = add_command(commands, "advise", run, text, DESCRIPTION, EPILOG)
    parser.add_argument(
        "recordings",
        nargs="+",
        metavar="BAG|DATASET",
        help=f"{BAG}; or the folder that `fleet run` wrote",
    )
    parser.add_argument(
        "--rest-states",
        metavar="FILE",
        help="power of standby and hibernation of this robot (default: assumed figures)",
    )
    parser.add_argument(
        "--no-speeds", action="store_true", help="do not look for other speeds, which takes longest"
    )
    year = parser.add_argument_group("a year")
    year.add_argument(
        "--hours-per-day",
        type=number,
        metavar="H",
        help="of such work by all robots together (default: as recorded, else 24)",
    )
    year.add_argument(
        "--days-per-year",
        type=number,
        metavar="D",
        help="with such work (default: 365 where a week was recorded, else 250)",
    )
    year.add_argument("--price", type=number, metavar="X", help="of a kWh")
    year.add_argument("--currency", default="EUR", metavar="NAME", help="of it (default EUR)")
    year.add_argument("--co2", type=number, metavar="KG", help="emission factor [kg/kWh]")
    outputs = parser.add_argument_group("outputs")
    add_json(outputs)
    outputs.add_argument("--report", metavar="FILE", help="write one HTML file with everything")
    add_replay(parser, fixed=False)


def run(args: Namespace) -> int:
    """Read the recordings and print what would save energy.

    Args:
        args: Of the command line.

    Returns:
        0, or 3 if a bag is damaged and was read in part.

    Raises:
        RobotEnergyError: If recordings, model or outputs cannot be used.
    """
    from robot_energy.advice.run import advise
    from robot_energy.optimization.rest_states import read_rest_states
    from robot_energy.report.advice import advice_document
    from robot_energy.report.document import Document

    named = model_named(args)
    check_outputs(args, [*args.recordings, named, args.inputs, args.rest_states])
    states = None if args.rest_states is None else read_rest_states(args.rest_states)
    keep_freed_memory()
    with progress("reading recordings") as show:
        options: dict[str, Any] = options_of(args) | {"progress": show}
        found = advise(
            args.recordings,
            named,
            rest_states=states,
            price=args.price,
            currency=args.currency,
            co2=args.co2,
            hours_per_day=args.hours_per_day,
            days_per_year=args.days_per_year,
            look_at_speeds=not args.no_speeds,
            **options,
        )
    page = Document(
        "What would save energy",
        "From recordings alone, through the model of the robot. No change was tried.",
    )
    advice_document(found.report, page)
    present(args, found.report, page)
    return DAMAGED if found.report.problems else 0
