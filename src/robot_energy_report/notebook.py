"""Results and models in a notebook: as HTML, and drawn on axes of matplotlib."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from robot_energy.certainty.deviation import Z90
from robot_energy.certainty.friction_certainty import FrictionCertainty
from robot_energy.foundation.errors import ReportError
from robot_energy.foundation.extras import require
from robot_energy.model import RobotModel
from robot_energy.physics.friction import FrictionModel
from robot_energy.physics.rigid_body import Robot
from robot_energy.results.base import Result
from robot_energy.results.energy import EnergyBreakdown, JointEnergy
from robot_energy.timeline.blocks import Float
from robot_energy.timeline.time_series import TimeSeries
from robot_energy_plan.results.prediction import PredictionReport, PredictionsReport
from robot_energy_report.canvas import COLOURS, PART_COLOURS, SERIES, Axes
from robot_energy_report.document import (
    DOCUMENTS,
    Document,
    FlowDiagram,
    Tiles,
    document_of,
)
from robot_energy_report.energy import FIELDS, scale_of
from robot_energy_report.formats import number, typeset
from robot_energy_report.html import parts_html
from robot_energy_report.model import model_report

ENDS = 3  # rows of a table that are shown at either end
MARGIN = 5.0  # drawn beyond the fitted temperatures of a friction law [K]


def html(shown: Any) -> str:
    """Return a result, a model or a table as HTML: what the terminal shows, and figures."""
    match shown:
        case TimeSeries():
            page = Document()
            _table(shown, page)
        case _:
            report = _report(shown)
            if isinstance(report, PredictionReport):
                report = PredictionsReport((report,))
            if not isinstance(report, Result) or report.NAME not in DOCUMENTS:
                return f"<pre>{typeset(repr(shown))}</pre>"
            page = document_of(report)
    drawn_by_a_page = (Tiles, FlowDiagram)  # with its styles and its program
    parts = [part for part in page.shown("terminal") if not isinstance(part, drawn_by_a_page)]
    return parts_html(parts)


def _report(shown: Any) -> Any:
    if isinstance(shown, RobotModel):
        return model_report(shown, Robot.from_model(shown))
    for name in ("report", "found"):
        shown = getattr(shown, name, shown)
    return shown


def _table(table: TimeSeries, page: Document) -> None:
    columns = {name: column for name, column in table.to_dict().items() if name != "stamp_ns"}
    units = {name: table.units.get(name.rpartition(".")[2]) for name in columns}
    names = [f"{name} [{unit}]" if unit else name for name, unit in units.items()]
    rows = range(len(table))
    kept = rows if len(rows) <= 2 * ENDS else (*rows[:ENDS], *rows[-ENDS:])
    cells = [
        [number(float(each[row]), 3) for each in (table.time, *columns.values())] for row in kept
    ]
    page.table(f"{len(rows)} rows", ["time [s]", *names], cells)


def plot(shown: Any, what: str | None = None, axes: Axes = None) -> Axes:
    """Return axes with an aspect of a result, a model or a table drawn on: see ``Shown.plot``."""
    power = shown if isinstance(shown, TimeSeries) else getattr(shown, "power", None)
    energy, joints = getattr(shown, "energy", None), getattr(shown, "joints", None)
    model = shown if isinstance(shown, RobotModel) else getattr(shown, "model", None)
    found: dict[str, Callable[[Axes], None]] = {}
    if isinstance(power, TimeSeries) and "predicted_grid_power" in power:
        found["power"] = lambda on: _power(power, on)
        found["energy"] = lambda on: _energy(power, on)
    if isinstance(energy, EnergyBreakdown):
        found["parts"] = lambda on: _parts(energy, on)
        found["joints"] = lambda on: _joints(energy, joints or (), on)
    if isinstance(power, TimeSeries) and "motor_temperature_degc" in power:
        found["temperatures"] = lambda on: _temperatures(power, on)
    if isinstance(model, RobotModel):
        found["friction"] = lambda on: _friction(model, on)
    if what is None and found:
        what = next(iter(found))
    if what not in found:
        raise ReportError(
            f"{type(shown).__name__} has no figure of '{what}'",
            ", ".join(found) or "a result, a model or a table of power",
        )
    if axes is None:
        require("matplotlib", "a figure")
        from matplotlib import pyplot

        axes = pyplot.subplots(layout="constrained")[1]
    found[what](axes)
    return axes


def _curves(power: TimeSeries) -> dict[str, tuple[str, Float]]:
    """Columns of power by label, with their role: two where a meter was read, at the same times."""
    if "measured_power" in power and np.isfinite(power["measured_power"]).any():
        measured, predicted = power["measured_power"], power["predicted_power_at_meter"]
        known = np.isfinite(measured) & np.isfinite(predicted)
        return {
            "measured": ("measured", np.where(known, measured, np.nan)),
            "predicted, as the meter shows it": ("predicted", np.where(known, predicted, np.nan)),
        }
    return {"predicted": ("predicted", power["predicted_grid_power"])}


def _power(power: TimeSeries, axes: Axes) -> None:
    for label, (role, watts) in _curves(power).items():
        known = np.isfinite(watts)
        axes.plot(power.time[known], watts[known], color=COLOURS[role], label=label)
        if role == "predicted" and "predicted_power_std" in power:
            half = Z90 * power["predicted_power_std"]
            _band(axes, power.time, watts, half, COLOURS[role], "90 % band")
    _over_time(axes, "power [W]")


def _band(axes: Axes, x: Float, middle: Float, half: Float, colour: str, label: str = "") -> None:
    known = np.isfinite(middle + half)
    low, high = (middle - half)[known], (middle + half)[known]
    axes.fill_between(x[known], low, high, color=colour, alpha=0.15, linewidth=0.0, label=label)


def _energy(power: TimeSeries, axes: Axes) -> None:
    """Energy since the start; time without power, or without a reading, adds nothing."""
    for label, (role, watts) in _curves(power).items():
        steps = 0.5 * (watts[1:] + watts[:-1]) * np.diff(power.time)
        joule = np.append(0.0, np.cumsum(np.nan_to_num(steps)))
        axes.plot(power.time, joule / 1e3, color=COLOURS[role], label=label)
    _over_time(axes, "energy [kJ]")


def _over_time(axes: Axes, quantity: str) -> None:
    axes.set_xlabel("time since the start [s]")
    axes.set_ylabel(quantity)
    axes.legend()


def _parts(energy: EnergyBreakdown, axes: Axes) -> None:
    scale = scale_of([energy])
    known = {key: value for key in FIELDS if (value := getattr(energy, key)) is not None}
    axes.barh(
        [FIELDS[key][1] for key in known],
        [value / scale.factor for value in known.values()],
        color=[PART_COLOURS[FIELDS[key][0]] for key in known],
    )
    axes.invert_yaxis()
    axes.set_xlabel(f"energy [{scale.unit}]")


def _joints(energy: EnergyBreakdown, joints: tuple[JointEnergy, ...], axes: Axes) -> None:
    scale = scale_of([energy])
    places = np.arange(len(joints))
    above, below = np.zeros(len(joints)), np.zeros(len(joints))
    for field in ("rigid", "friction", "drive_loss"):
        (part, label), name = FIELDS[field], f"{field}_energy"
        if all(getattr(joint, name) is None for joint in joints):
            continue
        values = np.array([getattr(joint, name) or 0.0 for joint in joints]) / scale.factor
        axes.bar(
            places,
            values,
            bottom=np.where(values < 0, below, above),
            label=label,
            color=PART_COLOURS[part],
        )
        above, below = above + np.maximum(values, 0.0), below + np.minimum(values, 0.0)
    axes.use_sticky_edges = False
    axes.margins(y=0.05)
    axes.set_xticks(places, [joint.name for joint in joints], rotation=30, ha="right")
    axes.set_ylabel(f"energy [{scale.unit}]")
    axes.legend()


def _temperatures(power: TimeSeries, axes: Axes) -> None:
    for joint, name in enumerate(power.joint_names):
        values = power["motor_temperature_degc"][:, joint]
        axes.plot(power.time, values, color=SERIES[joint % len(SERIES)], label=name)
    _over_time(axes, "motor temperature [degC]")


def _friction(model: RobotModel, axes: Axes) -> None:
    """Viscous coefficients over motor temperature, with 90 % bands (paper A, fig. 6)."""
    friction = FrictionModel.from_model(model)
    low, high = _fitted(model)
    degc = np.linspace(low - MARGIN, high + MARGIN, 100)
    every = np.repeat(degc[:, None], len(model.joints), axis=1)
    viscous, (std, _) = friction.viscous(every), FrictionCertainty(model).std(every)
    for joint, name in enumerate(model.joint_names):
        colour = SERIES[joint % len(SERIES)]
        axes.plot(degc, 1e3 * viscous[:, joint], color=colour, label=name)
        _band(axes, degc, 1e3 * viscous[:, joint], 1e3 * Z90 * std[:, joint], colour)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("temperature [degC]")
    axes.set_ylabel("viscous friction, motor side\n[1e-3 N m s/rad]")
    axes.legend()


def _fitted(model: RobotModel) -> tuple[float, float]:
    ranges = [
        fitted
        for joint in model.joints
        if (fitted := getattr(joint.friction.viscous, "fitted_degc", None)) is not None
    ]
    if not ranges:
        return 20.0, 60.0
    return min(low for low, _ in ranges), max(high for _, high in ranges)
