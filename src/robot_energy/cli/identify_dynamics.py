"""`robot-energy identify dynamics`: bodies, rotors and friction from motor torque."""

from __future__ import annotations

import resource
import time
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_energy.cli.terminal import add_debug, check_writable, console, progress
from robot_energy.errors import ModelFileError

if TYPE_CHECKING:
    from robot_energy.identify.dynamics import DynamicsSettings
    from robot_energy.identify.signals import Channels
    from robot_energy.model_file import RobotModel
    from robot_energy.report.dynamics import Reference

    # Model, stretches of every recording by its name, sources, friction known from elsewhere.
    Read = tuple[RobotModel, dict[str, list[Channels]], list[str], Reference | None]

EFFORTS = ("motor_torque", "joint_torque", "motor_current")

DESCRIPTION = """\
Identify inertial parameters, rotor inertias and friction of a robot from recorded positions
and motor torques, with standard deviations and errors on held-out data, and write a model
file that the monitor runs. Of several recordings, each is also predicted from the others.

From bags, with a model file for kinematics and gears; or directly from raw drive logs, by a
YAML file that says what they hold (src/examples/identify/tx40.yaml). Record all joints moving
at once, for ten seconds or more, at several speeds and far apart.
"""
EPILOG = """\
examples:
  robot-energy identify dynamics excitation_bag --model my_robot.yaml \\
      --effort motor_torque --out identified.yaml
  robot-energy identify dynamics --log tx40.yaml --data recordings --out tx40_model.yaml
  robot-energy identify dynamics --log tx40.yaml --details --method irls
  robot-energy identify dynamics --log kr300.yaml --data recordings
"""


def add_parser(subjects: Any) -> None:
    """Add the subject."""
    parser: ArgumentParser = subjects.add_parser(
        "dynamics",
        help="inertias, rotors and friction from positions and motor torque",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=RawDescriptionHelpFormatter,
    )
    parser.add_argument("bags", nargs="*", metavar="BAG", help="recordings of one robot")
    parser.add_argument(
        "--effort", choices=EFFORTS, help="what the effort in the joint states of bags means"
    )
    parser.add_argument("--log", metavar="FILE", help="instead of bags: what raw files hold")
    parser.add_argument(
        "--data", metavar="FOLDER", help="where the raw files lie (default: beside the mapping)"
    )
    parser.add_argument("--model", metavar="FILE|NAME", help="model file to begin with")
    parser.add_argument("--out", metavar="FILE", help="model file to write")
    parser.add_argument(
        "--method",
        choices=("ols", "wls", "irls"),
        default="wls",
        help="ordinary, weighted by joint (default), or robust against outliers",
    )
    parser.add_argument(
        "--stribeck", type=float, metavar="V", help="add a Stribeck term with this speed [rad/s]"
    )
    parser.add_argument(
        "--smooth",
        type=float,
        default=0.01,
        metavar="V",
        help="speed of the smooth sign of Coulomb friction [rad/s] (default: 0.01)",
    )
    parser.add_argument(
        "--cutoff",
        type=float,
        default=10.0,
        metavar="HZ",
        help="low-pass on both sides of the equation (default: 10)",
    )
    parser.add_argument(
        "--delay",
        type=float,
        default=5.0,
        metavar="MS",
        help="look for delays of the torque up to this (default: 5; 0: do not)",
    )
    parser.add_argument("--details", action="store_true", help="print every base parameter")
    add_debug(parser)
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Identify.

    Raises:
        RobotEnergyError: If mapping, files or recording cannot be used.
    """
    from robot_energy.identify.across import across_recordings
    from robot_energy.identify.dynamics import identify_dynamics
    from robot_energy.identify.dynamics_model import to_model
    from robot_energy.model_file import save
    from robot_energy.report.dynamics import Effort, print_across, print_dynamics

    check_writable(args.out, "the model")
    _check(args)
    for name in ("clarabel", "scipy.interpolate", "scipy.ndimage", "scipy.signal", "scipy.stats"):
        import_module(name)  # here, so that the time below is of the work alone
    begin = time.perf_counter()
    model, recordings, sources, reference = _log(args) if args.log else _bags(args)
    read = time.perf_counter()
    settings = _settings(args)
    channels = [part for stretches in recordings.values() for part in stretches]
    result = identify_dynamics(channels, model, settings)
    written = to_model(result, sources)
    if args.out:
        save(written, args.out)
    done = time.perf_counter()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    out = console()
    print_dynamics(
        out,
        result,
        result.held_out(),
        result.held_out_consistent(),
        reference,
        Effort(read - begin, done - read, peak),
        args.details,
    )
    if len(recordings) > 1:
        print_across(out, across_recordings(recordings, model, settings), model.joint_names)
    if args.out:
        out.print(f"wrote {args.out}: model {written.model_id}", soft_wrap=True)
    return 0


def _check(args: Namespace) -> None:
    """Refuse options that do not fit together."""
    if bool(args.bags) == bool(args.log):
        raise ModelFileError("neither bags nor a log, or both", "BAG... or --log")
    if args.bags and (args.model is None or args.effort is None):
        raise ModelFileError(
            "bags need --model and --effort",
            f"a model file, and one of {', '.join(EFFORTS)}",
            "the effort of a driver is never guessed",
        )


def _log(args: Namespace) -> Read:
    """Read raw files by their mapping."""
    from robot_energy.identify.raw_log import load_drive_log, model_of, read_channels
    from robot_energy.model_file import load
    from robot_energy.report.dynamics import Reference

    log = load_drive_log(args.log)
    folder = Path(args.data) if args.data else Path(args.log).parent
    beside = Path(args.log).parent
    model = load(args.model) if args.model else model_of(log, folder, beside)
    known = log.reference
    reference = None if known is None else Reference(known.viscous, known.coulomb, known.source)
    recordings = {name: [read_channels(log, model, folder, name)] for name in log.names}
    return model, recordings, list(log.files), reference


def _bags(args: Namespace) -> Read:
    """Run bags through the stages of the monitor."""
    from robot_energy.blocks import EffortMeaning
    from robot_energy.identify.recordings import read_recording
    from robot_energy.identify.signals import stretches
    from robot_energy.model_file import load

    model, effort = load(args.model), EffortMeaning[args.effort.upper()]
    recordings: dict[str, list[Channels]] = {}
    rate: float | None = None
    for bag in args.bags:
        with progress(f"reading {Path(bag).name}") as report:
            block = read_recording(bag, model, effort, progress=report).torque
        found = stretches(
            block.stamp_ns,
            block.segment,
            block.joint_position,
            block.motor_torque_measured,
            rate,
        )
        rate = found[0].rate
        name = Path(bag).name
        recordings[str(bag) if name in recordings else name] = found
    return model, recordings, [Path(bag).name for bag in args.bags], None


def _settings(args: Namespace) -> DynamicsSettings:
    from robot_energy.identify.columns import standard_columns
    from robot_energy.identify.dynamics import DynamicsSettings
    from robot_energy.identify.observations import Filters

    return DynamicsSettings(
        columns=standard_columns(args.smooth, args.stribeck),
        method=args.method,
        filters=Filters(cutoff=args.cutoff),
        delay_span=args.delay * 1e-3,
    )
