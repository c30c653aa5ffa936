"""Commands `robot-energy identify dynamics` and `excitation`, which makes a motion for it."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from robot_energy.foundation.errors import ReportError
from robot_energy.foundation.files.output_files import check_file
from robot_energy.foundation.files.output_folder import folder_path
from robot_energy.foundation.files.placement import all_or_none
from robot_energy.foundation.shown_text import shown
from robot_energy_cli.command import LIST, ONE_OF, REQUIRED, Command, Options
from robot_energy_cli.identify_inputs import (
    SENSOR_OPTIONS,
    IdentifyInputs,
    bag_options,
    result_options,
)
from robot_energy_cli.terminal import JSON_OPTION, check_bag, check_outputs, present, progress

if TYPE_CHECKING:
    from robot_energy.model import RobotModel
    from robot_energy_identify.data.signals import Channels
    from robot_energy_identify.dynamics.dynamics import DynamicsSettings
    from robot_energy_identify.excitation.limits import Floor
    from robot_energy_report.dynamics import ReferenceValues

    # Model, stretches of every recording by its name, sources, friction known from elsewhere.
    Read = tuple[RobotModel, dict[str, list[Channels]], list[str], ReferenceValues | None]

TOOL = "tool0"
CSV, BAG = "excitation.csv", "excitation_bag"

EXCITATION_OPTIONS: Options = {
    "--model FILE|NAME": ("model of the robot", REQUIRED),
    "--out FOLDER": ("folder of the files", REQUIRED),
    **JSON_OPTION,
    "--overwrite": "replace files of an earlier run",
    "the motion": {
        "--period S": ("length of the motion; its base frequency is 1 / length (default 10 s)",
                       {"default": 10.0}),
        "--harmonics N": ("default 5", {"default": 5}),
        "--rate HZ": ("of the points (default 125)", {"default": 125.0}),
        "--loops N": ("periods in the files (default 1)", {"default": 1}),
    },
    "the search": {
        "--criterion": (
            "greatest determinant (D-optimal, default), or least condition number",
            {"choices": ("determinant", "condition"), "default": "determinant"},
        ),
        "--starts N": ("default 3", {"default": 3}),
        "--iterations N": ("of each start (default 100)", {"default": 100}),
        "--seed N": ("the same seed gives the same motion", {"default": 0}),
    },
    "limits, in addition to those of the URDF": {
        "--margin SHARE": ("share of every limit that may be used (default 0.9)",
                           {"default": 0.9}),
        "--acceleration A": (
            "limit of the acceleration, one value or one per joint [rad/s^2] (default: full speed "
            "in 0.5 s)",
            LIST,
        ),
        ONE_OF: {
            "--floor M": "the tool stays above this height in the base frame (default: 0, where "
            "there is one)",
            "--no-floor": "do not limit the height of the tool",
        },
        "--tool LINK": f"link that stays above the floor (default: payload, or {TOOL})",
    },
}  # fmt: skip


def _excitation(args: Namespace) -> int:
    r"""`robot-energy identify excitation`: a motion to record for the dynamics.

    Make a motion for `identify dynamics`: one finite Fourier series per joint that begins and ends
    at rest (paper B, 4.3.2), optimised so that torque determines the base parameters, within the
    limits of position, velocity, acceleration and torque. The result is a CSV file and a bag with
    one trajectory_msgs/JointTrajectory.

    Move the robot to the start pose first. Collisions are not checked.

    examples:
      robot-energy identify excitation --model kr16 --floor 0.2 --out motion
      robot-energy identify excitation --model my_robot.yaml --period 20 --criterion condition \
          --acceleration 10 8 20 40 40 60 --out motion
    """
    import numpy as np

    from robot_energy.model import load
    from robot_energy_identify.excitation.excitation import ExcitationSettings, optimise_excitation
    from robot_energy_identify.excitation.limits import ExcitationLimits
    from robot_energy_identify.results.dynamics import excitation_report
    from robot_energy_plan.motion.trajectory_io import (
        check_sampling,
        points,
        write_csv,
        write_trajectory,
    )

    check_outputs(args, [args.model])
    model = load(args.model)
    folder = _folder(args, model)
    acceleration = None if args.acceleration is None else np.asarray(args.acceleration)
    limits = ExcitationLimits(model, acceleration, args.margin, _floor(args, model))
    settings = ExcitationSettings(
        criterion=args.criterion,
        harmonics=args.harmonics,
        period=args.period,
        starts=args.starts,
        iterations=args.iterations,
        seed=args.seed,
    )
    check_sampling(args.rate, args.loops)
    with progress("looking for a motion") as report:
        found = optimise_excitation(model, limits, settings, report)
    time, path = points(found.motion, args.rate, args.loops)
    names = limits.robot.joint_names
    with all_or_none():
        write_trajectory(folder / BAG, names, time, path, args.overwrite)
        write_csv(folder / CSV, names, time, path)
        made = f"{CSV} and {BAG}, {len(time)} points"
        present(args, excitation_report(found), made=made)
    return 0


def _folder(args: Namespace, model: RobotModel) -> Path:
    """Refuse what cannot be written before the search."""
    from robot_energy_plan.motion.trajectory_io import csv_kind

    folder = folder_path(args.out)
    inputs = [args.model]
    check_bag(str(folder / BAG), args.overwrite, inputs, [args.json])
    if not folder.exists():
        return folder
    check_file(folder / CSV, csv_kind(model.joint_names), "the trajectory", inputs)
    if (folder / CSV).exists() and not args.overwrite:
        raise ReportError(
            f"the folder '{shown(str(folder))}' holds {CSV} already",
            "a new folder",
            "choose another, or give --overwrite",
        )
    return folder


def _floor(args: Namespace, model: RobotModel) -> Floor | None:
    """The tool's floor; by default only where the robot has such a tool."""
    from robot_energy.physics.rigid_body import Robot
    from robot_energy_identify.excitation.limits import Floor

    if args.no_floor:
        return None
    link = args.tool or (model.payload[0].link if model.payload else TOOL)
    if args.tool is None and args.floor is None and not Robot.from_model(model).has_link(link):
        return None
    return Floor(link, 0.0 if args.floor is None else args.floor)


