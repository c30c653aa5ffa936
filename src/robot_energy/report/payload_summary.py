"""Payloads that a recording set at run time, as values and in words."""

from __future__ import annotations

from typing import Any

from robot_energy.bag_replay import Replay
from robot_energy.blocks import NANOSECOND


def payload_summary(result: Replay) -> dict[str, Any]:
    """Return the section ``payload`` of a summary; nothing where none was set.

    Args:
        result: A finished replay.

    Returns:
        Each change with the instant from which it counted, and the mass at the end.
    """
    if not result.topics.payload:
        return {}
    changes = [
        {
            "valid_from_ns": change.from_ns,
            "link": change.payload.link,
            "mass": change.payload.mass,
            "centre_of_mass": list(change.payload.centre_of_mass),
            "inertia": list(change.payload.inertia),
        }
        for change in result.payload.changes
    ]
    stage = result.pipeline.torque
    return {
        "payload": {
            "topic": result.topics.payload,
            "changes": changes,
            "not_reached": len(stage.coming_payloads),
            "last_mass": stage.robot.payload_mass,
        }
    }


def payload_lines(summary: dict[str, Any]) -> list[str]:
    """Return one line for each change.

    Args:
        summary: From `summarise`.
    """
    section = summary.get("payload")
    if section is None:
        return []
    start_ns = summary["time"]["start_ns"] or 0
    lines: list[str] = []
    for change in section["changes"]:
        after = (change["valid_from_ns"] - start_ns) * NANOSECOND
        when = f"from {after:.3f} s on" if after > 0 else "from the start"
        lines.append(f"{change['mass']:g} kg on {change['link']} {when}")
    return lines
