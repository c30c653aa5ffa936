"""All commands, in the order in which the help lists them."""

from __future__ import annotations

from robot_energy_cli import (
    advise,
    check,
    export,
    fleet_identify,
    fleet_report,
    fleet_run,
    history,
    identify_all,
    identify_drives,
    identify_dynamics,
    identify_excitation,
    identify_friction,
    identify_metered,
    identify_thermal,
    import_logs,
    info,
    kinds,
    layouts,
    models,
    monitoring,
    optimize,
    predict,
    replay,
    report,
    schema,
    shared_bus,
    simulate,
    test,
)
from robot_energy_cli.command import Command, Group

IDENTIFY = Group(
    "identify",
    "a model of your robot from recordings",
    "Identify a model from recordings; held-out figures say how good it is.",
    "steps",
    "STEP",
    lambda: (
        identify_all.COMMAND, identify_excitation.COMMAND, identify_friction.COMMAND,
        identify_dynamics.COMMAND, identify_metered.CABINET, identify_drives.COMMAND,
        identify_thermal.COMMAND, identify_metered.AUXILIARY,
    ),
)  # fmt: skip
FLEET = Group(
    "fleet",
    "many bags of many robots: replay them, report, identify",
    "Many bags of many robots: replay them into a dataset, report, identify.",
    "actions",
    "ACTION",
    lambda: (fleet_run.COMMAND, fleet_report.COMMAND, fleet_identify.COMMAND),
)
COMMANDS: tuple[Command | Group, ...] = (
    replay.COMMAND, report.COMMAND, export.COMMAND, import_logs.COMMAND, check.COMMAND,
    test.COMMAND, IDENTIFY, FLEET, history.COMMAND, predict.COMMAND, optimize.COMMAND,
    shared_bus.COMMAND, advise.COMMAND, models.LIST, models.MODEL, kinds.COMMAND, info.COMMAND,
    simulate.COMMAND, schema.COMMAND, layouts.COMMAND, monitoring.COMMAND,
)  # fmt: skip
