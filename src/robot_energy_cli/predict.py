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

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from robot_energy.foundation.errors import MotionError
from robot_energy_cli.command import LIST, Command, Options, flags
from robot_energy_cli.terminal import OUTPUTS, check_outputs, present, progress
from robot_energy_cli.tool_options import START_POSITION, tool_options, tool_table
from robot_energy_plan.options import PAYLOAD_LINK, PredictOptions

if TYPE_CHECKING:
    from robot_energy.model import RobotModel
    from robot_energy.model.payload import Payload
    from robot_energy.timeline.blocks import Float
    from robot_energy_plan.api.predict import PredictionResult
    from robot_energy_plan.motion.load_motion import LoadedMotion, ToolOptions

MAX_RUNS = 100
SEVERAL_REQUIRED: dict[str, Any] = {"required": True, "action": "append"}
AT_ORIGIN = (
    "--base was not given: the base of the robot was taken to stand at the origin of the program, "
    "not turned"
)
OPTIONS: Options = {
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
    "G-code and shapes": tool_table(several=True),
    "shapes\nan STL file is cut into layers; no infill": {
        "--layer-height MM": "default 10 mm",
        "--print-speed MM_PER_S": "of the tool, default 125 mm/s",
        "--bead-width MM": "the tool runs half of it inside the surface; default 0 mm",
        "--stl-unit": ("default mm", {"choices": ("mm", "m", "inch"), "default": "mm"}),
    },
}


def _run(args: Namespace) -> int:
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
        tool_options(args, base, start), slicing=Slicing(unit=args.stl_unit, **given_sizes)
    )


def _payload(text: str) -> Payload:
    from robot_energy.model.payload import payload
    from robot_energy_plan.motion.load_motion import joint_list

    figures, _, link = text.partition("@")
    values = joint_list(figures, "--payload", (1, 4)).tolist()
    return payload(link or PAYLOAD_LINK, values[0], values[1:] or (0.0, 0.0, 0.0), source=text)


COMMAND = Command.of(__doc__, _run, OPTIONS)
