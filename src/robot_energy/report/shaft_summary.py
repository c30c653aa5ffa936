"""Measured beside predicted shaft energy of each joint, as values and as a table."""

from __future__ import annotations

import math
from typing import Any

from robot_energy.bag_replay import Replay
from robot_energy.blocks import NANOSECOND, EffortMeaning
from robot_energy.report.printing import NOTHING, EnergyFormat, Page, line, percent, table

CAVEATS = {
    "motor_current": "measured = reported current x torque_constant of the model file x speed",
    "motor_torque": "measured = reported motor torque x motor speed",
    "joint_torque": "measured = reported joint torque through the gears x motor speed; a sensor "
    "behind the gear sees neither rotor inertia nor the friction before it",
}


def shaft_summary(result: Replay) -> dict[str, Any]:
    """Return the section ``shaft`` of a summary; nothing where the effort was not used.

    Args:
        result: A finished replay.

    Returns:
        Energies over the intervals in which the effort of the joint is known [J]; NaN
        where it never is. Relative errors refer to the measured energy that went either
        way, so that a motor which returns what it took does not blow them up.
    """
    if result.effort is EffortMeaning.NONE:
        return {}
    shaft = result.ledger.shaft
    observed_ns = result.ledger.registers.time.observed_ns
    names = ("measured_positive", "measured_negative", "predicted_positive", "predicted_negative")
    columns = [shaft.joints(name).tolist() for name in names]
    rows: list[dict[str, Any]] = []
    for index, joint in enumerate(result.model.joint_names):
        out, back, predicted_out, predicted_back = (column[index] for column in columns)
        compared_ns = int(shaft.compared_ns[index])
        difference = (predicted_out - predicted_back) - (out - back)
        turnover = out + back
        rows.append(
            {
                "name": joint,
                "compared_time": compared_ns * NANOSECOND,
                "coverage": compared_ns / observed_ns if observed_ns else math.nan,
                "shaft_energy_positive_measured": out,
                "shaft_energy_negative_measured": back,
                "shaft_energy_positive_compared": predicted_out,
                "shaft_energy_negative_compared": predicted_back,
                "predicted_minus_measured_energy": difference,
                "predicted_minus_measured_relative": difference / turnover
                if turnover > 0
                else math.nan,
            }
        )
    return {"shaft": {"effort": str(result.effort), "joints": rows}}


def print_shaft(page: Page, summary: dict[str, Any], scale: EnergyFormat) -> None:
    """Print the section, where there is one.

    Args:
        page: Where to.
        summary: From `summarise`.
        scale: Unit of the report.
    """
    shaft = summary.get("shaft")
    if shaft is None:
        return
    keys = (
        "shaft_energy_positive_measured",
        "shaft_energy_positive_compared",
        "shaft_energy_negative_measured",
        "shaft_energy_negative_compared",
        "predicted_minus_measured_energy",
    )
    rows: list[list[str]] = []
    sums = dict.fromkeys(keys, 0.0)
    for joint in shaft["joints"]:
        for key in keys:
            sums[key] += joint[key] or 0.0
        rows.append(
            [
                joint["name"],
                *(scale.joule(joint[key]) for key in keys),
                percent(joint["predicted_minus_measured_relative"], sign=True),
                percent(joint["coverage"]),
            ]
        )
    measured = sums[keys[0]] + sums[keys[2]]
    known = measured > 0
    total = [
        "all joints",
        *(scale.joule(sums[key]) if known else NOTHING for key in keys),
        percent(sums[keys[4]] / measured if known else None, sign=True),
        "",
    ]
    table(
        page,
        f"Shaft energy, measured by {shaft['effort'].replace('_', ' ')} and predicted over the "
        f"same time [{scale.unit}]",
        (
            "",
            "out,\nmeasured",
            "out,\npredicted",
            "back,\nmeasured",
            "back,\npredicted",
            "predicted\n- measured",
            "of out\n+ back",
            "time\nknown",
        ),
        rows,
        total,
    )
    line(page, f"  {CAVEATS[shaft['effort']]}")
    line(page, "")
