"""Figures of two model files of one robot side by side."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from robot_energy.certainty.band import Z95
from robot_energy.model import RobotModel
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.model.figure import Figure
from robot_energy.model.joint import Joint
from robot_energy.physics.friction import viscous_law
from robot_energy_identify.bounds import not_identified
from robot_energy_report.document import Column, Document
from robot_energy_report.formats import significant

SHOWN_DEGC = (20.0, 40.0, 60.0)


@dataclass(frozen=True)
class Change:
    """One figure of a model file, before and after.

    Attributes:
        before: As given; None if there was none.
    """

    name: str
    unit: str
    before: Figure | None
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
    for key, name in (("loss_grid", "grid side"), ("loss_dc", "DC side")):
        was, now = getattr(before.cabinet, key), getattr(after.cabinet, key)
        yield Change(f"{name} constant loss", "W", was, now)
    old_fan, new_fan = before.cabinet.fan, after.cabinet.fan
    for key, name, unit in (
        ("power", "fan", "W"),
        ("on_above_degc", "fan starts above", "degC"),
        ("hysteresis", "fan stops below that by", "K"),
    ):
        if (figure := getattr(new_fan, key, None)) is not None:
            yield Change(name, unit, getattr(old_fan, key, None), figure)
    for key, name in (("time_constant", "low pass of the meter"), ("delay", "delay of the meter")):
        if (figure := getattr(after.meter, key, None)) is not None:
            yield Change(name, "s", getattr(before.meter, key, None), figure)
    for key, name in (("kept", "kept at rest from the last motion"), ("carried", "load carried")):
        if (figure := getattr(after.hold, key, None)) is not None:
            unit = "of Coulomb"
            yield Change(f"torque {name}", unit, getattr(before.hold, key, None), figure)
    old_link, new_link = before.cabinet.capacitor, after.cabinet.capacitor
    if new_link is None:
        return
    for key, name, unit in (
        ("capacitance", "DC link capacitance", "F"),
        ("nominal_voltage", "DC link, rectified mains", "V"),
        ("chopper_voltage", "DC link, chopper", "V"),
    ):
        was = None if old_link is None else getattr(old_link, key)
        yield Change(name, unit, was, getattr(new_link, key))


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
        chosen = [change for change in found if change.weak is weak]
        if chosen:
            page.rows(title, columns, chosen)
    laws = [
        (new.name, _viscous(old), _viscous(new), new.friction.viscous.law)
        for old, new in zip(before.joints, after.joints, strict=True)
        if old.friction.viscous != new.friction.viscous
    ]
    if laws:
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
