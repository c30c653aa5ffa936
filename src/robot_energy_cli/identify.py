"""Commands `robot-energy identify all`, `friction`, `cabinet`, `thermal` and `auxiliary`."""

from __future__ import annotations

from argparse import ArgumentTypeError, Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_energy.foundation.errors import ModelFileError, NotIdentifiableError
from robot_energy_cli.command import Command, Options, flags, keywords_of, number
from robot_energy_cli.identify_inputs import (
    LINK_VOLTAGES,
    LOG,
    SENSOR_OPTIONS,
    IdentifyInputs,
    bag_options,
    result_options,
)
from robot_energy_cli.terminal import present, progress
from robot_energy_identify.options import OF_DRIVES, SUBJECTS, IdentifyOptions

if TYPE_CHECKING:
    from robot_energy_identify.api.identify import IdentificationResult
    from robot_energy_identify.friction.samples import FrictionData
    from robot_energy_identify.friction.temperature_study import Span
    from robot_energy_identify.results.identification import AxisStudy, ThermalReport

ALL_OPTIONS: Options = {
    **bag_options(
        effort="what the effort in the joint states means; without it neither bodies nor "
        "friction can be identified"
    ),
    **flags(IdentifyOptions, "test", OF_DRIVES, "skip"),
    "--no-test": "do not test the energy on held-out recordings",
    "--details": "print tables and notes of every step",
    **LINK_VOLTAGES,
    **flags(IdentifyOptions, "share_shape"),
    **SENSOR_OPTIONS,
    **result_options("all that was identified"),
}


def _all(args: Namespace) -> int:
    r"""`robot-energy identify all`: everything the recordings allow, with one report.

    Identify everything that the recordings allow, in this order: bodies and rotors from measured
    torque, friction over temperature, constant losses of the cabinet, losses of the drives, energy
    that the DC link stores, thermal networks of the motors. Other parameters keep the values of the
    model, and a sentence says what to record for them. Then the energy of the old and the new model
    is compared with the meter on recordings that the fit has not seen: whole recordings in turn, or
    those of --test.

    examples:
      robot-energy identify all cold warm hot --model my_robot.yaml --effort motor_torque \
          --out identified.yaml --report report.html
      robot-energy identify all cold warm hot --test another_day --model my_robot.yaml \
          --effort motor_current --drive-power /drive_power --out identified.yaml
    """
    from robot_energy_identify.api.identify import identify_all
    from robot_energy_report.identify_all import identification_lead

    IdentifyInputs(args).check_results()
    _check_all(args)
    options: dict[str, Any] = keywords_of(identify_all, args) | {
        "held_out": not args.no_test,
        "link_voltages": IdentifyInputs(args).link_voltages(),
        "sensors": IdentifyInputs(args).sensor_limits(),
        "progress": progress,
    }
    result = identify_all(args.bags, args.model, args.effort, **options)
    found = result.found
    title, lead = f"Identification of {result.model.robot.type}", identification_lead(found)
    present(args, found, title, lead, model=result.model, details=args.details)
    return 0


def _check_all(args: Namespace) -> None:
    from robot_energy_identify.provenance import require_distinct

    IdentifyInputs(args).drive_power()
    if args.test and args.no_test:
        raise ModelFileError("--test and --no-test exclude each other", "one of them")
    if set(args.skip) == set(SUBJECTS):
        raise ModelFileError("--skip leaves nothing to identify", "fewer subjects")
    require_distinct([Path(bag) for bag in args.bags], [Path(bag) for bag in args.test])


ALL = Command.of(_all.__doc__, _all, ALL_OPTIONS)

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


def _friction(args: Namespace) -> int:
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
    from robot_energy.model import load
    from robot_energy_identify.results.identification import FrictionReport, FrictionStudyReport
    from robot_energy_report.identification import friction_over_temperature

    given = IdentifyInputs(args)
    given.check_results()
    why = "figures from a log are relative and make no model file"
    given.check_source(needs_effort=True, relative=why)
    if (args.train is None) != (args.test is None):
        raise ModelFileError("--train and --test belong together", "both or none")
    source = given.names()
    if args.train is not None:
        axes = _friction_of_log(given) if args.log else given.bags().friction_data(load(args.model))
        studies = FrictionStudyReport(tuple(_study(axis, args) for axis in axes))
        title = "Friction at temperatures that were not seen"
        present(args, studies, title, source, notes=given.log_notes)
        return 0
    model = None
    if args.log:
        from robot_energy_identify.friction.friction import fit_axes
        from robot_energy_identify.friction.shared_shape import share_shape
        from robot_energy_identify.plausibility import check_friction

        axes = _friction_of_log(given)
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


def _friction_of_log(given: IdentifyInputs) -> list[FrictionData]:
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