EXCITATION = Command.of(_excitation.__doc__, _excitation, EXCITATION_OPTIONS)

DYNAMICS_OPTIONS: Options = {
    **bag_options(required=False, effort="what the effort in the joint states of bags means"),
    "--log LOG": ("instead of bags: tables (CSV, plain or .gz, Parquet) or their folder", LIST),
    "--mapping FILE": "what the columns mean",
    "--data FOLDER": "without --mapping: --log is the mapping, and this the folder of the tables "
    "(default: that of the mapping)",
    "--method": (
        "ordinary, weighted by joint (default), or robust against outliers",
        {"choices": ("ols", "wls", "irls"), "default": "wls"},
    ),
    "--stribeck V": "add a Stribeck term with this speed [rad/s]",
    "--smooth V": (
        "speed of the smooth sign of Coulomb friction [rad/s] (default: 0.01)",
        {"default": 0.01},
    ),
    "--cutoff HZ": (
        "cut-off frequency of the low-pass on both sides of the equation (default: 10 Hz)",
        {"default": 10.0},
    ),
    "--delay MS": (
        "search for delays of the torque up to this (default: 5 ms; 0: no search)",
        {"default": 5.0},
    ),
    "--details": "print every base parameter",
    **SENSOR_OPTIONS,
    **result_options("these dynamics"),
}


