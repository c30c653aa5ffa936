"""Where the energy of runs goes, as bars."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot_energy.results.energy import EnergyBreakdown
from robot_energy_report.canvas import PART_COLOURS, Axes, Target, canvas, named_ticks
from robot_energy_report.energy import scale_of

PARTS = {  # name, parts of the energy, and its colour
    "lifting, accelerating (net)": (("rigid",), "motion"),
    "friction": (("friction",), "friction"),
    "drive losses": (("drive_loss",), "drives"),
    "constant losses": (("loss_dc", "loss_grid"), "cabinet"),
    "brake, capacitor": (("brake", "capacitor"), "brake"),
}
BAR = 0.45  # inch per run


def energy_bars(energies: Sequence[EnergyBreakdown], labels: Sequence[str], path: Target) -> None:
    """Draw where the energy of each run goes."""
    with canvas(path, (8.0, 1.1 + BAR * len(energies))) as figure:
        add_bars(figure.subplots(), energies, labels)


def add_bars(axes: Axes, energies: Sequence[EnergyBreakdown], labels: Sequence[str]) -> None:
    """Draw them into axes."""
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
