"""What a cheaper program says: the choice, each measure, each move; robots on one DC bus."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from robot_energy_plan.results.optimization import MeasureResult, OptimizationReport
from robot_energy_plan.results.shared_bus import CommonSupply, SharedBusReport
from robot_energy_report.canvas import SERIES, Axes, Target, canvas, saving_bars
from robot_energy_report.document import Column, Document
from robot_energy_report.formats import (
    EnergyFormat,
    energy_text,
    fixed,
    percent,
    tags_text,
    watt_hours,
)


def bus_verdict(report: SharedBusReport) -> str:
    """Return what the bus saves, in a sentence."""
    saved, half = report.saved, report.half
    what = f"{len(report.robots)} robots on one DC bus"
    if report.saved_best is not None and report.half_best is not None:
        saved, half = report.saved_best, report.half_best
        what = f"with the best starts, {what}"
    if not saved > half > 0:
        return f"{what}: no saving is claimed; what was found is smaller than its uncertainty"
    share = saved / report.energy_apart
    return (
        f"{what} need {percent(share)} less energy, {energy_text(saved)} +- {energy_text(half)} "
        "(90 % band); predicted, not measured"
    )


def shared_bus_document(report: SharedBusReport, page: Document) -> None:
    """Add all that was found."""
    page.paragraph(bus_verdict(report), "strong")
    for problem in report.problems:
        page.paragraph(problem, "problem")
    page.notes(report.notes)
    page.paragraph()
    scale = EnergyFormat(report.energy_apart)
    what = "of recordings of all robots" if report.recorded else "of a common cycle"
    facts = [
        ("time", f"{report.duration:.2f} s {what}"),
        (
            "from the grid",
            f"{energy_text(report.energy_apart)} apart, {energy_text(report.energy)} on one bus",
        ),
        (
            "into brake resistors",
            f"{energy_text(report.brake_energy_apart)} apart, {energy_text(report.brake_energy)} "
            "on one bus",
        ),
        (
            "peak of the supply",
            f"{report.peak_power_apart:.0f} W apart, {report.peak_power:.0f} W on one bus",
        ),
        ("saved by the bus", f"{energy_text(report.saved)} +- {energy_text(report.half)}"),
    ]
    if report.capacitor_energy:
        facts.append(("capacitors take", f"{energy_text(report.capacitor_energy)} at most"))
    if report.saved_best is not None and report.saved_any_start is not None:
        facts[1:] = [(f"{name}, all starts at once", text) for name, text in facts[1:]]
        facts += [
            ("saved, starts that fall anywhere", f"{energy_text(report.saved_any_start)}, mean"),
            (
                "saved, best starts",
                f"{energy_text(report.saved_best)}; peak {report.peak_power_best:.0f} W",
            ),
        ]
    page.pairs(facts)
    columns = [
        Column("robot", lambda one: Path(one.name).name),
        Column("model", lambda one: f"{one.model.robot}, id {one.model.model_id}"),
        Column("its figures", lambda one: tags_text(one.model.figures)),
        Column("from the\ngrid", "energy", scale.joule, scale.unit),
        Column("into its\nresistor", "brake_energy", scale.joule, scale.unit),
        Column("peak", "peak_power", fixed(0), "W"),
    ]
    if not report.recorded:
        columns.append(Column("best\nstart", "start", fixed(2), "s"))
    page.rows("Each robot with a supply of its own", columns, report.robots)


def optimization_document(report: OptimizationReport, page: Document) -> None:
    """Add all that was found."""
    page.paragraph(_verdict(report), "strong")
    for problem in report.problems:
        page.paragraph(problem, "problem")
    page.notes(report.notes)
    page.paragraph()
    page.pairs(_facts(report))
    if report.saving.claimed:
        page.paragraph(_year(report))
    scale = EnergyFormat(max(report.before.energy, report.after.energy))
    page.figure(
        lambda path: measures_and_front(report, path),
        "What each measure saves with its 90 % band, and trade-offs of energy and time; colour is "
        "the peak power.",
    )
    _measures(page, report, scale)
    page.rows(
        "Move by move",
        [
            Column("move", "move"),
            Column("speed,\nnow", "speed_before", percent),
            Column("chosen", "speed", percent),
            Column("acceleration,\nnow", "acceleration_before", percent),
            Column("chosen", "acceleration", percent),
            Column("time,\nnow", "duration_before", fixed(2), "s"),
            Column("chosen", "duration", fixed(2), "s"),
            Column("energy,\nnow", "energy_before", scale.joule, scale.unit),
            Column("chosen", "energy", scale.joule, scale.unit),
        ],
        report.moves,
    )
    page.rows(
        "Rests as chosen",
        [
            Column("before the move", "before"),
            Column("time", "duration", fixed(2), "s"),
            Column("state", "state"),
            Column("power, drives hold", "power", fixed(0), "W"),
        ],
        report.rests,
    )
    page.rows(
        f"At each temperature, energy per cycle [{scale.unit}]",
        [
            Column("motors", "motor_temperature_degc", fixed(0), "degC"),
            Column("now", "energy_before", scale.joule),
            Column("as chosen", "energy", scale.joule),
            Column("chosen for\nit alone", "best_energy", scale.joule),
            Column("cycle of\nthat choice", "best_duration", fixed(2), "s"),
        ],
        report.temperatures if len(report.temperatures) > 1 else (),
    )
    page.rows(
        "From which rest on a state pays",
        [
            Column("state", "state"),
            Column("shortest rest", "shortest_rest", fixed(1), "s"),
            Column("time to wake up", "wake_time", fixed(1), "s"),
            Column("source", "source"),
        ],
        report.break_even,
    )
    if report.supply is not None:
        _supply(page, report, report.supply)
    page.heading("How to try it", 3)
    for number, step in enumerate(report.how_to_try, 1):
        page.paragraph(f"{number}. {step}")


def _verdict(report: OptimizationReport) -> str:
    saved, name = report.saving, Path(report.program).name
    if not saved.claimed:
        return f"{name}: no saving is claimed; what was found is smaller than its uncertainty"
    faster = report.before.duration - report.after.duration
    time = f", {abs(faster):.2f} s {'faster' if faster > 0 else 'slower'}" if faster else ""
    return (
        f"{name}: {percent(saved.relative)} less energy per cycle, {energy_text(saved.energy)} "
        f"+- {energy_text(saved.half)} (90 % band){time}; predicted, not measured"
    )


def _year(report: OptimizationReport) -> str:
    cycles, saved = report.cycles_per_year, report.saving
    if cycles is None:
        return "What this is in a year depends on how often it runs: give --cycles-per-year."
    return (
        f"In a year of {cycles:.0f} cycles, as given: {watt_hours(cycles * saved.energy)} +- "
        f"{watt_hours(cycles * saved.half)} less, if all cycles are like this one"
    )


def _facts(report: OptimizationReport) -> list[tuple[str, str]]:
    degc = [f"{one.motor_temperature_degc:g}" for one in report.temperatures]
    before, after = report.before, report.after
    rows = [
        ("program", report.program),
        ("model", f"{report.model.robot}, id {report.model.model_id}"),
        ("its figures", tags_text(report.model.figures)),
        ("motor temperatures", f"{', '.join(degc)} degC, held"),
        ("energy per cycle", f"{energy_text(before.energy)}, then {energy_text(after.energy)}"),
        ("time of a cycle", f"{before.duration:.2f} s, then {after.duration:.2f} s"),
        ("peak power", f"{before.peak_power:.0f} W, then {after.peak_power:.0f} W"),
    ]
    if report.cycle_time is not None:
        rows.append(("given cycle time", f"{report.cycle_time:g} s"))
    if report.peak_limit is not None:
        rows.append(("given peak limit", f"{report.peak_limit:g} W"))
    return rows


def _measures(page: Document, report: OptimizationReport, scale: EnergyFormat) -> None:
    def band(one: MeasureResult) -> str | None:
        return None if one.saving is None else f"+- {scale.joule(one.saving.half)}"

    page.rows(
        f"Each measure alone, saving per cycle [{scale.unit}]",
        [
            Column("measure", "label"),
            Column("saving", lambda one: one.saving and one.saving.energy, scale.joule),
            Column("90 %\nband", band),
            Column("time of\ncycle", lambda one: one.cycle.duration, fixed(2), "s"),
            Column("peak", lambda one: one.cycle.peak_power, fixed(0), "W"),
            Column("claim", "verdict"),
        ],
        [one for one in report.measures if one.cycle is not None],
    )
    page.paragraph(
        "They overlap: together they save what the first line of this report says, not their sum"
    )
    if others := [one.label for one in report.measures if one.cycle is None]:
        page.paragraph(f"These do not apply, or were not asked for: {'; '.join(others)}")


def _supply(page: Document, report: OptimizationReport, supply: CommonSupply) -> None:
    page.rows(
        "Robots on one supply: starts with the least "
        + ("peak" if report.shared_bus is None else "energy"),
        [Column("program", "program"), Column("start", "start", fixed(2), "s")],
        report.starts,
    )
    watt = fixed(0)
    page.paragraph(
        f"peak of the supply {watt(supply.peak_power_together)} W with all starts at once, "
        f"{watt(supply.peak_power)} W with these, mean {watt(supply.mean_power)} W; means over "
        "20 ms"
    )
    if report.shared_bus is not None:
        page.paragraph(bus_verdict(report.shared_bus), "strong")


KILO = 1e-3
BAR = 0.36  # inch per measure


def measures_and_front(report: OptimizationReport, path: Target) -> None:
    """Draw savings with their bands above energy over time."""
    bars = 0.9 + BAR * (1 + len(report.measures))
    with canvas(path, (8.0, bars + 3.2), "saving per cycle, and trade-offs") as figure:
        axes: Any = figure.subplots(2, 1, height_ratios=[bars, 3.2])
        _savings(axes[0], report)
        _draw_front(figure, axes[1], report)


def _savings(axes: Axes, report: OptimizationReport) -> None:
    named = [("all that change the program", report.saving)]
    named += [(one.label, one.saving) for one in report.measures if one.saving is not None]
    names, savings = zip(*named, strict=True)
    saving_bars(
        axes,
        names,
        [one.energy * KILO for one in savings],
        [one.half * KILO for one in savings],
        [one.claimed for one in savings],
        "saving per cycle [kJ], with its 90 % band; grey: not claimed",
    )


def _draw_front(figure: Any, axes: Axes, report: OptimizationReport) -> None:
    points = np.array([(p.duration, p.energy * KILO, p.peak_power) for p in report.front])
    shown = axes.scatter(points[:, 0], points[:, 1], c=points[:, 2], s=18, cmap="viridis")
    figure.colorbar(shown, ax=axes, label="peak power [W]")
    if report.cycle_time is None:
        for cycle, name, mark in ((report.before, "as it is", "s"), (report.after, "chosen", "D")):
            axes.plot(
                cycle.duration, cycle.energy * KILO, mark, color=SERIES[3], label=name,
                markerfacecolor="none" if mark == "s" else SERIES[3],
            )  # fmt: skip
        axes.legend(loc="best")
    axes.set_xlabel("time of a cycle without waits [s]")
    axes.set_ylabel("energy from the grid [kJ]")
