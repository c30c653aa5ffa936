"""Motion programs of any kind -> planned motions of one robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import MotionError, RobotDescriptionError
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import Float
from robot_energy_plan.motion.gcode import RAPID_SPEED, GcodeProgram, load_gcode, read_gcode
from robot_energy_plan.motion.inverse_kinematics import InverseKinematics
from robot_energy_plan.motion.joint_trajectory import read_bag_trajectory, read_csv_trajectory
from robot_energy_plan.motion.planned import PlannedMotion, SampledMotion
from robot_energy_plan.motion.ptp_file import program_for, read_program
from robot_energy_plan.motion.slicing import Slicing, slice_stl
from robot_energy_plan.motion.tool_motion import (
    STEP,
    TimedPath,
    ToolLimits,
    ToolMotion,
    ToolPlacement,
)

GCODE = (".gcode", ".gco", ".g", ".nc", ".ngc", ".cnc", ".tap")
STL = ".stl"
YAML = (".yaml", ".yml")
BAG = (".mcap", ".db3", ".zstd")
MAX_VALUE = 1e6  # of numbers in lists, whatever their unit
BENT = 0.6  # rad: a joint that would start in the middle of its range, stretched, starts bent
TOOL_DOWN = np.diag([1.0, -1.0, -1.0])  # z of the tool points down, its x forward


class ToolOptions(Described):
    """What a G-code program or a shape does not state."""

    link: Annotated[str, "The tool's frame in the URDF."] = "tool0"
    placement: Annotated[ToolPlacement, "Pose of the base in the frame of the program."] = field(
        default_factory=ToolPlacement
    )
    start: Annotated[
        Float | None,
        "Joint positions near the first; None: mid-range, bent. Shape (n,). [rad] or [m]",
    ] = None
    limits: Annotated[ToolLimits, "Limits of the tool's motion."] = field(
        default_factory=ToolLimits
    )
    rapid_speed: Annotated[float, "Speed of G0 where no F counts for it. [m/s]"] = RAPID_SPEED
    flavor: Annotated[str | None, "Whose G-code it is; None: found from the program."] = None
    step: Annotated[float, "Between solutions of the inverse kinematics. [s]"] = STEP
    slicing: Annotated[Slicing, "How a shape becomes a program."] = field(default_factory=Slicing)


class LoadedMotion(Described):
    """A program made ready for one robot."""

    motion: PlannedMotion
    name: str
    repeat: Annotated[int, "Number of runs that the program itself asks for."] = 1
    notes: tuple[str, ...] = ()
    length: Annotated[float | None, "Way of the tool, where the program has one. [m]"] = None
    printed_length: Annotated[float | None, "Way during which material flows. [m]"] = None
    stops: Annotated[int | None, "Rests of the tool in corners that could not be rounded."] = None
    full_speed_share: Annotated[float | None, "Share of the way at full speed. [-]"] = None


def load_motion(
    path: str | Path, robot: Robot, tool: ToolOptions | None = None, topic: str | None = None
) -> LoadedMotion:
    """Return a program as a motion of a robot.

    Args:
        path: G-code, an STL shape to be printed, a YAML file of point-to-point moves, a bag with
            a JointTrajectory, or such a trajectory as CSV; the end of the name decides.
        topic: Topic of the trajectory in a bag; None where there is one only.
    """
    file = Path(path)
    suffix = file.suffix.lower()
    if not file.exists():
        raise MotionError(f"there is no program '{path}'", "a file or a bag")
    if suffix in GCODE or suffix == STL:
        return _tool_program(file, robot, tool or ToolOptions())
    if suffix in YAML and file.name != "metadata.yaml":
        loaded = program_for(read_program(file), robot.limits, str(path))
        motion = SampledMotion(
            loaded.program, robot.joint_names, loaded.program.period,
            instants=loaded.program.instants.tolist(),
        )  # fmt: skip
        return LoadedMotion(motion, str(path), loaded.repeat, loaded.notes)
    if suffix == ".csv" or suffix in BAG or file.is_dir():
        found = read_csv_trajectory(file) if suffix == ".csv" else read_bag_trajectory(file, topic)
        return LoadedMotion(found.planned(), str(path), notes=found.notes)
    raise MotionError(
        f"the kind of the program '{path}' is unknown",
        f"G-code ({', '.join(GCODE)}), a shape ({STL}), moves ({', '.join(YAML)}), "
        "a bag or .csv with a JointTrajectory",
    )


def _tool_program(file: Path, robot: Robot, options: ToolOptions) -> LoadedMotion:
    if file.suffix.lower() != STL:
        program = load_gcode(file, options.rapid_speed, options.flavor)
        flavor, reason, certain = program.flavor
        rapid = "the last F" if flavor.rapid_at_feed else f"{options.rapid_speed:g} m/s (--rapid)"
        other = "" if certain else "; --flavor names another"
        note = f"the program was read as {flavor.title} ({reason}): G0 moves at {rapid}{other}"
        made = tool_program(program, robot, options)
        return replace(made, notes=(note, *made.notes))
    shape = slice_stl(file, options.slicing)
    program = read_gcode(shape.gcode, str(file), options.rapid_speed)
    made = tool_program(program, robot, options)
    return replace(made, notes=(*shape.notes, *made.notes))


def tool_program(program: GcodeProgram, robot: Robot, options: ToolOptions) -> LoadedMotion:
    """Return a program of a tool as a motion of a robot."""
    timed = TimedPath(program.path, options.limits)
    notes = [*program.notes]
    if not robot.has_link(options.link):
        raise RobotDescriptionError(
            f"the robot has no link '{options.link}' that could be the tool",
            "a link of its URDF",
            "name it with --tool",
        )
    kinematics = InverseKinematics(robot, options.link)
    planar = kinematics.structure == "planar"
    if planar:
        kinematics = InverseKinematics(robot, options.link, lifted=True)
        notes.append(
            "the robot is a planar arm: heights are left to an axis outside of the model, as in "
            "paper B"
        )
    elif kinematics.structure == "spatial" and options.start is None:
        kinematics = InverseKinematics(robot, options.link, orientation=TOOL_DOWN)
        notes.append("no start position was given: the tool points down, z of its frame downward")
    start = _start(robot, kinematics.structure) if options.start is None else options.start
    if start.shape != (robot.n_joints,) or not np.isfinite(start).all():
        raise MotionError(
            f"the start has {start.size} joint positions",
            f"{robot.n_joints} finite ones, one per joint",
        )
    limits = options.limits
    stated = (
        "the accelerations of the program are those of its machine"
        if program.accelerations
        else "the program states no accelerations"
    )
    notes.append(
        f"{stated}: {limits.acceleration:g} m/s^2 at the tool and "
        f"corners within {limits.corner_tolerance * 1e3:g} mm are assumed"
    )
    if timed.stops:
        notes.append(f"the tool comes to rest in {timed.stops} corners that cannot be rounded")
    motion = ToolMotion(
        timed, kinematics, start, robot.limits, options.placement, options.step, anchored=planar
    )
    return LoadedMotion(
        motion,
        program.path.name,
        notes=tuple(notes),
        length=timed.length,
        printed_length=program.path.printed_length,
        stops=timed.stops,
        full_speed_share=timed.full_speed_share,
    )


def _start(robot: Robot, structure: str) -> Float:
    """Middle of the ranges; joints that would be stretched are bent."""
    limits = robot.limits
    bounded = np.isfinite(limits.lower) & np.isfinite(limits.upper)
    middle = np.where(bounded, 0.5 * (limits.lower + limits.upper), 0.0)
    if structure == "gantry":
        return np.asarray(middle)
    bend = np.where((np.abs(middle) < BENT) & ~limits.prismatic, BENT, 0.0)
    bend[0] = 0.0
    return np.asarray(middle + bend)


def joint_list(text: str, what: str, counts: Sequence[int]) -> Float:
    """Return numbers that were separated by commas, shape (k,)."""
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError as error:
        raise MotionError(f"{what} is '{text}'", "numbers separated by commas") from error
    if not (np.abs(values) <= MAX_VALUE).all() or (counts and len(values) not in counts):
        number = " or ".join(map(str, counts)) or "any number of"
        raise MotionError(f"{what} is '{text}'", f"{number} finite numbers separated by commas")
    return values