FRICTION_OPTIONS: Options = {
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
FRICTION = Command.of(_friction.__doc__, _friction, FRICTION_OPTIONS)


def _degc(text: str) -> float:
    value = float(number(text))
    if not -40.0 <= value <= 60.0:
        raise ArgumentTypeError(f"{value:g} degC is not the air that a robot works in")
    return value


def _thermal(args: Namespace) -> int:
    r"""`robot-energy identify thermal`: motor temperatures from losses.

    Identify the heat capacity and the time constants of every motor from recordings with motor
    temperatures. The heat is that of the model's own losses, so identify friction and drives first.
    With them the monitor estimates a motor temperature where no sensor measures it, or the sensor
    is stuck.

    Record from a cold start, for hours, with work and rest. A free run from the first reading is
    compared with the readings that follow; the error stated is on what the fit has not seen.

    examples:
      robot-energy identify thermal monday tuesday --model my_robot.yaml --ambient 21 \
          --out my_robot_thermal.yaml
      robot-energy identify thermal --log dataset.csv --mapping ur3_cobotops.yaml
    """
    given = IdentifyInputs(args)
    given.check_results()
    given.check_source(relative="the heat of a log is relative and makes no model file")
    model = None
    if args.log:
        report = _thermal_of_log(given, args.ambient)
    else:
        from robot_energy_identify.api.identify import identify_thermal

        result = identify_thermal(given.bags(), args.model, ambient_degc=args.ambient)
        report, model = result.found, result.model
    title, lead = "Thermal networks of the motors", f"Identified from {given.names()}."
    present(args, report, title, lead, model=model, notes=given.log_notes)
    return 0


def _thermal_of_log(given: IdentifyInputs, ambient_degc: float | None) -> ThermalReport:
    from robot_energy_identify.results.identification import ThermalReport
    from robot_energy_identify.thermal.network import fit_networks
    from robot_energy_identify.thermal.windows import runs_of_log

    parts, names = given.columns_of_log()
    runs = [runs_of_log(parts, joint) for joint in range(len(names))]
    ambient, fits, refused = fit_networks(names, runs, ambient_degc)
    return ThermalReport("squared_current", ambient, tuple(fits), tuple(refused))


THERMAL_OPTIONS: Options = {
    **bag_options(required=False, effort=""),
    "--ambient DEGC": (
        "temperature of the air around the robot [degC] (default: the coldest first reading "
        "of all motors)",
        {"type": _degc},
    ),
    **result_options("these networks"),
    "from a log with motor currents, without a model": LOG,
}
THERMAL = Command.of(_thermal.__doc__, _thermal, THERMAL_OPTIONS)


def _cabinet(args: Namespace) -> int:
    """`robot-energy identify cabinet`: constant losses of grid and DC side, energy of the DC link.

    Identify the constant losses of the cabinet from recordings with a power meter (paper A, section
    II-A): while nothing moves, the meter shows the sum of both sides; while the robot brakes hard,
    it shows the grid side alone. The command finds both phases, rest by the noise of the
    velocities. After hard braking the DC link feeds the drives; how much energy it stores is found
    from that, with an interval, and taken if held-out readings are predicted better with it. A fan
    of the cabinet that starts while the robot warms up is found by the step in the power at rest,
    one that runs in warm recordings alone by the levels of their power.

    Record at least ten seconds of rest with active drives, and fast motions that stop hard; for the
    fan a warm-up with pauses and motor temperatures. Identify the drives first (or use `identify
    all`): drive losses that the model lacks can hide the effect of the DC link.

    example:
      robot-energy identify cabinet bag --model kr16 --out my_robot.yaml
    """
    from robot_energy_identify.api.identify import identify_cabinet

    given = IdentifyInputs(args)
    given.check_results()
    result = identify_cabinet(given.bags(), args.model, link_voltages=given.link_voltages())
    return _present(given, result, "Cabinet", "Constant losses and DC link")


def _auxiliary(args: Namespace) -> int:
    """`robot-energy identify auxiliary`: power of the states of loads outside of the cabinet.

    Identify what pump, extruder and other loads outside of the cabinet draw in each of their
    states. A load with a meter of its own needs its readings and its states. For the others the
    recordings need a meter of the outlet that feeds cabinet and loads (--outlet-meter): while the
    robot stands still, what changes with their states is theirs.

    Let each load be in each state for some seconds, several times. For the meter of the outlet,
    switch them on their own and not together, while the robot stands with active drives.

    example:
      robot-energy identify auxiliary cell --model cell.yaml --out identified.yaml
    """
    from robot_energy_identify.api.identify import identify_auxiliary

    given = IdentifyInputs(args)
    given.check_results()
    result = identify_auxiliary(given.bags(), args.model, outlet_meter=args.outlet_meter)
    return _present(given, result, "Loads of the cell", "Powers of their states")


def _present(
    given: IdentifyInputs, result: IdentificationResult[Any], whose: str, what: str
) -> int:
    title = f"{whose} of {result.model.robot.type}"
    lead = f"{what} identified from {given.names()}."
    present(given.args, result.found, title, lead, model=result.model)
    return 0


CABINET_OPTIONS: Options = {
    **bag_options(effort=""),
    **LINK_VOLTAGES,
    **SENSOR_OPTIONS,
    **result_options("these figures"),
}
CABINET = Command.of(_cabinet.__doc__, _cabinet, CABINET_OPTIONS)
AUXILIARY_OPTIONS: Options = {
    **bag_options(effort=""),
    "--outlet-meter": "the power meter of the recordings sits at the outlet of the cell: it sees "
    "the cabinet and all loads",
    **SENSOR_OPTIONS,
    **result_options("these powers"),
}
AUXILIARY = Command.of(_auxiliary.__doc__, _auxiliary, AUXILIARY_OPTIONS)
