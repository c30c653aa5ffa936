r"""`robot-energy optimize`: programs that need less energy for the same work.

Look for the speeds, accelerations, pauses and states at rest with which a program needs least
energy, at the motor temperatures that you give. What each measure saves has a 90 % band, in
which errors that both programs share cancel; a saving smaller than its band is not claimed.
Faster can be cheaper, and a cold robot can need other speeds than a warm one. Nothing is
measured here. Paths stay as they are, so collisions stay as they were.

examples:
  robot-energy optimize src/examples/programs/kr16_pick_and_place.yaml --model kr16 \
      --temperature 20..60 --out cheaper.yaml
  robot-energy optimize moves.yaml --model m.yaml --cycle-time 12 --standby --report s.html
  robot-energy optimize recorded_bag --start 12 --end 31.5 --free-rests --model m.yaml
"""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import Any

from robot_energy.replay.options import PART
from robot_energy_cli.command import REQUIRED, Command, Options, flags, keywords_of
from robot_energy_cli.terminal import OUTPUTS, check_outputs, present, progress
from robot_energy_cli.tool_options import tool_options, tool_table
from robot_energy_plan.options import TOOL, OptimizeOptions

OPTIONS: Options = {
    "program PROGRAM|BAG": "YAML of point-to-point moves, G-code, a JointTrajectory as CSV or in a "
    "bag, or a bag of recorded joint states",
    "--model FILE|NAME": ("model of the robot", REQUIRED),
    "--temperature DEGC|A..B": "temperature of all motors, or the range in which they work "
    "(default: that of the model)",
    **flags(OptimizeOptions, ""),
    "G-code": {**tool_table(), **flags(OptimizeOptions, TOOL)},
    "part of recorded joint states: one cycle": flags(OptimizeOptions, PART),
    "output": {
        "--out FILE": "write the chosen program in the form of the given one",
        **OUTPUTS,
        "--plot FILE": "draw savings and trade-offs: png, svg, pdf",
    },
}


def _run(args: Namespace) -> int:
    from robot_energy.foundation.files.placement import all_or_none
    from robot_energy_plan.api.optimize import optimize
    from robot_energy_report.optimization import measures_and_front

    check_outputs(args, [args.program, args.model, args.rest_states, *args.level])
    with progress(f"{args.program}: every move in every way") as show:
        options: Any = keywords_of(optimize, args) | {
            "tool": tool_options(args, args.base, args.start_position),
            "progress": show,
        }
        found = optimize(args.program, args.model, _temperature(args.temperature), **options)
    with all_or_none():
        if args.out is not None:
            found.write(Path(args.out))
        present(
            args,
            found.report,
            "Less energy for the same work",
            "A program as it is and as chosen, through the model of the robot. "
            "Nothing in this report was measured.",
            "the chosen program",
            lambda path: measures_and_front(found.report, path),
        )
    return 0


def _temperature(text: str | None) -> float | tuple[float, float] | None:
    from robot_energy.foundation.errors import MotionError

    if text is None:
        return None
    try:
        values = [float(part) for part in text.split("..")]
    except ValueError:
        values = []
    if len(values) not in (1, 2):
        raise MotionError(f"--temperature is '{text}'", "one temperature, or two as 20..60 [degC]")
    return values[0] if len(values) == 1 else (values[0], values[1])


COMMAND = Command.of(__doc__, _run, OPTIONS)
