r"""`robot-energy shared-bus`: what several robots save on one DC bus.

Say what several robots save on one DC bus, where what one brakes is used by another: from bags
that were recorded at one time, or for programs that repeat in a common cycle, with all starts
at once, with starts that fall anywhere and with the best ones. Capacitors add up; one brake
resistor takes what is left. Nothing is measured here: the bus is that of the models.

examples:
  robot-energy shared-bus robot1_bag robot2_bag --model kr16
  robot-energy shared-bus monday tuesday --model my_robot.yaml --same-start
  robot-energy shared-bus a.yaml b.yaml --model kr16 --model irb4600 --temperature 40 \
      --cycle-time 12 --report bus.html
"""

from __future__ import annotations

from argparse import Namespace
from typing import Any

from robot_energy_cli.command import LIST, Command, Options, flags, keywords_of
from robot_energy_cli.replay_arguments import DAMAGED, READING
from robot_energy_cli.terminal import OUTPUTS, check_outputs, present
from robot_energy_cli.tool_options import tool_options, tool_table
from robot_energy_plan.options import SharedBusOptions

OPTIONS: Options = {
    "motions BAG|PROGRAM": (
        "one of each robot: bags of recorded joint states, or programs as of predict",
        LIST,
    ),
    "--model FILE|NAME": (
        "model of the robots: once for all, or once for each, in the order of the motions",
        {"required": True, "action": "append"},
    ),
    "--temperature DEGC": "temperature of all motors, for programs (default: that of each model)",
    **flags(SharedBusOptions, ""),
    "outputs": OUTPUTS,
    "G-code": tool_table(),
    **READING,
}


def _run(args: Namespace) -> int:
    from robot_energy_plan.api.shared_bus import shared_bus

    check_outputs(args, [*args.motions, *args.model, args.inputs])
    tool = tool_options(args, args.base, args.start_position)
    given: Any = keywords_of(shared_bus, args) | {"tool": tool}
    found = shared_bus(args.motions, args.model, args.temperature, **given)
    present(
        args,
        found.report,
        "Several robots on one DC bus",
        "Through the models of the robots: with a supply each, and on one bus. "
        "Nothing in this report was measured.",
    )
    return DAMAGED if found.report.recorded and found.report.problems else 0


COMMAND = Command.of(__doc__, _run, OPTIONS)
