"""What recordings say would save energy: a ranked list, and how to try each."""

from __future__ import annotations

from typing import Any

import numpy as np

from robot_energy.foundation.units import JOULE_PER_KWH
from robot_energy_fleet.results.advice import Advice, AdviceReport
from robot_energy_report.canvas import SERIES, Target, canvas, named_ticks
from robot_energy_report.document import Column, Document
from robot_energy_report.formats import energy_text, fixed, percent, significant


def advice_document(report: AdviceReport, page: Document) -> None:
    """Add all that was found.

    Args:
        page: Where to.
    """
    page.paragraph(_verdict(report), "strong")
    for problem in report.problems:
        page.paragraph(problem, "problem")
    page.notes(report.notes)
    page.paragraph()
    basis = report.basis
    page.pairs(
        [
            ("recordings", f"{basis.recordings}: {', '.join(report.source)}"),
            ("model", f"{report.model.robot}, id {report.model.model_id}"),
            ("energy from the grid", f"{energy_text(basis.recorded_energy)} in the recordings"),
            ("at work", percent(basis.duty)),
            ("basis", basis.sentence),
        ]
    )
    both = (*report.advice, *report.unproven)
    if both:
        page.figure(
            lambda path: _savings(both, path),
            "Savings in a year with their 90 % bands; grey: not proven by these recordings.",
        )
    _table(page, "What would save how much", report.advice, report)
    _table(page, "Not proven by these recordings", report.unproven, report)
    if len(report.advice) > len(report.counted):
        page.paragraph(
            "Some of these save the same energy; the sum has only: " + ", ".join(report.counted)
        )
    for number, one in enumerate(both, 1):
        page.heading(f"{number}. {one.label}", 3)
        page.paragraph(f"Found: {one.found}.")
        page.paragraph(f"To try: {one.change}.")
        if one.command:
            page.paragraph(f"Next: {one.command}")
    for sentence in report.without:
        page.note(sentence)


def _verdict(report: AdviceReport) -> str:
    if not report.advice:
        return "No saving is claimed: what was found is smaller than its own uncertainty"
    saved = significant(3)(report.energy_per_year / JOULE_PER_KWH)
    return (
        f"{saved} kWh a year can be saved, without what overlaps; predicted from recordings, "
        "nothing was tried"
    )


def _table(page: Document, title: str, rows: tuple[Advice, ...], report: AdviceReport) -> None:
    if not rows:
        return
    columns = [
        Column("change", "label"),
        Column("of the\nenergy", "relative", percent),
        Column("an hour", lambda one: one.energy_per_hour / JOULE_PER_KWH, significant(3), "kWh"),
        Column("a day", lambda one: one.energy_per_day / JOULE_PER_KWH, significant(3), "kWh"),
        Column("a year", lambda one: one.energy_per_year / JOULE_PER_KWH, significant(3), "kWh"),
        Column(
            "90 %\nband", lambda one: one.half_per_year / JOULE_PER_KWH, significant(2), "+- kWh"
        ),
        Column("rests on", "sure"),
    ]
    if report.basis.price_per_kwh is not None:
        columns.insert(6, Column("cost", "cost_per_year", fixed(0), report.basis.currency))
    if report.basis.co2_kg_per_kwh is not None:
        columns.insert(-1, Column("CO2", "co2_per_year", fixed(0), "kg"))
    if any(one.overlaps for one in rows):
        columns.append(Column("overlaps", lambda one: ", ".join(one.overlaps) or None))
    page.rows(title, columns, rows)


def _savings(rows: tuple[Advice, ...], path: Target) -> None:
    with canvas(path, (8.0, 1.2 + 0.45 * len(rows)), "savings in a year") as figure:
        axes: Any = figure.subplots()
        place = np.arange(len(rows))[::-1]
        energy = np.array([one.energy_per_year for one in rows]) / JOULE_PER_KWH
        half = np.array([one.half_per_year for one in rows]) / JOULE_PER_KWH
        colours = [SERIES[2] if one.claimed else SERIES[6] for one in rows]
        axes.barh(place, energy, 0.6, color=colours)
        axes.errorbar(energy, place, xerr=half, fmt="none", ecolor="#16202b", capsize=3)
        named_ticks(axes.yaxis, place, [one.name.replace("_", " ") for one in rows])
        axes.axvline(0.0, color="#51606f", linewidth=0.8)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("saving in a year [kWh]")
