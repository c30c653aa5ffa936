"""What recordings say would save energy: a ranked list, and how to try each."""

from __future__ import annotations

import math

from robot_energy.foundation.units import JOULE_PER_KWH, JOULE_PER_WH
from robot_energy_fleet.results.advice import Advice, AdviceBasis, AdviceReport
from robot_energy_report.canvas import Target, canvas, saving_bars
from robot_energy_report.document import Column, Document
from robot_energy_report.formats import fixed, percent, significant, watt_hours
from robot_energy_report.headline import duration

TITLES = (
    "Seen in the recordings: what would save how much",
    "Seen in the recordings, but not proven by them",
)
KINDS = {
    "measured": "measured: from the meter alone",
    "predicted": "predicted: by the model from the recordings",
    "assumed": "assumed: with a figure that nobody has measured on this robot",
}


def advice_document(report: AdviceReport, page: Document) -> None:
    """Add what was seen, what follows in a year, and how to try each."""
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
            ("energy from the grid", f"{watt_hours(basis.recorded_energy)} in the recordings"),
            ("at work", percent(basis.duty)),
            ("basis", basis.sentence),
        ]
    )
    both = (*report.advice, *report.unproven)
    if both:
        page.figure(
            lambda path: _savings(both, report.basis, path),
            "Savings with their 90 % bands; grey: not proven by these recordings.",
        )
    for title, rows in zip(TITLES, (report.advice, report.unproven), strict=True):
        _seen(page, title, rows)
    labels = {one.name: one.label for one in both}
    if len(report.advice) > len(report.counted):
        page.paragraph(
            "Some of these save the same energy; the sum has only: "
            + ", ".join(labels[name] for name in report.counted)
        )
    _year(page, report)
    for number, one in enumerate(both, 1):
        page.heading(f"{number}. {one.label}", 3)
        page.paragraph(f"Found: {one.found}.")
        page.paragraph(f"To try: {one.change}.")
        if one.command:
            page.paragraph(f"Next: `{one.command}`")
        if shared := [labels[other] for other in one.overlaps if other in labels]:
            page.paragraph(
                f"Overlaps with: {', '.join(shared)}. They save a part of the same energy, so do "
                "not add them."
            )
        page.paragraph(f"Rests on: {KINDS.get(one.sure, one.sure)}.")
    if report.without:
        page.heading("Not found", 3)
    for sentence in report.without:
        page.note(sentence)


def _verdict(report: AdviceReport) -> str:
    seen = f"Seen: {watt_hours(report.basis.recorded_energy)} from the grid"
    seen += f" in {duration(report.basis.recorded_time)}."
    if not report.advice:
        return f"{seen} No saving is claimed: what was found is smaller than its own uncertainty"
    share = report.energy_per_hour * report.basis.recorded_time / 3600.0
    half = report.half_per_hour * report.basis.recorded_time / 3600.0
    whole = report.basis.recorded_energy
    return (
        f"{seen} {percent(share / whole)} +- {percent(half / whole)} of it can be saved, without "
        "what overlaps; predicted from recordings, nothing was tried"
    )


def _seen(page: Document, title: str, rows: tuple[Advice, ...]) -> None:
    if rows:
        columns = [
            Column("change", "label"),
            Column("of the\nenergy", "relative", percent),
            Column(
                "in an hour", lambda one: one.energy_per_hour / JOULE_PER_WH, significant(3), "Wh"
            ),
            Column(
                "90 %\nband", lambda one: one.half_per_hour / JOULE_PER_WH, significant(2), "+- Wh"
            ),
            Column("rests on", "sure"),
        ]
        page.rows(title, columns, rows)


def _year(page: Document, report: AdviceReport) -> None:
    """Add what follows for a year, if it is known how much such work there is."""
    basis, kwh = report.basis, JOULE_PER_KWH
    if report.energy_per_year is None or report.half_per_year is None:
        page.paragraph(
            "What this is in a year depends on how much such work there is: give --hours-per-day "
            "and --days-per-year, and for money --price."
        )
        return
    if not report.advice:
        return
    columns = [
        Column("change", "label"),
        Column("saved", lambda one: one.energy_per_year / kwh, significant(3), "kWh"),
        Column("90 %\nband", lambda one: one.half_per_year / kwh, significant(2), "+- kWh"),
    ]
    if basis.price_per_kwh is not None:
        columns.append(Column("saved", "cost_per_year", fixed(0), basis.currency))
    if basis.co2_kg_per_kwh is not None:
        columns.append(Column("saved", "co2_per_year", fixed(0), "kg CO2"))
    page.rows(
        f"In a year of {basis.hours_per_day:.3g} h a day on {basis.days_per_year:g} days",
        columns,
        report.advice,
    )
    page.paragraph(
        f"Together, without what overlaps: {significant(3)(report.energy_per_year / kwh)} "
        f"+- {significant(2)(report.half_per_year / kwh)} kWh a year, if all work is like that of "
        "the recordings; the band does not say how typical they are."
    )


def _savings(rows: tuple[Advice, ...], basis: AdviceBasis, path: Target) -> None:
    with canvas(path, (8.0, 1.2 + 0.45 * len(rows)), "savings") as figure:
        share = 100.0 / basis.recorded_energy if basis.recorded_energy > 0 else math.nan
        saving_bars(
            figure.subplots(),
            [one.label for one in rows],
            [one.energy * share for one in rows],
            [one.half * share for one in rows],
            [one.claimed for one in rows],
            "saving, share of the energy from the grid [%]",
        )
