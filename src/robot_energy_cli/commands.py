"""All commands, in the order in which the help lists them."""

from __future__ import annotations

from robot_energy_cli import (
    dashboards,
    fleet,
    history,
    identify,
    identify_drives,
    identify_dynamics,
    listings,
    models,
    motions,
    recordings,
    replay,
    simulate,
)
from robot_energy_cli.command import Command, Group

IDENTIFY = Group(
    "identify",
    "a model of your robot from recordings",
    "Identify a model from recordings; held-out figures say how good it is.",
    "what",
    "WHAT",
    lambda: (
        identify.ALL, identify_dynamics.EXCITATION, identify.FRICTION, identify_dynamics.DYNAMICS,
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
    replay.REPLAY, replay.REPORT, replay.EXPORT, recordings.IMPORT, recordings.CHECK,
    recordings.TEST, IDENTIFY, FLEET, history.COMMAND, motions.PREDICT, motions.OPTIMIZE,
    motions.SHARED_BUS, fleet.ADVISE, models.LIST, models.MODEL, listings.KINDS, recordings.INFO,
    simulate.COMMAND, listings.SCHEMA, dashboards.LAYOUTS, dashboards.MONITORING,
)  # fmt: skip
