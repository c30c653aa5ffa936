"""Options for programs of a tool: what G-code and shapes do not state."""

from __future__ import annotations

import math
from argparse import Namespace
from dataclasses import replace
from typing import TYPE_CHECKING

from robot_energy_cli.command import Options

if TYPE_CHECKING:
    from robot_energy_plan.motion.load_motion import ToolOptions

START_POSITION = "--start-position"


def tool_table(several: bool = False) -> Options:
    """Return the options, for one robot or for several."""
    words = {"action": "append" if several else "store"}
    each = "; once for all robots, or once per model" if several else ""
    return {
        "--base X,Y,Z[,YAW]": (
            "where the robot's base stands in the frame of the program [m], and its turn about "
            f"the vertical axis [deg]{each}",
            words,
        ),
        f"{START_POSITION}{'/--start' if several else ''} Q,Q,...": (
            "joint positions near the first one [rad or m], which decide elbow and wrist"
            f"{each} (default: middle of the ranges, bent)",
            words,
        ),
        "--tool LINK": ("default tool0", {"default": "tool0"}),
        "--tool-acceleration A": "greatest acceleration of the tool [m/s^2], default 2, assumed",
        "--corner-tolerance MM": "greatest distance of the path from a corner, default 3 mm; with "
        "0 the tool stops in every corner",
        "--smoothing S": "time over which the tool's motion is smoothed, default 0.02 s",
        "--rapid M_PER_S": "speed of G0 where no F counts for it, default 0.25 m/s",
        "--flavor NAME": (
            "whose G-code it is: marlin, reprapfirmware, klipper, grbl or linuxcnc; default: found "
            "from the program",
            {"choices": ("marlin", "reprapfirmware", "klipper", "grbl", "linuxcnc")},
        ),
    }


def tool_options(args: Namespace, base: str | None, start: str | None) -> ToolOptions:
    """Return what was given."""
    from robot_energy_plan.motion.load_motion import ToolOptions, joint_list
    from robot_energy_plan.motion.tool_motion import ToolLimits, ToolPlacement

    placement = ToolPlacement()
    if base is not None:
        values = joint_list(base, "--base", (3, 4)).tolist()
        yaw = math.radians(values[3]) if len(values) == 4 else 0.0
        placement = ToolPlacement(values[0], values[1], values[2], yaw)
    limits = (
        ("acceleration", args.tool_acceleration, 1.0),
        ("corner_tolerance", args.corner_tolerance, 1e-3),
        ("smoothing", args.smoothing, 1.0),
    )
    given = {name: value * unit for name, value, unit in limits if value is not None}
    options = ToolOptions(
        link=args.tool,
        placement=placement,
        start=None if start is None else joint_list(start, START_POSITION, ()),
        limits=ToolLimits(**given),
        flavor=args.flavor,
    )
    return options if args.rapid is None else replace(options, rapid_speed=args.rapid)
