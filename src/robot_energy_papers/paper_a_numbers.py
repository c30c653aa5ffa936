"""The figures of the study as plain numbers: for JSON, and for the page."""

from __future__ import annotations

from typing import Any

from robot_energy.results.base import json_value
from robot_energy.results.identification import FrictionReport
from robot_energy_papers.calibration import Calibration
from robot_energy_papers.drawn_plants import error_spreads
from robot_energy_papers.held_out import SetRow, worst
from robot_energy_papers.paper_a import POWER_DEGC, PaperA

LABEL = "virtual rig, KR 16 class; nothing here was measured on a robot"
Figures = dict[str, Any]


def figures(result: PaperA) -> Figures:
    """Return every figure of the study, ready for JSON; ratios are 0 to 1.

    Args:
        result: The study.
    """
    found, heating = result.identified, result.warming
    return {
        "label": LABEL,
        "seed": result.seed,
        "quick": result.quick,
        "robot_degc": [
            min(row.robot_degc for row in result.rows),
            max(row.robot_degc for row in result.rows),
        ],
        "motor_degc": [
            min(row.coldest_degc for row in result.rows),
            max(row.warmest_degc for row in result.rows),
        ],
        "energy_cold_over_hot": heating[0].mean_power / heating[-1].mean_power,
        "worst_error": {name: worst(result.rows, name) for name in found.models},
        "error_range": {
            name: [
                min(row.error(name) for row in result.rows),
                max(row.error(name) for row in result.rows),
            ]
            for name in found.models
        },
        "fixed_identified_degc": found.fixed_degc,
        "sets": [_row(row) for row in result.rows],
        "train": [
            {
                "motor_degc": entry.recording.motor_temperature_degc.mean(axis=0).tolist(),
                "rise": entry.rise,
                "motor_minus_gear": entry.lag,
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
        "coulomb_by_set": [
            {
                "motor_degc": entry.motor_temperature_degc.tolist(),
                "coulomb": entry.coulomb.tolist(),
                "viscous": entry.viscous.tolist(),
            }
            for entry in found.sets
        ],
        "cabinet": json_value(found.cabinet),
        "notes": list(found.notes),
        "shaft_power": [
            {
                "robot_degc": curve.robot_degc,
                "motor_degc": curve.motor_degc,
                "mean_power": curve.mean_power,
            }
            for curve in result.shaft
        ],
        "effects": [
            {
                "rig": row.name,
                "follows": list(row.follows),
                "fixed_20": list(row.fixed),
                "mean": row.mean,
                "worst": row.worst,
            }
            for row in result.effects
        ],
        "plants": [
            {"plant_seed": row.plant_seed, "error": row.errors, "refused": row.refused}
            for row in result.plants
        ],
        "plants_error": json_value(error_spreads(result.plants)),
        "effects_degc": list(result.scale.rigs.test_degc),
        "sensitivity": {name: table.to_dict() for name, table in result.open.items()},
        "calibration": _calibration(result.calibration),
    }


def _row(row: SetRow) -> Figures:
    return {
        "bag": row.bag,
        "way": row.way,
        "robot_degc": row.robot_degc,
        "motor_degc": [row.coldest_degc, row.warmest_degc],
        "rise": row.rise,
        "motor_minus_gear": row.lag,
        "measured_energy": row.measured_energy,
        "compared_time": row.compared,
        "mean_power": row.mean_power,
        "peak_power": row.peak_power,
        "predicted_energy": row.predicted,
        "error": {name: row.error(name) for name in row.predicted},
        "extrapolated": row.extrapolated,
    }


def _calibration(found: Calibration) -> Figures:
    ratio = found.ratio(20.0, 60.0)
    column = found.start_degc.tolist().index(POWER_DEGC)
    return {
        "energy_20_over_60": [float(ratio.min()), float(ratio.max())],
        "peak_power_at_60": [
            float(found.peak_power[:, column].min()),
            float(found.peak_power[:, column].max()),
        ],
        "programs": len(found.mean_power),
        "hold_mean": found.holding.mean,
        "hold_range": [found.holding.least, found.holding.greatest],
        "hold_deviation": found.holding.deviation,
        "flows": {f"{degc:g}": flow for degc, flow in found.flows.items()},
        "electrical_over_mechanical": {
            f"{degc:g}": found.electrical_over_mechanical(degc) for degc in found.flows
        },
    }
