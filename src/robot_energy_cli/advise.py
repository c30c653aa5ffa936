"""`robot-energy advise`: what would save how much, from recordings alone."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from typing import Any

from robot_energy.foundation.process_memory import keep_freed_memory
from robot_energy_cli.command import Command, add_options, keywords_of
from robot_energy_cli.replay_options import BAG, DAMAGED, add_replay, model_named
from robot_energy_cli.terminal import OUTPUTS, check_outputs, present, progress

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


OPTIONS = {
    "--rest-states FILE": "power of standby and hibernation of this robot (default: assumed "
    "figures)",
    "--no-speeds": "do not look for other speeds, which takes longest",
}
YEAR = {
    "--hours-per-day H": "hours a day of such work, all robots together (default: as recorded, "
    "where the recordings span a day)",
    "--days-per-year D": "days a year of such work (default: 365, where the recordings span a "
    "week); without hours and days no saving a year is stated",
    "--price X": "price of a kWh",
    "--currency NAME": "currency of the price (default EUR)",
    "--co2 KG": "emission factor [kg/kWh]",
}


def _options(parser: ArgumentParser) -> None:
    parser.add_argument(
        "recordings",
        nargs="+",
        metavar="BAG|DATASET",
        help=f"{BAG}; or the folder that `fleet run` wrote",
    )
    add_options(parser, OPTIONS)
    add_options(parser.add_argument_group("a year"), YEAR)
    add_options(parser.add_argument_group("outputs"), OUTPUTS)
    add_replay(parser, fixed=False)
    parser.set_defaults(currency="EUR")


def _run(args: Namespace) -> int:
    from robot_energy_fleet.advice.advise import advise
    from robot_energy_fleet.documents.advice import advice_document
    from robot_energy_plan.optimization.rest_states import read_rest_states
    from robot_energy_report.document import Document

    named = model_named(args)
    check_outputs(args, [*args.recordings, named, args.inputs, args.rest_states])
    states = None if args.rest_states is None else read_rest_states(args.rest_states)
    keep_freed_memory()
    with progress("reading recordings") as show:
        options: dict[str, Any] = keywords_of(advise, args) | {
            "rest_states": states,
            "look_at_speeds": not args.no_speeds,
            "progress": show,
        }
        found = advise(args.recordings, named, **options)
    page = Document(
        "What would save energy",
        "From recordings alone, through the model of the robot. No change was tried.",
    )
    advice_document(found.report, page)
    present(args, found.report, page)
    return DAMAGED if found.report.problems else 0


COMMAND = Command(
    "advise",
    "what would save how much energy, from recordings alone",
    _run,
    _options,
    DESCRIPTION,
    EPILOG,
)
