"""What `identify friction` and `identify cabinet` found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from robot_energy.foundation.errors import ShapeError
from robot_energy.model.friction_laws import FRICTION_LAWS
from robot_energy.physics.friction import viscous_law
from robot_energy_identify.auxiliary import LoadStatesReport
from robot_energy_identify.cabinet.cabinet import CabinetFit, Level
from robot_energy_identify.cabinet.dc_link import LinkFit
from robot_energy_identify.cabinet.fan import UNTIL_IT_RUNS
from robot_energy_identify.cabinet.supply import CabinetReport
from robot_energy_identify.cabinet.thermometers import REST_FIRST
from robot_energy_identify.friction.friction import FrictionFit
from robot_energy_identify.friction.hold import HoldFit
from robot_energy_identify.friction.laws import fitted_laws
from robot_energy_identify.friction.temperature_study import FrictionStudyReport
from robot_energy_identify.friction.torque_constants import FallingConstant
from robot_energy_identify.friction_and_thermal import FrictionReport, ThermalReport
from robot_energy_identify.stats.lag import Delay
from robot_energy_identify.thermal.gear import GearsFound
from robot_energy_identify.thermal.network import ThermalFit
from robot_energy_report.canvas import COLOURS, Target, panels
from robot_energy_report.document import Column, Document
from robot_energy_report.formats import (
    counted,
    fixed,
    grouped,
    percent,
    signed_percent,
    significant,
    uncertain,
)

AT_BOUND = "0, at bound"
MILLI = 1e3
BEYOND = 5.0  # K drawn outside the fitted range, where the edge is held
LAW_COLOURS = {"constant": COLOURS["fixed"], "exponential": COLOURS["predicted"]}
UNKNOWN_DEGC = (20.0, 60.0)  # drawn for a constant of an axis without temperatures
TABLE_COLOUR = "#009e73"
HELD_OUT = {
    "recordings": "whole recordings",
    "blocks": "contiguous blocks",
    "temperatures": "temperatures",
}


def friction_document(report: FrictionReport, page: Document) -> None:
    """Add the friction of every axis, with its figure."""
    friction_tables(report, page)
    page.figure(
        lambda path: friction_over_temperature(report.axes, path, report.torque_unit),
        "Viscous friction over motor temperature: free points and the laws that competed on "
        "what their fits have not seen.",
    )


def friction_over_temperature(
    fits: Sequence[FrictionFit], path: Target, unit: str = "N m", title: str = ""
) -> None:
    """Draw points and laws of every axis."""
    if not fits:
        raise ShapeError("no axis to draw", "at least one")
    names = [f"{fit.name}: Coulomb {fit.coulomb:.3g} {unit}" for fit in fits]
    labels = "motor temperature [degC]", f"viscous [1e-3 {unit} s/rad]"
    with panels(path, names, (3.2, 2.6), (0.8, 0.6), labels, title=title) as (_, grid):
        for axes, fit in zip(grid, fits, strict=True):
            _axis(axes, fit)
        grid[0].legend(loc="best")


def _axis(axes: Any, fit: FrictionFit) -> None:
    low, high = fit.range_degc if np.isfinite(fit.range_degc).all() else UNKNOWN_DEGC
    degc = np.linspace(low - BEYOND, high + BEYOND, 200)
    for name, law in fit.laws.items():
        chosen = name == fit.chosen
        axes.plot(
            degc,
            MILLI * viscous_law(law).viscous(degc),
            "-" if chosen else ":",
            color=LAW_COLOURS.get(name, TABLE_COLOUR),
            label=f"{name}{', chosen' if chosen else ''}",
        )
    axes.errorbar(
        [point.motor_temperature_degc for point in fit.points],
        [MILLI * point.viscous for point in fit.points],
        [2 * MILLI * point.std if np.isfinite(point.std) else 0.0 for point in fit.points],
        fmt="o",
        color=COLOURS["measured"],
        markersize=4,
        capsize=2,
        linewidth=1,
        label="points, 2 std",
    )
    axes.margins(y=0.15)
    axes.set_ylim(bottom=0.0)


def friction_tables(report: FrictionReport, page: Document) -> None:
    """Add the friction of every axis."""
    unit = report.torque_unit
    page.rows(
        "Friction over motor temperature, "
        + ("as logged" if report.effort == "log" else "motor side"),
        [
            Column("axis", "name"),
            Column(
                "Coulomb",
                lambda fit: (
                    uncertain(fit.coulomb, fit.coulomb_std) if fit.coulomb > 0 else AT_BOUND
                ),
                unit=unit,
            ),
            Column("viscous", _law, unit=f"1e-3 {unit} s/rad"),
            Column("Stribeck", _stribeck, unit=unit, optional=True),
            Column("of the load", _by_load, optional=True),
            Column("exponent", _exponent, optional=True),
            Column("fitted at", _fitted_at),
        ],
        report.axes,
    )
    coulomb = {fit.name: fit.parts["coulomb"] for fit in report.axes if "coulomb" in fit.parts}
    _deviations_table(f"{unit}, Coulomb", coulomb, page)
    page.rows(
        f"RMS torque error on what the fit has not seen [{unit}]",
        [
            Column("axis", "name"),
            Column("held out", lambda fit: HELD_OUT[fit.held_out]),
            Column("samples", "samples"),
            *(
                Column(
                    FRICTION_LAWS[law].label,
                    lambda fit, law=law: fit.errors[law].rms if law in fit.errors else None,
                    significant(4),
                )
                for law in fitted_laws()
            ),
            Column("chosen", "chosen"),
        ],
        report.axes,
    )
    warnings = [text for fit in report.axes for text in fit.warnings]
    page.notes(grouped([*warnings, *report.refused, *report.apart]))
    gear_tables(report.gears, page)
    if report.falls:
        page.notes([falls_words(report.falls)])
    if report.hold is not None:
        page.notes([hold_words(report.hold)])


def falls_words(falls: Sequence[FallingConstant]) -> str:
    """Return by how much torque constants fall, in one sentence."""
    each = (
        f"{one.name} {uncertain(100.0 * one.fall.value, 100.0 * (one.fall.std or 0.0))} %/K"
        for one in falls
    )
    return (
        "measured torque grows with the motor temperature, as of weaker magnets, so torque "
        f"constants fall: {', '.join(each)}"
    )


def hold_words(hold: HoldFit) -> str:
    """Return what motors hold at rest, in one sentence."""
    kept, carried = uncertain(*hold.kept), uncertain(*hold.carried)
    static = "it"
    if hold.static is not None:
        low, high = min(hold.static), max(hold.static)
        static = f"static friction ({low:.2f} to {high:.2f} of the Coulomb torque)"
    return (
        f"at rest motors hold the load within {hold.std:.2f} of the Coulomb torque "
        f"({hold.load_std:.2f} for the load alone): {kept} of {static} stays in the direction of "
        f"the last motion, {carried} carries the load; {hold.rests} rests"
    )


def gear_tables(gears: GearsFound, page: Document) -> None:
    """Add the temperatures of gears, and why others were not found."""
    if gears.fits:
        page.rows(
            "Gears that warm by their own friction: friction follows their temperature, which "
            f"begins at that of the motor; air at {gears.ambient_degc:.1f} degC",
            [
                Column("gear", "name"),
                Column(
                    "time constant",
                    lambda fit: uncertain(*(each / 60.0 for each in fit.time_constant)),
                    unit="min",
                ),
                Column("rise at work", lambda fit: uncertain(*fit.rise), unit="K"),
                Column("friction work, gear", "error", percent),
                Column("motor", "motor_error", percent),
                Column("hours", "hours", fixed(1)),
            ],
            gears.fits,
        )
        page.notes(
            ["error (RMS) of the friction work of a minute that the fit has not seen, with "
             "friction that follows the gear and the motor"]
        )  # fmt: skip
    page.notes(grouped(gears.refused))


def _stribeck(fit: FrictionFit) -> str | None:
    term = fit.stribeck
    if term is None:
        return None
    torque = uncertain(term.torque.value, term.torque.std or 0.0)
    return f"{torque}, at {term.velocity.value:.3g} rad/s"


def _by_load(fit: FrictionFit) -> str | None:
    if fit.load is None:
        return None
    share, std, saturation = fit.load
    text = f"{100.0 * share:.1f} +- {100.0 * std:.1f} %"
    return f"{text}, up to {saturation:.3g} N m" if np.isfinite(saturation) else text


def _exponent(fit: FrictionFit) -> str | None:
    if fit.exponent is None:
        return None
    exponent, std, velocity = fit.exponent
    return f"{uncertain(exponent, std)}, from {velocity:.3g} rad/s"


def _fitted_at(fit: FrictionFit) -> str | None:
    low, high = fit.range_degc
    return f"{low:.0f} to {high:.0f} degC" if np.isfinite(low) else None


def _law(fit: FrictionFit) -> str:
    law = fit.law.model_dump(mode="json", exclude_none=True)
    return FRICTION_LAWS[law["law"]].text(law)


def study_document(report: FrictionStudyReport, page: Document) -> None:
    """Add tests on temperatures that were not seen."""
    for entry in report.studies:
        study = entry.study
        page.rows(
            f"{entry.name}: fitted at {study.train} ({study.trained} samples), "
            f"tested at {study.test} ({study.tested} samples)",
            [
                Column("viscous friction", "law"),
                Column("outside its range", "beyond"),
                Column("RMS error", "rms", significant(4)),
                Column("friction power", "power_bias", signed_percent),
            ],
            study.rows,
        )
        page.notes(study.refused)
        if entry.gain is not None and entry.median_gain is not None:
            page.paragraph(
                f"RMS of the exponential law over the constant: {entry.gain:.2f}; with "
                f"temperatures shuffled between runs {entry.median_gain:.2f} (median of "
                f"{entry.shuffles}), at best {entry.least_gain:.2f}"
            )


def cabinet_document(report: CabinetReport, page: Document) -> None:
    """Add constant losses and DC link."""
    losses_section(report.losses, page)
    delay_lines("the meter", report.meter_delay, report.meter_time_constant, page)
    if report.link is not None:
        link_section(report.link, page)
    if report.link_reason:
        page.note(f"DC link as given: {report.link_reason}")
    if report.link_note:
        page.note(report.link_note)


def losses_section(fit: CabinetFit, page: Document) -> None:
    """Add the constant losses."""

    def row(name: str, found: Level | None) -> tuple[str, ...]:
        if found is None:
            return name, "-", "0", "0", "-"
        power = uncertain(found.power, found.std)
        return name, power, str(found.readings), str(found.events), f"{found.spread:.1f}"

    def loss(value: float | None, std: float | None) -> str:
        if value is None:
            return "-"
        return uncertain(value, std or 0.0) if value > 0.0 else AT_BOUND

    page.table(
        "Measured power while it is constant, less what the drives take [W]",
        ("phase", "power", "readings", "events", "greatest difference"),
        [row("HOLD", fit.hold), row("GENERATING", fit.generating)],
    )
    page.table(
        "Constant losses [W]",
        ("side", "loss"),
        [
            ("grid", loss(fit.loss_grid, fit.loss_grid_std)),
            ("DC", loss(fit.loss_dc, fit.loss_dc_std)),
        ],
    )
    _deviations_table("W", fit.parts, page)
    page.notes(fit.notes)
    fan = fit.fan
    if fan is not None:
        shown = f"{fan.rests} rests of {counted(fan.recordings, 'recording')}; with a meter for "
        shown += "all drives its power is then fitted together with their losses"
        if not fan.rests:
            shown = "levels of the power in recordings with it and without it; "
            shown += f"{UNTIL_IT_RUNS} to find both more exactly"
        page.note(
            f"a fan takes {uncertain(fan.power, fan.std)} W once the warmest motor is above "
            f"{uncertain(fan.on_above_degc, fan.on_std)} degC: {shown}"
        )
        if fan.thermometers is None:
            page.note(f"which motor is the warmest is not sure: thermometers differ; {REST_FIRST}")
    elif fit.fan_reason:
        page.note(f"fan: {fit.fan_reason}")


def _deviations_table(unit: str, parts: Mapping[str, Mapping[str, float]], page: Document) -> None:
    causes = list(dict.fromkeys(cause for own in parts.values() for cause in own))
    if not causes:
        return
    page.table(
        f"Standard deviations by cause [{unit}]",
        ("figure", *causes),
        [
            (
                name.replace("_", " "),
                *(f"{own[cause]:.2g}" if cause in own else "-" for cause in causes),
            )
            for name, own in parts.items()
        ],
    )


def link_section(fit: LinkFit, page: Document) -> None:
    """Add the energy of the DC link."""
    page.paragraph(
        "energy of the DC link between rectified and chopper voltage: "
        f"{uncertain(fit.energy, fit.std)} J, 95 % interval {fit.interval[0]:.0f} to "
        f"{fit.interval[1]:.0f} J; full {fit.events} times, empty again "
        f"{fit.emptying:.2g} s after it begins to fill (median)"
    )
    _deviations_table("J", {"energy": fit.parts}, page)
    page.rows(
        f"Power at the grid, {fit.readings} readings of {fit.spacing:.2g} s; "
        f"{HELD_OUT[fit.held_out]} held out, drives and constants as fitted to all",
        [
            Column("DC link", lambda entry: entry[0]),
            Column("RMS [W]", lambda entry: entry[1].rms, fixed(2)),
            Column("energy", lambda entry: entry[1].energy_error, percent),
        ],
        [("as given", fit.given), ("identified", fit.identified)],
    )
    page.paragraph(
        "if the constant of the DC side were free as well, it would change by "
        f"{uncertain(fit.loss_dc_shift, fit.loss_dc_shift_std)} W; it stays"
    )


def delay_lines(what: str, delay: Delay | None, low_pass: Delay | None, page: Document) -> None:
    """Add a delay behind the joint states, and the time constant of a low pass, a line each."""
    found = {f"delay of {what} behind the joint states": delay, f"low pass in {what}": low_pass}
    for name, one in found.items():
        if one is None:
            continue
        if one is low_pass and one.value == 0.0:
            page.paragraph(f"no {name} lowers the held-out error")
        else:
            page.paragraph(
                f"{name}: {uncertain(1e3 * one.value, 1e3 * one.std)} ms would lower the held-out "
                f"error by {percent(one.gain)}: {delay_use(one, 'undone')}"
            )


def delay_use(delay: Delay, done: str) -> str:
    """Return what was done about a delay."""
    if delay.at_edge:
        return f"not applied, at the limit of the search of {1e3 * delay.span:g} ms"
    return done if delay.applied else "not applied"


def thermal_document(report: ThermalReport, page: Document) -> None:
    """Add the thermal networks of the motors."""
    unit = "J/K" if report.heat == "losses" else "A2 s/K"
    page.rows(
        f"Thermal networks, air at {report.ambient_degc:.1f} degC",
        [
            Column("motor", "name"),
            Column("heat capacity", lambda fit: _thermal_figure(fit, "capacity"), unit=unit),
            Column(
                "time constant",
                lambda fit: fixed(0)(fit.motor_time_constant / 60.0),
                unit="min",
            ),
            Column("structure", lambda fit: _thermal_figure(fit, "structure_capacity"), unit=unit),
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
    gear_tables(report.gears, page)


def _thermal_figure(fit: ThermalFit, key: str) -> str | None:
    figure = getattr(fit.network, key)
    return None if figure is None else uncertain(figure.value, figure.std or 0.0)


def states_document(report: LoadStatesReport, page: Document) -> None:
    """Add the identified powers of states."""
    page.table(
        "Power of each state [W]",
        ("load", "state", "power", "given", "readings", "times", "by"),
        [
            (
                one.load,
                one.state,
                fixed(1)(one.power) if one.std is None else uncertain(one.power, one.std),
                fixed(1)(one.before),
                str(one.readings),
                str(one.visits),
                fit.source,
            )
            for fit in report.fits
            for one in fit.states
        ],
    )
    rows = [
        (
            ", ".join(fit.loads),
            held.what,
            fixed(1)(held.rms),
            fixed(1)(held.rms_before),
            signed_percent(held.energy_error),
            "yes" if fit.used else "no",
        )
        for fit in report.fits
        if (held := fit.held_out) is not None
    ]
    columns = ("load", "held out", "RMS [W]", "with the given model", "energy", "used")
    page.table("What the fit has not seen: predicted minus measured", columns, rows)
    page.notes([note for fit in report.fits for note in fit.notes] + list(report.refused))
