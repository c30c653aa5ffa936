"""`robot-energy simulate`: record the virtual test rig to a bag."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from robot_energy.cli.numbers import number, whole
from robot_energy.cli.terminal import add_command, check_bag, console, wrote

if TYPE_CHECKING:
    from robot_energy.motion import Program
    from robot_energy.rig import PlantProfile

RATE = 250.0  # Hz
ROBOTS = ("kr16", "mantis", "testbed", "irb4600")
TOOL, MIN_HEIGHT = "tool0", 0.2  # m: the random program stays above the floor

DESCRIPTION = """\
Simulate a robot with its cabinet, motor temperature sensors and grid meter, and record their
messages to a bag. The plant knows effects that the model under test does not:
Stribeck and load-dependent friction, lubricant, copper, iron and inverter loss, sensor
errors. Nothing is measured on a robot: results on the rig show that the method works.
With --plant-seed the plant's friction, losses and constants are drawn at random, and any model
file gives the bodies. With --hard come effects that no model file has a term for: elastic
joints, presliding, Coulomb friction that falls with temperature, viscous friction of a lower
power of speed, a fan, and filtered and offset sensors.
"""
EPILOG = """\
example:
  robot-energy simulate --robot kr16 --duration 60 --start-temperature 20 --out cold
  robot-energy replay cold --model kr16 --compare
"""


def add_parser(commands: Any) -> None:
    """Add the sub-command.

    Args:
        commands: What `ArgumentParser.add_subparsers` returned.
    """
    text = "record the virtual test rig to a bag"
    parser = add_command(commands, "simulate", run, text, DESCRIPTION, EPILOG)
    parser.add_argument(
        "--robot",
        default="kr16",
        metavar="NAME",
        help=f"plant: {', '.join(ROBOTS)}; with --plant-seed any model (default kr16)",
    )
    parser.add_argument(
        "--plant-seed",
        type=whole,
        metavar="N",
        help="draw friction, losses and constants of the plant at random",
    )
    parser.add_argument("--hard", action="store_true", help="effects without a term in models")
    parser.add_argument("--out", required=True, metavar="BAG", help="folder of the new bag")
    parser.add_argument("--duration", type=number, default=60.0, metavar="S", help="default 60 s")
    parser.add_argument(
        "--start-temperature",
        type=number,
        default=20.0,
        metavar="DEGC",
        help="of motors and gears (default 20 degC)",
    )
    parser.add_argument(
        "--ambient", type=number, default=20.0, metavar="DEGC", help="default 20 degC"
    )
    parser.add_argument(
        "--seed",
        type=whole,
        default=0,
        metavar="N",
        help="of program and sensor errors; the same seed gives the same bag",
    )
    parser.add_argument(
        "--device-seed",
        type=whole,
        metavar="N",
        help="of the constant errors of meter and sensors: recordings of one robot have the same "
        "(default: that of --seed)",
    )
    parser.add_argument(
        "--speedup",
        type=number,
        default=1.0,
        metavar="FACTOR",
        help="factor on how fast temperatures change (default 1)",
    )
    parser.add_argument(
        "--rate",
        type=number,
        default=RATE,
        metavar="HZ",
        help=f"of the joint states (default {RATE:g} Hz)",
    )
    parser.add_argument(
        "--override",
        type=number,
        default=1.0,
        metavar="SHARE",
        help="share of full speed, above 0 to 1 (default 1)",
    )
    parser.add_argument(
        "--dwell",
        type=number,
        default=0.2,
        metavar="S",
        help="rest after every motion (default 0.2 s)",
    )
    parser.add_argument(
        "--drive-power",
        action="store_true",
        help="record the electrical input of each drive as well, on /drive_power",
    )
    parser.add_argument(
        "--auxiliary",
        action="store_true",
        help="record a pump and an extruder as well, with meters and states of their own",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace the bag of --out")


def run(args: Namespace) -> int:
    """Record the rig.

    Args:
        args: Of the command.

    Returns:
        Exit code 0.

    Raises:
        RigError: If the seed is negative, or the figures of the rig do not fit together.
        RobotEnergyError: If the rig cannot be set up so, or the bag not be written.
    """
    from robot_energy.errors import RigError
    from robot_energy.rig import RigConfig, VirtualRig, load_profile, random_profile
    from robot_energy.rig.record import record

    if args.seed < 0:
        raise RigError(f"the seed is {args.seed}", "a whole number from 0 on")
    check_bag(args.out, args.overwrite)
    drawn = args.plant_seed is not None
    profile = random_profile(args.robot, args.plant_seed) if drawn else load_profile(args.robot)
    config = RigConfig.hard() if args.hard else RigConfig()
    rig = VirtualRig(
        profile,
        _program(profile, args),
        replace(config, thermal_speedup=args.speedup),
        args.seed,
        args.start_temperature,
        args.ambient,
        rate_hz=args.rate,
        device_seed=args.device_seed,
    )
    recording = record(
        rig,
        args.duration,
        args.out,
        overwrite=args.overwrite,
        drive_power=args.drive_power,
        auxiliary=args.auxiliary,
    )
    out = console()
    drawn_energy = f"{recording.energy / 1e3:.4g} kJ truly drawn from its grid"
    wrote(
        out,
        recording.path,
        f"{args.duration:g} s of the virtual rig ({args.robot}), {drawn_energy}",
    )
    for topic, count in recording.messages.items():
        out.print(f"  {topic:<20} {count}", soft_wrap=True)
    return 0


def _program(profile: PlantProfile, args: Namespace) -> Program:
    from robot_energy.motion import random_program, tool_above

    robot, _ = profile.mechanics()
    limits = profile.motion_limits(robot)
    above = tool_above(robot, TOOL, MIN_HEIGHT) if robot.has_link(TOOL) else None
    return random_program(
        limits,
        args.seed,
        dwell=args.dwell,
        override=args.override,
        accept=above,
    )
