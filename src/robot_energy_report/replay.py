"""What a replay says: headline, where the energy went, comparison, joints, data quality."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from robot_energy.results.replay import JointShaft, ReplayReport, ShaftComparison
from robot_energy.timeline.blocks import NANOSECOND
from robot_energy_report.document import HEADINGS, Column, Document, Text
from robot_energy_report.energy import (
    EnergySections,
    add_flow,
    auxiliary_section,
    flow_labels,
    scale_of,
)
from robot_energy_report.energy_bars import energy_bars
from robot_energy_report.formats import (
    EnergyFormat,
    counted,
    fixed,
    percent,
    plus_minus,
    seconds,
    signed_percent,
    tags_text,
    utc,
)
from robot_energy_report.headline import beyond_constant, headline, place_of, tiles, verdict
from robot_energy_report.jobs import job_section, summary_section
from robot_energy_report.replay_figures import (
    Series,
    TemperatureHistory,
    power_and_energy,
    temperature_and_friction,
)

if TYPE_CHECKING:
    from robot_energy_report.page.settings import PageSettings

INPUT_NAMES = {
    "joint_state_messages": "joint states",
    "temperature_messages": "temperatures, messages",
    "temperature_values": "temperatures, values",
    "meter_messages": "meter, messages",
    "meter_readings": "meter, readings",
    "payload_messages": "payloads",
}
FIRST = "Where the energy went"
CAVEATS = {
    "motor_current": "measured = reported current x torque_constant of the model file x "
    "(1 - torque_constant_fall (T - 20)) x speed",
    "motor_torque": "measured = reported motor torque x (1 - torque_constant_fall (T - 20)) x "
    "motor speed",
    "joint_torque": "measured = reported joint torque through the gears x motor speed; a sensor "
    "behind the gear sees neither rotor inertia nor the friction before it",
}
SHAFT = (
    ("out,\nmeasured", "shaft_energy_positive_measured"),
    ("out,\npredicted", "shaft_energy_positive_compared"),
    ("back,\nmeasured", "shaft_energy_negative_measured"),
    ("back,\npredicted", "shaft_energy_negative_compared"),
    ("predicted\n- measured", "predicted_minus_measured_energy"),
)


@dataclass(frozen=True)
class ReplayCurves:
    """What the figures of a replay show beyond its report."""

    series: Sequence[Series]
    temperatures: TemperatureHistory


def replay_document(
    report: ReplayReport,
    page: Document,
    curves: ReplayCurves | None = None,
    depth: int = 2,
    settings: PageSettings | None = None,
) -> None:
    """Add all that a replay says."""
    other = report.compared_with
    page.paragraph(verdict(report), "strong")
    page.paragraph(headline(report))
    if beyond := beyond_constant(report):
        page.paragraph(beyond)
    if other is not None:
        page.paragraph(f"with {other.model.change}: {headline(other)}")
    if report.origin:
        page.paragraph(f"origin: {report.origin}")
    for problem in report.problems:
        page.paragraph(problem, "problem")
    page.notes(report.notes)
    page.paragraph()
    with page.only("terminal"):
        page.pairs([*_recording(report), *_provenance(report)])
    for title, write in SECTIONS.items():
        before = len(page.parts)
        if title == FIRST:
            page.add(tiles([report], settings))
        write(page, report, curves)
        if len(page.parts) > before:
            heading = Text(title, HEADINGS[depth])
            page.parts.insert(before, ("page", heading))


def _recording(report: ReplayReport) -> list[tuple[str, str]]:
    time, topics = report.time, report.topics
    rows = [
        ("bag", report.bag),
        ("joint states", ", ".join(topics.joint_states or ())),
        ("temperatures", ", ".join(topics.temperatures or ()) or "none"),
        ("meter", topics.meter or "none"),
    ]
    if time.start_ns is not None:
        start = utc(time.start_ns, "%F %T")
        rows.append(("recorded", f"from {start} UTC, span {seconds(time.span_ns)}"))
    for change in report.payload.changes if report.payload is not None else ():
        after = (change.from_ns - (time.start_ns or 0)) * NANOSECOND
        when = f"from {after:.3f} s on" if after > 0 else "from the start"
        rows.append(("payload", f"{change.payload.mass:g} kg on {change.payload.link} {when}"))
    gaps = "no gaps"
    if time.gap_count:
        gaps = f"{counted(time.gap_count, 'gap')} of {seconds(time.gap_ns)} in all"
    rows.append(
        ("predicted", f"{seconds(time.observed_ns)} ({percent(time.coverage)} of the span), {gaps}")
    )
    return rows


def _provenance(report: ReplayReport) -> list[tuple[str, str]]:
    model = report.model
    change = f"; {model.change}" if model.change else ""
    serial = f", serial {model.serial}" if model.serial else ""
    rows = [
        ("model", f"{model.robot}{serial}, id {model.model_id}{change}"),
        ("model file", model.source),
        ("its figures", tags_text(model.figures)),
    ]
    if model.notes:
        rows.append(("its notes", " ".join(model.notes.split())))
    return rows


def _model(page: Document, report: ReplayReport, _: ReplayCurves | None) -> None:
    with page.only("page"):
        page.pairs(_provenance(report))


def _energy(page: Document, report: ReplayReport, _: ReplayCurves | None) -> None:
    energy, power, other = report.energy, report.power, report.compared_with
    scale = scale_of([energy])
    loads = flow_labels(report.auxiliary)
    add_flow(
        page,
        [report],
        "Where the energy from the grid went, as predicted. Into a joint flows what the "
        "DC bus gives, and what its bodies give back.",
        loads,
    )
    second = None
    if other is not None:
        second = str(other.model.change), other.energy
        runs = {"predicted": energy, f"predicted, {second[0]}": other.energy}
        page.figure(
            lambda path: energy_bars(list(runs.values()), list(runs), path),
            "The same with friction at measured and at one temperature.",
        )
    over = seconds(report.time.observed_ns)
    sections = EnergySections(page, report)
    sections.energy(f"Where the energy went, predicted, over {over}", second)
    if energy.grid_return:
        page.paragraph(
            f"  drawn {scale.joule(energy.grid_import)} {scale.unit}, "
            f"returned {scale.joule(energy.grid_return)} {scale.unit}"
        )
    mean, peak = power.predicted_mean_grid_power, power.predicted_peak_grid_power
    if mean is not None and peak is not None:
        page.paragraph(
            f"  mean {mean:.1f} W, peak {peak:.1f} W from the grid; balance: grid minus "
            f"the sum of its parts = {energy.balance_residual * 1e6:.0f} uJ"
        )
    sections.normalised()
    page.paragraph()
    auxiliary_section(page, report.auxiliary)


def _comparison(page: Document, report: ReplayReport, curves: ReplayCurves | None) -> None:
    _compared(page, report)
    if curves is not None and curves.series:
        page.figure(
            lambda path: power_and_energy(curves.series, path, place=place_of(report)),
            f"Power and energy at {place_of(report)}.",
        )


def _compared(page: Document, report: ReplayReport) -> None:
    compared, other, scale = report.comparison, report.compared_with, scale_of([report.energy])
    measured, power = compared.measured_energy, compared.measured_mean_power
    if measured is None or power is None:
        with page.only("page"):
            page.paragraph("Nothing was measured that could be compared.")
        return
    rows = [("measured", scale.joule(measured), f"{power:.1f} W", "", "", "", "")]
    for entry in (report, other):
        values = None if entry is None else entry.comparison
        if entry is None or values is None or values.measured_energy is None:
            continue
        change = entry.model.change or "measured temperatures"
        rows.append(
            (
                f"predicted, {change}" if other is not None else "predicted",
                scale.joule(values.predicted_energy_at_meter),
                f"{fixed(1)(values.predicted_mean_power_at_meter)} W",
                scale.joule(values.predicted_minus_measured_energy),
                signed_percent(values.predicted_minus_measured_relative),
                plus_minus(values.half_relative),
                f"{fixed(1)(values.power_error_rms)} W",
            )
        )
    page.table(
        f"Predicted and measured at {place_of(report)}, over the same "
        f"{seconds(compared.compared_ns)} ({percent(compared.coverage)} of what is predicted)",
        (
            "",
            f"energy [{scale.unit}]",
            "mean power",
            f"error [{scale.unit}]",
            "",
            "90 % band\nof the model",
            "RMS error\nof power",
        ),
        rows,
    )


def _joints(page: Document, report: ReplayReport, _: ReplayCurves | None) -> None:
    EnergySections(page, report).joints()
    if report.shaft is not None:
        _shaft(page, report.shaft, scale_of([report.energy]))


def _shaft(page: Document, shaft: ShaftComparison, scale: EnergyFormat) -> None:
    def summed(rows: Sequence[JointShaft], *keys: str) -> float:
        return sum(getattr(row, key) or 0.0 for row in rows for key in keys)

    def turnover(rows: Sequence[JointShaft]) -> float:
        return summed(rows, "shaft_energy_positive_measured", "shaft_energy_negative_measured")

    def error(rows: Sequence[JointShaft]) -> float | None:
        known = turnover(rows)
        return summed(rows, "predicted_minus_measured_energy") / known if known else None

    def column(name: str, key: str) -> Column:
        return Column(
            name, key, scale.joule, total=lambda rows: summed(rows, key) if turnover(rows) else None
        )

    page.rows(
        f"Shaft energy, measured by {shaft.effort.replace('_', ' ')} and predicted over the "
        f"same time [{scale.unit}]",
        [
            Column("", "name"),
            *(column(name, key) for name, key in SHAFT),
            Column("of out\n+ back", "predicted_minus_measured_relative", signed_percent,
                   total=error),
            Column("time\nknown", "coverage", percent),
        ],
        shaft.joints,
        "all joints",
    )  # fmt: skip
    page.paragraph(f"  {CAVEATS.get(shaft.effort, '')}")
    page.paragraph()


def _temperatures(page: Document, report: ReplayReport, curves: ReplayCurves | None) -> None:
    with page.only("page"):
        page.paragraph(
            f"Where no motor temperature is known, that of the model is taken: "
            f"{report.model.fallback_temperature_degc:g} degC."
        )
    if curves is not None:
        page.figure(
            lambda path: temperature_and_friction(curves.temperatures, path),
            "Motor temperatures that friction was computed with, and predicted power of friction.",
        )


def _condition(page: Document, whole: ReplayReport, _: ReplayCurves | None) -> None:
    report = whole.condition
    if report is None:
        return
    for change in report.wear:
        page.paragraph(change.sentence, "note" if change.fell else "problem")
    known = [joint for joint in report.joints if joint.valid]
    page.rows(
        "Learned: friction over that of the model file, from measured torque",
        [
            Column("", "name"),
            Column("multiplier", "multiplier", fixed(3)),
            Column("last minute", "multiplier_raw", fixed(3)),
            Column("records\nfor wear", "records"),
        ],
        known,
    )
    if report.meter_valid:
        page.paragraph(
            f"learned from the power meter: constant losses {report.loss_offset:+.1f} W"
            + ("" if known else f", friction x {report.friction_factor:.3f}")
            + " against the model file"
        )


def _quality(page: Document, report: ReplayReport, _: ReplayCurves | None) -> None:
    with page.only("page"):
        page.pairs(_recording(report))
    page.rows(
        "Inputs",
        [
            Column("", 0),
            Column("received", lambda entry: entry[1].received),
            Column("accepted", lambda entry: entry[1].accepted),
            Column(
                "rejected",
                lambda entry: (
                    ", ".join(
                        f"{n} {why.replace('_', ' ')}" for why, n in entry[1].rejected.items()
                    )
                    or "none"
                ),
            ),
        ],
        [  # such as ``pump, meter`` for ``pump_meter_messages``
            (INPUT_NAMES.get(key) or ", ".join(key.removesuffix("_messages").rsplit("_", 1)), one)
            for key, one in report.inputs.items()
            if one.received
        ],
    )
    EnergySections(page, report).quality()


Section = Callable[[Document, ReplayReport, ReplayCurves | None], None]
SECTIONS: dict[str, Section] = {
    FIRST: _energy,
    "Predicted against measured": _comparison,
    "How sure": lambda page, report, _: EnergySections(page, report).certainty(),
    "Joints": _joints,
    "Temperatures and friction": _temperatures,
    "Condition": _condition,
    "Phases": lambda page, report, _: EnergySections(page, report).phases(),
    "Job intervals": lambda page, report, _: job_section(page, report),
    "Conditions, cycles and states": lambda page, report, _: summary_section(page, report),
    "Data quality": _quality,
    "Model and provenance": _model,
}
"""Parts of a report about one recording, in their order; one that adds nothing has no heading."""
