"""Figure of how error and power change from recording to recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np

from robot_energy.blocks import Float
from robot_energy.report.canvas import MAX_TICK, SERIES, Axes, Target, canvas
from robot_energy.report.headline import error_of, observed_time
from robot_energy.report.jobs import job_kinds, mean_energy
from robot_energy.results.replay import ReplayReport
from robot_energy.shown_text import shown
from robot_energy.units import JOULE_PER_WH

MARKERS = "osD^v"  # of the jobs of one robot


def trend(groups: Mapping[str, Sequence[ReplayReport]], path: Target) -> None:
    """Draw the error of the prediction, and energy per job or mean power, recording by recording.

    Args:
        groups: Recordings by robot and model, each in order of time.
        path: File to write: PNG, SVG or PDF by its suffix.
    """
    ordered = sorted(
        (one for group in groups.values() for one in group), key=lambda one: one.time.start_ns or 0
    )
    number = {id(one): place for place, one in enumerate(ordered, 1)}
    with_jobs = any(one.jobs for one in ordered)
    with canvas(path, (8.0, 4.4)) as figure:
        axes: Any = figure.subplots(2, 1, sharex=True)
        for colour, (name, group) in enumerate(groups.items()):
            style: dict[str, Any] = {
                "color": SERIES[colour % len(SERIES)],
                "label": shown(name, 2 * MAX_TICK),
            }
            errors = [error_of([one])[0] for one in group]
            place = [number[id(one)] for one in group]
            _line(axes[0], place, [None if one is None else 100 * one for one in errors], style)
            if not with_jobs:
                power = [(one.energy.net, observed_time([one])) for one in group]
                _line(axes[1], place, [net / time if time else None for net, time in power], style)
            for marker, kind in zip(cycle(MARKERS), job_kinds(group), strict=False):
                jobs = [[job for job in one.jobs if job.name == kind] for one in group]
                values = [mean_energy(one) / JOULE_PER_WH if one else None for one in jobs]
                label = shown(f"{name}: {kind}" if len(groups) > 1 else kind, 2 * MAX_TICK)
                _line(axes[1], place, values, style | {"marker": marker, "label": label})
        axes[0].axhline(0.0, color="#9a9a9a", linewidth=0.8)
        axes[0].set_ylabel("predicted -\nmeasured [%]")
        axes[1].set_ylabel("energy per job [Wh]" if with_jobs else "mean power\nfrom the grid [W]")
        axes[1].set_xlabel("recording, in order of time")
        axes[1].xaxis.get_major_locator().set_params(integer=True)
        axes[1].set_ylim(bottom=min(0.0, axes[1].get_ylim()[0]))
        if len(groups) > 1:
            axes[0].legend(loc="lower center", bbox_to_anchor=(0.5, 1.0))
        if with_jobs:
            axes[1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def _line(
    axes: Axes, place: Sequence[int], values: Sequence[float | None], style: dict[str, Any]
) -> None:
    known: Float = np.array(values, dtype=np.float64)  # NaN where nothing is known
    axes.plot(place, known, "-", **{"marker": "o", "markersize": 4.0} | style)
