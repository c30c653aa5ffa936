"""What predictions say: side by side, then each; energies and powers drawn."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from robot_energy.results.energy import EnergyBreakdown
from robot_energy_plan.prediction import START_NS, Prediction
from robot_energy_plan.results.prediction import PredictionReport, PredictionsReport
from robot_energy_report.canvas import SERIES, Axes, Target, canvas
from robot_energy_report.document import Column, Document
from robot_energy_report.energy import (
    EnergySections,
    add_flow,
    auxiliary_section,
    flow_labels,
    scale_of,
    sum_of_known,
)
from robot_energy_report.energy_bars import BAR, add_bars, energy_bars
from robot_energy_report.formats import (
    energy_text,
    fixed,
    percent,
    plus_minus,
    significant,
    tags_text,
)
from robot_energy_report.replay_figures import MAX_TIME_IN_SECONDS, MINUTE

LETTERS = 78  # of a legend side by side
DASHES = ("-", "--", ":", "-.")  # when the colours begin again
THIN = 0.9  # line width where curves lie over each other


def power_curves(results: Sequence[Prediction], labels: Sequence[str], path: Target) -> None:
    """Draw the predicted power of each run over time."""
    high = 3.2 + 0.12 * len(results)
    with canvas(path, (8.0, high)) as figure:
        _curves(figure.subplots(), results, labels)


def energy_and_power(
    results: Sequence[Prediction],
    energies: Sequence[EnergyBreakdown],
    labels: Sequence[str],
    path: Target,
) -> None:
    """Draw energies above powers."""
    bars = 0.9 + BAR * len(energies)
    with canvas(path, (8.0, bars + 3.2), "predicted energy and power from the grid") as figure:
        axes: Any = figure.subplots(2, 1, height_ratios=[bars, 3.2])
        add_bars(axes[0], energies, labels)
        _curves(axes[1], results, labels)


def _curves(axes: Axes, results: Sequence[Prediction], labels: Sequence[str]) -> None:
    longest = max(result.duration for result in results)
    unit, second = ("min", MINUTE) if longest > MAX_TIME_IN_SECONDS else ("s", 1.0)
    for index, (result, name) in enumerate(zip(results, labels, strict=True)):
        means = result.means
        if means is None:
            continue
        power = means.predicted_power
        time = (means.stamp_ns - START_NS) * 1e-9
        axes.plot(
            (time - 0.5 * means.period) / second, power, DASHES[index // len(SERIES) % len(DASHES)],
            color=SERIES[index % len(SERIES)], label=name, linewidth=THIN,
        )  # fmt: skip
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    axes.set_xlim(0.0, longest / second)
    axes.set_xlabel(f"time since the start of the motion [{unit}]")
    axes.set_ylabel("power from the grid [W]")
    if len(results) > 1:
        columns = max(1, min(3, LETTERS // max(map(len, labels))))
        axes.legend(loc="lower center", bbox_to_anchor=(0.45, 1.0), ncols=columns)


def labels(runs: Sequence[PredictionReport]) -> list[str]:
    """Return a name for each run: what distinguishes it from the others."""
    programs = {run.program for run in runs}
    temperatures = {_temperatures(run) for run in runs}
    return [
        ", ".join(
            [
                run.model.robot,
                *([Path(run.program).name] if len(programs) > 1 else []),
                *([_temperatures(run)] if len(temperatures) > 1 else []),
            ]
        )
        for run in runs
    ]


def _temperatures(run: PredictionReport) -> str:
    texts = [f"{value:g}" for value in run.motor_temperature_degc.values()]
    return f"{texts[0] if len(set(texts)) == 1 else ' '.join(texts)} degC"


def prediction_document(
    report: PredictionsReport, page: Document, results: Sequence[Prediction] = ()
) -> None:
    """Add all that predictions say, with the power over time where their results are given."""
    runs, names = report.runs, labels(report.runs)
    if len(runs) > 1:
        with page.only("page"):
            page.heading("Side by side")
        _side_by_side(page, runs, names)
    if len(runs) == 1:
        loads = flow_labels(runs[0].auxiliary)
        add_flow(page, runs, "Where the energy from the grid goes, as predicted.", loads)
    else:
        page.figure(
            lambda path: energy_bars([run.energy for run in runs], names, path),
            "Predicted energy from the grid and where it goes.",
        )
    if results:
        page.figure(
            lambda path: power_curves(results, names, path),
            "Predicted power from the grid, means over short periods.",
        )
    for run, name in zip(runs, names, strict=True):
        with page.only("page"):
            page.heading(name)
        _run(page, run)


def _side_by_side(page: Document, runs: Sequence[PredictionReport], names: Sequence[str]) -> None:
    scale = scale_of([run.energy for run in runs])
    name_of = dict(zip(map(id, runs), names, strict=True))
    name = Column("", lambda run: name_of[id(run)])

    def energy(heading: str, *parts: str) -> Column:
        return Column(
            heading,
            lambda run: sum_of_known(getattr(run.energy, part) for part in parts),
            scale.joule,
        )

    page.rows(
        f"Predicted energy [{scale.unit}]",
        [
            name,
            energy("rigid", "rigid"),
            energy("friction", "friction"),
            energy("drive\nloss", "drive_loss"),
            energy("constant\nlosses", "loss_dc", "loss_grid"),
            energy("brake,\ncapacitor", "brake", "capacitor"),
            energy("grid", "net"),
            Column("90 %\nband", lambda run: run.uncertainty.half_relative, plus_minus),
        ],
        runs,
    )
    columns = [
        name,
        Column("time", lambda run: run.time.duration, fixed(2), "s"),
        Column("mean", lambda run: run.power.predicted_mean_grid_power, fixed(1), "W"),
        Column("peak", lambda run: run.power.predicted_peak_grid_power, fixed(1), "W"),
        Column(
            "per printed m",
            lambda run: run.tool and run.tool.energy_per_printed_metre,
            significant(4),
            "J",
            optional=True,
        ),
    ]
    page.rows("Time, and power from the grid", columns, runs)


def _run(page: Document, run: PredictionReport) -> None:
    watt = fixed(1)
    page.paragraph(
        f"predicted {energy_text(run.energy.net)} from the grid over {_time(run.time.duration)}, "
        f"mean {watt(run.power.predicted_mean_grid_power)} W, peak "
        f"{watt(run.power.predicted_peak_grid_power)} W; not measured",
        "strong",
    )
    for problem in run.problems:
        page.paragraph(problem, "problem")
    page.notes(run.notes)
    page.paragraph()
    page.pairs(_facts(run))
    sections = EnergySections(page, run)
    sections.energy("Where the energy goes, predicted")
    auxiliary_section(page, run.auxiliary)
    sections.normalised()
    sections.certainty()
    sections.joints()
    sections.phases()
    page.rows(
        "Greatest use of the limits of the URDF",
        [
            Column("", "name"),
            Column("speed", "speed_use", percent),
            Column("torque", "torque_use", percent),
        ],
        run.limits,
    )
    sections.quality()


def _facts(run: PredictionReport) -> list[tuple[str, str]]:
    rows = [
        ("program", run.program + (f", {run.repeat} times" if run.repeat > 1 else "")),
        ("model", f"{run.model.robot}, id {run.model.model_id}"),
        ("model file", run.model.source),
        ("its figures", tags_text(run.model.figures)),
        ("motor temperatures", f"{_temperatures(run)}, assumed and held"),
    ]
    rows += [("payload", f"{body.mass:g} kg on {body.link}") for body in run.payload]
    tool = run.tool
    if tool is not None:
        text = f"{tool.length:.3f} m"
        if tool.printed_length is not None:
            text += f", {tool.printed_length:.3f} m of the program printed"
        rows.append(("way of the tool", text))
        rows.append(("at the programmed speed", percent(tool.full_speed_share)))
    return rows


def _time(seconds: float) -> str:
    if seconds < 10 * MINUTE:
        return f"{seconds:.2f} s"
    return f"{seconds / MINUTE:.1f} min"
