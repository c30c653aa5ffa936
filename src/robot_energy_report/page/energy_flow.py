"""The energy flow from the grid to where it ends, in whole units that balance at every node."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any

from robot_energy.foundation.described import Described
from robot_energy.foundation.shown_text import shown
from robot_energy.foundation.units import JOULE_PER_WH

MAX_SHOWN = 5  # digits of the largest flow
GRID, BUS, CABINET, BRAKE = "grid", "bus", "cabinet", "brake"
FRICTION, DRIVES, MOTION, CAPACITOR = "friction", "drives", "motion", "capacitor"
PARTS = {  # of the energy from the grid, as all tables and pictures name them
    MOTION: "lifting, accelerating",
    FRICTION: "friction",
    DRIVES: "drive losses",
    CABINET: "constant losses",
    BRAKE: "brake resistor",
    CAPACITOR: "capacitor",
}
LABELS = {GRID: "Grid", BUS: "DC bus"} | {part: name.capitalize() for part, name in PARTS.items()}


class FlowParts(Described):
    """What power or energy from the grid is the sum of, signed; all in [W] or all in [J]."""

    joint_names: Sequence[str]
    rigid: Annotated[Sequence[float], "Into motion of each axis; negative while it comes back."]
    friction: Annotated[Sequence[float], "Into friction of each axis, >= 0."]
    drive_loss: Annotated[Sequence[float], "Of each axis, >= 0; NaN where it is not modelled."]
    loss_dc: Annotated[float, "Constant loss on the DC bus, >= 0."]
    loss_grid: Annotated[float, "Constant loss on the grid side, >= 0."]
    brake: float
    capacitor: Annotated[float, "Negative while it gives back; NaN where it is not modelled."]
    returned: Annotated[float, "Fed back, >= 0; already subtracted from the grid's sum."]
    auxiliary: Annotated[Sequence[tuple[str, float]], "Name and size of loads outside, >= 0."] = ()

    @property
    def terms(self) -> list[float]:
        """All terms of the balance: net grid = their sum."""
        return [
            *self.rigid,
            *self.friction,
            *(0.0 if math.isnan(loss) else loss for loss in self.drive_loss),
            self.loss_dc,
            self.loss_grid,
            self.brake,
            0.0 if math.isnan(self.capacitor) else self.capacitor,
            *(size for _, size in self.auxiliary),
        ]


class Flow(Described):
    """One band of the picture."""

    source: str
    target: str
    units: Annotated[int, "Its size in whole units, > 0."]


class FlowPicture(Described):
    """Flows that balance exactly: at every inner node, what enters leaves."""

    unit: Annotated[float, "Size of one unit, in the unit of the parts."]
    net: Annotated[int, "Net flow from the grid. [units]"]
    flows: list[Flow]
    labels: dict[str, str]

    def plain(self, base: float = 1.0) -> dict[str, Any]:
        """Return it as plain values; a size in the displayed unit is ``units`` times ``unit``.

        Args:
            base: What one displayed unit is, in the unit of the parts. [W] or [J]
        """
        return {
            "unit": self.unit / base,
            "net": self.net,
            "labels": self.labels,
            "flows": [[flow.source, flow.target, flow.units] for flow in self.flows],
        }


def rounded_parts(parts: Sequence[float], unit: float, total: int | None = None) -> list[int]:
    """Return parts as whole units, less than one off each, that sum to the rounded sum.

    Args:
        parts: Finite terms of a sum, of any sign. [W] or [J]
        unit: Size of a unit, > 0. [W] or [J]
        total: What they sum to, less than one unit a part from it; None: their rounded sum. [units]
    """
    scaled = [part / unit for part in parts]
    whole = [math.floor(part) for part in scaled]
    missing = (round(math.fsum(scaled)) if total is None else total) - sum(whole)
    order = sorted(range(len(parts)), key=lambda place: whole[place] - scaled[place])
    for place in order[:missing]:
        whole[place] += 1
    return whole


def unit_for(largest: float, base: float = 1.0) -> float:
    """Return ``base`` times a power of ten, not below 1e-3, that leaves a readable count of digits.

    Args:
        largest: The largest size shown. [W] or [J]
        base: What one displayed unit is, such as 3600 for a size in J shown in Wh. [W] or [J]
    """
    if not largest > 0 or not math.isfinite(largest):
        return base
    digits = math.floor(math.log10(largest / base)) + 1
    return base * 10.0 ** min(0, max(-3, digits - MAX_SHOWN + 1))


def known_label(name: str, known_time: float, missing_time: float) -> str:
    """Return the name of a load, with the time its energy is of where part of it is missing.

    Args:
        known_time: For which its power is known. [s]
        missing_time: For which it is not. [s]
    """
    return f"{name}, {known_time:.0f} s known" if missing_time else name


def flow_picture(parts: FlowParts, base: float = 1.0) -> FlowPicture | None:
    """Return the flows of a balance; None where a term is unknown. The base is as in `unit_for`.

    Only the terms are rounded, so that they sum to the grid's rounded flow; every flow between
    them is a sum of whole units. An axis that feeds back is a source: of what its motion gives.
    """
    terms = parts.terms
    if not all(map(math.isfinite, [*terms, parts.returned])):
        return None
    unit = unit_for(max(abs(math.fsum(terms)), *map(abs, terms)), base)
    units = rounded_parts(terms, unit)
    n = len(parts.joint_names)
    friction, loss = ([max(u, 0) for u in units[k * n : (k + 1) * n]] for k in (1, 2))
    # Rounding, or a drive model, may leave a loss below zero: it counts as motion.
    rigid = [sum(units[place : 3 * n : n]) - friction[place] - loss[place] for place in range(n)]
    loss_dc, loss_grid, brake, capacitor, *loads = units[3 * n :]
    net = sum(units)
    cabinet = net - sum(loads)
    returned = max(round(parts.returned / unit), -cabinet, 0)
    sources: list[Flow] = []
    middle: list[Flow] = []
    axes: list[Flow] = []
    labels: dict[str, str] = {}
    for place, name in enumerate(parts.joint_names):
        axis = f"axis{place}"
        labels[axis] = name
        drive = rigid[place] + friction[place] + loss[place]
        if drive < 0:  # its motion feeds friction, losses and the bus
            labels[axis] = f"{name} brakes"
            sources.append(Flow(axis, BUS, -drive))
        else:
            middle += [Flow(f"{MOTION}{place}", axis, -rigid[place]), Flow(BUS, axis, drive)]
            labels[f"{MOTION}{place}"] = f"{name} gives back"
        axes += [
            Flow(axis, FRICTION, friction[place]),
            Flow(axis, DRIVES, loss[place]),
            Flow(axis, MOTION, max(rigid[place], 0)),
        ]
    drawn = cabinet + returned
    at_grid = min(drawn, loss_grid)  # a supply that feeds back covers the rest from the bus
    flows = [
        Flow(GRID, BUS, drawn - at_grid),
        Flow(GRID, CABINET, at_grid),
        *sources,
        Flow(CAPACITOR, BUS, -capacitor),
        *middle,
        Flow(BUS, CABINET, loss_dc + loss_grid - at_grid),
        Flow(BUS, BRAKE, brake),
        Flow(BUS, "capacitor_in", capacitor),
        Flow(BUS, "grid_back", returned),
        *axes,
        *(Flow(GRID, f"load{place}", size) for place, size in enumerate(loads)),
    ]
    labels |= LABELS | {"capacitor_in": "Capacitor", "grid_back": "Back to the grid"}
    labels |= {f"load{place}": name for place, (name, _) in enumerate(parts.auxiliary)}
    if loads:
        labels[GRID] = "Outlet"
    kept = [flow for flow in flows if flow.units > 0]
    used = {node for flow in kept for node in (flow.source, flow.target)}
    return FlowPicture(unit, net, kept, {node: labels[node] for node in labels if node in used})


def registers_picture(registers: dict[str, Any]) -> FlowPicture | None:
    """Return flows since the registers were zero, in units readable in Wh; None: unknown."""
    joints = registers["joints"]
    parts = FlowParts(
        [shown(joint["name"]) for joint in joints],
        [joint["rigid_energy"] for joint in joints],
        [joint["friction_energy"] for joint in joints],
        [joint["drive_loss_energy"] for joint in joints],
        loss_dc=registers["loss_dc_energy"],
        loss_grid=registers["loss_grid_energy"],
        brake=registers["brake_energy"],
        capacitor=registers["capacitor_energy"],
        returned=registers["predicted_return_energy"],
        auxiliary=[
            (
                known_label(shown(load["name"]), load["known_time"], load["missing_time"]),
                load["energy"],
            )
            for load in registers["auxiliary"]
        ],
    )
    return flow_picture(parts, JOULE_PER_WH)
