"""`robot-energy advise`: what would save how much energy, from recordings alone.

Rank what would save energy, from recordings alone: standby in breaks and at night, a supply
that returns braking energy, a warmer start, other speeds, other places to wait. Each has a 90 %
band and says what it rests on; a saving smaller than its band is listed apart, as not proven.

examples:
  robot-energy advise monday tuesday --model my_robot.yaml --price 0.25 --co2 0.38
  robot-energy advise dataset --model my_robot.yaml --report advice.html
  robot-energy advise bag --model m.yaml --rest-states states.yaml --hours-per-day 16
"""

from __future__ import annotations

from argparse import Namespace
from typing import Any

from robot_energy.foundation.process_memory import keep_freed_memory
from robot_energy_cli.command import LIST, Command, Options, flags, keywords_of
from robot_energy_cli.replay_arguments import BAG, DAMAGED, model_named, replay_options
from robot_energy_cli.terminal import OUTPUTS, check_outputs, present, progress
from robot_energy_fleet.options import YEAR, AdviseOptions

OPTIONS: Options = {
    "recordings BAG|DATASET": (f"{BAG}; or the folder that `fleet run` wrote", LIST),
    **flags(AdviseOptions, "rest_states"),
    "--no-speeds": "do not look for other speeds, which takes longest",
    YEAR: flags(AdviseOptions, YEAR),
    "outputs": OUTPUTS,
    **replay_options(fixed=False),
}


def _run(args: Namespace) -> int:
    from robot_energy_fleet.advice.advise import advise

    named = model_named(args)
    check_outputs(args, [*args.recordings, named, args.inputs, args.rest_states])
    keep_freed_memory()
    with progress("reading recordings") as show:
        options: dict[str, Any] = keywords_of(advise, args) | {
            "look_at_speeds": not args.no_speeds,
            "progress": show,
        }
        found = advise(args.recordings, named, **options)
    present(
        args,
        found.report,
        "What would save energy",
        "From recordings alone, through the model of the robot. No change was tried.",
    )
    return DAMAGED if found.report.problems else 0


COMMAND = Command.of(__doc__, _run, OPTIONS)
