"""What robots save on one DC bus."""

from __future__ import annotations

from pathlib import Path

from robot_energy_plan.results.shared_bus import SharedBusReport
from robot_energy_report.document import Column, Document
from robot_energy_report.formats import EnergyFormat, energy_text, fixed, percent, tags_text


def bus_verdict(report: SharedBusReport) -> str:
    """Return what the bus saves, in a sentence.

    Args:
        report: Of recordings, or of programs: with their best starts.
    """
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
