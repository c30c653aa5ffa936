"""What a model file holds."""

from __future__ import annotations

from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.results.model import JointOfModel, ModelReport
from robot_energy_report.document import Column, Document
from robot_energy_report.formats import significant


def model_document(report: ModelReport, page: Document) -> None:
    """Add what a model file holds."""
    page.paragraph(
        f"{report.source}: a valid model of {report.robot}, {len(report.joints)} joints, id "
        f"{report.model_id}",
        "strong",
    )
    tags = report.figures
    entries = [
        (
            "figures",
            f"{sum(tags.values())}: {', '.join(f'{count} {tag}' for tag, count in tags.items())}",
        ),
        (
            "moving mass",
            f"{report.moving_mass:.2f} kg, of which payload {report.payload_mass:.2f} kg",
        ),
        ("locked joints", ", ".join(report.locked_joints) or "none"),
        ("coupling", "; ".join(report.coupling) or "none"),
        ("drives", DRIVE_MODELS[report.drive].label),
        (
            "constant losses",
            f"{report.loss_dc:g} W on the DC side, {report.loss_grid:g} W on the grid side",
        ),
        ("braking energy", "returned to the grid" if report.regenerates else "to the resistor"),
        ("DC-link capacitor", "modelled" if report.capacitor else "not modelled"),
        ("fan", "modelled" if report.fan else "not modelled"),
        (
            "temperature",
            f"{report.fallback_temperature_degc:g} degC where none is known or it "
            f"is older than {report.stale_after:g} s",
        ),
    ]
    if report.notes:
        entries.append(("notes", " ".join(report.notes.split())))
    page.pairs(entries)
    page.paragraph()
    page.paragraph("Joints and links of the URDF", "strong")
    for sentence in report.inventory:
        page.paragraph(f"  {sentence}")
    page.rows(
        "Joints, motor side",
        [
            Column("", "name"),
            Column("gear\nratio", "gear_ratio", significant(6)),
            Column("rotor inertia\n[kg m^2]", "rotor_inertia", significant(3)),
            Column("Coulomb\n[N m]", "coulomb", significant(3)),
            Column("viscous\nlaw", "viscous_law"),
            Column("fitted\n[degC]", _fitted),
        ],
        report.joints,
    )
    page.notes(report.remarks)


def _fitted(joint: JointOfModel) -> str:
    if joint.fitted_degc is None:
        return "any"
    return "{:g} to {:g}".format(*joint.fitted_degc)
