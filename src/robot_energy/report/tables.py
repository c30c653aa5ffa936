"""A summary as tables for the terminal; plain lines where there is none."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.report.payload_summary import payload_lines
from robot_energy.report.printing import (
    NOTHING,
    EnergyFormat,
    Page,
    energy_text,
    line,
    pairs,
    percent,
    seconds,
    table,
)
from robot_energy.report.shaft_summary import print_shaft

Summary = dict[str, Any]

QUALITY_NAMES = {
    "temperature_missing": "temperature missing, fallback used",
    "temperature_stale": "temperature stale, fallback used",
    "temperature_implausible": "temperature implausible, the one before used",
    "temperature_stuck": "temperature stands still while losses warm the motor",
    "extrapolated": "friction law outside its fitted temperatures, edge held",
    "acceleration_incomplete": "acceleration from a window cut by start, end or gap",
    "velocity_derived": "velocity derived from positions",
    "after_gap": "first sample after a gap",
    "drive_extrapolated": "drive outside its efficiency map",
    "not_finite": "power unknown, counted as gap",
}
INPUT_NAMES = {
    "joint_state_messages": "joint states",
    "temperature_messages": "temperatures, messages",
    "temperature_values": "temperatures, values",
    "meter_messages": "meter, messages",
    "meter_readings": "meter, readings",
    "payload_messages": "payloads",
}
LOCATION_NAMES = {"grid": "the grid", "dc_bus": "the DC bus"}


def headline(summary: Summary) -> str:
    """Return the result in one line.

    Args:
        summary: From `summarise`.

    Returns:
        Predicted beside measured over the compared time; where nothing was measured, the
        predicted energy and that.
    """
    compared = summary["comparison"]
    energy, time = summary["energy"], summary["time"]
    if compared["measured_energy"] is None:
        net = energy["grid_import"] - energy["grid_return"]
        why = "no meter" if summary["topics"]["meter"] is None else "no meter reading fits in time"
        return (
            f"predicted {energy_text(net)} from the grid over {time['observed_time']:.1f} s; "
            f"nothing measured ({why}): prediction only"
        )
    error = compared["predicted_minus_measured_relative"]
    place = LOCATION_NAMES.get(compared["meter_location"] or "", "the meter")
    text = (
        f"predicted {energy_text(compared['predicted_energy_at_meter'])} beside measured "
        f"{energy_text(compared['measured_energy'])} at {place}"
    )
    if error is not None:
        text += f": {percent(error, sign=True)}"
    return f"{text} over {compared['compared_time']:.1f} s compared"


def beyond_constant(summary: Summary) -> str:
    """Return in one line how well the part that is not constant is predicted.

    Args:
        summary: From `summarise`.

    Returns:
        A sentence; empty where nothing was measured.
    """
    compared = summary["comparison"]
    measured = compared["measured_energy_beyond_constant"]
    constant = compared["constant_power_at_meter"]
    if measured is None or not constant:
        return ""
    error = compared["beyond_constant_relative"]
    return (
        f"beyond the model's constant losses of {constant:.4g} W: "
        f"predicted {energy_text(compared['predicted_energy_beyond_constant'])} beside measured "
        f"{energy_text(measured)}" + (f": {percent(error, sign=True)}" if error is not None else "")
    )


def print_replay(summary: Summary, page: Page, other: Summary | None = None) -> None:
    """Print a replay.

    Args:
        summary: From `summarise`.
        page: Where to.
        other: A second replay of the same bag to set beside it.
    """
    line(page, headline(summary), style="bold")
    if beyond := beyond_constant(summary):
        line(page, beyond)
    if other is not None:
        line(page, f"with {other['model']['change']}: {headline(other)}")
    if summary["origin"]:
        line(page, f"origin: {summary['origin']}")
    for problem in summary["problems"]:
        line(page, f"problem: {problem}", style="bold red")
    for note in summary["notes"]:
        line(page, f"note: {note}")
    line(page, "")
    scale = EnergyFormat(max(summary["energy"]["grid_import"], summary["energy"]["grid_return"]))
    pairs(page, _recording(summary))
    _print_comparison(page, summary, other, scale)
    _print_breakdown(page, summary, other, scale)
    print_joints(page, summary, scale)
    print_shaft(page, summary, scale)
    print_phases(page, summary, scale)
    _print_inputs(page, summary)


def _recording(summary: Summary) -> list[tuple[str, str]]:
    model, time, topics = summary["model"], summary["time"], summary["topics"]
    figures = ", ".join(f"{count} {tag}" for tag, count in model["figures"].items() if count)
    change = f"; {model['change']}" if model["change"] else ""
    rows = [
        ("bag", summary["bag"]),
        ("model", f"{model['robot']}, id {model['model_id']}{change}"),
        ("model file", model["source"]),
        ("its figures", figures or "none tagged"),
    ]
    if model["notes"]:
        rows.append(("its notes", " ".join(model["notes"].split())))
    rows += [
        ("joint states", ", ".join(topics["joint_states"])),
        ("temperatures", ", ".join(topics["temperatures"]) or "none"),
        ("meter", topics["meter"] or "none"),
    ]
    if time["start_ns"] is not None:
        start = datetime.fromtimestamp(time["start_ns"] // 10**9, tz=UTC)
        rows.append(
            ("recorded", f"from {start:%Y-%m-%d %H:%M:%S} UTC, span {seconds(time['span_ns'])}")
        )
    rows += [("payload", change) for change in payload_lines(summary)]
    gaps = time["gap_count"]
    rows.append(
        (
            "predicted",
            f"{seconds(time['observed_ns'])} ({percent(time['coverage'])} of the span), "
            + (
                f"{gaps} gap{'s' * (gaps != 1)} of {seconds(time['gap_ns'])} in all"
                if gaps
                else "no gaps"
            ),
        )
    )
    return rows


def _print_comparison(
    page: Page, summary: Summary, other: Summary | None, scale: EnergyFormat
) -> None:
    compared = summary["comparison"]
    if compared["measured_energy"] is None:
        return
    place = LOCATION_NAMES.get(compared["meter_location"] or "", "the meter")
    rows = [
        (
            "measured",
            scale.joule(compared["measured_energy"]),
            scale.watt_hour(compared["measured_energy"]),
            f"{compared['measured_mean_power']:.1f} W",
            "",
            "",
        )
    ]
    for entry in (summary, other):
        if entry is None:
            continue
        values = entry["comparison"]
        if values["measured_energy"] is None:
            continue
        name = entry["model"]["change"] if entry is other else None
        rows.append(
            (
                f"predicted, {name or entry['model']['change'] or 'measured temperatures'}"
                if other is not None
                else "predicted",
                scale.joule(values["predicted_energy_at_meter"]),
                scale.watt_hour(values["predicted_energy_at_meter"]),
                f"{values['predicted_mean_power_at_meter']:.1f} W",
                scale.joule(values["predicted_minus_measured_energy"]),
                percent(values["predicted_minus_measured_relative"], sign=True),
            )
        )
    title = (
        f"Predicted beside measured at {place}, over the same "
        f"{seconds(compared['compared_ns'])} "
        f"({percent(compared['coverage'])} of what is predicted)"
    )
    table(
        page,
        title,
        ("", f"energy [{scale.unit}]", "", "mean power", f"error [{scale.unit}]", ""),
        rows,
    )


def part_names(drive: str) -> dict[str, str]:
    """Return the names of the parts of the energy from the grid, in their order.

    Args:
        drive: Drive model of the robot.
    """
    return {
        "rigid": "lifting and accelerating, net",
        "friction": "friction",
        "drive_loss": "drive losses" + (" (not modelled)" if DRIVE_MODELS[drive].lossless else ""),
        "loss_dc": "constant losses, DC side",
        "loss_grid": "constant and supply losses, grid",
        "brake": "brake resistor",
        "capacitor": "into the DC-link capacitor, net",
    }


def _print_breakdown(
    page: Page, summary: Summary, other: Summary | None, scale: EnergyFormat
) -> None:
    energy = summary["energy"]
    net = energy["grid_import"] - energy["grid_return"]
    names = part_names(summary["model"]["drive"])

    def row(name: str, value: float, second: float | None) -> list[str]:
        share = value / net if net > 0 else None
        cells = [name, scale.joule(value), scale.watt_hour(value), percent(share)]
        return [*cells, scale.joule(second)] if other is not None else cells

    second: Summary = other["energy"] if other is not None else {}
    rows = [
        row(text, energy[key], second.get(key))
        for key, text in names.items()
        if energy[key] or key not in ("brake", "capacitor")
    ]
    second_net = second["grid_import"] - second["grid_return"] if second else None
    columns = ["", f"energy [{scale.unit}]", "", "share"]
    if other is not None:
        change = str(other["model"]["change"]).replace("friction ", "friction\n")
        columns.append(f"{change}\n[{scale.unit}]")
    over = seconds(summary["time"]["observed_ns"])
    table(
        page,
        f"Where the energy went, predicted, over {over}",
        columns,
        rows,
        row("from the grid", net, second_net),
    )
    if energy["grid_return"]:
        line(
            page,
            f"  drawn {scale.joule(energy['grid_import'])} {scale.unit}, "
            f"returned {scale.joule(energy['grid_return'])} {scale.unit}",
        )
    power = summary["power"]
    mean, peak = power["predicted_mean_grid_power"], power["predicted_peak_grid_power"]
    if mean is not None and peak is not None:
        line(
            page,
            f"  mean {mean:.1f} W, peak {peak:.1f} W from the grid; balance: grid minus "
            f"the sum of its parts = {energy['balance_residual'] * 1e6:.0f} uJ",
        )
    line(page, "")


def print_joints(page: Page, summary: Summary, scale: EnergyFormat) -> None:
    """Print where the energy of each joint went.

    Args:
        page: Where to.
        summary: With ``joints``.
        scale: Unit of the energies.
    """
    keys = (
        "shaft_energy_positive",
        "shaft_energy_negative",
        "rigid_energy",
        "friction_energy",
        "drive_loss_energy",
        "drive_input_energy",
    )
    rows: list[list[str]] = []
    sums = dict.fromkeys((*keys, "share_of_grid"), 0.0)
    known = True
    for joint in summary["joints"]:
        for key in keys:
            sums[key] += joint[key]
        known = known and joint["share_of_grid"] is not None
        sums["share_of_grid"] += joint["share_of_grid"] or 0.0
        degc = joint["last_motor_temperature_degc"]
        rows.append(
            [
                joint["name"],
                *(scale.joule(joint[key]) for key in keys),
                percent(joint["share_of_grid"]),
                NOTHING if degc is None else f"{degc:.1f}",
            ]
        )
    total = [
        "all joints",
        *(scale.joule(sums[key]) for key in keys),
        percent(sums["share_of_grid"] if known else None),
        "",
    ]
    title = f"Joints, predicted [{scale.unit}]: rigid + friction + drive loss = drive input"
    table(
        page,
        title,
        (
            "",
            "shaft\nout",
            "shaft\nback",
            "rigid",
            "friction",
            "drive\nloss",
            "drive\ninput",
            "share\nof grid",
            "last\ndegC",
        ),
        rows,
        total,
    )


def print_phases(page: Page, summary: Summary, scale: EnergyFormat) -> None:
    """Print time and energy of the phases.

    Args:
        page: Where to.
        summary: With ``phases``.
        scale: Unit of the energies.
    """
    rows = [
        (
            name,
            f"{phase['time']:.3f} s",
            scale.joule(phase["grid_import_energy"]),
            f"{phase['grid_import_energy'] / phase['time']:.1f} W" if phase["time"] else NOTHING,
        )
        for name, phase in summary["phases"].items()
        if name != "unknown" or phase["time"]
    ]
    table(page, "Phases, predicted", ("", "time", f"drawn [{scale.unit}]", "mean power"), rows)


def _print_inputs(page: Page, summary: Summary) -> None:
    rows: list[tuple[str, str, str, str]] = []
    for key, account in summary["inputs"].items():
        if not account["received"]:
            continue
        rejected: dict[str, int] = account["rejected"]
        reasons = ", ".join(f"{n} {why.replace('_', ' ')}" for why, n in rejected.items())
        rows.append(
            (
                INPUT_NAMES[key],
                str(account["received"]),
                str(account["accepted"]),
                reasons or "none",
            )
        )
    table(page, "Inputs", ("", "received", "accepted", "rejected"), rows)
    quality = summary["quality"]
    counts: dict[str, int] = quality["counts"]
    marked = [
        (
            QUALITY_NAMES.get(name, name),
            str(count),
            percent(count / quality["samples"] if quality["samples"] else None),
        )
        for name, count in counts.items()
    ]
    if marked:
        table(
            page,
            f"Quality: marked of {quality['samples']} samples",
            ("", "samples", "share"),
            marked,
        )
