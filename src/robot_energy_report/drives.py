"""What was found of the drives: losses and maps of each, losses behind one meter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot_energy.foundation.errors import ShapeError
from robot_energy.model.drive_models import DRIVE_MODELS, EfficiencyMap
from robot_energy.results.base import known
from robot_energy_identify.drives.all_drives import DrivesReport, LossTerm, TotalPower
from robot_energy_identify.drives.drives import WAYS, AxisFit, DrivesFit
from robot_energy_identify.drives.losses import TERMS
from robot_energy_identify.drives.total_sums import COEFFICIENTS
from robot_energy_identify.stats.lag import Delay
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
from robot_energy_report.identification import AT_BOUND, HELD_OUT, delay_lines

WAY_NAMES = {
    "none": "no efficiency",
    "constant": "constant 87.5 %, as in paper B",
    "constant_fitted": "constant, fitted to all drives",
    "map": "efficiency map, as run",
    "map_processed": "map, power processed",
    "losses": "loss model",
}
SPLIT_NAMES = {"blocks": "5 blocks", "recordings": "recordings", "beyond": "beyond 60 %"}
TOTAL_NAMES = {
    "constant": "a constant",
    "shaft": "shaft power and a constant",
    "given": "the model as given",
    "shared": "losses, shared by all axes",
    "axis_copper": "losses, copper of each axis",
    "axis": "losses of each axis",
    "identified": "identified",
    "drives_measured": "measured drives and a constant",
}
STRUCTURE_NAMES = {**TOTAL_NAMES, "shaft": "shaft power alone"}
UNITS = {"constant": "W", "copper": "W/(N m)^2", "linear": "W s/rad", "quadratic": "W s^2/rad^2"}


def drives_document(report: DrivesReport, page: Document) -> None:
    """Add all that was found of the drives."""
    if report.drives is not None:
        _drives(report.drives, report.delay, page)
    if report.total is not None:
        _total(report.total, page)
    page.notes(report.notes)


def mapped(fit: DrivesFit | None) -> list[AxisFit]:
    """Return the axes with an efficiency map."""
    return [] if fit is None else [axis for axis in fit.axes if axis.map is not None]


def _drives(fit: DrivesFit, delay: Delay | None, page: Document) -> None:
    page.rows(
        "Losses of the drives, without shaft power",
        [
            Column("axis", "name"),
            *(
                Column(term, lambda axis, term=term: _loss(axis, term), unit=UNITS[term])
                for term in TERMS
            ),
        ],
        [axis for axis in fit.axes if axis.losses is not None],
    )
    page.rows(
        f"Reduced efficiency maps, P_mech / P_el, low-pass {fit.cutoff:g} Hz",
        [
            Column("axis", "name"),
            Column("samples", lambda axis: axis.map.samples),
            Column("outliers", lambda axis: axis.map.removed, percent),
            Column("points", lambda axis: len(axis.map.entry.efficiency)),
            Column("median, motor", lambda axis: known(axis.map.motor_efficiency), significant(3)),
            Column(
                "median, generator",
                lambda axis: known(axis.map.generator_efficiency),
                significant(3),
            ),
        ],
        mapped(fit),
    )
    for title, key, form in (
        (
            "Energy accuracy on held-out data, 1 - |E - E_measured| / E_measured",
            "accuracy",
            percent,
        ),
        ("RMS error of the power of a drive on held-out data [W]", "rms", significant(4)),
    ):
        page.rows(
            title,
            [
                Column("prediction", lambda way: WAY_NAMES.get(way) or DRIVE_MODELS[way].label),
                *(
                    Column(
                        SPLIT_NAMES[one.split],
                        lambda way, one=one, key=key: getattr(one.scores.get(way), key, None),
                        form,
                    )
                    for one in fit.comparisons
                ),
            ],
            list(dict.fromkeys((*WAYS, *(way for one in fit.comparisons for way in one.scores)))),
        )
    page.paragraph(
        "held out: contiguous blocks, whole recordings, samples beyond 60 % of the greatest "
        "speed or torque"
    )
    missing = set(SPLIT_NAMES) - {one.split for one in fit.comparisons}
    if missing:
        names = ", ".join(text for name, text in SPLIT_NAMES.items() if name in missing)
        page.paragraph(f"too few recordings or samples to hold out: {names}")
    delay_lines("the power", delay, None, page)
    chosen = DRIVE_MODELS[fit.chosen].label
    page.paragraph(f"the {chosen} is taken, by its held-out RMS error")
    if delay is not None and delay.at_edge:
        page.note(
            f"power and joint states may be shifted by more than {1e3 * delay.span:.0f} ms: check "
            "that both have one clock"
        )
    page.notes(grouped([note for axis in fit.axes for note in axis.notes]))
    axes = mapped(fit)
    if axes:
        page.figure(
            lambda path: efficiency_maps(axes, path),
            "Reduced efficiency maps in four quadrants, with their points.",
        )


def _loss(axis: Any, term: str) -> str:
    losses = axis.losses
    return _figure(losses.values[term], known(losses.std[term]), term in losses.negative)


def _figure(value: float, std: float | None, at_bound: bool = False) -> str:
    if at_bound:
        return AT_BOUND
    if std is None:
        return "not determined"
    return uncertain(value, std)


def _total(total: TotalPower, page: Document) -> None:
    place = {"GRID": "the grid", "DC_BUS": "the DC bus"}.get(total.location.name, "one place")

    page.rows(
        f"Measured power at {place}, {total.readings} readings in "
        f"{counted(total.recordings, 'recording')}, {total.duration:.1f} s; "
        f"{HELD_OUT[total.held_out]} held out",
        [
            Column("prediction", lambda entry: TOTAL_NAMES[entry[0]]),
            Column("RMS", lambda entry: entry[1].rms, fixed(2), "W"),
            Column("energy", lambda entry: entry[1].energy_error, percent),
            Column("worst", lambda entry: entry[1].worst, signed_percent),
        ],
        list(total.ways.items()),
    )
    constant = _figure(total.constant, total.constant_std, not total.constant)
    page.rows(
        f"Losses from all recordings: {STRUCTURE_NAMES[total.structure]}; constant {constant} W",
        [
            Column("axis", "name"),
            *(Column(term, term, _term, UNITS[term]) for term in COEFFICIENTS),
        ],
        total.axes,
    )
    delay_lines("the meter", total.meter_delay, total.meter_time_constant, page)
    page.notes(total.notes)


def _term(term: LossTerm) -> str:
    return _figure(term.value, term.std, term.at_bound)


LEVELS = np.linspace(-0.5, 1.5, 21)
MIN_POINTS = 4  # of a surface


def efficiency_maps(axes: Sequence[AxisFit], path: Target, title: str = "") -> None:
    """Draw the map of every axis."""
    maps = {axis.name: axis.map.entry for axis in axes if axis.map is not None}
    if not maps:
        raise ShapeError("no efficiency map to draw", "measured power of the drives")
    labels = "motor velocity [rad/s]", "motor torque [N m]"
    with panels(path, [*maps], (3.2, 2.8), (1.2, 0.6), labels, title=title) as (figure, grid):
        surface: Any = None
        for panel, entry in zip(grid, maps.values(), strict=True):
            surface = _map(panel, entry) or surface
        if surface is not None:
            bar = figure.colorbar(surface, ax=figure.axes, shrink=0.9)
            bar.set_label("efficiency, mechanical over electrical power")


def _map(panel: Any, entry: EfficiencyMap) -> Any:
    from matplotlib.tri import Triangulation

    speed, torque = np.asarray(entry.motor_velocity), np.asarray(entry.motor_torque)
    eta = np.clip(np.asarray(entry.efficiency), LEVELS[0], LEVELS[-1])
    surface = None
    if len(eta) >= MIN_POINTS and min(float(np.ptp(speed)), float(np.ptp(torque))) > 0:
        shape: Any = Triangulation(speed / np.ptp(speed), torque / np.ptp(torque))
        flat: Any = Triangulation(speed, torque, shape.triangles)
        surface = panel.tricontourf(flat, eta, levels=LEVELS, cmap="viridis", extend="both")
    panel.plot(speed, torque, ".", color=COLOURS["measured"], markersize=1.5)
    panel.axhline(0.0, color=COLOURS["measured"], linewidth=0.6)
    panel.axvline(0.0, color=COLOURS["measured"], linewidth=0.6)
    return surface