def _dynamics(args: Namespace) -> int:
    r"""`robot-energy identify dynamics`: inertias, rotors and friction from positions and torque.

    Identify inertial parameters, rotor inertias and friction of a robot from recorded positions and
    motor torques, with standard deviations and errors on held-out data, and write a model file that
    the monitor runs. Each recording is also predicted from the others.

    From bags, with a model file for kinematics and gears; or directly from logs of the drives, by a
    YAML file that says what their columns mean (src/examples/identify/tx40.yaml). Record all joints
    moving at the same time, for ten seconds or more, at several speeds and far apart.

    examples:
      robot-energy identify dynamics excitation_bag --model my_robot.yaml \
          --effort motor_torque --out identified.yaml
      robot-energy identify dynamics --log recordings --mapping tx40.yaml --out tx40_model.yaml
      robot-energy identify dynamics --log one.parquet two.parquet --mapping cell.yaml --details
    """
    from robot_energy_identify.dynamics.dynamics import identify_dynamics
    from robot_energy_identify.dynamics.dynamics_model import to_model
    from robot_energy_identify.dynamics.leave_one_out import across_recordings
    from robot_energy_identify.plausibility import check_dynamics
    from robot_energy_identify.provenance import hashed
    from robot_energy_identify.refused_recordings import cause_named, evidence_of_rows
    from robot_energy_identify.results.dynamics import dynamics_report

    IdentifyInputs(args).check_results()
    IdentifyInputs(args).check_source(needs_effort=True)
    model, recordings, sources, reference = _log(args) if args.log else _bags(args)
    settings = _settings(args)
    channels = [part for stretches in recordings.values() for part in stretches]
    result = identify_dynamics(channels, model, settings)
    held_out, consistent = result.held_out(), result.held_out_consistent()
    with cause_named(lambda: [evidence_of_rows(result)]):
        check_dynamics(result, consistent)
    bags = [] if args.log else [Path(bag) for bag in args.bags]
    written = to_model(result, [hashed(bag) for bag in bags] or sources)
    across = across_recordings(recordings, model, settings) if len(recordings) > 1 else None
    report = dynamics_report(result, held_out, consistent, across=across)
    present(
        args,
        report,
        f"Dynamics of {model.robot.type}",
        f"Identified from {', '.join(sources)}. Model {written.model_id}.",
        model=written,
        reference=reference,
        details=args.details,
    )
    return 0


def _log(args: Namespace) -> Read:
    """Read tables by their mapping; with --data the mapping is what --log names."""
    from robot_energy.model import load
    from robot_energy_identify.data.log_channels import model_of, read_channels
    from robot_energy_logs.mapping import load_mapping
    from robot_energy_report.dynamics import ReferenceValues

    described = Path(args.mapping or args.log[0])
    tables = args.log if args.mapping else [args.data or described.parent]
    mapping = load_mapping(described)
    folder = Path(tables[0])
    folders = [folder if folder.is_dir() else folder.parent, described.parent]
    model = load(args.model) if args.model else model_of(mapping, folders)
    known = mapping.reference
    reference = (
        None if known is None else ReferenceValues(known.viscous, known.coulomb, known.source)
    )
    recordings = read_channels(tables, mapping, model)
    return model, recordings, mapping.files or [Path(name).name for name in tables], reference


def _bags(args: Namespace) -> Read:
    from robot_energy.model import load

    model = load(args.model)
    recordings = IdentifyInputs(args).bags().channels(model)
    return model, recordings, [Path(bag).name for bag in args.bags], None


def _settings(args: Namespace) -> DynamicsSettings:
    from robot_energy_identify.data.observations import Filters
    from robot_energy_identify.dynamics.dynamics import DynamicsSettings
    from robot_energy_identify.dynamics.torque_model import standard_columns

    return DynamicsSettings(
        columns=standard_columns(args.smooth, args.stribeck),
        method=args.method,
        filters=Filters(cutoff=args.cutoff),
        delay_span=args.delay * 1e-3,
        sensors=IdentifyInputs(args).sensor_limits(),
    )


DYNAMICS = Command.of(_dynamics.__doc__, _dynamics, DYNAMICS_OPTIONS)
