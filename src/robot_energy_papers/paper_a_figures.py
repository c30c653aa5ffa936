"""The figures of the study as plain numbers: for JSON, and for the page."""

from __future__ import annotations

from typing import Any

import numpy as np

from robot_energy.blocks import Float
from robot_energy.physics.friction import viscous_law
from robot_energy.results.base import plain
from robot_energy.results.identification import FrictionReport
from robot_energy_papers.calibration import Calibration
from robot_energy_papers.held_out import SetRow, normalised, worst
from robot_energy_papers.models import FOLLOWS
from robot_energy_papers.paper_a import PaperA, mean_shaft_power

REFERENCE_DEGC = 22.0  # of fig. 7a
POWER_DEGC = 60.0  # of fig. 4
FIXED = ("fixed_20", "fixed_60")
LABEL = "virtual rig, KR 16 class; nothing here was measured on a robot"
ROUNDING = 0.5  # K
Figures = dict[str, Any]


def figures(result: PaperA) -> Figures:
    """Return every figure of the study, ready for JSON; ratios are 0 to 1.

    Args:
        result: The study.
    """
    found, heating = result.identified, warming(result)
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
        "friction": plain(FrictionReport("motor_torque", tuple(found.fits), ())),
        "friction_against_truth": [
            {"motor_degc": degc.tolist(), "error": error.tolist()}
            for degc, error in friction_errors(result)
        ],
        "coulomb_by_set": [
            {
                "motor_degc": entry.motor_temperature_degc.tolist(),
                "coulomb": entry.coulomb.tolist(),
                "viscous": entry.viscous.tolist(),
            }
            for entry in found.sets
        ],
        "cabinet": plain(found.cabinet),
        "notes": list(found.notes),
        "shaft_power": [
            {
                "robot_degc": curve.robot_degc,
                "motor_degc": curve.motor_degc,
                "mean_power": mean_shaft_power(curve),
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
        "effects_degc": list(result.scale.rigs.test_degc),
        "calibration": _calibration(result.calibration),
    }


def warming(result: PaperA) -> list[SetRow]:
    """Return the held-out sets that were not recorded while cooling, coldest first."""
    rows = [row for row in result.rows if row.way != "cooling"]
    return sorted(rows, key=lambda row: row.robot_degc)


def reference_power(result: PaperA) -> float:
    """Return the measured mean power at 22 degC. [W]"""
    return normalised(warming(result), REFERENCE_DEGC)


def friction_errors(result: PaperA) -> list[tuple[Float, Float]]:
    """Return identified over true viscous friction, less 1, of every set for identification.

    Returns:
        Motor temperatures [degC] and errors [-], shape (n,) each, one pair per set.
    """
    laws = [viscous_law(fit.law) for fit in result.identified.fits]
    found: list[tuple[Float, Float]] = []
    for entry in result.truth:
        degc = entry.motor_temperature_degc
        law = np.array([float(one.viscous(value)) for one, value in zip(laws, degc, strict=True)])
        found.append((degc, law / entry.viscous - 1.0))
    return found


def beyond_range(result: PaperA) -> tuple[int, float]:
    """Return in how many held-out sets a motor was outside the fitted range of its law.

    Returns:
        The count, and the greatest distance from a range. [K]
    """
    low = np.array([fit.range_degc[0] for fit in result.identified.fits])
    high = np.array([fit.range_degc[1] for fit in result.identified.fits])
    away = [
        float(np.maximum(low - degc, degc - high).max())
        for degc in (entry.recording.motor_temperature_degc for entry in result.test)
    ]
    # Readings are whole degrees: what lies within their rounding is not outside.
    outside = [kelvin for kelvin in away if kelvin > ROUNDING]
    return len(outside), max(outside, default=0.0)


def nearest_row(result: PaperA, degc: float) -> int:
    """Return the index of the held-out set of warming up nearest to a robot temperature."""
    rows = result.rows
    usable = [index for index, row in enumerate(rows) if row.way != "cooling"]
    return min(usable, key=lambda index: abs(rows[index].robot_degc - degc))


def coulomb_drift(result: PaperA) -> Float:
    """Return Coulomb friction of the hottest set over that of the coldest, less 1, by axis."""
    sets = result.identified.sets
    return sets[-1].coulomb / sets[0].coulomb - 1.0


def viscous_fall(result: PaperA) -> Float:
    """Return the identified law at the coldest set over that at the hottest, by axis."""
    laws = [viscous_law(fit.law) for fit in result.identified.fits]
    cold, hot = result.truth[0].motor_temperature_degc, result.truth[-1].motor_temperature_degc
    return np.array(
        [
            float(law.viscous(low)) / float(law.viscous(high))
            for law, low, high in zip(laws, cold, hot, strict=True)
        ]
    )


def electrical_over_mechanical(calibration: Calibration, degc: float) -> float:
    """Return losses of motors, inverters and rectifier over friction losses, true. [-]"""
    flow = calibration.flows[degc]
    electrical = ("iron_loss", "copper_loss", "inverter_loss", "rectifier_loss")
    return sum(flow[name] for name in electrical) / flow["friction_power"]


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
            f"{degc:g}": electrical_over_mechanical(found, degc) for degc in found.flows
        },
    }


SHORT = {
    "fixed_20": "fixed cold",
    "fixed_60": "fixed warm",
    "follows": "follows",
    "table": "table",
    "losses": "+ losses",
    "capacitor": "+ DC link",
}


def curve_names(result: PaperA) -> dict[str, str]:
    """Return what each model is called in a legend."""
    at = result.identified.fixed_degc
    names = {name: f"predicted, friction of {at[name]:.0f} degC" for name in FIXED}
    names[FOLLOWS] = "predicted, friction follows temperature"
    names["capacitor"] = "and drive losses, DC link"
    return names


def model_names(result: PaperA) -> dict[str, str]:
    """Return what each model is called on the page, in its order."""
    at = result.identified.fixed_degc
    names = {name: f"fixed, identified at {at[name]:.0f} degC" for name in FIXED}
    names[FOLLOWS] = "follows temperature (paper A)"
    names["table"] = "viscous table"
    names["losses"] = "and drive losses"
    names["capacitor"] = "and DC link"
    return {name: text for name, text in names.items() if name in result.identified.models}
