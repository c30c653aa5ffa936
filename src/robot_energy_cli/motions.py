"""Commands on motions that are planned: `robot-energy predict`, `optimize`, `shared-bus`."""

from __future__ import annotations

import math
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_energy.foundation.errors import MotionError
from robot_energy.replay.options import PART
from robot_energy_cli.command import LIST, REQUIRED, Command, Options, flags, keywords_of
from robot_energy_cli.replay_arguments import DAMAGED, READING
from robot_energy_cli.terminal import OUTPUTS, check_outputs, present, progress
from robot_energy_plan.options import (
    PAYLOAD_LINK,
    TOOL,
    OptimizeOptions,
    PredictOptions,
    SharedBusOptions,
)

if TYPE_CHECKING:
    from robot_energy.model import RobotModel
    from robot_energy.model.payload import Payload
    from robot_energy.timeline.blocks import Float
    from robot_energy_plan.api.predict import PredictionResult
    from robot_energy_plan.motion.load_motion import LoadedMotion, ToolOptions

AT_ORIGIN = (
    "--base was not given: the base of the robot was taken to stand at the origin of the program, "
    "not turned"
)
START_POSITION = "--start-position"


def _tool_table(several: bool = False) -> Options:
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


def _tool_options(args: Namespace, base: str | None, start: str | None) -> ToolOptions:
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


MAX_RUNS = 100
SEVERAL_REQUIRED: dict[str, Any] = {"required": True, "action": "append"}

PREDICT_OPTIONS: Options = {
    "program PROGRAM": ("program of motion", LIST),
    "--model FILE|NAME": (
        "model of the robot; repeat the option for several robots",
        SEVERAL_REQUIRED,
    ),
    "--temperature DEGC[,DEGC...]": (
        "motor temperature, one for all or one per joint, held throughout; repeat the option to "
        "compare",
        SEVERAL_REQUIRED,
    ),
    **flags(PredictOptions, ""),
    "--topic NAME": "of the JointTrajectory in a bag",
    "output": {**OUTPUTS, "--plot FILE": "draw energy and power: png, svg or pdf"},
    "G-code and shapes": _tool_table(several=True),
    "shapes\nan STL file is cut into layers; no infill": {
        "--layer-height MM": "default 10 mm",
        "--print-speed MM_PER_S": "of the tool, default 125 mm/s",
        "--bead-width MM": "the tool runs half of it inside the surface; default 0 mm",
        "--stl-unit": ("default mm", {"choices": ("mm", "m", "inch"), "default": "mm"}),
    },
}


def _predict(args: Namespace) -> int:
    r"""`robot-energy predict`: the energy of motion programs before they are run.

    Predict the energy of motion programs before they are run, for one or several robots, at the
    motor temperatures that you give. A program is G-code, an STL shape to be printed, a YAML file
    of point-to-point moves, a bag with a trajectory_msgs/JointTrajectory, or such a trajectory as
    CSV. A prediction uses the same stages as live operation and replay, and states the power of
    bodies, friction, drives, constant losses and brake. Nothing is measured here. Collisions are
    not checked.

    examples:
      robot-energy predict moves.yaml --model kr16 --temperature 20 --temperature 60
      robot-energy predict wall_layer.gcode --model mantis --base=-1.2,-0.2,0 \
          --model testbed --base 0,0,0 --model irb4600 --base=-1,0.15,0 --temperature 40 \
          --report wall.html
      robot-energy predict wall.stl --layer-height 10 --model mantis --base=-1.2,-0.2,0 \
          --temperature 40
    """
    from robot_energy_plan.results.prediction import PredictionsReport
    from robot_energy_report.prediction import energy_and_power, labels

    check_outputs(args, [*args.program, *args.model])
    count = len(args.program) * len(args.model) * len(args.temperature)
    if count > MAX_RUNS:
        raise MotionError(f"{count} predictions were asked for", f"at most {MAX_RUNS}")
    found = _predictions(args)
    runs, results = tuple(one.report for one in found), [one.prediction for one in found]
    present(
        args,
        PredictionsReport(runs),
        "Predicted energy",
        "Motion programs before they are run, through the models of the robots. "
        "Nothing in this report was measured.",
        plot=lambda to: energy_and_power(results, [run.energy for run in runs], labels(runs), to),
        results=results,
    )
    return 0


