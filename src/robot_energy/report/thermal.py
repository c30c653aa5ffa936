"""What `identify thermal` found."""

from __future__ import annotations

from robot_energy.identify.thermal.network import ThermalFit
from robot_energy.report.document import Column, Document
from robot_energy.report.formats import fixed, grouped, uncertain
from robot_energy.results.thermal import ThermalReport


def thermal_document(report: ThermalReport, page: Document) -> None:
    """Add the thermal networks of the motors.

    Args:
        report: What was found.
        page: Where to.
    """
    unit = "J/K" if report.heat == "losses" else "A2 s/K"
    page.rows(
        f"Thermal networks, air at {report.ambient_degc:.1f} degC",
        [
            Column("motor", "name"),
            Column("heat capacity", lambda fit: _figure(fit, "capacity"), unit=unit),
            Column(
                "time constant", lambda fit: fixed(0)(fit.motor_time_constant / 60.0), unit="min"
            ),
            Column("structure", lambda fit: _figure(fit, "structure_capacity"), unit=unit),
            Column("seen at", lambda fit: "{:.0f} to {:.0f} degC".format(*fit.range_degc)),
            Column("hours", "hours", fixed(1)),
        ],
        report.axes,
    )
    page.rows(
        "RMS error of a free run on temperatures that the fit has not seen [K]",
        [
            Column("motor", "name"),
            Column("tested on", "held_out"),
            *(
                Column(order, lambda fit, order=order: fit.orders[order], fixed(2))
                for order in ("one node", "two nodes")
            ),
            Column("chosen", "rms", fixed(2)),
            Column("first reading held", "held_rms", fixed(2)),
        ],
        report.axes,
    )
    page.notes(grouped(list(report.refused)))


def _figure(fit: ThermalFit, key: str) -> str | None:
    figure = getattr(fit.network, key)
    return None if figure is None else uncertain(figure.value, figure.std or 0.0)
