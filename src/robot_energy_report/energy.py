"""Sections that replay and prediction share: parts of the energy, joints, phases, quality."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from robot_energy.foundation.shown_text import shown
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.results.auxiliary import AuxiliaryReport, LoadEnergy
from robot_energy.results.energy import EnergyBreakdown, EnergyReport
from robot_energy.timeline.blocks import NANOSECOND
from robot_energy_report.document import Column, Document, FlowDiagram
from robot_energy_report.formats import (
    EnergyFormat,
    energy_text,
    fixed,
    percent,
    seconds,
)
from robot_energy_report.page.energy_flow import PARTS, FlowParts, flow_picture, known_label

QUALITY_NAMES = {
    "temperature_missing": "temperature missing, fallback used",
    "temperature_stale": "temperature stale, fallback used",
    "temperature_implausible": "temperature implausible, the one before used",
    "temperature_stuck": "temperature does not change while losses warm the motor",
    "extrapolated": "friction law outside its fitted temperatures, edge held",
    "acceleration_incomplete": "acceleration from a window cut by start, end or gap",
    "velocity_derived": "velocity derived from positions",
    "after_gap": "first sample after a gap",
    "drive_extrapolated": "drive outside its efficiency map",
    "not_finite": "power unknown, counted as gap",
}
BANDS = {
    "parametric": "of the model's figures",
    "calibrated": "calibrated with the meter",
}
FIELDS = {  # of `EnergyBreakdown`: the part of the energy that each belongs to, and its name
    "rigid": ("motion", f"{PARTS['motion']} (net)"),
    "friction": ("friction", PARTS["friction"]),
    "drive_loss": ("drives", PARTS["drives"]),
    "loss_dc": ("cabinet", f"{PARTS['cabinet']}, DC side"),
    "loss_grid": ("cabinet", "constant and supply losses, grid side"),
    "brake": ("brake", PARTS["brake"]),
    "capacitor": ("capacitor", "into the DC-link capacitor (net)"),
}
MIN_SHARE = 0.005  # of the variance; what adds less is not shown
MAX_CONTRIBUTIONS = 8


def scale_of(energies: Sequence[EnergyBreakdown]) -> EnergyFormat:
    """Return one unit and precision for several results, by the greatest energy of all."""
    return EnergyFormat(max(max(energy.grid_import, energy.grid_return) for energy in energies))


def _part_names(drive: str) -> dict[str, str]:
    names = {key: name for key, (_, name) in FIELDS.items()}
    if drive in DRIVE_MODELS and DRIVE_MODELS[drive].lossless:
        names["drive_loss"] += " (not modelled)"
    return names


def add_flow(
    page: Document,
    reports: Sequence[EnergyReport],
    caption: str,
    auxiliary: Sequence[tuple[str, float]] = (),
) -> None:
    """Add the picture of where the energy goes, of one result or the sum of several.

    Args:
        auxiliary: Name and energy of each load outside of the cabinet. [J]
    """

    def known_sum(energies: Iterable[float | None]) -> float:
        total = sum_of_known(energies)
        return math.nan if total is None else total

    def total(name: str) -> float:
        return known_sum(getattr(one.energy, name) for one in reports)

    def of_joints(name: str) -> list[float]:
        rows = zip(*(one.joints for one in reports), strict=True)
        return [known_sum(getattr(joint, name) for joint in row) for row in rows]

    parts = FlowParts(
        [shown(joint.name) for joint in reports[0].joints],
        of_joints("rigid_energy"),
        of_joints("friction_energy"),
        of_joints("drive_loss_energy"),
        loss_dc=total("loss_dc"),
        loss_grid=total("loss_grid"),
        brake=total("brake"),
        capacitor=total("capacitor"),
        returned=total("grid_return"),
        auxiliary=auxiliary,
    )
    scale = scale_of([one.energy for one in reports])
    picture = flow_picture(parts, scale.factor)
    if picture is not None and picture.flows:
        page.add(FlowDiagram(picture, caption, scale.unit, scale.factor))


def sum_of_known(energies: Iterable[float | None]) -> float | None:
    """Return the sum of the energies that are modelled; None where none is.

    Args:
        energies: Parts of an energy. [J]
    """
    known = [energy for energy in energies if energy is not None]
    return math.fsum(known) if known else None


def _share(part: float | None, whole: float) -> float | None:
    return part / whole if part is not None and whole > 0 else None


class EnergySections:
    """Sections about the energy of one result, for replay and prediction."""

    def __init__(self, page: Document, report: EnergyReport) -> None:
        self._page, self._report = page, report
        self._scale = scale_of([report.energy])

    def energy(self, title: str, other: tuple[str, EnergyBreakdown] | None = None) -> None:
        """Add where the energy goes."""
        energy, scale = self._report.energy, self._scale
        both = [energy] if other is None else [energy, other[1]]
        names = {
            key: text
            for key, text in _part_names(self._report.model.drive).items()
            if any(getattr(one, key) for one in both) or key not in ("brake", "capacitor")
        }
        net, values = energy.net, [getattr(energy, key) for key in names]
        columns = ["", f"energy [{scale.unit}]", "share"]
        cells = [
            [*names.values(), "from the grid"],
            [*scale.parts(values), scale.joule(net)],
            [percent(_share(value, net)) for value in (*values, net)],
        ]
        if other is not None:
            change = other[0].replace("friction ", "friction\n")
            columns.append(f"{change}\n[{scale.unit}]")
            parts = scale.parts([getattr(other[1], key) for key in names])
            cells.append([*parts, scale.joule(other[1].net)])
        *rows, total = zip(*cells, strict=True)
        self._page.table(title, columns, rows, total)

    def certainty(self) -> None:
        """Add how sure the energy is, and what to measure next to make it more so."""
        sure = self._report.uncertainty
        shown = [one for one in sure.contributions if (one.share or 0.0) >= MIN_SHARE]
        half = energy_text(0.5 * (sure.upper - sure.lower))
        relative = f" ({percent(sure.half_relative)})" if sure.half_relative is not None else ""
        self._page.paragraph(
            f"How sure: {energy_text(self._report.energy.net)} +- {half}{relative}, 90 % band "
            f"{BANDS[sure.band]}"
        )
        if sure.readings:
            self._page.paragraph(
                f"  {percent(sure.inside)} of {sure.readings} meter readings lay in the 90 % band "
                f"of power; before calibration {percent(sure.inside_parametric)} did"
            )
        self._page.rows(
            "What makes the energy from the grid unsure, the largest first: measure that next",
            [
                Column("", "name"),
                Column("standard deviation", "std", self._scale.joule, self._scale.unit),
                Column("share of variance", "share", percent),
            ],
            shown[:MAX_CONTRIBUTIONS],
        )

    def normalised(self) -> None:
        """Add what the energy comes to for each metre of the tool, and for each part."""
        found = self._report.normalised
        texts = [f"{percent(found.body_work_share)} is work that lifts and accelerates the bodies"]
        if found.energy_per_metre is not None and found.tool_path is not None:
            texts.insert(
                0,
                f"{energy_text(found.energy_per_metre)} for each metre of the tool's "
                f"{found.tool_path:.3g} m",
            )
        texts += [
            f"{energy_text(one.energy)} for each {one.name} (mean of {one.count})"
            for one in found.parts
            if one.count > 1
        ]
        self._page.paragraph(f"Energy from the grid: {'; '.join(texts)}")

    def joints(self) -> None:
        """Add where the energy of each joint goes."""
        scale = self._scale
        energies = {
            "shaft\nout": "shaft_energy_positive",
            "shaft\nback": "shaft_energy_negative",
            "rigid": "rigid_energy",
            "friction": "friction_energy",
            "drive\nloss": "drive_loss_energy",
            "drive\ninput": "drive_input_energy",
        }
        self._page.rows(
            f"Joints, predicted [{scale.unit}]: rigid + friction + drive loss = drive input",
            [
                Column("", "name"),
                *(Column(name, key, scale.joule, total=True) for name, key in energies.items()),
                Column("share\nof grid", "share_of_grid", percent, total=True),
                Column("motor\ndegC", "last_motor_temperature_degc", fixed(1)),
                Column("gear\ndegC", "last_gear_temperature_degc", fixed(1), optional=True),
            ],
            self._report.joints,
            "all joints",
        )

    def phases(self) -> None:
        """Add time and energy of the phases."""
        scale, phases = self._scale, self._report.phases.items()
        self._page.rows(
            "Phases, predicted",
            [
                Column("", lambda entry: entry[0]),
                Column("time", lambda entry: f"{entry[1].time:.3f} s"),
                Column("drawn", lambda entry: entry[1].grid_import_energy, scale.joule, scale.unit),
                Column(
                    "mean power",
                    lambda entry: (
                        f"{entry[1].grid_import_energy / entry[1].time:.1f} W"
                        if entry[1].time
                        else None
                    ),
                ),
            ],
            [(name, one) for name, one in phases if name != "unknown" or one.time],
        )

    def quality(self) -> None:
        """Add which samples are marked, where any is."""
        quality = self._report.quality
        self._page.table(
            f"Quality: marked of {quality.samples} samples",
            ("", "samples", "share"),
            [
                (
                    QUALITY_NAMES.get(name, name),
                    str(count),
                    percent(count / quality.samples if quality.samples else None),
                )
                for name, count in quality.counts.items()
            ],
        )


def auxiliary_section(page: Document, report: AuxiliaryReport | None) -> None:
    """Add the loads, their states and the balance of the outlet."""
    if report is None:
        return
    scale = EnergyFormat(max(report.outlet_energy, *(one.known_energy for one in report.loads)))

    def coverage(load: LoadEnergy) -> float | None:
        observed_ns = load.known_ns + load.missing_ns
        return load.known_ns / observed_ns if observed_ns else None

    page.rows(
        f"Loads outside of the cabinet [{scale.unit}]",
        [
            Column("", "name"),
            Column("power by", lambda load: "meter" if load.metered else "state"),
            Column("energy\nwhile known", "known_energy", scale.joule),
            Column("mean", "mean_power", fixed(1), "W"),
            Column("time\nknown", coverage, percent),
            Column("ceased to\nbe known", "missing_count"),
        ],
        report.loads,
    )
    rows = [
        (
            load.name,
            name,
            fixed(1)(state.time),
            fixed(1)(state.mean_power),
            fixed(1)(state.model_power),
        )
        for load in report.loads
        for name, state in load.states.items()
        if len(load.states) > 1
    ]
    columns = ("", "state", "time [s]", "mean power [W]", "in the model [W]")
    page.table("Mean power by state", columns, rows)
    known = seconds(report.balanced_ns)
    page.table(
        f"Balance of the outlet over the {known} in which all loads are known",
        ("", f"energy [{scale.unit}]"),
        [
            ("cabinet, predicted", scale.joule(report.cabinet_energy)),
            ("other loads", scale.joule(report.auxiliary_energy)),
        ],
        ("from the outlet", scale.joule(report.outlet_energy)),
    )


def flow_labels(report: AuxiliaryReport | None) -> list[tuple[str, float]]:
    """Return name and known energy of each load for the picture of the flows. [J]"""
    return [
        (
            known_label(load.name, load.known_ns * NANOSECOND, load.missing_ns * NANOSECOND),
            load.known_energy,
        )
        for load in (report.loads if report is not None else ())
    ]
