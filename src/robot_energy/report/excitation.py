"""What an excitation motion tells and what it uses of the limits, for terminal and JSON."""

from __future__ import annotations

from typing import Any

import numpy as np

from robot_energy.identify.excitation.excitation import Excitation, ExcitationScore
from robot_energy.report.printing import NOTHING, Page, line, percent, table

KINDS = ("position", "velocity", "acceleration", "torque")


def excitation_summary(found: Excitation) -> dict[str, Any]:
    """Return everything about an excitation motion, ready for JSON.

    Args:
        found: The motion.
    """
    limits, settings = found.limits, found.settings
    start = found.motion.sample(np.zeros(1)).joint_position[0]
    names = limits.robot.joint_names
    unlimited = ~np.isfinite(limits.torque)
    return {
        "criterion": settings.criterion,
        "harmonics": settings.harmonics,
        "period": settings.period,
        "base_frequency": 1.0 / settings.period,
        "starts": settings.starts,
        "seed": settings.seed,
        "before": _quality(found.start),
        "after": _quality(found.quality),
        "base_parameters": [
            {
                "name": name,
                "sum": found.base.expression(place),
                "excited": name not in found.quality.not_excited,
            }
            for place, name in enumerate(found.base.labels)
        ],
        "without_effect": list(found.base.without_effect),
        "margin": limits.margin,
        "acceleration_assumed": limits.acceleration_assumed,
        "joints": [
            {
                "name": name,
                "start": float(start[joint]),
                "use": {
                    kind: None
                    if kind == "torque" and unlimited[joint]
                    else float(found.use[kind][joint]) * limits.margin
                    for kind in KINDS
                },
            }
            for joint, name in enumerate(names)
        ],
        "floor": None
        if limits.floor is None
        else {
            "link": limits.floor.link,
            "height": limits.floor.height,
            "least": found.height,
        },
    }


def _quality(quality: ExcitationScore) -> dict[str, Any]:
    finite = np.isfinite(quality.condition)
    return {
        "condition": quality.condition if finite else None,
        "log_determinant": quality.log_determinant if finite else None,
    }


def print_excitation(summary: dict[str, Any], page: Page) -> None:
    """Print what an excitation motion tells and uses.

    Args:
        summary: From `excitation_summary`.
        page: Where to.
    """
    excited = [entry["name"] for entry in summary["base_parameters"] if entry["excited"]]
    silent = [entry["name"] for entry in summary["base_parameters"] if not entry["excited"]]
    rows = [
        (title, _text(summary["before"][key]), _text(summary["after"][key]))
        for title, key in (
            ("condition number", "condition"),
            ("log determinant per parameter", "log_determinant"),
        )
    ]
    table(
        page,
        f"Observation matrix of {len(summary['base_parameters'])} base parameters, "
        f"{summary['harmonics']} harmonics of {summary['base_frequency']:.4g} Hz, "
        f"{summary['period']:g} s",
        ("", "best random start", "optimised"),
        rows,
    )
    table(
        page,
        f"Start pose, and use of the limits of URDF and robot (at most "
        f"{100 * summary['margin']:.0f} % was allowed)",
        ("joint", "start [rad or m]", *KINDS),
        [
            (
                joint["name"],
                f"{joint['start']:.4f}",
                *(percent(joint["use"][kind]) for kind in KINDS),
            )
            for joint in summary["joints"]
        ],
    )
    floor = summary["floor"]
    if floor is not None:
        line(
            page,
            f"{floor['link']} stays above {floor['least']:.3f} m ({floor['height']:g} m allowed)",
        )
    else:
        line(page, "note: no link is kept above a floor; --floor and --tool do")
    line(page, f"excited: {', '.join(excited) or NOTHING}")
    line(page, f"not excited: {', '.join(silent) or NOTHING}")
    line(page, f"no torque depends on: {', '.join(summary['without_effect']) or NOTHING}")
    if summary["acceleration_assumed"]:
        line(
            page,
            "note: a URDF knows no acceleration limits; full speed in 0.5 s is assumed, "
            "--acceleration gives those of the robot",
        )
    if any(joint["use"]["torque"] is None for joint in summary["joints"]):
        line(page, "note: the URDF gives no torque limit for some joints; none was kept there")
    line(
        page,
        "note: collisions of the robot with itself and its surroundings are not checked; play "
        "the motion in simulation, then slowly, before recording it",
    )


def _text(value: float | None) -> str:
    return NOTHING if value is None else f"{value:.4g}"
