"""What identification found, as tables for the terminal and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot_energy.identify.cabinet.cabinet import CabinetFit, Level
from robot_energy.identify.friction.friction import FrictionFit
from robot_energy.identify.friction.laws import fitted_laws
from robot_energy.identify.friction.temperature_study import Study
from robot_energy.model.friction_laws import FRICTION_LAWS
from robot_energy.report.printing import Page, line, percent, table

Summary = dict[str, Any]


def friction_summary(fits: Sequence[FrictionFit], refused: Sequence[str], unit: str) -> Summary:
    """Return everything that `identify friction` found, ready for JSON.

    Args:
        fits: One per axis that could be identified.
        refused: Why the others could not, one sentence each.
        unit: What the torque is measured as.
    """
    return {
        "effort": unit,
        "axes": [_axis(fit) for fit in fits],
        "refused": list(refused),
        "warnings": [warning for fit in fits for warning in fit.warnings],
    }


def _axis(fit: FrictionFit) -> Summary:
    return {
        "name": fit.name,
        "coulomb": fit.coulomb,
        "coulomb_std": fit.coulomb_std,
        "law": fit.chosen,
        "parameters": fit.law.model_dump(mode="json", exclude_none=True),
        "fitted_degc": list(fit.range_degc),
        "samples": fit.samples,
        "points": [
            {
                "motor_temperature_degc": point.motor_temperature_degc,
                "viscous": point.viscous,
                "std": point.std if np.isfinite(point.std) else None,
            }
            for point in fit.points
        ],
        "held_out_rms": {name: error.rms for name, error in fit.errors.items()},
        "in_sample_rms": fit.residual,
    }


def print_friction(summary: Summary, page: Page) -> None:
    """Print what `identify friction` found.

    Args:
        summary: From `friction_summary`.
        page: Where to.
    """
    unit = "A" if summary["effort"] == "log" else "N m"
    laws = fitted_laws()
    found: list[tuple[str, ...]] = []
    tested: list[tuple[str, ...]] = []
    for axis in summary["axes"]:
        low, high = axis["fitted_degc"]
        found.append(
            (
                axis["name"],
                f"{axis['coulomb']:.4g} +- {axis['coulomb_std']:.2g}"
                if axis["coulomb"] > 0.0
                else "0, at bound",
                _law_text(axis),
                f"{low:.0f} to {high:.0f} degC",
            )
        )
        errors = axis["held_out_rms"]
        tested.append(
            (
                axis["name"],
                str(axis["samples"]),
                *(f"{errors[name]:.4g}" if name in errors else "-" for name in laws),
                axis["law"],
            )
        )
    side = "as logged" if summary["effort"] == "log" else "motor side"
    table(
        page,
        f"Friction over motor temperature, {side}",
        ("axis", f"Coulomb [{unit}]", f"viscous [1e-3 {unit} s/rad]", "fitted at"),
        found,
    )
    table(
        page,
        f"RMS torque error on temperatures that the fit has not seen [{unit}]",
        ("axis", "samples", *(FRICTION_LAWS[name].label for name in laws), "chosen"),
        tested,
    )
    for sentence in (*summary["warnings"], *summary["refused"]):
        line(page, f"note: {sentence}")


def _loss_text(value: float, std: float) -> str:
    return f"{value:.1f} +- {std:.1g}" if value > 0.0 else "0, at bound"


def _law_text(axis: Summary) -> str:
    law = axis["parameters"]
    return FRICTION_LAWS[law["law"]].text(law)


def study_summary(name: str, study: Study, chance: Sequence[float]) -> Summary:
    """Return a test on unseen temperatures, ready for JSON.

    Args:
        name: Of the axis.
        study: The test.
        chance: RMS of the exponential law over that of the constant, with temperatures
            shuffled between the runs, one per shuffle.
    """
    return {
        "name": name,
        "train": str(study.train),
        "test": str(study.test),
        "trained_samples": study.trained,
        "tested_samples": study.tested,
        "rows": [
            {
                "law": row.law,
                "beyond": row.beyond,
                "rms": row.rms,
                "power_bias": row.power_bias,
                "coulomb": row.coulomb,
            }
            for row in study.rows
        ],
        "gain": study.row("exponential", "carried on").rms / study.row("constant").rms,
        "shuffled": {
            "count": len(chance),
            "median_gain": float(np.median(chance)) if chance else None,
            "least_gain": float(np.min(chance)) if chance else None,
        },
    }


def print_friction_study(studies: Sequence[Summary], page: Page) -> None:
    """Print tests on unseen temperatures.

    Args:
        studies: From `study_summary`.
        page: Where to.
    """
    for study in studies:
        table(
            page,
            f"{study['name']}: fitted at {study['train']} ({study['trained_samples']} samples), "
            f"tested at {study['test']} ({study['tested_samples']} samples)",
            ("viscous friction", "outside its range", "RMS error", "friction power"),
            [
                (row["law"], row["beyond"], f"{row['rms']:.4g}", percent(row["power_bias"], True))
                for row in study["rows"]
            ],
        )
        mixed = study["shuffled"]
        if mixed["median_gain"] is not None:
            line(
                page,
                f"RMS of the exponential law over the constant: {study['gain']:.2f}; with "
                f"temperatures shuffled between runs {mixed['median_gain']:.2f} (median of "
                f"{mixed['count']}), at best {mixed['least_gain']:.2f}",
            )


def cabinet_summary(fit: CabinetFit) -> Summary:
    """Return what `identify cabinet` found, ready for JSON. [W]"""

    def level(found: Level | None) -> Summary | None:
        return None if found is None else dict(found.__dict__)

    return {
        "meter": fit.location.name.lower(),
        "hold": level(fit.hold),
        "generating": level(fit.generating),
        "loss_grid": fit.loss_grid,
        "loss_grid_std": fit.loss_grid_std,
        "loss_dc": fit.loss_dc,
        "loss_dc_std": fit.loss_dc_std,
        "notes": list(fit.notes),
    }


def print_cabinet(summary: Summary, page: Page) -> None:
    """Print what `identify cabinet` found.

    Args:
        summary: From `cabinet_summary`.
        page: Where to.
    """
    rows: list[tuple[str, ...]] = []
    for name, phase in (("HOLD", "hold"), ("GENERATING", "generating")):
        found = summary[phase]
        if found is None:
            rows.append((name, "-", "0", "0", "-"))
            continue
        rows.append(
            (
                name,
                f"{found['power']:.1f} +- {found['std']:.1g}",
                str(found["readings"]),
                str(found["events"]),
                f"{found['spread']:.1f}",
            )
        )
    table(
        page,
        "Measured power while it is constant, less what the drives take [W]",
        ("phase", "power", "readings", "events", "greatest difference"),
        rows,
    )
    table(
        page,
        "Constant losses [W]",
        ("side", "loss"),
        [
            (side, "-" if value is None else _loss_text(value, std))
            for side, value, std in (
                ("grid", summary["loss_grid"], summary["loss_grid_std"]),
                ("DC", summary["loss_dc"], summary["loss_dc_std"]),
            )
        ],
    )
    for sentence in summary["notes"]:
        line(page, f"note: {sentence}")
    line(page, "the error class of the meter is not in these deviations")
