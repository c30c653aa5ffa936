"""The report of a fleet for terminal and page, with its figures."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from datetime import UTC, datetime
from typing import Any

import numpy as np

from robot_energy.foundation.units import JOULE_PER_KWH, SECOND_NS
from robot_energy_fleet.results.fleet import (
    FleetFinding,
    FleetFriction,
    FleetReport,
    FrictionCurve,
    ModelError,
    RobotEnergy,
)
from robot_energy_identify.friction_and_thermal import FrictionReport
from robot_energy_report.canvas import (
    COLOURS,
    PART_COLOURS,
    SERIES,
    Target,
    canvas,
    named_ticks,
    panels,
)
from robot_energy_report.document import Column, Document, Tiles
from robot_energy_report.formats import (
    aligned,
    counted,
    fixed,
    number,
    percent,
    signed_percent,
    significant,
    some_names,
    uncertain,
    utc,
)
from robot_energy_report.headline import duration
from robot_energy_report.identification import friction_document
from robot_energy_report.page.settings import PageSettings

PANELS = 2  # in a row: they must be read on a phone
MAX_BARS = 40  # robots that are drawn
MAX_LINES = 6  # robots to look at, in a panel


def energy_of_robots(robots: Sequence[RobotEnergy], path: Target) -> None:
    """Draw the energy of every robot, standby apart."""
    drawn = sorted(robots, key=lambda one: -one.grid_energy)[:MAX_BARS]
    drawn.sort(key=lambda one: one.robot, reverse=True)
    with canvas(path, (8.0, 1.2 + 0.22 * len(drawn))) as figure:
        axes: Any = figure.subplots()
        places = np.arange(len(drawn))
        standby = np.array([one.standby_energy for one in drawn]) / JOULE_PER_KWH
        whole = np.array([one.grid_energy for one in drawn]) / JOULE_PER_KWH
        work = np.maximum(whole - standby, 0.0)
        axes.barh(places, work, color=PART_COLOURS["motion"], label="other than standby")
        axes.barh(places, standby, left=work, color=PART_COLOURS["cabinet"], label="standby")
        named_ticks(axes.yaxis, places, [one.robot for one in drawn])
        axes.grid(False, axis="y")
        axes.set_xlabel("energy from the grid, as recorded [kWh]")
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)


def friction_against_model(curves: Sequence[FrictionCurve], path: Target, weekly: bool) -> None:
    """Draw friction against the model, one panel for each joint.

    Over the motor temperature, or over time at equal temperature and speed.
    """
    names = [curve.joint for curve in curves]
    labels = "week, its middle" if weekly else "motor temperature [degC]", "friction / model"
    with panels(path, names, (2.8, 1.9), (0.5, 0.5), labels, PANELS) as (_, grid):
        for axes, curve in zip(grid, curves, strict=True):
            x: Any = curve.degc
            spread, lines = (curve.low, curve.middle, curve.high), curve.by_degc
            if weekly:
                x = [datetime.fromtimestamp(one / SECOND_NS, UTC) for one in curve.weeks_ns]
                spread = curve.week_low, curve.week_middle, curve.week_high
                lines = curve.by_week
            low, median, high = (np.array(values, dtype=np.float64) for values in spread)
            axes.fill_between(x, low, high, color=COLOURS["predicted"], alpha=0.15, linewidth=0)
            axes.plot(x, median, color=COLOURS["predicted"])
            named = zip(curve.robots[:MAX_LINES], lines[:MAX_LINES], strict=True)
            for number, (robot, values) in enumerate(named, 1):
                known, colour = np.array(values, dtype=np.float64), SERIES[number % len(SERIES)]
                axes.plot(x, known, "o-", color=colour, markersize=3, label=robot)
            if weekly:
                ticks = x[:: max(1, len(x) // 3)]
                axes.set_xticks(ticks, [f"{one:%b %d}" for one in ticks])
            axes.axhline(1.0, color="#9a9a9a", linewidth=0.8)
            if curve.robots:
                axes.legend(loc="best")


def error_by_temperature(errors: Sequence[ModelError], path: Target) -> None:
    """Draw the error of the model over the mean motor temperature of bags."""
    with canvas(path, (8.0, 2.6)) as figure:
        axes: Any = figure.subplots()
        degc = [0.5 * (one.low_degc + one.high_degc) for one in errors]
        middle, low, high = (
            100.0 * np.array(values)
            for values in zip(*((one.error, one.low, one.high) for one in errors), strict=True)
        )
        spread = np.maximum([middle - low, high - middle], 0.0)
        axes.errorbar(degc, middle, spread, fmt="o-", color=COLOURS["predicted"], capsize=3)
        axes.axhline(0.0, color="#9a9a9a", linewidth=0.8)
        axes.set_xlabel("mean motor temperature of a bag [degC]")
        axes.set_ylabel("predicted -\nmeasured [%]")


HOUR = 3600.0  # s
MAX_LISTED = 50  # bags that could not be read, and damaged ones
MAX_SENTENCES = 10  # on robots to look at; the table has all
WITHOUT_PRICES = PageSettings()


def fleet_document(
    report: FleetReport, page: Document, settings: PageSettings = WITHOUT_PRICES
) -> None:
    """Add the report of a fleet."""
    with page.only("page"):
        page.heading("At a glance")
        page.add(_tiles(report, settings))
    with page.only("terminal"):
        page.paragraph(fleet_headline(report))
    if report.damaged:
        page.paragraph(
            f"damaged or doubtful: {len(report.damaged)} of {counted(report.bags, 'bag')}; what "
            "was read counts, see the list under 'Data and method'",
            "problem",
        )
    _findings(report, page)
    _energy(report, page, settings)
    _friction(report, page)
    _errors(report, page)
    _method(report, page)


def fleet_headline(report: FleetReport) -> str:
    """Return the report in one line."""
    energy = sum(one.grid_energy for one in report.robots)
    standby = sum(one.standby_energy for one in report.robots)
    time = sum(one.observed_time for one in report.robots)
    concerned = some_names([one.robot for one in report.findings])
    look = f"look at {concerned}" if concerned else "no robot to look at"
    return (
        f"{counted(len(report.robots), 'robot')}, {counted(report.bags, 'bag')}, {duration(time)}: "
        f"{number(energy / JOULE_PER_KWH, 2)} kWh from the grid, predicted, "
        f"{percent(standby / energy if energy else None)} of it in standby; "
        + (look if _is_compared(report) else "no robot could be compared")
    )


def _is_compared(report: FleetReport) -> bool:
    """Whether any robot could be compared, with sisters or with itself before."""
    return report.compared_with_sisters + report.compared_with_before > 0


def fleet_friction_document(report: FleetFriction, page: Document) -> None:
    """Add the friction of a fleet, and how good it is on bags that the fit has not seen."""
    page.paragraph(
        f"{counted(report.bags, 'bag')} of {counted(report.robots, 'robot')}"
        + (f", without {', '.join(report.left_out)}, which differ" if report.left_out else "")
    )
    friction_document(FrictionReport("measured", report.axes, report.refused), page)
    page.rows(
        "Friction torque of the last fifth of the time, which its fit has not seen",
        [
            Column("axis", "joint"),
            Column("RMS error", "rms", significant(3), "N m"),
            Column("before", "rms_before", significant(3), "N m"),
            Column("friction energy", "energy_error", signed_percent),
            Column("before", "energy_error_before", signed_percent),
        ],
        report.held_out,
    )


def _tiles(report: FleetReport, settings: PageSettings) -> Tiles:
    energy = sum(one.grid_energy for one in report.robots)
    observed = sum(one.observed_time for one in report.robots)
    standby = sum(one.standby_energy for one in report.robots)
    time = sum(one.standby_time for one in report.robots)
    found = [
        _tile_of_robots(report),
        (
            "Energy from the grid",
            f"{number(energy / JOULE_PER_KWH, 2)} kWh",
            f"predicted, {counted(report.bags, 'bag')} of {duration(observed)} in all",
        ),
        (
            "Standby",
            f"{number(standby / JOULE_PER_KWH, 2)} kWh",
            f"{percent(standby / energy if energy else None)} of the energy, "
            f"{duration(time)} at rest with drives on",
        ),
        ("Prediction against meter", signed_percent(_error(report)), "all bags with a meter"),
    ]
    cost = [one.cost for one in report.shifts]
    if cost and None not in cost:
        wasted = sum(one.standby_cost or 0.0 for one in report.shifts)
        found.append(
            (
                "Cost",
                f"{sum(one or 0.0 for one in cost):.2f} {settings.currency}",
                f"{wasted:.2f} {settings.currency} of it in standby",
            )
        )
    if settings.co2_kg_per_kwh is not None:
        mass = energy / JOULE_PER_KWH * settings.co2_kg_per_kwh
        source = f", {settings.co2_source}" if settings.co2_source else ""
        found.append(("CO\u2082", f"{mass:.2f} kg", f"{settings.co2_kg_per_kwh:g} kg/kWh{source}"))
    return Tiles(found)


def _tile_of_robots(report: FleetReport) -> tuple[str, str, str]:
    label, robots = "Robots to look at", counted(len(report.robots), "robot")
    if not _is_compared(report):
        few = f"too few robots or bags: {robots}, {counted(report.bags, 'bag')}"
        return label, "not compared", few
    concerned = dict.fromkeys(one.robot for one in report.findings)
    partly = (
        f"compared with sisters: {report.compared_with_sisters}, with themselves before: "
        f"{report.compared_with_before}"
    )
    none = partly if report.not_compared else "none differs or has changed"
    return label, f"{len(concerned)} of {len(report.robots)}", some_names(concerned) or none


def _error(report: FleetReport) -> float | None:
    pairs = [
        (one.measured_energy, one.error)
        for one in report.robots
        if one.measured_energy is not None and one.error is not None
    ]
    measured = sum(one for one, _ in pairs)
    return sum(one * (1.0 + error) for one, error in pairs) / measured - 1.0 if measured else None


def _findings(report: FleetReport, page: Document) -> None:
    page.heading("Robots to look at")
    if not report.findings:
        page.paragraph(_nothing_found(report))
    page.notes(report.not_compared)
    for one in report.findings[:MAX_SENTENCES]:
        good = one.kind in ("wear", "energy", "friction") and one.size < 0
        page.paragraph(f"{one.robot}: {one.sentence}", "note" if good else "problem")
    if more := len(report.findings[MAX_SENTENCES:]):
        page.paragraph(f"{counted(more, 'finding')} more in the table")
    page.rows(
        "How much, and how sure",
        [
            Column("robot", "robot"),
            Column("cause", lambda one: "energy of a job" if one.kind == "energy" else one.kind),
            Column("of", lambda one: one.subject or None),
            Column("size", _size),
            Column(
                "certainty",
                "certainty",
                lambda sure: "> 99.99 %" if sure > 0.9999 else percent(sure, digits=2),
            ),
            Column("since, UTC", lambda one: utc(one.since_ns, "%F")),
        ],
        report.findings,
    )


def _nothing_found(report: FleetReport) -> str:
    if report.compared_with_sisters and report.compared_with_before:
        return "No robot differs from its sisters, and none has changed."
    if report.compared_with_sisters:
        return "No robot differs from its sisters."
    return "No robot has changed." if report.compared_with_before else "No robot was compared."


def _size(one: FleetFinding) -> str:
    unit = {"payload": " kg", "standby": " h a day"}.get(one.kind, " %")
    factor = 100.0 if unit == " %" else 1.0
    text = uncertain(factor * one.size, factor * one.std if one.std else 0.0)
    return f"{'+' if one.size > 0 else ''}{text}{unit}"


def _energy(report: FleetReport, page: Document, settings: PageSettings) -> None:
    page.heading("Energy")
    kwh = aligned([one.grid_energy / JOULE_PER_KWH for one in report.robots], 4)
    priced = any(one.standby_cost is not None for one in report.robots)

    def cost(heading: str, name: str) -> list[Column]:
        return [Column(heading, name, fixed(2), settings.currency, total=True)] if priced else []

    time = Column("recorded", lambda one: one.observed_time / HOUR, fixed(2), "h", total=True)
    energy = Column("energy", lambda one: one.grid_energy / JOULE_PER_KWH, kwh, "kWh", total=True)
    standby = [
        Column("standby", lambda one: one.standby_time / HOUR, fixed(2), "h", total=True),
        Column("energy in\nstandby", lambda one: one.standby_energy / JOULE_PER_KWH, kwh, "kWh",
               total=True),
        *cost("its cost", "standby_cost"),
    ]  # fmt: skip
    page.figure(
        lambda path: energy_of_robots(report.robots, path),
        "Energy from the grid of every robot, in what was recorded of it; standby is rest with "
        "drives on for a minute or more.",
    )
    page.rows(
        "Robots",
        [
            Column("", "robot"),
            Column("bags", "bags", total=True),
            time,
            energy,
            Column("error against\nthe meter", "error", signed_percent),
            Column("jobs", "jobs", total=True),
            *standby,
        ],
        report.robots,
        "all",
    )
    page.rows(
        "Programmes: energy of a job from the grid, predicted",
        [
            Column("", "name"),
            Column("robots", "robots"),
            Column("jobs", "jobs"),
            Column("mean time", "mean_time", fixed(2), "s"),
            Column("mean", lambda one: one.mean_energy / HOUR, significant(4), "Wh"),
            Column("lowest robot", lambda one: one.lowest / HOUR, significant(4), "Wh"),
            Column("highest robot", lambda one: one.highest / HOUR, significant(4), "Wh"),
            Column("error against\nthe meter", "error", signed_percent),
        ],
        report.programmes,
    )
    page.rows(
        f"Shifts, {settings.timezone}",
        [Column("", "name"), time, energy, *cost("cost", "cost"), *standby],
        report.shifts,
        "all",
    )
    page.paragraph("A rest counts as standby of the hour in which it has lasted a minute.")


def _friction(report: FleetReport, page: Document) -> None:
    by_degc = [one for one in report.friction if _is_seen(one.middle, *one.by_degc)]
    by_week = [one for one in report.friction if _is_seen(one.week_middle, *one.by_week)]
    if not by_degc:
        return
    with page.only("page"):
        page.heading("Friction against the model")
        page.figure(
            lambda path: friction_against_model(by_degc, path, weekly=False),
            "Measured friction torque over that of the model, by mean motor temperature of a "
            "bag: median of the robots, the middle eight tenths of them, and the first six robots "
            "to look at.",
        )
        if by_week:
            page.figure(
                lambda path: friction_against_model(by_week, path, weekly=True),
                "The same over time, at equal temperature and speed.",
            )


def _is_seen(*lines: Sequence[float | None]) -> bool:
    return any(value is not None for line in lines for value in line)


def _errors(report: FleetReport, page: Document) -> None:
    if not report.model_errors:
        return
    page.heading("Error of the model by temperature")
    page.figure(
        lambda path: error_by_temperature(report.model_errors, path),
        "Predicted minus measured energy, and the middle eight tenths of the bags.",
    )
    page.rows(
        "Predicted minus measured energy, by mean motor temperature of a bag",
        [
            Column("from", "low_degc", fixed(0), "degC"),
            Column("to", "high_degc", fixed(0), "degC"),
            Column("bags", "bags"),
            Column("error", "error", signed_percent),
            Column("lowest tenth\nbelow", "low", signed_percent),
            Column("highest tenth\nabove", "high", signed_percent),
        ],
        report.model_errors,
    )


def _method(report: FleetReport, page: Document) -> None:
    with nullcontext() if report.notes or report.refused or report.damaged else page.only("page"):
        page.heading("Data and method")
    page.notes(report.notes)
    bag = [Column("bag", "bag"), Column("robot", "robot")]
    page.rows(
        f"Bags that could not be read: {_listed(report.refused)}",
        [*bag, Column("reason", "reason")],
        report.refused[:MAX_LISTED],
    )
    page.rows(
        f"Damaged bags, and doubtful joint states; what was read counts: {_listed(report.damaged)}",
        [*bag, Column("what is wrong", lambda one: "; ".join(one.problems))],
        report.damaged[:MAX_LISTED],
    )
    with page.only("page"):
        page.pairs(
            [
                ("dataset", report.dataset),
                ("from, to (UTC)", f"{utc(report.start_ns)} to {utc(report.end_ns)}"),
                ("models", ", ".join(report.model_ids)),
                ("kinds of figures compared", str(report.comparisons)),
            ]
        )
        page.paragraph(
            "Robots with the same model are compared by payload, friction of each joint, standby "
            "and energy of a job, in the last quarter of the time, with the effects of temperature "
            "and speed removed. A robot is listed if chance alone would make any robot differ so "
            "much in fewer than one of a hundred reports, over all comparisons. When a joint "
            "reverses, the torque of a load that the model lacks keeps its sign and that of "
            "friction changes it: so a wrong payload is not reported as wear. "
            "A change of friction is found by the test of the live monitor, over all bags."
        )


def _listed(bags: Sequence[object]) -> str:
    return f"{len(bags)}" + (f", the first {MAX_LISTED}" if len(bags) > MAX_LISTED else "")
