"""What `identify drives` found, as tables for the terminal and as JSON."""

from __future__ import annotations

import math
from typing import Any

from robot_energy.identify.drives.all_drives import DrivesFound
from robot_energy.identify.drives.drives import WAYS, AxisFit, DrivesFit
from robot_energy.identify.drives.losses import TERMS
from robot_energy.identify.drives.total_power import TotalFit
from robot_energy.identify.drives.total_sums import COEFFICIENTS, Sums
from robot_energy.identify.stats.cross_validation import EnergyScore
from robot_energy.identify.stats.lag import Delay
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.report.printing import Page, line, percent, table

Summary = dict[str, Any]

WAY_NAMES = {
    "none": "no efficiency",
    "constant": "constant 87.5 %",
    "map": "efficiency map, as run",
    "map_processed": "map, power processed",
    "losses": "loss model",
}
SPLIT_NAMES = {
    "blocks": "5 blocks",
    "recordings": "recordings",
    "beyond": "beyond 60 %",
}
TOTAL_NAMES = {
    "constant": "a constant",
    "shaft": "shaft power and a constant",
    "given": "the model as given",
    "shared": "losses, shared by all axes",
    "axis_copper": "losses, copper of each axis",
    "axis": "losses of each axis",
    "identified": "identified",
    "drives_measured": "measured drives and a constant",
}
STRUCTURE_NAMES = {**TOTAL_NAMES, "shaft": "shaft power alone"}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def drives_summary(fit: DrivesFit, delay: Delay | None = None) -> Summary:
    """Return what was identified from the power of each drive, ready for JSON.

    Args:
        fit: What was identified.
        delay: Of the power behind the joint states; None where it cannot be told.
    """
    return {
        "axes": [_axis(axis) for axis in fit.axes],
        "comparisons": [
            {
                "held_out": comparison.split,
                "samples": comparison.samples,
                "energy": comparison.energy,
                "ways": {
                    way: {
                        "energy_accuracy": score.accuracy,
                        "rms": score.rms,
                        "axis_rms": [_finite(value) for value in score.axis_rms],
                    }
                    for way, score in comparison.scores.items()
                },
            }
            for comparison in fit.comparisons
        ],
        "chosen": fit.chosen,
        "cutoff_hz": fit.cutoff,
        "delay": None if delay is None else dict(delay.__dict__),
        "notes": [
            *([] if delay is None or not delay.at_edge else [_beyond(delay)]),
            *(note for axis in fit.axes for note in axis.notes),
        ],
    }


def _beyond(delay: Delay) -> str:
    return (
        f"power and joint states may be shifted by more than {1e3 * delay.span:.0f} ms: check that "
        "both have one clock"
    )


def _axis(axis: AxisFit) -> Summary:
    losses, reduced = axis.losses, axis.map
    return {
        "name": axis.name,
        "losses": None
        if losses is None
        else {
            "values": losses.values,
            "std": {name: _finite(value) for name, value in losses.std.items()},
            "untold": list(losses.untold),
            "negative": list(losses.negative),
            "samples": losses.samples,
            "in_sample_rms": losses.rms,
        },
        "map": None
        if reduced is None
        else {
            "points": len(reduced.entry.efficiency),
            "samples": reduced.samples,
            "removed": reduced.removed,
            "motor_efficiency": _finite(reduced.motor_efficiency),
            "generator_efficiency": _finite(reduced.generator_efficiency),
            "reach": reduced.entry.reach,
        },
    }


def total_summary(
    data: Sums, fit: TotalFit, held_out: str, scores: dict[str, EnergyScore]
) -> Summary:
    """Return what was identified from one meter for all drives, ready for JSON.

    Args:
        data: Pieces between readings.
        fit: What was identified.
        held_out: ``recordings`` or ``blocks``.
        scores: By way.
    """
    negative, untold = fit.losses.negative, fit.losses.untold
    notes: list[str] = []
    if untold:
        notes.append(f"not told apart from the terms before, taken as 0: {', '.join(untold)}")
    if negative:
        notes.append(f"at the bound 0, negative otherwise: {', '.join(negative)}")
    if fit.structure in ("shared", "axis_copper"):
        notes.append("what axes share cannot be told apart per axis from one meter here")
    return {
        "location": data.location.name.lower(),
        "readings": len(data),
        "duration": float(data.duration.sum()),
        "recordings": len(set(data.recording.tolist())),
        "structure": fit.structure,
        "constant": fit.constant,
        "constant_std": _finite(fit.constant_std),
        "axes": [
            {
                "name": name,
                **{
                    term: {
                        "value": float(fit.coefficients[row, k]),
                        "std": _finite(float(fit.deviations[row, k])),
                        "at_bound": bool(
                            {f"{term} of {name}", f"{term} of all axes"} & set(negative)
                        ),
                    }
                    for row, term in enumerate(COEFFICIENTS)
                },
            }
            for k, name in enumerate(data.names)
        ],
        "block_rms": dict(fit.errors),
        "held_out": held_out,
        "ways": {way: dict(score.__dict__) for way, score in scores.items()},
        "notes": notes,
    }


def drives_found_summary(found: DrivesFound, torque: str = "") -> Summary:
    """Return all that was found of the drives, ready for JSON.

    Args:
        found: From the power of each drive, from one meter, or both.
        torque: Where the torque comes from.
    """
    summary: Summary = {"torque": torque} if torque else {}
    if found.drives is not None:
        summary["drives"] = drives_summary(found.drives, found.delay)
    if found.total is not None:
        total = found.total
        summary["total"] = {
            **total_summary(total.data, total.fit, total.held_out, total.scores),
            "meter_delay": None if total.delay is None else dict(total.delay.__dict__),
        }
    return summary


