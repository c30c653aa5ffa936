"""All commands, in the order in which the help lists them."""

from __future__ import annotations

from robot_energy_cli import (
    check,
    dashboards,
    export,
    fleet,
    history,
    identify,
    identify_drives,
    identify_dynamics,
    identify_excitation,
    import_logs,
    info,
    listings,
    models,
    motions,
    replay,
    report,
    simulate,
    test,
)
from robot_energy_cli.command import Command, Group

IDENTIFY = Group(
    "identify",
    "a model of your robot from recordings",
    "Identify a model from recordings; held-out figures say how good it is.",
    "what",
    "WHAT",
    lambda: (
        identify.ALL, identify_excitation.COMMAND, identify.FRICTION, identify_dynamics.COMMAND,
        identify.CABINET, identify_drives.COMMAND, identify.THERMAL, identify.AUXILIARY,
    ),
)  # fmt: skip
FLEET = Group(
    "fleet",
    "many bags of many robots: replay them, report, identify",
    "Many bags of many robots: replay them into a dataset, report, identify.",
    "what",
    "WHAT",
    lambda: (fleet.RUN, fleet.REPORT, fleet.IDENTIFY),
)
COMMANDS: tuple[Command | Group, ...] = (
    replay.COMMAND, report.COMMAND, export.COMMAND, import_logs.COMMAND, check.COMMAND,
    test.COMMAND, IDENTIFY, FLEET, history.COMMAND, motions.PREDICT, motions.OPTIMIZE,
    motions.SHARED_BUS, fleet.ADVISE, models.LIST, models.MODEL, listings.KINDS, info.COMMAND,
    simulate.COMMAND, listings.SCHEMA, dashboards.LAYOUTS, dashboards.MONITORING,
)  # fmt: skip
