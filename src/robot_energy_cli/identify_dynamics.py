r"""`robot-energy identify dynamics`: inertias, rotors and friction from positions and motor torque.

Identify inertial parameters, rotor inertias and friction of a robot from recorded positions
and motor torques, with standard deviations and errors on held-out data, and write a model
file that the monitor runs. Each recording is also predicted from the others.

From bags, with a model file for kinematics and gears; or directly from logs of the drives, by
a YAML file that says what their columns mean (src/examples/identify/tx40.yaml). Record all
joints moving at the same time, for ten seconds or more, at several speeds and far apart.

examples:
  robot-energy identify dynamics excitation_bag --model my_robot.yaml \
      --effort motor_torque --out identified.yaml
  robot-energy identify dynamics --log recordings --mapping tx40.yaml --out tx40_model.yaml
  robot-energy identify dynamics --log one.parquet two.parquet --mapping cell.yaml --details
"""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from robot_energy_cli.command import LIST, Command, Options
from robot_energy_cli.identify_inputs import (
    SENSOR_OPTIONS,
    IdentifyInputs,
    bag_options,
    result_options,
)
from robot_energy_cli.terminal import present

if TYPE_CHECKING:
    from robot_energy.model import RobotModel
    from robot_energy_identify.data.observations import Channels
    from robot_energy_identify.dynamics.dynamics import DynamicsSettings
    from robot_energy_report.dynamics import ReferenceValues


OPTIONS: Options = {
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


def _run(args: Namespace) -> int:
    from robot_energy_identify.api.identify import dynamics_of, identify_dynamics

    given, reference = IdentifyInputs(args), None
    given.check_results()
    given.check_source(needs_effort=True)
    settings = _settings(args)
    if args.log:
        model, recordings, sources, reference = _log(args)
        result = dynamics_of(recordings, model, settings, sources)
    else:
        sources = [Path(bag).name for bag in args.bags]
        result = identify_dynamics(given.bags(), args.model, settings=settings)
    model = result.model
    present(
        args,
        result.found,
        f"Dynamics of {model.robot.type}",
        f"Identified from {', '.join(sources)}. Model {model.model_id}.",
        model=model,
        reference=reference,
        details=args.details,
    )
    return 0


def _log(
    args: Namespace,
) -> tuple[RobotModel, dict[str, list[Channels]], list[str], ReferenceValues | None]:
    """Model, stretches by recording, names and friction known from elsewhere, by a mapping.

    With --data the mapping is what --log names.
    """
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


COMMAND = Command.of(__doc__, _run, OPTIONS)
