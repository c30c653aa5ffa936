"""`robot-energy simulate`: record the virtual test rig to a bag.

Simulate a robot with its cabinet, motor temperature sensors and grid meter, and record their
messages to a bag. The plant knows effects that the model under test does not:
Stribeck and load-dependent friction, lubricant, copper, iron and inverter loss, sensor
errors. Nothing is measured on a robot: results on the rig show that the method works.
With --plant-seed the plant's friction, losses and constants are drawn at random, and any model
file gives the bodies. With --hard come effects that no model file has a term for: elastic
joints, presliding, Coulomb friction that falls with temperature, viscous friction of a lower
power of speed, a fan, and filtered and offset sensors.

example:
  robot-energy simulate --robot kr16 --duration 60 --start-temperature 20 --out cold
  robot-energy replay cold --model kr16 --compare
"""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from typing import TYPE_CHECKING

from robot_energy_cli.command import REQUIRED, Command, Options
from robot_energy_cli.terminal import check_bag, console, wrote

if TYPE_CHECKING:
    from robot_energy_plan.motion import Program
    from robot_energy_rig import PlantProfile

RATE = 250.0  # Hz
ROBOTS = ("kr16", "mantis", "testbed", "irb4600")
TOOL, MIN_HEIGHT = "tool0", 0.2  # m: the random program stays above the floor

OPTIONS: Options = {
    "--robot NAME": (
        f"plant: {', '.join(ROBOTS)}; with --plant-seed any model (default kr16)",
        {"default": "kr16"},
    ),
    "--plant-seed N": "draw friction, losses and constants of the plant at random",
    "--hard": "effects without a term in models",
    "--out BAG": ("folder of the new bag", REQUIRED),
    "--duration S": ("default 60 s", {"default": 60.0}),
    "--start-temperature DEGC": ("of motors and gears (default 20 degC)", {"default": 20.0}),
    "--ambient DEGC": ("default 20 degC", {"default": 20.0}),
    "--seed N": ("of program and sensor errors; the same seed gives the same bag", {"default": 0}),
    "--device-seed N": "of the constant errors of meter and sensors: recordings of one robot "
    "have the same (default: that of --seed)",
    "--speedup FACTOR": ("factor on how fast temperatures change (default 1)", {"default": 1.0}),
    "--rate HZ": (f"of the joint states (default {RATE:g} Hz)", {"default": RATE}),
    "--dwell S": ("rest after every motion (default 0.2 s)", {"default": 0.2}),
    "--drive-power": "record the electrical input of each drive as well, on /drive_power",
    "--auxiliary": "record a pump and an extruder as well, with meters and states of their own",
    "--overwrite": "replace the bag of --out",
}


def _run(args: Namespace) -> int:
    from robot_energy.foundation.errors import RigError
    from robot_energy_rig import RigConfig, VirtualRig, load_profile, random_profile
    from robot_energy_rig.record import record

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
        out.print(f"  {topic:<20} {count}")
    return 0


def _program(profile: PlantProfile, args: Namespace) -> Program:
    from robot_energy_plan.motion import random_program, tool_above

    robot, _ = profile.mechanics()
    limits = profile.motion_limits(robot)
    above = tool_above(robot, TOOL, MIN_HEIGHT) if robot.has_link(TOOL) else None
    return random_program(
        limits,
        args.seed,
        dwell=args.dwell,
        accept=above,
    )


COMMAND = Command.of(__doc__, _run, OPTIONS)
