"""What several recordings say together: totals, one row each in order of time, and the trend."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np

from robot_energy.foundation.shown_text import shown
from robot_energy.results.base import ModelUsed
from robot_energy.results.replay import ReplayReport
from robot_energy.timeline.blocks import Float
from robot_energy_report.canvas import MAX_TICK, SERIES, Axes, Target, canvas
from robot_energy_report.document import Column, Document
from robot_energy_report.energy import add_flow, scale_of, sum_of_known
from robot_energy_report.energy_bars import energy_bars
from robot_energy_report.formats import (
    EnergyFormat,
    counted,
    fixed,
    number,
    percent,
    signed_percent,
    utc,
)
from robot_energy_report.headline import error_of, observed_time, tiles
from robot_energy_report.jobs import job_kinds, kind_table, mean_energy
from robot_energy_report.page.settings import PageSettings
from robot_energy_report.repeats import given_once, overlaps
from robot_energy_report.replay import FIRST, ReplayCurves, replay_document

Recording = tuple[ReplayReport, ReplayCurves | None]


def recordings_document(
    recordings: Sequence[Recording], page: Document, settings: PageSettings
) -> None:
    """Add one or several recordings; what they say together comes first.

    A recording that was given twice counts once, and a note says so; so it does where recordings
    of one robot overlap in time.
    """
    recordings, notes = _once(recordings)
    if len(recordings) == 1:
        page.notes(notes)
        replay_document(recordings[0][0], page, recordings[0][1], settings=settings)
        return
    ordered = sorted(recordings, key=lambda one: one[0].time.start_ns or 0)
    reports = [report for report, _ in ordered]
    groups: dict[str, list[ReplayReport]] = {}
    for one in reports:
        groups.setdefault(robot_name(one.model), []).append(one)
    page.heading(FIRST)
    page.notes(notes)
    page.add(tiles(reports, settings))
    for name, group in groups.items():
        add_flow(
            page,
            group,
            f"{name}, {counted(len(group), 'recording')}: where the energy from the grid went, "
            "as predicted.",
        )
    page.heading("Recordings in order of time")
    _table(page, reports, groups)
    if job_kinds(reports):
        kind_table(page, reports, scale_of([one.energy for one in reports]))
    page.figure(
        lambda path: energy_bars(
            [one.energy for one in reports], [_name(one) for one in reports], path
        ),
        "Predicted energy from the grid and where it went.",
    )
    page.figure(
        lambda path: _trend(groups, path),
        "Trend: predicted minus measured energy, and "
        + ("mean energy per job" if job_kinds(reports) else "mean power from the grid")
        + ", recording by recording in order of time.",
    )
    for place, (report, curves) in enumerate(ordered, 1):
        page.heading(f"{place}. {_name(report)}")
        replay_document(report, page, curves, 3, settings)


def robot_name(model: ModelUsed) -> str:
    """Return robot, serial number, model and change in words."""
    serial = f" {model.serial}" if model.serial else ""
    change = f", {model.change}" if model.change else ""
    return f"{model.robot}{serial}, model {model.model_id}{change}"


def _once(recordings: Sequence[Recording]) -> tuple[list[Recording], list[str]]:
    """Recordings without repetitions, and notes on these and on what overlaps in time."""
    names, contents = [one.bag for one, _ in recordings], [_content(one) for one, _ in recordings]
    rows, notes = given_once(names, contents)
    kept = [recordings[row] for row in rows]
    robots: dict[tuple[str, str | None, tuple[str, ...]], list[ReplayReport]] = {}
    for one, _ in kept:
        key = one.model.robot, one.model.serial, tuple(one.topics.joint_states or ())
        robots.setdefault(key, []).append(one)
    for group in robots.values():
        spans = [(one.time.start_ns, one.time.end_ns) for one in group]
        notes += overlaps([one.bag for one in group], spans)
    return kept, notes


def _content(report: ReplayReport) -> tuple[object, ...]:
    """Equal for the same recording of the same robot, wherever the bag lies."""
    time, states = report.time, tuple(report.topics.joint_states or ())
    span = time.start_ns, time.end_ns, time.observed_ns
    measured = report.comparison.measured_energy
    return robot_name(report.model), states, *span, report.energy.net, measured


def _name(report: ReplayReport) -> str:
    return Path(report.bag).name


def _table(
    page: Document, reports: Sequence[ReplayReport], groups: dict[str, list[ReplayReport]]
) -> None:
    scale = scale_of([one.energy for one in reports])
    place_of = {id(one): place for place, one in enumerate(reports, 1)}

    def mean(rows: Sequence[ReplayReport]) -> float | None:
        time = observed_time(rows)
        return sum(one.energy.net for one in rows) / time if time else None

    columns = [
        Column("recording", lambda one: f"{place_of[id(one)]}. {_name(one)}"),
        Column("begun, UTC", lambda one: utc(one.time.start_ns)),
        Column("time", lambda one: one.time.observed_time, fixed(1), "s", total=True),
        Column("covered", lambda one: one.time.coverage, percent),
        Column("predicted", lambda one: one.energy.net, scale.joule, scale.unit, total=True),
        Column("mean", lambda one: mean([one]), fixed(1), "W", total=mean),
        Column("measured", lambda one: one.comparison.measured_energy, scale.joule, scale.unit,
               total=lambda rows: sum_of_known(one.comparison.measured_energy for one in rows)),
        Column("error", lambda one: error_of([one])[0], signed_percent,
               total=lambda rows: error_of(rows)[0]),
        Column("without constant\nlosses", lambda one: one.comparison.beyond_constant_relative,
               signed_percent),
        Column("friction\nof grid", lambda one: _share([one]), percent, total=_share),
        Column("per job", lambda one: _per_job([one], scale), optional=True,
               total=lambda rows: _per_job(rows, scale)),
    ]  # fmt: skip
    for name, group in groups.items():
        page.rows(name, columns, group, f"{counted(len(group), 'recording')}")
    if len(groups) > 1:
        net, time = sum(one.energy.net for one in reports), observed_time(reports)
        page.paragraph(
            f"All robots: {scale.joule(net)} {scale.unit} from the grid, predicted, over "
            f"{number(time, 1)} s."
        )
    missing = sum(one.comparison.measured_energy is None for one in reports)
    if missing:
        page.note(
            f"{counted(missing, 'recording')} without a measured energy: predicted only, and not "
            "part of the errors"
        )
    bad = [_name(one) for one in reports if one.problems]
    if bad:
        page.paragraph(f"{', '.join(bad)}: see the problems named below", "problem")


def _per_job(reports: Sequence[ReplayReport], scale: EnergyFormat) -> str | None:
    kinds = job_kinds(reports)
    return f"{scale.text(mean_energy(next(iter(kinds.values()))))}" if kinds else None


def _share(reports: Sequence[ReplayReport]) -> float | None:
    net = sum(one.energy.net for one in reports)
    return sum(one.energy.friction for one in reports) / net if net > 0 else None


MARKERS = "osD^v"  # of the jobs of one robot


def _trend(groups: Mapping[str, Sequence[ReplayReport]], path: Target) -> None:
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
                values = [mean_energy(one) * 1e-3 if one else None for one in jobs]
                label = shown(f"{name}: {kind}" if len(groups) > 1 else kind, 2 * MAX_TICK)
                _line(axes[1], place, values, style | {"marker": marker, "label": label})
        axes[0].axhline(0.0, color="#9a9a9a", linewidth=0.8)
        axes[0].set_ylabel("predicted -\nmeasured [%]")
        axes[1].set_ylabel("energy per job [kJ]" if with_jobs else "mean power\nfrom the grid [W]")
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
