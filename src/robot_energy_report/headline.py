"""The first lines of a report about recordings: what was used, and how far the meter agrees."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from robot_energy.foundation.units import JOULE_PER_KWH
from robot_energy.results.replay import ReplayReport
from robot_energy.timeline.blocks import NANOSECOND
from robot_energy_report.document import Tiles
from robot_energy_report.energy import scale_of
from robot_energy_report.formats import (
    counted,
    energy_text,
    percent,
    signed_percent,
    watt_hours,
)

if TYPE_CHECKING:
    from robot_energy_report.page.settings import PageSettings

AGREES = 5e-4  # of the energy; less is 0.0 % as it is shown [-]
LOCATION_NAMES = {"grid": "the grid", "dc_bus": "the DC bus"}


def place_of(report: ReplayReport) -> str:
    """Return where the power of the comparison flows, in words."""
    return LOCATION_NAMES.get(report.comparison.meter_location or "", "the meter")


def verdict(report: ReplayReport) -> str:
    """Return what the result means, in plain words: how good, how sure, what to measure next."""
    error, sure = report.comparison.predicted_minus_measured_relative, report.uncertainty
    if error is None:
        text = "Nothing was measured: this is a prediction alone"
    elif abs(error) < AGREES:
        text = f"The model agrees with the meter within {percent(AGREES)}"
    else:
        text = f"The model reads {percent(abs(error))} {'high' if error > 0 else 'low'}"
    if sure.half_relative is not None:
        text += f"; its energy is known within {percent(sure.half_relative)} (90 % band)"
    if sure.contributions:
        text += f"; measure next: {sure.contributions[0].name}"
    return text


def headline(report: ReplayReport) -> str:
    """Return the result in one line: predicted and measured, or predicted alone and why."""
    compared = report.comparison
    measured, predicted = compared.measured_energy, compared.predicted_energy_at_meter
    if measured is None or predicted is None:
        why = "no meter" if report.topics.meter is None else "no meter reading fits in time"
        return (
            f"predicted {energy_text(report.energy.net)} from the grid over "
            f"{report.time.observed_time:.1f} s; nothing measured ({why}): prediction only"
        )
    text = (
        f"predicted {energy_text(predicted)}, measured {energy_text(measured)} at "
        f"{place_of(report)}"
    )
    if compared.predicted_minus_measured_relative is not None:
        text += f": {percent(compared.predicted_minus_measured_relative, sign=True)}"
    return f"{text} over {compared.compared_time:.1f} s compared"


def beyond_constant(report: ReplayReport) -> str:
    """Return in one line how well the part that is not constant is predicted."""
    compared = report.comparison
    predicted = compared.predicted_energy_beyond_constant
    measured, error = compared.measured_energy_beyond_constant, compared.beyond_constant_relative
    if measured is None or predicted is None or not compared.constant_power_at_meter:
        return ""
    return (
        f"beyond the model's constant losses of {compared.constant_power_at_meter:.4g} W: "
        f"predicted {energy_text(predicted)}, measured {energy_text(measured)}"
        + (f": {percent(error, sign=True)}" if error is not None else "")
    )


def tiles(reports: Sequence[ReplayReport], settings: PageSettings | None) -> Tiles:
    """Return the figures that matter most, over all recordings."""
    net, observed = sum(one.energy.net for one in reports), observed_time(reports)
    scale = scale_of([one.energy for one in reports])
    error, compared = error_of(reports)
    half = reports[0].uncertainty.half_relative if len(reports) == 1 else None
    sure = "" if half is None else f"; 90 % band +- {percent(half)}"
    found = [
        (
            "Energy from the grid",
            scale.text(net),
            f"or {watt_hours(net)}; predicted, {counted(len(reports), 'recording')} of "
            f"{duration(observed)} in all{sure}",
        ),
        ("Mean power", f"{net / observed:.0f} W" if observed else "-", "predicted"),
        (
            "Prediction against meter",
            signed_percent(error),
            "nothing was measured" if error is None else f"over {duration(compared)} compared",
        ),
    ]
    friction = sum(one.energy.friction for one in reports)
    names = [job.name for one in reports for job in one.jobs]
    if names:
        name = max(names, key=names.count)
        jobs = [job.energy for one in reports for job in one.jobs if job.name == name]
        found.append(
            ("Per job", scale.text(sum(jobs) / len(jobs)), f"mean of {len(jobs)} of '{name}'")
        )
    if net > 0:
        found.append(
            ("Into friction", percent(friction / net), f"{scale.text(friction)} of all joints")
        )
    if settings is None:
        return Tiles(found)
    used = [one.energy.grid_import / JOULE_PER_KWH for one in reports]
    spans = [(one.time.start_ns or 0, one.time.span_ns) for one in reports]
    prices = [settings.mean_price(start_ns, start_ns + span_ns) for start_ns, span_ns in spans]
    if None not in prices:
        cost = sum(kwh * (price or 0.0) for kwh, price in zip(used, prices, strict=True))
        how = (
            "energy spread evenly over each recording, each time at its price"
            if settings.time_of_use
            else f"at {settings.price_per_kwh:g} {settings.currency}/kWh"
        )
        found.append(("Cost", f"{cost:.4f} {settings.currency}", how))
    if settings.co2_kg_per_kwh is not None:
        grams = sum(used) * settings.co2_kg_per_kwh * 1e3
        source = f", {settings.co2_source}" if settings.co2_source else ""
        found.append(("CO\u2082", f"{grams:.1f} g", f"{settings.co2_kg_per_kwh:g} kg/kWh{source}"))
    return Tiles(found)


def error_of(reports: Sequence[ReplayReport]) -> tuple[float | None, float]:
    """Return predicted over measured energy less 1 [-], None if unmeasured; compared time [s]."""
    pairs = [
        (one.comparison.predicted_energy_at_meter, one.comparison.measured_energy)
        for one in reports
    ]
    known = [
        (predicted, measured) for predicted, measured in pairs if None not in (predicted, measured)
    ]
    measured = sum(measured or 0.0 for _, measured in known)
    predicted = sum(predicted or 0.0 for predicted, _ in known)
    time = sum(one.comparison.compared_time for one in reports)
    return (predicted / measured - 1.0 if measured > 0 else None), time


def observed_time(reports: Sequence[ReplayReport]) -> float:
    """Return the predicted time of all recordings. [s]"""
    return sum(one.time.observed_ns for one in reports) * NANOSECOND


def duration(time: float) -> str:
    """Return a span of time with three to four digits.

    Args:
        time: The span. [s]
    """
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if time >= 2 * size:
            return f"{time / size:.1f} {unit}"
    return f"{time:.1f} s"
