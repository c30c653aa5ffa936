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

from robot_energy.foundation.errors import ModelFileError, NotIdentifiableError
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
    from robot_energy_identify.results.identification import AxisStudy

SHUFFLES = 20


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
    from robot_energy_identify.friction_and_thermal import FrictionReport
    from robot_energy_identify.results.identification import FrictionStudyReport
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
        studies = FrictionStudyReport(tuple(_study(axis, args) for axis in axes))
        title = "Friction at temperatures that were not seen"
        present(args, studies, title, source, notes=given.log_notes)
        return 0
    model = None
    if args.log:
        from robot_energy_identify.friction.friction import fit_axes
        from robot_energy_identify.friction.shared_shape import share_shape
        from robot_energy_identify.plausibility import check_friction

        axes = _of_log(given)
        fits, refused = fit_axes(axes)
        if args.share_shape:
            fits = share_shape(fits, axes)
        fits, implausible = check_friction(fits)
        report = FrictionReport("log", tuple(fits), (*refused, *implausible))
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


def _study(axis: FrictionData, args: Namespace) -> AxisStudy:
    from robot_energy_identify.friction.temperature_study import shuffled, temperature_split
    from robot_energy_identify.results.identification import axis_study, exponential_gain

    study = temperature_split(axis, args.train, args.test)
    chance: list[float] = []
    for seed in range(SHUFFLES):
        try:
            other = temperature_split(shuffled(axis, seed), args.train, args.test)
        except NotIdentifiableError:
            continue
        gain = exponential_gain(other)
        if gain is not None:
            chance.append(gain)
    return axis_study(axis.name, study, chance)


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
