"""What a model file and a bag hold, as tables for the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.console import Console

from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.report.printing import line, pairs, table

Summary = dict[str, Any]


def print_model(summary: Summary, console: Console) -> None:
    """Print what a model file holds.

    Args:
        summary: From `summarise_model`.
        console: Where to.
    """
    tags = summary["figures"]
    total = sum(tags.values())
    line(
        console,
        f"{summary['source']}: a valid model of {summary['robot']}, "
        f"{len(summary['joints'])} joints, id {summary['model_id']}",
        style="bold",
    )
    shares = ", ".join(f"{count} {tag}" for tag, count in tags.items())
    entries = [
        ("figures", f"{total}: {shares}"),
        (
            "moving mass",
            f"{summary['moving_mass']:.2f} kg, of which payload {summary['payload_mass']:.2f} kg",
        ),
        ("locked joints", ", ".join(summary["locked_joints"]) or "none"),
        ("coupling", "; ".join(summary["coupling"]) or "none"),
        ("drives", DRIVE_MODELS[summary["drive"]].label),
        (
            "constant losses",
            f"{summary['loss_dc']:g} W on the DC side, {summary['loss_grid']:g} W on the grid side",
        ),
        ("braking energy", "returned to the grid" if summary["regenerates"] else "to the resistor"),
        ("DC-link capacitor", "modelled" if summary["capacitor"] else "not modelled"),
        (
            "temperature",
            f"{summary['fallback_temperature_degc']:g} degC where none is known or it "
            f"is older than {summary['stale_after']:g} s",
        ),
    ]
    if summary["notes"]:
        entries.append(("notes", " ".join(summary["notes"].split())))
    pairs(console, entries)
    line(console, "")
    line(console, "Joints and links of the URDF", style="bold")
    for sentence in summary["inventory"]:
        line(console, f"  {sentence}")
    rows = [
        (
            joint["name"],
            f"{joint['gear_ratio']:g}",
            f"{joint['rotor_inertia']:.3g}",
            f"{joint['coulomb']:.3g}",
            joint["viscous_law"],
            "any"
            if joint["fitted_degc"] is None
            else f"{joint['fitted_degc'][0]:g} to {joint['fitted_degc'][1]:g}",
        )
        for joint in summary["joints"]
    ]
    table(
        console,
        "Joints, motor side",
        (
            "",
            "gear\nratio",
            "rotor inertia\n[kg m^2]",
            "Coulomb\n[N m]",
            "viscous\nlaw",
            "fitted\n[degC]",
        ),
        rows,
    )


def print_bag(
    name: str,
    span: str | None,
    topics: Sequence[tuple[str, str, str, str]],
    problems: Sequence[str],
    origin: str,
    console: Console,
) -> None:
    """Print what a bag holds.

    Args:
        name: The bag.
        span: Its time in words; None if it holds no message.
        topics: Topic, type, count and use of each.
        problems: What is wrong with it.
        origin: Where it comes from; empty if it does not say.
        console: Where to.
    """
    line(console, f"{name}: {span or 'no messages'}", style="bold")
    if origin:
        line(console, f"origin: {origin}")
    for problem in problems:
        line(console, f"problem: {problem}", style="bold red")
    table(console, "", ("topic", "type", "messages", "used as"), topics)
