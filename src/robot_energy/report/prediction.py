"""Predictions as plain values, and as tables for terminal and HTML."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from robot_energy import __version__
from robot_energy.blocks import NANOSECOND, Quality
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.motion.load_motion import LoadedMotion
from robot_energy.prediction import Prediction
from robot_energy.report.document import Document
from robot_energy.report.model_summary import count_tags
from robot_energy.report.printing import (
    NOTHING,
    EnergyFormat,
    Page,
    energy_text,
    line,
    number,
    pairs,
    percent,
    table,
)
from robot_energy.report.summary import breakdown, joint_energies, peak_and_mean, phases, plain
from robot_energy.report.tables import (
    QUALITY_NAMES,
    Summary,
    part_names,
    print_joints,
    print_phases,
)

SUMMARY_VERSION = 1
MINUTE = 60.0  # s


def prediction_summary(result: Prediction, motion: LoadedMotion | None = None) -> Summary:
    """Return all figures of a prediction, ready for JSON.

    Args:
        result: A prediction.
        motion: The program behind it.

    Returns:
        Plain values; energies in J, powers in W, times in s, lengths in m.
    """
    model, ledger = result.model, result.ledger
    registers = ledger.registers
    energy = breakdown(registers)
    net = energy["grid_import"] - energy["grid_return"]
    temperature = result.motor_temperature_degc.tolist()
    printed = motion.printed_length if motion is not None else None
    way = printed * result.repeat if printed else None
    summary: Summary = {
        "program": result.program,
        "repeat": result.repeat,
        "model": {
            "model_id": model.model_id,
            "source": model.source,
            "robot": model.robot.type,
            "drive": model.drive,
            "figures": count_tags(model),
        },
        "motor_temperature_degc": dict(zip(model.joint_names, temperature, strict=True)),
        "payload": [
            {"link": body.link, "mass": body.mass, "centre_of_mass": list(body.centre_of_mass)}
            for body in result.payload
        ],
        "time": {
            "duration": result.duration,
            "predicted_time": registers.time.observed_ns * NANOSECOND,
            "gap_ns": registers.time.gap_ns,
        },
        "tool": None
        if motion is None or motion.length is None
        else {
            "length": motion.length * result.repeat,
            "printed_length": way,
            "stops": motion.stops,
            "full_speed_share": motion.full_speed_share,
            "energy_per_printed_metre": net / way if way else math.nan,
        },
        "energy": energy,
        "power": peak_and_mean(ledger),
        "phases": phases(ledger),
        "joints": [
            {**row, "last_motor_temperature_degc": degc}
            for row, degc in zip(
                joint_energies(registers, model.joint_names, net), temperature, strict=True
            )
        ],
        "limits": [
            {"name": name, "speed_use": speed, "torque_use": torque}
            for name, speed, torque in zip(
                model.joint_names,
                result.limits.speed.tolist(),
                result.limits.torque.tolist(),
                strict=True,
            )
        ],
        "friction": {
            "extrapolated_joints": list(result.extrapolated),
            "one_temperature_joints": list(result.one_temperature),
        },
        "quality": {
            "samples": ledger.samples,
            "counts": {
                str(Quality(bit).name).lower(): ledger.quality[bit]
                for bit in sorted(ledger.quality)
            },
        },
        "problems": _problems(result, energy),
        "notes": [*result.notes, *_notes(result)],
    }
    return plain(summary)


def predictions_summary(runs: Sequence[Summary]) -> dict[str, Any]:
    """Return several predictions as one value for JSON."""
    return {
        "summary_version": SUMMARY_VERSION,
        "tool_version": __version__,
        "runs": list(runs),
    }


def _problems(result: Prediction, energy: dict[str, Any]) -> list[str]:
    problems: list[str] = []
    if not energy["balanced"]:
        problems.append(
            "the parts of the energy do not sum to the grid: "
            f"{energy['balance_residual']:g} J are left"
        )
    problems += result.limits.sentences()
    time = result.ledger.registers.time
    if time.gap_ns:
        problems.append(
            f"{time.gap_ns * NANOSECOND:.3f} s of the motion are not predicted and not counted"
        )
    return problems


def _notes(result: Prediction) -> list[str]:
    notes: list[str] = []
    if result.extrapolated:
        notes.append(
            f"EXTRAPOLATED: the friction of {', '.join(result.extrapolated)} was never fitted at "
            "that temperature; the law is held at the edge of its range"
        )
    if result.one_temperature:
        notes.append(
            f"the friction of {', '.join(result.one_temperature)} is the same at every "
            "temperature in this model"
        )
    samples, counts = result.ledger.samples, result.ledger.quality
    share = counts[int(Quality.DRIVE_EXTRAPOLATED)] / samples if samples else 0.0
    if share:
        notes.append(
            f"DRIVE_EXTRAPOLATED: a drive runs outside its efficiency map in {percent(share)} of "
            "the samples; the nearest point was used"
        )
    if DRIVE_MODELS[result.model.drive].lossless:
        notes.append("the model knows no drive losses: they are missing from the energy")
    tags = count_tags(result.model)
    if assumed := tags.get("assumed", 0):
        notes.append(f"{assumed} of {sum(tags.values())} figures of the model are assumed")
    return notes


def label(run: Summary, runs: Sequence[Summary]) -> str:
    """Name a run by what tells it from the others.

    Args:
        run: One of them.
        runs: All.
    """
    parts = [run["model"]["robot"]]
    if len({other["program"] for other in runs}) > 1:
        parts.append(Path(run["program"]).name)
    if len({temperature_text(other) for other in runs}) > 1:
        parts.append(temperature_text(run))
    return ", ".join(parts)


def temperature_text(run: Summary) -> str:
    """Temperatures of the motors in words."""
    values = list(run["motor_temperature_degc"].values())
    texts = [f"{value:g}" for value in values]
    return f"{texts[0] if len(set(texts)) == 1 else ' '.join(texts)} degC"


def print_predictions(
    runs: Sequence[Summary], page: Page, figures: Callable[[Document], None] | None = None
) -> None:
    """Print predictions: side by side, then each.

    Args:
        runs: From `prediction_summary`.
        page: Where to.
        figures: Adds figures to a document, after the comparison.
    """
    if len(runs) > 1:
        if isinstance(page, Document):
            page.heading("Side by side")
        print_side_by_side(runs, page)
    if isinstance(page, Document) and figures is not None:
        figures(page)
    for run in runs:
        if isinstance(page, Document):
            page.heading(label(run, runs))
        print_prediction(run, page)


def print_side_by_side(runs: Sequence[Summary], page: Page) -> None:
    """Print one line per prediction.

    Args:
        runs: From `prediction_summary`.
        page: Where to.
    """
    scale = EnergyFormat(max(run["energy"]["grid_import"] for run in runs))
    table(
        page,
        f"Predicted energy [{scale.unit}]",
        ("", "rigid", "friction", "drive\nloss", "constant\nlosses", "brake,\ncapacitor", "grid"),
        [
            [
                label(run, runs),
                *(scale.joule(run["energy"][part]) for part in ("rigid", "friction", "drive_loss")),
                scale.joule(run["energy"]["loss_dc"] + run["energy"]["loss_grid"]),
                scale.joule(run["energy"]["brake"] + run["energy"]["capacitor"]),
                scale.joule(_net(run)),
            ]
            for run in runs
        ],
    )
    columns = ["", "time [s]", "mean [W]", "peak [W]"]
    if any(run["tool"] for run in runs):
        columns.append("per printed m [J]")
    table(
        page,
        "Time, and power from the grid",
        columns,
        [
            [
                label(run, runs),
                number(run["time"]["duration"], 2),
                _watt(run["power"]["predicted_mean_grid_power"]),
                _watt(run["power"]["predicted_peak_grid_power"]),
                *_per_metre(run, runs),
            ]
            for run in runs
        ],
    )


def _per_metre(run: Summary, runs: Sequence[Summary]) -> list[str]:
    if not any(other["tool"] for other in runs):
        return []
    value = run["tool"]["energy_per_printed_metre"] if run["tool"] else None
    return [NOTHING if value is None else f"{value:.4g}"]


def _net(run: Summary) -> float:
    return run["energy"]["grid_import"] - run["energy"]["grid_return"]


def _watt(value: float | None) -> str:
    return NOTHING if value is None else f"{value:.1f}"


def print_prediction(run: Summary, page: Page) -> None:
    """Print one prediction.

    Args:
        run: From `prediction_summary`.
        page: Where to.
    """
    time, power, energy = run["time"], run["power"], run["energy"]
    mean, peak = power["predicted_mean_grid_power"], power["predicted_peak_grid_power"]
    line(
        page,
        f"predicted {energy_text(_net(run))} from the grid over {_time(time['duration'])}, mean "
        f"{_watt(mean)} W, peak {_watt(peak)} W; not measured",
        style="bold",
    )
    for problem in run["problems"]:
        line(page, f"problem: {problem}", style="bold red")
    for note in run["notes"]:
        line(page, f"note: {note}")
    line(page, "")
    pairs(page, _facts(run))
    scale = EnergyFormat(max(energy["grid_import"], energy["grid_return"]))
    net = _net(run)

    def row(text: str, value: float) -> list[str]:
        share = percent(value / net if net > 0 else None)
        return [text, scale.joule(value), scale.watt_hour(value), share]

    names = part_names(run["model"]["drive"])
    rows = [
        row(text, energy[key])
        for key, text in names.items()
        if energy[key] or key not in ("brake", "capacitor")
    ]
    table(
        page,
        "Where the energy goes, predicted",
        ("", f"energy [{scale.unit}]", "", "share"),
        rows,
        row("from the grid", net),
    )
    print_joints(page, run, scale)
    print_phases(page, run, scale)
    table(
        page,
        "Greatest use of the limits of the URDF",
        ("", "speed", "torque"),
        [
            (joint["name"], *(percent(joint[key]) for key in ("speed_use", "torque_use")))
            for joint in run["limits"]
        ],
    )
    counts: dict[str, int] = run["quality"]["counts"]
    marked = [
        (QUALITY_NAMES.get(name, name), str(count), percent(count / run["quality"]["samples"]))
        for name, count in counts.items()
    ]
    if marked:
        table(page, "Samples with a flag", ("", "samples", "share"), marked)


def _facts(run: Summary) -> list[tuple[str, str]]:
    model = run["model"]
    figures = ", ".join(f"{count} {tag}" for tag, count in model["figures"].items() if count)
    rows = [
        ("program", run["program"] + (f", {run['repeat']} times" if run["repeat"] > 1 else "")),
        ("model", f"{model['robot']}, id {model['model_id']}"),
        ("model file", model["source"]),
        ("its figures", figures or "none tagged"),
        ("motor temperatures", f"{temperature_text(run)}, assumed and held"),
    ]
    for body in run["payload"]:
        rows.append(("payload", f"{body['mass']:g} kg on {body['link']}"))
    tool = run["tool"]
    if tool:
        text = f"{tool['length']:.3f} m"
        if tool["printed_length"] is not None:
            text += f", {tool['printed_length']:.3f} m of the program printed"
        rows.append(("way of the tool", text))
        rows.append(("at the programmed speed", percent(tool["full_speed_share"])))
    return rows


def _time(seconds: float) -> str:
    if seconds < 10 * MINUTE:
        return f"{seconds:.2f} s"
    return f"{seconds / MINUTE:.1f} min"