def _predictions(args: Namespace) -> list[PredictionResult]:
    from robot_energy.model import load
    from robot_energy.physics.rigid_body import Robot
    from robot_energy_plan.api.predict import predict
    from robot_energy_plan.motion.load_motion import joint_list, load_motion
    from robot_energy_plan.prediction import MAX_SAMPLES

    models = [load(name) for name in args.model]
    bases = _per_model(args.base, len(models), "--base")
    starts = _per_model(args.start_position, len(models), START_POSITION)
    plans: list[tuple[LoadedMotion, RobotModel, Float, int]] = []
    for program in args.program:
        for model, base, start in zip(models, bases, starts, strict=True):
            robot = Robot.from_model(model)
            motion = load_motion(program, robot, _tool_and_shape(args, base, start), args.topic)
            if motion.length is not None and base is None:
                motion = replace(motion, notes=(*motion.notes, AT_ORIGIN))
            repeat = motion.repeat if args.repeat is None else args.repeat
            for text in args.temperature:
                degc = joint_list(text, "--temperature", sorted({1, robot.n_joints}))
                plans.append((motion, model, degc, repeat))
    most = MAX_SAMPLES if args.max_samples is None else args.max_samples
    _refuse_length([(motion, repeat) for motion, _, _, repeat in plans], most)
    options: Any = {
        "payload": [] if args.payload is None else [_payload(args.payload)],
        "auxiliary": dict(_load_state(text) for text in args.auxiliary),
        "max_samples": most,
    }
    found: list[PredictionResult] = []
    for motion, model, degc, repeat in plans:
        label = f"{motion.name}, {model.robot.type}, {motion.motion.duration * repeat:.4g} s"
        with progress(label) as show:
            found.append(predict(motion, model, degc, repeat=repeat, progress=show, **options))
    return found


def _load_state(text: str) -> tuple[str, str]:
    name, sign, state = text.partition("=")
    if not sign:
        raise MotionError(f"--auxiliary is '{text}'", "LOAD=STATE, such as pump=on")
    return name, state


def _refuse_length(plans: Sequence[tuple[LoadedMotion, int]], most: int) -> None:
    from robot_energy_plan.prediction import planned_samples

    samples = sum(planned_samples(plan.motion, repeat) for plan, repeat in plans)
    duration = sum(plan.motion.duration * repeat for plan, repeat in plans)
    if samples > most:
        raise MotionError(
            f"the prediction has {samples} samples over {duration:.6g} s of motion",
            f"at most {most} samples",
            f"predict less, or allow more with --max-samples {samples}",
        )


def _per_model(values: Sequence[str] | None, count: int, option: str) -> list[str | None]:
    if values is None:
        return [None] * count
    if len(values) not in (1, count):
        raise MotionError(
            f"{option} was given {len(values)} times", f"once, or {count} times, once per model"
        )
    return [values[0]] * count if len(values) == 1 else list(values)


def _tool_and_shape(args: Namespace, base: str | None, start: str | None) -> ToolOptions:
    from robot_energy_plan.motion.slicing import Slicing

    sizes = {
        "layer_height": args.layer_height,
        "speed": args.print_speed,
        "bead_width": args.bead_width,
    }
    given_sizes = {name: 1e-3 * value for name, value in sizes.items() if value is not None}
    return replace(
        _tool_options(args, base, start), slicing=Slicing(unit=args.stl_unit, **given_sizes)
    )


def _payload(text: str) -> Payload:
    from robot_energy.model.payload import payload
    from robot_energy_plan.motion.load_motion import joint_list

    figures, _, link = text.partition("@")
    values = joint_list(figures, "--payload", (1, 4)).tolist()
    return payload(link or PAYLOAD_LINK, values[0], values[1:] or (0.0, 0.0, 0.0), source=text)


PREDICT = Command.of(_predict.__doc__, _predict, PREDICT_OPTIONS)

OPTIMIZE_OPTIONS: Options = {
    "program PROGRAM|BAG": "YAML of point-to-point moves, G-code, a JointTrajectory as CSV or in a "
    "bag, or a bag of recorded joint states",
    "--model FILE|NAME": ("model of the robot", REQUIRED),
    "--temperature DEGC|A..B": "temperature of all motors, or the range in which they work "
    "(default: that of the model)",
    **flags(OptimizeOptions, ""),
    "G-code": {**_tool_table(), **flags(OptimizeOptions, TOOL)},
    "part of recorded joint states: one cycle": flags(OptimizeOptions, PART),
    "output": {
        "--out FILE": "write the chosen program in the form of the given one",
        **OUTPUTS,
        "--plot FILE": "draw savings and trade-offs: png, svg, pdf",
    },
}


def _optimize(args: Namespace) -> int:
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
    from robot_energy.foundation.files.placement import all_or_none
    from robot_energy_plan.api.optimize import optimize
    from robot_energy_report.optimization import measures_and_front

    check_outputs(args, [args.program, args.model, args.rest_states, *args.level])
    with progress(f"{args.program}: every move in every way") as show:
        options: Any = keywords_of(optimize, args) | {
            "tool": _tool_options(args, args.base, args.start_position),
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


OPTIMIZE = Command.of(_optimize.__doc__, _optimize, OPTIMIZE_OPTIONS)

SHARED_BUS_OPTIONS: Options = {
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
    "G-code": _tool_table(),
    **READING,
}


def _shared_bus(args: Namespace) -> int:
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
    from robot_energy_plan.api.shared_bus import shared_bus

    check_outputs(args, [*args.motions, *args.model, args.inputs])
    tool = _tool_options(args, args.base, args.start_position)
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


SHARED_BUS = Command.of(_shared_bus.__doc__, _shared_bus, SHARED_BUS_OPTIONS)
