"""What a report says of the loads outside of the cabinet."""

from __future__ import annotations

from robot_energy.blocks import NANOSECOND
from robot_energy.page.energy_flow import known_label
from robot_energy.report.document import Column, Document
from robot_energy.report.formats import (
    EnergyFormat,
    fixed,
    percent,
    seconds,
)
from robot_energy.results.auxiliary import AuxiliaryReport, LoadEnergy


def auxiliary_section(page: Document, report: AuxiliaryReport | None) -> None:
    """Add the loads, their states and the balance of the outlet.

    Args:
        page: Where to.
        report: What to say; None says nothing.
    """
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
    if rows:
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
    """Return name and known energy of each load for the picture of the flows. [J]

    Args:
        report: The loads; None for none.
    """
    return [
        (
            known_label(load.name, load.known_ns * NANOSECOND, load.missing_ns * NANOSECOND),
            load.known_energy,
        )
        for load in (report.loads if report is not None else ())
    ]
