"""The study of paper A as JSON, what its templates name, and the front picture."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from robot_energy.physics.friction import with_fixed_friction
from robot_energy.replay.bag_replay import replay
from robot_energy.results.base import json_value
from robot_energy.timeline.blocks import Float
from robot_energy_identify.friction_and_thermal import FrictionReport
from robot_energy_papers.calibration import Calibration
from robot_energy_papers.drawings import (
    EnergyStudy,
    ModelEnergyCurve,
    Role,
    energy_over_temperature,
    shaft_power_over_temperature,
)
from robot_energy_papers.experiment import MOVES
from robot_energy_papers.models import (
    CAPACITOR,
    FIXED_DEGC,
    FOLLOWS,
    fixed_name,
    normalised,
    worst,
)
from robot_energy_papers.pages import Piece
from robot_energy_papers.paper_a import HOLD, POWER_DEGC, REFERENCE_DEGC, RISE, PaperA
from robot_energy_papers.soaked_rigs import (
    ALL,
    EFFECTS,
    NO_OIL,
    NOTHING,
    SHARED,
    EffectRow,
    error_spreads,
)
from robot_energy_report.identification import (
    friction_over_temperature,
    friction_tables,
    losses_section,
)
from robot_energy_report.replay_figures import Series, compared_series, power_and_energy

PAPER = (
    "Modeling and Experimental Validation of the Influence of Robot Temperature on Its Energy "
    "Consumption"
)
FIXED = tuple(fixed_name(degc) for degc in FIXED_DEGC)
RIG = "virtual rig, KR 16 class"
LABEL = f"{RIG}; nothing here was measured on a robot"
GOAL = 0.05  # paper A: error that remains
WINDOW = 7.0  # s of fig. 5
SMOOTH = 0.02  # s
SHORT = {
    "fixed_20": "fixed cold",
    "fixed_60": "fixed warm",
    "follows": "follows",
    "table": "table",
    "losses": "+ losses",
    "capacitor": "+ DC link",
}
ROLES: dict[str, Role] = {
    FOLLOWS: "predicted",
    FIXED[0]: "fixed",
    FIXED[1]: "other",
    CAPACITOR: "more",
}


def front_picture(result: PaperA, path: Path) -> None:
    """Draw measured and predicted energy over temperature, small and alone."""
    energy_over_temperature(_energy_study(result), path, f"Held-out motions, {RIG}")


def context(result: PaperA) -> dict[str, Any]:
    """Return what the expressions of the templates use."""
    names = _model_names(result)
    outside, outside_by = result.beyond_range
    effects = {row.name: row for row in result.effects}
    friction = result.friction_errors
    chosen = [fit.chosen for fit in result.identified.fits]
    return {
        "result": result,
        "scale": result.scale,
        "data": figures(result),
        "rig": RIG,
        "paper": PAPER,
        "names": names,
        "short": {name: SHORT[name] for name in names},
        "missed": [row for row in result.rows if abs(row.error(FOLLOWS)) > GOAL],
        "mean_error": float(np.mean([row.error(FOLLOWS) for row in result.rows])),
        "outside": outside,
        "outside_by": outside_by,
        "warm": result.rows[result.nearest(POWER_DEGC)],
        "axes": [fit.name for fit in result.identified.fits],
        "friction_errors": [
            {"degc": friction[index][0].mean(), "error": friction[index][1].tolist()}
            for index in sorted({0, len(friction) // 2, len(friction) - 1})
        ],
        "effects": _effects(effects),
        "no_oil": effects[NO_OIL],
        "all_effects": effects[ALL],
        "plants": error_spreads(result.plants),
        "shared": SHARED,
        "hold": HOLD,
        "rise": RISE,
        "moves": MOVES,
        "laws": ", ".join(f"{chosen.count(law)} axes {law}" for law in dict.fromkeys(chosen)),
    }


def _effects(rows: dict[str, EffectRow]) -> list[dict[str, Any]]:
    """Rows of the table of effects: the three that frame them, then without and only."""
    everything, nothing = rows[ALL].mean, rows[NOTHING].mean
    cost: dict[str, float | None] = {
        **dict.fromkeys((ALL, NOTHING, NO_OIL)),
        **{name: everything - row.mean for name, row in rows.items() if name.startswith("without")},
        **{name: row.mean - nothing for name, row in rows.items() if name.startswith("only")},
    }
    order = [ALL, NOTHING, NO_OIL]
    order += [f"{kind} {name}" for kind in ("without", "only") for name in EFFECTS]
    return [
        {"name": name, "follows": rows[name].follows, "mean": rows[name].mean, "cost": cost[name]}
        for name in order
        if name in rows
    ]


def _model_names(result: PaperA) -> dict[str, str]:
    at = result.identified.fixed_degc
    names = {name: f"fixed, identified at {at[name]:.0f} degC" for name in FIXED}
    names |= {
        FOLLOWS: "follows temperature (paper A)",
        "table": "viscous table",
        "losses": "with drive losses",
        CAPACITOR: "with losses and DC link",
    }
    return {name: text for name, text in names.items() if name in result.identified.models}


def pieces(result: PaperA) -> dict[str, Piece]:
    """Return the figures of the page, and the parts that the report writes."""
    index = result.nearest(POWER_DEGC)
    at = f"robot at {result.rows[index].robot_degc:.0f} degC"
    axis, fits = result.model.joint_names[0], result.identified.fits
    curves = {
        f"robot {curve.robot_degc:.0f}, motor {curve.motor_degc:.0f} degC": _window(
            curve.time, curve.power, result
        )
        for curve in result.shaft
    }
    friction = FrictionReport("motor_torque", tuple(fits), ())
    losses = result.identified.cabinet
    return {
        "friction_tables": lambda page: friction_tables(friction, page),
        "cabinet_tables": lambda page: losses_section(losses, page),
        "energy": lambda path: energy_over_temperature(
            _energy_study(result), path, f"Fig. 7, {RIG}", deviation=True
        ),
        "rest": lambda path: power_and_energy(
            _series(result.rest.path, result), path, f"Fig. 1, rest in several poses, {RIG}"
        ),
        "warm": lambda path: power_and_energy(
            _series(result.test[index].path, result), path, f"Fig. 4, {at}, {RIG}"
        ),
        "shaft": lambda path: shaft_power_over_temperature(curves, path, axis, f"Fig. 5, {RIG}"),
        "friction": lambda path: friction_over_temperature(fits, path, title=f"Fig. 6, {RIG}"),
    }


def _energy_study(result: PaperA) -> EnergyStudy:
    reference, at = normalised(result.warming, REFERENCE_DEGC), result.identified.fixed_degc
    labels = {name: f"predicted, friction of {at[name]:.0f} degC" for name in FIXED}
    labels[FOLLOWS] = "predicted, friction follows temperature"
    labels[CAPACITOR] = "with drive losses and DC link"
    curves = [
        ModelEnergyCurve(
            labels[name],
            role,
            np.array([row.predicted_energy[name] / row.compared_time for row in result.rows])
            / reference,
            np.array([row.error(name) for row in result.rows]),
        )
        for name, role in ROLES.items()
        if name in result.identified.models
    ]
    return EnergyStudy(
        np.array([row.robot_degc for row in result.rows]),
        np.array([row.mean_power for row in result.rows]) / reference,
        [row.way == "cooling" for row in result.rows],
        curves,
        REFERENCE_DEGC,
    )


def _series(bag: Path, result: PaperA) -> list[Series]:
    """Measured, predicted, and predicted with friction held at 22 degC."""
    model = result.model
    found = compared_series(replay(bag, model, keep_curves=True), "predicted, friction follows")
    held = compared_series(
        replay(bag, with_fixed_friction(model, REFERENCE_DEGC), keep_curves=True),
        f"predicted, friction held at {REFERENCE_DEGC:g} degC",
        "fixed",
    )
    if found is None or held is None:  # held_out has refused such a bag before
        return []
    return [*found, held[1]]


def _window(time: Float, power: Float, result: PaperA) -> tuple[Float, Float]:
    """The seconds in which axis 1 works hardest in the coldest set, smoothed a little."""
    first = result.shaft[0]
    length = round(WINDOW / float(np.median(np.diff(first.time))))
    work = np.convolve(np.abs(first.power), np.ones(length), "valid")
    begin = float(first.time[int(np.argmax(work))])
    count = max(round(SMOOTH / float(np.median(np.diff(time)))), 1)
    mean = np.convolve(power, np.ones(count) / count, "same")
    rows = (time >= begin) & (time <= begin + WINDOW)
    return time[rows], mean[rows]


def figures(result: PaperA) -> dict[str, Any]:
    """Return every figure of the study, ready for JSON; ratios are 0 to 1."""
    found, heating = result.identified, result.warming
    return {
        "label": LABEL,
        "seed": result.seed,
        "quick": result.quick,
        "robot_degc": _span(row.robot_degc for row in result.rows),
        "motor_degc": [
            min(row.motor_degc[0] for row in result.rows),
            max(row.motor_degc[1] for row in result.rows),
        ],
        "energy_cold_over_hot": heating[0].mean_power / heating[-1].mean_power,
        "worst_error": {name: worst(result.rows, name) for name in found.models},
        "error_range": {
            name: _span(row.error(name) for row in result.rows) for name in found.models
        },
        "fixed_identified_degc": found.fixed_degc,
        "sets": [
            {
                **json_value(row),
                "mean_power": row.mean_power,
                "error": {name: row.error(name) for name in found.models},
            }
            for row in result.rows
        ],
        "train": [
            {
                "motor_degc": entry.recording.motor_temperature_degc.mean(axis=0).tolist(),
                "rise": entry.rise,
                "motor_minus_gear": entry.motor_minus_gear,
            }
            for entry in result.train
        ],
        "greatest_rise_in_a_set": max(entry.rise for entry in (*result.train, *result.test)),
        "peak_power": max(entry.recording.peak_power for entry in (*result.train, *result.test)),
        "friction": json_value(FrictionReport("motor_torque", tuple(found.fits), ())),
        "friction_against_truth": [
            {"motor_degc": degc.tolist(), "error": error.tolist()}
            for degc, error in result.friction_errors
        ],
        "coulomb_by_set": json_value(found.sets),
        "cabinet": json_value(found.cabinet),
        "notes": list(found.notes),
        "shaft_power": [
            {**json_value(curve), "mean_power": curve.mean_power} for curve in result.shaft
        ],
        "effects": [
            {**json_value(row), "mean": row.mean, "worst": row.worst} for row in result.effects
        ],
        "plants": json_value(result.plants),
        "plants_error": json_value(error_spreads(result.plants)),
        "effects_degc": list(result.scale.rigs.test_degc),
        "sensitivity": json_value(result.open),
        "calibration": _calibration(result.calibration),
    }


def _span(values: Iterable[float]) -> list[float]:
    ordered = sorted(values)
    return [ordered[0], ordered[-1]]


def _calibration(found: Calibration) -> dict[str, Any]:
    ratio = found.ratio(20.0, 60.0)
    column = found.start_degc.tolist().index(POWER_DEGC)
    return {
        "energy_20_over_60": _span(ratio.tolist()),
        "peak_power_at_60": _span(found.peak_power[:, column].tolist()),
        "programs": len(found.mean_power),
        "hold_mean": found.holding.mean,
        "hold_range": [found.holding.least, found.holding.greatest],
        "hold_deviation": found.holding.deviation,
        "flows": {f"{degc:g}": flow for degc, flow in found.flows.items()},
        "electrical_over_mechanical": {
            f"{degc:g}": found.electrical_over_mechanical(degc) for degc in found.flows
        },
    }