def print_drives(summary: Summary, page: Page) -> None:
    """Print what `identify drives` found.

    Args:
        summary: ``drives`` and ``total``, where there are such.
        page: Where to.
    """
    if "drives" in summary:
        _print_drives(summary["drives"], page)
    if "total" in summary:
        _print_total(summary["total"], page)


def _print_drives(summary: Summary, page: Page) -> None:
    found: list[tuple[str, ...]] = []
    maps: list[tuple[str, ...]] = []
    for axis in summary["axes"]:
        losses, reduced = axis["losses"], axis["map"]
        if losses is not None:
            cells = [
                _figure(losses["values"][term], losses["std"][term], term in losses["negative"])
                for term in TERMS
            ]
            found.append((axis["name"], *cells))
        if reduced is not None:
            maps.append(
                (
                    axis["name"],
                    str(reduced["samples"]),
                    percent(reduced["removed"]),
                    str(reduced["points"]),
                    _number(reduced["motor_efficiency"]),
                    _number(reduced["generator_efficiency"]),
                )
            )
    table(
        page,
        "Losses of the drives beside shaft power",
        ("axis", "constant [W]", "copper [W/(N m)^2]", "linear [W s/rad]", "quadratic [W s2/rad2]"),
        found,
    )
    table(
        page,
        f"Reduced efficiency maps, P_mech / P_el, low-pass {summary['cutoff_hz']:g} Hz",
        ("axis", "samples", "outliers", "points", "median, motor", "median, generator"),
        maps,
    )
    comparisons = summary["comparisons"]
    heads = [SPLIT_NAMES[comparison["held_out"]] for comparison in comparisons]
    for title, key in (
        (
            "Energy accuracy on held-out data, 1 - |E - E_measured| / E_measured",
            "energy_accuracy",
        ),
        ("RMS error of the power of a drive on held-out data [W]", "rms"),
    ):
        rows: list[tuple[str, ...]] = []
        for way in dict.fromkeys((*WAYS, *(way for c in comparisons for way in c["ways"]))):
            values = [c["ways"].get(way, {}).get(key, math.nan) for c in comparisons]
            shown = [percent(v) if key == "energy_accuracy" else f"{v:.4g}" for v in values]
            rows.append((WAY_NAMES.get(way) or DRIVE_MODELS[way].label, *shown))
        table(page, title, ("prediction", *heads), rows)
    line(
        page,
        "held out: contiguous blocks, whole recordings, samples beyond 60 % of the greatest "
        "speed or torque",
    )
    missing = [SPLIT_NAMES[name] for name in SPLIT_NAMES if SPLIT_NAMES[name] not in heads]
    if missing:
        line(page, f"too few recordings or samples to hold out: {', '.join(missing)}")
    delay = summary["delay"]
    if delay is not None:
        line(page, delay_text("the power", delay))
    chosen = DRIVE_MODELS[summary["chosen"]].label
    line(page, f"the {chosen} is taken, by its held-out RMS error")
    for note in summary["notes"]:
        line(page, f"note: {note}")


def delay_text(what: str, delay: Summary) -> str:
    """Return a delay behind the joint states in one line.

    Args:
        what: Of what.
        delay: Fields of a `Delay`.
    """
    return (
        f"delay of {what} behind the joint states: {1e3 * delay['value']:+.1f} +- "
        f"{1e3 * delay['std']:.1g} ms would lower the held-out error by "
        f"{percent(delay['gain'])}: {'undone' if delay['applied'] else 'not applied'}"
    )


def _figure(value: float, std: float | None, at_bound: bool = False) -> str:
    if at_bound:
        return "0, at bound"
    if std is None:
        return "not told"
    return f"{value:.3g} +- {std:.1g}" if std > 0 else f"{value:.3g}"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def _print_total(summary: Summary, page: Page) -> None:
    place = {"grid": "the grid", "dc_bus": "the DC bus"}.get(summary["location"], "one place")
    what = "whole recordings" if summary["held_out"] == "recordings" else "contiguous blocks"
    table(
        page,
        f"Measured power at {place}, {summary['readings']} readings in "
        f"{summary['recordings']} recordings, {summary['duration']:.1f} s; {what} held out",
        ("prediction", "RMS [W]", "energy", "worst"),
        [
            (
                TOTAL_NAMES[way],
                f"{score['rms']:.2f}",
                percent(score["energy_error"]),
                percent(score["worst"], True),
            )
            for way, score in summary["ways"].items()
        ],
    )
    table(
        page,
        f"Losses from all recordings: {STRUCTURE_NAMES[summary['structure']]}; constant "
        f"{_figure(summary['constant'], summary['constant_std'], not summary['constant'])} W",
        ("axis", "copper [W/(N m)^2]", "linear [W s/rad]", "quadratic [W s2/rad2]"),
        [
            (
                axis["name"],
                *(
                    _figure(*(axis[term][key] for key in ("value", "std", "at_bound")))
                    for term in COEFFICIENTS
                ),
            )
            for axis in summary["axes"]
        ],
    )
    delay = summary.get("meter_delay")
    if delay is not None:
        line(page, delay_text("the meter", delay))
    for note in summary["notes"]:
        line(page, f"note: {note}")
