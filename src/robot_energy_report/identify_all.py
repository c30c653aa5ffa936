"""Everything that was identified, step by step, with the test on what was held out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import reduce
from math import isfinite
from pathlib import Path
from typing import Annotated

from robot_energy import __version__
from robot_energy.certainty.deviation import Z95
from robot_energy.foundation.described import Described
from robot_energy.model import RobotModel
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.model.figure import Figure
from robot_energy.model.joint import Joint
from robot_energy.physics.friction import viscous_law
from robot_energy.results.base import count_tags
from robot_energy.timeline.blocks import EffortMeaning
from robot_energy_identify.bounds import not_identified
from robot_energy_identify.cabinet.cabinet import CabinetFit
from robot_energy_identify.cabinet.dc_link import LinkFit
from robot_energy_identify.data.bags import VIRTUAL, BagFacts
from robot_energy_identify.drives.all_drives import DrivesReport, TotalPower
from robot_energy_identify.drives.drives import DrivesFit
from robot_energy_identify.dynamics.dynamics import DynamicsReport
from robot_energy_identify.friction_and_thermal import FrictionReport, ThermalReport
from robot_energy_identify.results.identification import IdentificationReport
from robot_energy_identify.steps import Step
from robot_energy_report.document import Column, Document
from robot_energy_report.drives import drives_document
from robot_energy_report.dynamics import dynamics_document
from robot_energy_report.formats import NOTHING, counted, percent, significant, tags_text
from robot_energy_report.held_out import PLACES, held_out_document, verdict_line
from robot_energy_report.identification import (
    delay_lines,
    friction_document,
    link_section,
    losses_section,
    thermal_document,
)

SHOWN_DEGC = (20.0, 40.0, 60.0)
FIGURES = (  # of the whole robot: path in the model, name and unit
    ("cabinet.loss_grid", "grid side constant loss", "W"),
    ("cabinet.loss_dc", "DC side constant loss", "W"),
    ("cabinet.fan.power", "fan", "W"),
    ("cabinet.fan.on_above_degc", "fan starts above", "degC"),
    ("cabinet.fan.hysteresis", "fan stops below that by", "K"),
    ("meter.time_constant", "low pass of the meter", "s"),
    ("meter.delay", "delay of the meter", "s"),
    ("hold.kept", "torque kept at rest from the last motion", "of static friction"),
    ("hold.carried", "torque load carried", "of static friction"),
    ("cabinet.capacitor.capacitance", "DC link capacitance", "F"),
    ("cabinet.capacitor.nominal_voltage", "DC link, rectified mains", "V"),
    ("cabinet.capacitor.chopper_voltage", "DC link, chopper", "V"),
)


class Change(Described):
    """One figure of a model file, before and after."""

    name: str
    unit: str
    before: Annotated[Figure | None, "As given; None if there was none."]
    after: Figure

    @property
    def weak(self) -> bool:
        """Whether the 95 % interval is wider than the value itself."""
        return self.after.std is not None and Z95 * self.after.std > abs(self.after.value)


def changes(before: RobotModel, after: RobotModel) -> list[Change]:
    """Return the figures that differ, but for those of the bodies and of laws over temperature."""
    return [change for change in _pairs(before, after) if change.before != change.after]


def _pairs(before: RobotModel, after: RobotModel) -> Iterator[Change]:
    for old, new in zip(before.joints, after.joints, strict=True):
        yield Change(f"{new.name} rotor inertia", "kg m^2", old.rotor_inertia, new.rotor_inertia)
        yield Change(f"{new.name} Coulomb", "N m", old.friction.coulomb, new.friction.coulomb)
        for kind in DRIVE_MODELS.values():
            entry, given = kind.of(new), kind.of(old)
            for key, words, unit in kind.figures if entry is not None else ():
                was = None if given is None else getattr(given, key)
                yield Change(f"{new.name} {words}", unit, was, getattr(entry, key))
    for path, name, unit in FIGURES:
        if (figure := _at(after, path)) is not None:
            yield Change(name, unit, _at(before, path), figure)
    for joint, was, figure in zip(after.joints, _statics(before), _statics(after), strict=True):
        if figure is not None:
            yield Change(f"{joint.name} static friction", "of Coulomb", was, figure)


def _at(model: RobotModel, path: str) -> Figure | None:
    return reduce(lambda part, key: getattr(part, key, None), path.split("."), model)  # type: ignore[return-value]


def _statics(model: RobotModel) -> Sequence[Figure | None]:
    """Static friction of each joint over its Coulomb torque, as well known as the hold itself."""
    hold = model.hold
    if hold is None or hold.static is None:
        return [None] * len(model.joints)
    tag, source = hold.kept.tag, hold.kept.source
    return [Figure(value=value, tag=tag, source=source) for value in hold.static]


def changes_document(before: RobotModel, after: RobotModel, page: Document) -> None:
    """Add what is new in a model file; what is hardly known stands apart, by name."""
    found = changes(before, after)
    columns = [
        Column("figure", "name"),
        Column("unit", "unit"),
        Column("as given", lambda one: one.before and one.before.value, significant(4)),
        Column("now", lambda one: one.after.value, significant(4)),
        Column("std", lambda one: one.after.std, significant(2)),
        Column("known as", lambda one: one.after.tag),
        Column("not identified", lambda one: not_identified(one.after), optional=True),
    ]
    for title, weak in (
        ("New figures of the model file, motor side", False),
        ("New figures that are hardly known: 95 % interval wider than the figure itself", True),
    ):
        page.rows(title, columns, [change for change in found if change.weak is weak])
    laws = [
        (new.name, _viscous(old), _viscous(new), new.friction.viscous.law)
        for old, new in zip(before.joints, after.joints, strict=True)
        if old.friction.viscous != new.friction.viscous
    ]
    degc = ", ".join(f"{t:g}" for t in SHOWN_DEGC)
    page.table(
        f"Viscous friction at {degc} degC [1e-3 N m s/rad], motor side",
        ("joint", "as given", "now", "law"),
        laws,
    )
    if not found and not laws:
        page.paragraph("no figure of the model file changed")


def _viscous(joint: Joint) -> str:
    law = viscous_law(joint.friction.viscous)
    return " ".join(f"{1e3 * float(law.viscous(degc)):.3g}" for degc in SHOWN_DEGC)


TITLES = {
    "dynamics": "Dynamics: bodies, rotors and friction",
    "friction": "Friction over motor temperature",
    "cabinet": "Constant losses of the cabinet",
    "drives": "Drives: electrical power",
    "capacitor": "Energy of the DC link",
    "thermal": "Thermal networks of the motors",
}


def identification_lead(report: IdentificationReport) -> str:
    """Return what was identified, and of what data."""
    bags = (*report.recordings, *report.tests)
    origins = sorted({entry.origin for entry in bags if entry.origin})
    count = counted(len(report.recordings), "recording")
    return ". ".join([f"{report.model.robot.type}, identified from {count}", *origins]) + "."


def identification_document(
    report: IdentificationReport, page: Document, details: bool = False
) -> None:
    """Add everything."""
    page.heading("In short")
    identification_overview(report, page)
    if report.energy is not None:
        page.heading("Energy on what the model has not seen")
        held_out_document(report.energy, report.model.joint_names, page)
    page.heading("What was read")
    _read(report, page)
    steps = Document()
    for step in report.steps:
        steps.heading(TITLES[step.subject])
        _step(step, report, steps)
    if details:
        page.parts += steps.parts
    else:
        with page.only("page"):
            for part in steps.shown("page"):
                page.add(part)
        with page.only("terminal"):
            page.paragraph("tables and notes of every step: --details, or --report FILE")
    page.heading("Model file")
    _model(report, page)


def identification_overview(report: IdentificationReport, page: Document) -> None:
    """Add what every step found, in one table."""
    page.rows(
        "What was identified, in the order in which it was done",
        [
            Column("step", "subject"),
            Column("in the model", lambda step: "new" if step.taken else "as given"),
            Column("what came of it", _came_of),
        ],
        report.steps,
    )
    verdict_line(report.energy, page)
    page.notes(report.notes)
    virtual = [entry.name for entry in report.recordings if VIRTUAL in entry.origin]
    if virtual:
        page.note(
            f"virtual rig: {', '.join(virtual)} simulated; figures on it show the method, "
            "not a robot"
        )


def _came_of(step: Step) -> str:
    if step.reason:
        return step.reason
    match step.found:
        case DynamicsReport() as found:
            weak = sum(entry.weakly_excited for entry in found.base_parameters)
            errors = found.torque_error
            return (
                f"{len(found.base_parameters)} base parameters, {weak} of them weakly excited; "
                f"held-out torque {percent(errors['held_out_model_file'].total)} off, "
                f"{percent(errors['held_out_given_bodies'].total)} with the bodies as given"
            )
        case FrictionReport(_, fits, _):
            known = [degc for fit in fits for degc in fit.range_degc if isfinite(degc)]
            where = f"{min(known):.0f} to {max(known):.0f} degC" if known else "no temperatures"
            laws = ", ".join(sorted({fit.chosen for fit in fits}))
            return f"{counted(len(fits), 'axis', 'axes')}, {where}: {laws}"
        case CabinetFit() as fit:
            sides = (("grid", fit.loss_grid), ("DC", fit.loss_dc))
            words = [f"{name} side {_constant(value)}" for name, value in sides]
            if fit.fan is not None:
                fan = fit.fan
                words.append(f"a fan of {fan.power:.1f} W above {fan.on_above_degc:.1f} degC")
            return ", ".join(words)
        case DrivesReport(drives=None, total=TotalPower(constant=constant)):
            return (
                "losses behind one meter for all drives; constant losses that it sees: "
                f"{constant:.1f} W"
            )
        case DrivesReport(drives=DrivesFit(chosen=chosen)):
            return f"each drive by its own power: {chosen.replace('_', ' ')}"
        case LinkFit() as fit:
            return (
                f"{fit.energy:.0f} J, 95 % interval {fit.interval[0]:.0f} to {fit.interval[1]:.0f}"
            )
        case ThermalReport() as found:
            worst = max(fit.rms for fit in found.axes)
            motors = counted(len(found.axes), "motor")
            return f"{motors}, free run at most {worst:.1f} K off (RMS)"
        case _:
            return ""


def _constant(value: float | None) -> str:
    """A constant loss in words; the model file has 0 where the fit went below."""
    if value is None:
        return "as given"
    return f"{value:.1f} W" if value > 0.0 else "at its bound 0"


def _read(report: IdentificationReport, page: Document) -> None:
    uses = {id(entry): "test" for entry in report.tests}
    bags = (*report.recordings, *report.tests)
    page.rows(
        "Recordings",
        [
            Column("bag", "name"),
            Column("for", lambda entry: uses.get(id(entry), "fit")),
            Column("samples", lambda entry: f"{entry.duration:.1f} s, {entry.rate:.0f} Hz"),
            Column(
                "motors",
                lambda entry: entry.range_degc and "{:.0f} to {:.0f}".format(*entry.range_degc),
                unit="degC",
            ),
            Column(
                "effort",
                lambda entry: (
                    None
                    if entry.effort is EffortMeaning.NONE
                    else entry.effort.value.replace("_", " ")
                ),
            ),
            Column("power readings", _readings),
        ],
        bags,
    )
    delay_lines("the power meter", report.meter_delay, report.meter_time_constant, page)
    page.notes([f"{entry.name}: {problem}" for entry in bags for problem in entry.problems])


def _readings(entry: BagFacts) -> str | None:
    if entry.meter is None:
        return None
    place = PLACES.get(entry.meter, "unknown place")
    return f"{entry.readings} at {place}{', drives' if entry.drives else ''}"


def _step(step: Step, report: IdentificationReport, page: Document) -> None:
    if step.found is None:
        page.note(f"not done: {step.reason}")
        return
    if step.reason:
        page.note(f"not taken: {step.reason}")
    match step.found:
        case DynamicsReport() as found:
            follows = not step.taken or report.taken("friction")
            dynamics_document(found, page, friction_follows=follows)
            errors = found.torque_error
            page.paragraph(
                f"held out with the bodies as given, rotors and friction refitted: "
                f"{percent(errors['held_out_given_bodies'].total)} of the moving torque; "
                f"identified bodies {percent(errors['held_out_model_file'].total)}"
            )
        case FrictionReport() as found:
            friction_document(found, page)
        case CabinetFit() as fit:
            losses_section(fit, page)
        case DrivesReport() as found:
            drives_document(found, page)
        case LinkFit() as fit:
            link_section(fit, page)
        case ThermalReport() as found:
            thermal_document(found, page)
    page.notes(step.notes)


def _model(report: IdentificationReport, page: Document) -> None:
    model, before = report.model, report.given
    changes_document(before, model, page)
    provenance = model.provenance
    page.pairs(
        [
            (
                "model",
                f"{model.model_id} (as given: {before.model_id}, {Path(before.source).name})",
            ),
            ("figures", tags_text(count_tags(model))),
            ("made from", ", ".join(provenance.bags)),
            ("recorded", provenance.data_date or NOTHING),
            ("made by", f"robot-energy {__version__}"),
        ]
    )
