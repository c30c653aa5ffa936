"""Which numbers of which messages belong into one plot, from the message definitions alone.

Every `float64` of our messages is in a plot: those of a message that share a unit together, those
of the joints by field. The first page is a choice of the totals. A field of it that is renamed or
removed makes the making of layouts fail; a new field appears by itself.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from robot_energy.bag.cdr.schema import compile_schema, leaf
from robot_energy.bag.cdr.types import ENERGY_PACKAGE, definition, typestore
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import LayoutError
from robot_energy.messages.fields import METER_TOPIC, TEMPERATURES_TOPIC

DIAGNOSTICS = "/diagnostics"
UNIT = re.compile(r"\[([^\]\d][^\]]*)\]")
FIELD = re.compile(r"^(\S+)\s+(\w+)\s*$")


class PlotCurve(Described):
    """One line of a plot."""

    topic: str
    field: Annotated[str, "Of the message, or of the entry of `joints`."]
    joint: Annotated[int | None, "Position of the joint; None for a number of the whole robot."] = (
        None
    )
    name: Annotated[str, "Name of the joint; empty for the whole robot."] = ""
    nested: Annotated[
        bool, "Whether the joints are entries of `joints`, not elements of arrays."
    ] = False

    @property
    def label(self) -> str:
        """What a legend says."""
        return self.name or self.field


@dataclass(frozen=True)
class Plot:
    """Curves with one axis."""

    title: str
    curves: tuple[PlotCurve, ...]


@dataclass(frozen=True)
class Page:
    """Plots that are seen together."""

    title: str
    plots: tuple[Plot, ...]


# Topic, type, title of the page of its totals, title of the page of its joints; empty: no page.
TOPICS = (
    ("/energy/power", "PowerState", "Power", "Joints"),
    ("/energy/registers", "EnergyRegisters", "Registers", "Energy of joints"),
    ("/energy/joint_torque", "JointTorque", "", "Torque"),
    ("/energy/joint_friction", "JointFriction", "", "Friction"),
    ("/energy/payload", "Payload", "", ""),
    (METER_TOPIC, "PowerReading", "Meter", ""),
    (TEMPERATURES_TOPIC, "MotorTemperatures", "", "Temperatures"),
)
JOINTS = "joints"
# The first page: titles, and fields of one topic in each.
OVERVIEW = (
    (
        "Power from the grid [W]",
        "/energy/power",
        ("predicted_grid_power", "predicted_power_lower", "predicted_power_upper"),
    ),
    ("Power at the meter [W]", "/energy/power", ("predicted_power_at_meter", "measured_power")),
    (
        "Where it goes [W]",
        "/energy/power",
        (
            "rigid_power", "friction_power", "drive_loss", "loss_dc", "loss_grid",
            "brake_power", "capacitor_power",
        ),
    ),
    ("Predicted minus measured [W]", "/energy/power", ("residual_power",)),
    (
        "Energy [J]",
        "/energy/registers",
        ("predicted_import_energy", "predicted_energy_at_meter", "measured_energy", "brake_energy"),
    ),
)  # fmt: skip


@dataclass(frozen=True)
class _Number:
    name: str
    unit: str
    array: bool


def pages(joint_names: Sequence[str]) -> list[Page]:
    """Return all pages of plots."""
    found = [_overview()]
    for topic, kind, totals, by_joint in TOPICS:
        numbers = _numbers(kind)
        if totals:
            found.append(Page(totals, _totals(topic, numbers)))
        if by_joint:
            arrays = [number for number in numbers if number.array]
            entries, _ = _fields(kind).get(JOINTS, ("", ""))
            nested = _numbers(entries.removesuffix("[]")) if entries else []
            plots = [_by_joint(topic, number, joint_names, False) for number in arrays]
            plots += [_by_joint(topic, number, joint_names, True) for number in nested]
            found.append(Page(by_joint, tuple(plots)))
    return found


def _overview() -> Page:
    kinds = {topic: kind for topic, kind, _, _ in TOPICS}
    for _, topic, fields in OVERVIEW:
        known = {number.name for number in _numbers(kinds[topic])}
        lacking = [name for name in fields if name not in known]
        if lacking:
            raise LayoutError(
                f"{kinds[topic]} has no number {', '.join(lacking)}",
                f"some of {', '.join(sorted(known))}",
                "change the first page in robot_energy_report/layouts/plots.py",
            )
    return Page(
        "Energy",
        tuple(
            Plot(title, tuple(PlotCurve(topic, name) for name in fields))
            for title, topic, fields in OVERVIEW
        ),
    )


def _totals(topic: str, numbers: Sequence[_Number]) -> tuple[Plot, ...]:
    """Numbers of the whole robot, one plot for each unit."""
    units = dict.fromkeys(number.unit for number in numbers if not number.array)
    return tuple(
        Plot(
            f"{topic} [{unit}]",
            tuple(
                PlotCurve(topic, one.name) for one in numbers if one.unit == unit and not one.array
            ),
        )
        for unit in units
    )


def _by_joint(topic: str, number: _Number, joint_names: Sequence[str], nested: bool) -> Plot:
    curves = (
        PlotCurve(topic, number.name, at, name, nested) for at, name in enumerate(joint_names)
    )
    return Plot(f"{number.name} [{number.unit}]", tuple(curves))


def _numbers(kind: str) -> list[_Number]:
    """Every float64 of a message of ours, and arrays of them, in the order of its definition."""
    fields, msgtype = _fields(kind), f"{ENERGY_PACKAGE}/msg/{kind}"
    schema = compile_schema(msgtype, typestore())
    found: list[_Number] = []
    for name, (written, unit) in fields.items():
        if written in ("float64", "float64[]"):
            leaf(schema, name, msgtype)  # as bags have it
            found.append(_Number(name, unit, written.endswith("[]")))
    return found


def _fields(kind: str) -> dict[str, tuple[str, str]]:
    """Type and unit of every field: the unit stands in brackets in the comment above it."""
    found: dict[str, tuple[str, str]] = {}
    comment = ""
    for line in definition(kind).splitlines():
        match = FIELD.match(line)
        if match is not None:
            units = UNIT.findall(comment)
            found[match.group(2)] = match.group(1), units[0] if units else "-"
        comment = f"{comment} {line}" if line.startswith("#") else ""
    return found
