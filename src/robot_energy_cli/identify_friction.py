r"""`robot-energy identify friction`: friction over motor temperature.

Identify the friction of every axis over its motor temperature from recordings with measured
torque (paper A, eq. 8 to 10), and write a model file that the monitor runs. Coulomb friction
does not depend on temperature. For viscous friction a constant, an exponential law and a table
are compared at held-out temperatures.

Record the same motions, at several speeds and in both directions, with the robot cold, warm and
in between.

examples:
  robot-energy identify friction cold warm hot --model kr16 --effort motor_torque \
      --out my_robot.yaml
  robot-energy identify friction --log runs.csv.gz --mapping xarm6_joint3.yaml \
      --train 29: --test :25
"""

from __future__ import annotations

from argparse import ArgumentTypeError, Namespace
from typing import TYPE_CHECKING

from robot_energy.foundation.errors import ModelFileError
from robot_energy_cli.command import Command, Options, flags
from robot_energy_cli.identify_inputs import (
    LOG,
    SENSOR_OPTIONS,
    IdentifyInputs,
    bag_options,
    result_options,
)
from robot_energy_cli.terminal import present
from robot_energy_identify.options import IdentifyOptions

if TYPE_CHECKING:
    from robot_energy_identify.friction.samples import FrictionData
    from robot_energy_identify.friction.temperature_study import Span


def _span(text: str) -> Span:
    from robot_energy_identify.friction.temperature_study import Span

    low, colon, high = text.partition(":")
    try:
        span = Span(float(low or "-inf"), float(high or "inf"))
    except ValueError:
        colon = ""
        span = Span()
    if not colon or not span.low < span.high:
        raise ArgumentTypeError(f"'{text}' is not a range of temperatures such as 29: or :25")
    return span


def _run(args: Namespace) -> int:
    from robot_energy.model import load
    from robot_energy_identify.friction.temperature_study import FrictionStudyReport, axis_study
    from robot_energy_identify.friction_and_thermal import FrictionReport, plausible_fits
    from robot_energy_report.identification import friction_over_temperature

    given = IdentifyInputs(args)
    given.check_results()
    why = "figures from a log are relative and make no model file"
    given.check_source(needs_effort=True, relative=why)
    if (args.train is None) != (args.test is None):
        raise ModelFileError("--train and --test belong together", "both or none")
    source = given.names()
    if args.train is not None:
        axes = _of_log(given) if args.log else given.bags().friction_data(load(args.model))
        found = tuple(axis_study(axis, args.train, args.test) for axis in axes)
        studies = FrictionStudyReport(found)
        title = "Friction at temperatures that were not seen"
        present(args, studies, title, source, notes=given.log_notes)
        return 0
    model = None
    if args.log:
        fits, refused = plausible_fits(_of_log(given), share=args.share_shape)
        report = FrictionReport("log", tuple(fits), refused)
    else:
        from robot_energy_identify.api.identify import identify_friction

        result = identify_friction(given.bags(), args.model, share_shape=args.share_shape)
        report, model = result.found, result.model
    present(
        args,
        report,
        "Friction over motor temperature",
        f"Identified from {source}.",
        plot=lambda to: friction_over_temperature(report.axes, to, report.torque_unit, source),
        model=model,
        notes=given.log_notes,
    )
    return 0


def _of_log(given: IdentifyInputs) -> list[FrictionData]:
    from robot_energy_identify.friction.samples import friction_data_of_log

    parts, names = given.columns_of_log()
    return [friction_data_of_log(parts, names, j) for j in range(len(names))]


OPTIONS: Options = {
    **bag_options(required=False),
    **flags(IdentifyOptions, "share_shape"),
    **SENSOR_OPTIONS,
    **result_options("this friction", "draw points and laws (.png, .svg, .pdf)"),
    "from a log of single-joint motions, without a model (relative figures)": LOG,
    "test on temperatures that the fit has not seen": {
        "--train LOW:HIGH": ("[degC], one may be empty", {"type": _span}),
        "--test LOW:HIGH": ("[degC]", {"type": _span}),
    },
}
COMMAND = Command.of(__doc__, _run, OPTIONS)
