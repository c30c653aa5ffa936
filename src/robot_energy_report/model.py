"""What a model file holds."""

from __future__ import annotations

from typing import Annotated

from robot_energy.model import RobotModel
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.physics.rigid_body import Robot
from robot_energy.results.base import ModelUsed, Result, Texts, model_used
from robot_energy_identify.starter.model_remarks import implausible
from robot_energy_report.document import Column, Document
from robot_energy_report.formats import significant


class JointOfModel(Result):
    """One joint of a model file, motor side."""

    name: Annotated[str, "Name of the joint."]
    gear_ratio: Annotated[float, "Motor turns per joint turn. [-]"]
    rotor_inertia: Annotated[float, "[kg m^2]"]
    coulomb: Annotated[float, "Coulomb friction. [N m]"]
    viscous_law: Annotated[str, "Kind of the law of viscous friction."]
    fitted_degc: Annotated[
        tuple[float, float] | None, "Temperatures of its fit, shape (2,); None for any. [degC]"
    ]


class ModelReport(ModelUsed, name="model"):
    """What a model file holds."""

    description: Annotated[str | None, "Description of the robot."]
    joints: Annotated[tuple[JointOfModel, ...], "Joints in model order."]
    locked_joints: Annotated[Texts, "Joints of the URDF that are held."]
    inventory: Annotated[Texts, "Joints and links of the URDF, one sentence each."]
    coupling: Annotated[Texts, "Motors that turn with another joint."]
    moving_mass: Annotated[float, "Moving mass, payload included. [kg]"]
    payload_mass: Annotated[float, "[kg]"]
    loss_dc: Annotated[float, "Constant loss on the DC side. [W]"]
    loss_grid: Annotated[float, "Constant loss on the grid side. [W]"]
    regenerates: Annotated[bool, "Whether braking energy returns to the grid."]
    capacitor: Annotated[bool, "Whether the DC-link capacitor is modelled."]
    fan: Annotated[bool, "Whether a fan of the cabinet is modelled."]
    stale_after: Annotated[float, "Age from which a temperature counts as unknown. [s]"]
    remarks: Annotated[
        Texts, "What contradicts the rest, as figures in wrong units do, one sentence each."
    ]


def model_report(model: RobotModel, robot: Robot) -> ModelReport:
    """Return what a model holds."""
    cabinet = model.cabinet
    return ModelReport(
        **vars(model_used(model)),
        description=model.robot.description or None,
        joints=tuple(
            JointOfModel(
                joint.name,
                joint.gear_ratio.value,
                joint.rotor_inertia.value,
                joint.friction.coulomb.value,
                joint.friction.viscous.law,
                _range(joint.friction.viscous),
            )
            for joint in model.joints
        ),
        locked_joints=tuple(robot.inventory.locked_joints),
        inventory=tuple(robot.inventory.sentences()),
        coupling=tuple(f"{entry.motor} turns with {entry.joint}" for entry in model.coupling),
        moving_mass=robot.moving_mass,
        payload_mass=sum(body.mass for body in model.payload),
        loss_dc=cabinet.loss_dc.value,
        loss_grid=cabinet.loss_grid.value,
        regenerates=cabinet.regeneration_efficiency is not None,
        capacitor=cabinet.capacitor is not None,
        fan=cabinet.fan is not None,
        stale_after=model.temperature.stale_after,
        remarks=tuple(implausible(model, robot)),
    )


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


def _range(law: object) -> tuple[float, float] | None:
    fitted = getattr(law, "fitted_degc", None) or getattr(law, "motor_temperature_degc", None)
    return None if fitted is None else (float(fitted[0]), float(fitted[-1]))
