"""`robot-energy optimize`: the same work with less energy."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import Any

from robot_energy.cli.numbers import number
from robot_energy.cli.replay_options import PART
from robot_energy.cli.terminal import add_command, add_json, check_outputs, present, progress
from robot_energy.cli.tool_options import add_tool, tool_options

DESCRIPTION = """\
Look for the speeds, accelerations, pauses and states at rest with which a program needs least
energy, at the motor temperatures that you give. What each measure saves has a 90 % band, in which
errors that both programs share cancel; a saving smaller than its band is not claimed. Faster can be
cheaper, and a cold robot can need other speeds than a warm one. Nothing is measured here.
Collisions are not checked; paths stay as they are but for --place and --any-order.
"""
EPILOG = """\
examples:
  robot-energy optimize src/examples/programs/kr16_pick_and_place.yaml --model kr16 \\
      --temperature 20..60 --out cheaper.yaml
  robot-energy optimize moves.yaml --model m.yaml --cycle-time 12 --standby --report savings.html
  robot-energy optimize recorded_bag --start 12 --end 31.5 --free-rests --model m.yaml
"""


def add_parser(commands: Any) -> None:
    """Add the sub-command.

    Args:
        commands: Sub-parsers of the command.
    """
    text = "programs that need less energy for the same work"
    parser = add_command(commands, "optimize", run, text, DESCRIPTION, EPILOG)
    parser.add_argument(
        "program",
        metavar="PROGRAM|BAG",
        help="YAML of point-to-point moves, G-code, a JointTrajectory as CSV or in a bag, or a bag "
        "of recorded joint states",
    )
    parser.add_argument("--model", required=True, metavar="FILE|NAME", help="model of the robot")
    parser.add_argument(
        "--temperature",
        metavar="DEGC|A..B",
        help="of all motors, or the range in which they work (default: that of the model)",
    )
    parser.add_argument(
        "--cycle-time",
        type=number,
        metavar="S",
        help="time of one cycle with its wait (default: the next one begins at once)",
    )
    parser.add_argument(
        "--standby",
        action="store_true",
        help="rests may be spent on brakes, in standby or hibernation, with assumed figures",
    )
    parser.add_argument(
        "--rest-states", metavar="FILE", help="figures of these states, for this robot"
    )
    parser.add_argument(
        "--regenerative", action="store_true", help="judge a regenerative supply as well"
    )
    parser.add_argument(
        "--peak-limit", type=number, metavar="W", help="greatest power from the grid"
    )
    parser.add_argument(
        "--time-law",
        action="store_true",
        help="moves may follow time laws of their own; --out writes a trajectory then",
    )
    parser.add_argument(
        "--level",
        action="append",
        default=[],
        metavar="PROGRAM",
        help="program of another robot of this model on the same supply; starts within the cycle "
        "time are shifted so that the peak is least; several times for several robots",
    )
    parser.add_argument(
        "--any-order",
        action="store_true",
        help="the configurations of point-to-point moves are independent: their order may change",
    )
    parser.add_argument(
        "--place",
        metavar="X,Y,Z",
        help="the workpiece may be shifted by up to this to either side, in the base frame [m]; "
        "for point-to-point moves",
    )
    parser.add_argument(
        "--free-rests",
        action="store_true",
        help="the work needs none of the rests of the program: moves may fill them (cycle time: as "
        "long as now, unless given)",
    )
    parser.add_argument(
        "--topic", metavar="NAME", help="of the JointTrajectory, or of the joint states, in a bag"
    )
    tool = parser.add_argument_group("G-code; --tool also holds the work that --place shifts")
    add_tool(tool)
    tool.add_argument(
        "--max-feed",
        type=number,
        default=1.0,
        metavar="F",
        help="greatest factor on all feeds (default 1: never faster than the program)",
    )
    part = parser.add_argument_group("part of recorded joint states: one cycle")
    for name, keywords in PART.items():
        part.add_argument(f"--{name}", **keywords)
    output = parser.add_argument_group("output")
    output.add_argument(
        "--out", metavar="FILE", help="write the chosen program in the form that went in"
    )
    add_json(output)
    output.add_argument("--report", metavar="FILE", help="write one HTML file with everything")
    output.add_argument("--plot", metavar="FILE", help="draw savings and trade-offs: png, svg, pdf")


def run(args: Namespace) -> int:
    """Look for the cheapest program and print what was found.

    Args:
        args: Of the command line.

    Returns:
        The exit code.

    Raises:
        RobotEnergyError: If model or program cannot be used.
    """
    from robot_energy.api.optimize import optimize
    from robot_energy.files.placement import all_or_none
    from robot_energy.motion.load_motion import joint_list
    from robot_energy.optimization.rest_states import read_rest_states
    from robot_energy.report.document import Document
    from robot_energy.report.optimization import optimization_document
    from robot_energy.report.optimization_figure import measures_and_front

    check_outputs(args, [args.program, args.model, args.rest_states, *args.level])
    states = args.standby if args.rest_states is None else read_rest_states(args.rest_states)
    with progress(f"{args.program}: every move in every way") as show:
        found = optimize(
            args.program,
            args.model,
            _temperature(args.temperature),
            cycle_time=args.cycle_time,
            standby=states,
            regenerative=args.regenerative,
            peak_limit=args.peak_limit,
            level=args.level,
            any_order=args.any_order,
            time_law=args.time_law,
            place=None if args.place is None else joint_list(args.place, "--place", (3,)).tolist(),
            link=args.tool,
            topic=args.topic,
            start=args.start,
            end=args.end,
            free_rests=args.free_rests,
            tool=tool_options(args, args.base, args.start_position),
            max_feed=args.max_feed,
            progress=show,
        )
    page = Document(
        "Less energy for the same work",
        "A program as it is and as chosen, through the model of the robot. "
        "Nothing in this report was measured.",
    )
    optimization_document(found.report, page)
    with all_or_none():
        if args.out is not None:
            found.write(Path(args.out))
        present(
            args, found.report, page, "the chosen program",
            lambda path: measures_and_front(found.report, path),
        )  # fmt: skip
    return 0


def _temperature(text: str | None) -> float | tuple[float, float] | None:
    from robot_energy.errors import MotionError

    if text is None:
        return None
    try:
        values = [float(part) for part in text.split("..")]
    except ValueError:
        values = []
    if len(values) not in (1, 2):
        raise MotionError(f"--temperature is '{text}'", "one temperature, or two as 20..60 [degC]")
    return values[0] if len(values) == 1 else (values[0], values[1])
