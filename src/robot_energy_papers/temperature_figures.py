"""Figures of a study over robot temperature (paper A, fig. 5 and 7)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from robot_energy.blocks import Float
from robot_energy.errors import ShapeError
from robot_energy.report.canvas import COLOURS, SERIES, Axes, Target, canvas

PERCENT = 100.0
KILO = 1e-3
BAND = 0.05  # paper A: what remains of the deviation

Role = Literal["predicted", "fixed", "other", "more"]
LOOKS: dict[Role, dict[str, Any]] = {
    "predicted": {"color": COLOURS["predicted"], "linestyle": "-"},
    "fixed": {"color": COLOURS["fixed"], "linestyle": "--"},
    "other": {"color": COLOURS["fixed"], "linestyle": ":"},
    "more": {"color": SERIES[2], "linestyle": "-."},
}


@dataclass(frozen=True)
class ModelEnergyCurve:
    """Energy of one model over robot temperature.

    Attributes:
        label: For the legend.
        role: Decides colour and line.
        energy: Relative to the measured energy at the reference, shape (K,). [-]
        error: Relative to the measured energy of the same set, shape (K,). [-]
    """

    label: str
    role: Role
    energy: Float
    error: Float


@dataclass(frozen=True)
class EnergyStudy:
    """Measured and predicted energy of the same motions over robot temperature.

    Attributes:
        robot_degc: Of each set, shape (K,). [degC]
        measured: Relative to the reference, shape (K,). [-]
        cooling: Which sets were recorded while the robot cooled, shape (K,).
        curves: The models.
        reference_degc: Where the measured energy is 1. [degC]
    """

    robot_degc: Float
    measured: Float
    cooling: Sequence[bool]
    curves: Sequence[ModelEnergyCurve]
    reference_degc: float


def energy_over_temperature(study: EnergyStudy, path: Target, title: str = "") -> None:
    """Draw measured and predicted energy (paper A, fig. 7a).

    Args:
        study: What to draw.
        path: File to write: PNG, SVG or PDF by its suffix.
        title: Above the figure.

    Raises:
        ShapeError: If there is no set.
        ReportError: If the file cannot be written.
    """
    _check(study)
    with canvas(path, (6.4, 4.2), title) as figure:
        axes: Any = figure.subplots()
        _energies(axes, study)
        axes.set_xlabel("robot temperature, mean of the motors [degC]")


def energy_and_deviation(study: EnergyStudy, path: Target, title: str = "") -> None:
    """Draw energy and deviation below each other (paper A, fig. 7a and 7b).

    Args:
        study: What to draw.
        path: File to write: PNG, SVG or PDF by its suffix.
        title: Above the figure.

    Raises:
        ShapeError: If there is no set.
        ReportError: If the file cannot be written.
    """
    _check(study)
    with canvas(path, (8.0, 7.0), title) as figure:
        axes: Any = figure.subplots(2, 1, sharex=True)
        _energies(axes[0], study)
        axes[1].axhspan(-PERCENT * BAND, PERCENT * BAND, color="#ececec", zorder=0)
        axes[1].axhline(0.0, color="#9a9a9a", linewidth=0.8)
        for curve in study.curves:
            _curve(axes[1], study, curve, PERCENT * curve.error)
        axes[1].set_ylabel("predicted minus measured [%]")
        axes[1].set_xlabel("robot temperature, mean of the motors [degC]; grey: +-5 %")
        figure.align_ylabels(axes)


def shaft_power_over_temperature(
    curves: Mapping[str, tuple[Float, Float]], path: Target, name: str, title: str = ""
) -> None:
    """Draw measured shaft power of one axis at several temperatures (paper A, fig. 5).

    Args:
        curves: Time [s] and power [W] of the same motions, by label, coldest first.
        path: File to write: PNG, SVG or PDF by its suffix.
        name: Of the axis.
        title: Above the figure.

    Raises:
        ShapeError: If there is no curve.
        ReportError: If the file cannot be written.
    """
    if not curves:
        raise ShapeError("no curve to draw", "at least one temperature")
    colours = (SERIES[0], SERIES[2], SERIES[1], SERIES[3])
    with canvas(path, (8.0, 3.4), title) as figure:
        axes: Any = figure.subplots()
        axes.axhline(0.0, color="#9a9a9a", linewidth=0.8)
        for (label, (time, power)), colour in zip(curves.items(), colours, strict=False):
            axes.plot(time, KILO * power, color=colour, label=label, linewidth=1.1)
        axes.set_xlabel("time since the start of the set [s]")
        axes.set_ylabel(f"shaft power of {name} [kW]")
        axes.margins(x=0)
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(curves))


def _check(study: EnergyStudy) -> None:
    if not len(study.robot_degc):
        raise ShapeError("no set to draw", "at least one temperature")


def _energies(axes: Axes, study: EnergyStudy) -> None:
    for curve in study.curves:
        _curve(axes, study, curve, curve.energy, curve.label)
    cooling = np.asarray(study.cooling, dtype=np.bool_)
    for rows, fill, label in (
        (~cooling, COLOURS["measured"], "measured"),
        (cooling, "white", "measured, cooling down"),
    ):
        if rows.any():
            axes.plot(
                study.robot_degc[rows],
                study.measured[rows],
                "o",
                color=COLOURS["measured"],
                markerfacecolor=fill,
                markersize=4.5,
                label=label,
            )
    axes.set_ylabel(f"grid energy / measured at {study.reference_degc:g} degC")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)


def _curve(
    axes: Axes, study: EnergyStudy, curve: ModelEnergyCurve, values: Float, label: str = ""
) -> None:
    """A line through the sets of heating up; points alone for those of cooling down."""
    cooling = np.asarray(study.cooling, dtype=np.bool_)
    order = np.argsort(study.robot_degc[~cooling])
    look = LOOKS[curve.role]
    axes.plot(
        study.robot_degc[~cooling][order], values[~cooling][order], label=label or None, **look
    )
    if cooling.any():
        axes.plot(
            study.robot_degc[cooling], values[cooling], "o", color=look["color"],
            markerfacecolor="white", markersize=3.5,
        )  # fmt: skip
