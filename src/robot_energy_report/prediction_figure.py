"""Figures of predictions: where the energy goes, and power over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot_energy.results.energy import EnergyBreakdown
from robot_energy_plan.prediction import START_NS, Prediction
from robot_energy_report.canvas import PART_COLOURS, SERIES, Axes, Target, canvas, named_ticks
from robot_energy_report.energy import scale_of
from robot_energy_report.replay_figures import MAX_TIME_IN_SECONDS, MINUTE

PARTS = {  # name, parts of the energy, and its colour
    "lifting, accelerating (net)": (("rigid",), "motion"),
    "friction": (("friction",), "friction"),
    "drive losses": (("drive_loss",), "drives"),
    "constant losses": (("loss_dc", "loss_grid"), "cabinet"),
    "brake, capacitor": (("brake", "capacitor"), "brake"),
}
BAR = 0.45  # inch per run
LETTERS = 78  # of a legend side by side
DASHES = ("-", "--", ":", "-.")  # when the colours begin again
THIN = 0.9  # line width where curves lie over each other


def energy_bars(energies: Sequence[EnergyBreakdown], labels: Sequence[str], path: Target) -> None:
    """Draw where the energy of each run goes."""
    with canvas(path, (8.0, 1.1 + BAR * len(energies))) as figure:
        _bars(figure.subplots(), energies, labels)


def power_curves(results: Sequence[Prediction], labels: Sequence[str], path: Target) -> None:
    """Draw the predicted power of each run over time."""
    high = 3.2 + 0.12 * len(results)
    with canvas(path, (8.0, high)) as figure:
        _curves(figure.subplots(), results, labels)


def energy_and_power(
    results: Sequence[Prediction],
    energies: Sequence[EnergyBreakdown],
    labels: Sequence[str],
    path: Target,
) -> None:
    """Draw energies above powers."""
    bars = 0.9 + BAR * len(energies)
    with canvas(path, (8.0, bars + 3.2), "predicted energy and power from the grid") as figure:
        axes: Any = figure.subplots(2, 1, height_ratios=[bars, 3.2])
        _bars(axes[0], energies, labels)
        _curves(axes[1], results, labels)


def _bars(axes: Axes, energies: Sequence[EnergyBreakdown], labels: Sequence[str]) -> None:
    scale, count = scale_of(energies), len(energies)
    place = np.arange(count)[::-1]
    right, left = np.zeros(count), np.zeros(count)
    for name, (keys, kind) in PARTS.items():
        width = np.array([sum(getattr(one, key) or 0.0 for key in keys) for one in energies])
        width = width / scale.factor
        if not width.any():
            continue
        start = np.where(width >= 0, right, left)
        axes.barh(place, width, 0.6, left=start, color=PART_COLOURS[kind], label=name)
        right += np.maximum(width, 0.0)
        left += np.minimum(width, 0.0)
    for row, energy in zip(place.tolist(), energies, strict=True):
        axes.annotate(
            f"{scale.joule(energy.net)} {scale.unit}",
            (max(right[count - 1 - row], 0.0), row),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
        )
    named_ticks(axes.yaxis, place, labels)
    axes.grid(visible=False, axis="y")
    axes.margins(x=0.14)
    axes.set_xlim(left=min(float(left.min()) * 1.05, 0.0))
    axes.set_xlabel(f"energy [{scale.unit}]")
    axes.legend(loc="lower center", bbox_to_anchor=(0.45, 1.0), ncols=len(PARTS))


def _curves(axes: Axes, results: Sequence[Prediction], labels: Sequence[str]) -> None:
    longest = max(result.duration for result in results)
    unit, second = ("min", MINUTE) if longest > MAX_TIME_IN_SECONDS else ("s", 1.0)
    for index, (result, name) in enumerate(zip(results, labels, strict=True)):
        means = result.means
        if means is None:
            continue
        power = means.predicted_power
        time = (means.stamp_ns - START_NS) * 1e-9
        axes.plot(
            (time - 0.5 * means.period) / second, power, DASHES[index // len(SERIES) % len(DASHES)],
            color=SERIES[index % len(SERIES)], label=name, linewidth=THIN,
        )  # fmt: skip
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    axes.set_xlim(0.0, longest / second)
    axes.set_xlabel(f"time since the start of the motion [{unit}]")
    axes.set_ylabel("power from the grid [W]")
    if len(results) > 1:
        columns = max(1, min(3, LETTERS // max(map(len, labels))))
        axes.legend(loc="lower center", bbox_to_anchor=(0.45, 1.0), ncols=columns)
