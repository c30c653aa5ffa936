"""The command `robot-energy kinds`: the tables of kinds."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterable

from robot_energy.foundation.kinds import Kind
from robot_energy_cli.command import Command


def _run(args: Namespace) -> int:
    del args
    print(kinds_listing(), end="")
    return 0


def kinds_listing() -> str:
    """Return all tables of kinds, one line for each kind, as Markdown."""
    from robot_energy.inputs.meter.kinds import METER_KINDS, OTHER
    from robot_energy.inputs.temperatures.kinds import TEMPERATURE_KINDS
    from robot_energy.model.drive_models import DRIVE_MODELS
    from robot_energy.model.friction_laws import FRICTION_LAWS
    from robot_energy.presets import ROBOTS
    from robot_energy_logs.log_formats import LOG_FORMATS

    parts = [
        _table(
            "Drive models",
            ("`drive`", "entry of each joint", "identified", "meaning"),
            (
                (f"`{k.name}`", f"`{k.key}`" if k.key else "", _yes(k.fitted), k.line)
                for k in DRIVE_MODELS.values()
            ),
        ),
        _table(
            "Friction laws",
            ("`law`", "follows temperature", "identified", "meaning"),
            (
                (f"`{k.name}`", _yes(k.follows_temperature), _yes(k.fit), k.line)
                for k in FRICTION_LAWS.values()
            ),
        ),
        _table("Meters", ("`type`", "meaning"), _lines((*METER_KINDS.values(), OTHER))),
        _table("Temperature sources", ("`type`", "meaning"), _lines(TEMPERATURE_KINDS.values())),
        _table("Log formats", ("`robot-energy import`", "meaning"), _lines(LOG_FORMATS.values())),
        _table(
            "Robots",
            ("`--robot`", "shipped model", "robot, driver"),
            (
                (f"`{k.name}`", f"`{k.model}`" if k.model else "", f"{k.label}: {k.line}")
                for k in ROBOTS.values()
            ),
        ),
    ]
    return "\n".join(parts)


def _lines(kinds: Iterable[Kind]) -> Iterable[tuple[str, str]]:
    return ((f"`{kind.name}`", kind.line) for kind in kinds)


def _yes(part: object) -> str:
    return "yes" if part else "no"


def _table(title: str, heads: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [heads, ("---",) * len(heads), *rows]
    return f"### {title}\n\n" + "".join(f"| {' | '.join(line)} |\n" for line in lines)


COMMAND = Command(
    "kinds",
    "list drive models, friction laws, meters, temperatures, log formats, robots",
    _run,
    description="List the kinds of drive models, friction laws, meters, temperature sources "
    "and log formats, those of your own included, and the robots whose drivers are known, as "
    "Markdown.",
)
