"""Energy of jobs and cycles, and what a recording says in the order of energy tests of robots."""

from __future__ import annotations

import math
from collections.abc import Sequence

from robot_energy.results.replay import JobFigures, ReplayReport
from robot_energy.timeline.blocks import NANOSECOND
from robot_energy_report.document import Column, Document
from robot_energy_report.energy import scale_of
from robot_energy_report.formats import EnergyFormat, counted, fixed, signed_percent, utc
from robot_energy_report.headline import duration, place_of

MAX_ROWS = 100  # jobs that are listed one by one
HOLD, MOTION = "hold", "motion"


def job_kinds(reports: Sequence[ReplayReport]) -> dict[str, list[JobFigures]]:
    """Return the jobs of all recordings by name, the most frequent name first."""
    found: dict[str, list[JobFigures]] = {}
    for job in (job for one in reports for job in one.jobs):
        found.setdefault(job.name, []).append(job)
    return dict(sorted(found.items(), key=lambda kind: -len(kind[1])))


def mean_energy(jobs: Sequence[JobFigures]) -> float:
    """Return the mean predicted energy of jobs. [J]"""
    return math.fsum(job.energy for job in jobs) / len(jobs)


def job_section(page: Document, report: ReplayReport) -> None:
    """Add the jobs of a recording: by name, and one by one."""
    if not report.jobs:
        return
    scale = scale_of([report.energy])
    kind_table(page, [report], scale)
    start_ns, count = report.time.start_ns or 0, len(report.jobs)
    with page.only("page"):
        page.rows(
            "Jobs one by one, in time since the start of the recording"
            + (f": the first {MAX_ROWS} of {count}" if count > MAX_ROWS else ""),
            [
                Column("", "name"),
                Column("begun", lambda job: (job.start_ns - start_ns) * NANOSECOND, fixed(2), "s"),
                Column("time", "time", fixed(2), "s"),
                Column("gaps", "gap_time", fixed(2), "s"),
                Column("predicted", "energy", scale.joule, scale.unit),
                Column("90 % band", "energy_band", lambda half: f"+- {scale.joule(half)}"),
                Column("measured", "measured_energy", scale.joule, scale.unit),
                Column("error", lambda job: _error([job]), signed_percent),
                Column("peak", "peak_grid_power", fixed(0), "W"),
            ],
            report.jobs[:MAX_ROWS],
        )  # fmt: skip


def kind_table(page: Document, reports: Sequence[ReplayReport], scale: EnergyFormat) -> None:
    """Add energy and time of the jobs of each name."""
    page.rows(
        "Energy per job, predicted, at the grid",
        [
            Column("", lambda kind: kind[0]),
            Column("number", lambda kind: len(kind[1])),
            Column("mean time", lambda kind: _mean_time(kind[1]), fixed(2), "s"),
            Column("mean", lambda kind: mean_energy(kind[1]), scale.joule, scale.unit),
            Column("lowest", lambda kind: min(job.energy for job in kind[1]), scale.joule),
            Column("highest", lambda kind: max(job.energy for job in kind[1]), scale.joule),
            Column("error against\nthe meter", lambda kind: _error(kind[1]), signed_percent),
        ],
        list(job_kinds(reports).items()),
    )


def summary_section(page: Document, report: ReplayReport) -> None:
    """Add conditions and results in the order in which energy tests of robots state them."""
    model, time, scale = report.model, report.time, scale_of([report.energy])
    with page.only("page"):
        page.paragraph(
            "In the order of the public scope of the draft ISO/TS 25213 (energy consumption of "
            "six-axis industrial robots): conditions, energy per defined cycle, energy per state. "
            "The text of the draft is not public; no conformity is claimed."
        )
        begun = "unknown" if time.start_ns is None else f"{utc(time.start_ns)} UTC"
        degc = [joint.last_motor_temperature_degc for joint in report.joints]
        known = [one for one in degc if one is not None]
        payload = "as in the model file"
        if report.payload is not None:
            payload = f"{report.payload.last_mass:g} kg at the end, set at run time"
        meter = f"{report.topics.meter}, at {place_of(report)}" if report.topics.meter else "none"
        page.pairs(
            [
                ("robot", f"{model.robot}{f', serial {model.serial}' if model.serial else ''}, "
                 f"{counted(len(report.joints), 'axis', 'axes')}"),
                ("payload", payload),
                ("motor temperatures", f"{min(known):.1f} to {max(known):.1f} degC at the end"
                 if known else "unknown"),
                ("surroundings, supply voltage", "not recorded"),
                ("meter", meter),
                ("recorded", f"{begun}, {duration(time.observed_time)} predicted, "
                 f"{duration(report.comparison.compared_time)} compared with the meter"),
            ]
        )  # fmt: skip
        rows: list[tuple[str, str, str, str, str]] = [
            (
                f"cycle '{name}'",
                str(len(jobs)),
                f"{_mean_time(jobs):.2f} s",
                scale.text(mean_energy(jobs)),
                f"{mean_energy(jobs) / _mean_time(jobs):.1f} W" if _mean_time(jobs) else "-",
            )
            for name, jobs in job_kinds([report]).items()
        ]
        names = {HOLD: "hold (at rest, drives on)", MOTION: "motion", "generating": "generating"}
        rows += [
            (
                names[name],
                "",
                f"{one.time:.2f} s",
                scale.text(one.grid_import_energy),
                f"{one.grid_import_energy / one.time:.1f} W",
            )
            for name, one in report.phases.items()
            if name in names and one.time
        ]
        page.table(
            "Cycles (mean of each) and states (sum), predicted at the grid",
            ("", "number", "time", "energy", "mean power"),
            rows,
        )
        page.paragraph(
            "While the drives are off there are no joint states, so that time is not part of this "
            "recording." + ("" if report.jobs else " No cycle is defined: name them with `--jobs`.")
        )


def _mean_time(jobs: Sequence[JobFigures]) -> float:
    return math.fsum(job.time for job in jobs) / len(jobs)


def _error(jobs: Sequence[JobFigures]) -> float | None:
    pairs = [
        (job.predicted_energy_at_meter, job.measured_energy)
        for job in jobs
        if job.predicted_energy_at_meter is not None and job.measured_energy is not None
    ]
    measured = math.fsum(one for _, one in pairs)
    return math.fsum(one for one, _ in pairs) / measured - 1.0 if measured > 0 else None
