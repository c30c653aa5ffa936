"""The figures of the page as OpenMetrics, for Prometheus and what reads its format."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, cast

from prometheus_client.core import (
    CollectorRegistry,
    CounterMetricFamily,
    GaugeMetricFamily,
)
from prometheus_client.openmetrics import exposition
from prometheus_client.registry import Collector

from robot_energy.foundation.described import Described
from robot_energy.timeline.blocks import Phase
from robot_energy_report.page.hub import PageHub

OPENMETRICS = exposition.CONTENT_TYPE_LATEST
Labels = tuple[str, ...]


class Metric(Described):
    """One family of metrics."""

    name: str
    unit: str
    text: str
    labels: Annotated[Labels, "Names of the labels; the first is ``robot``."] = ("robot",)
    counter: Annotated[bool, "Whether it only grows, from ``energy_start`` on."] = False


METRICS = {
    metric.name: metric
    for metric in (
        Metric("robot_energy_joules", "joules", "Predicted energy by where it came from or went.",
               ("robot", "part"), True),
        Metric("robot_joint_friction_energy_joules", "joules", "Predicted friction energy.",
               ("robot", "joint"), True),
        Metric("robot_joint_drive_loss_energy_joules", "joules",
               "Predicted loss of motor and drive.", ("robot", "joint"), True),
        Metric("robot_energy_observed_seconds", "seconds", "Time with valid joint states.",
               counter=True),
        Metric("robot_energy_gap_seconds", "seconds", "Time without valid joint states.",
               counter=True),
        Metric("robot_energy_at_meter_joules", "joules",
               "Energy at the meter over the compared intervals; no sample until the lag of the "
               "meter hardly matters. It may fall where the supply feeds back.",
               ("robot", "source")),
        Metric("robot_energy_band_joules", "joules",
               "Half width of the 90 % band of the predicted net energy."),
        Metric("robot_power_watts", "watts",
               "Power, mean of the newest period; NaN where unknown or stale.",
               ("robot", "source")),
        Metric("robot_power_part_watts", "watts",
               "Predicted power by where it goes, mean over a second.", ("robot", "part")),
        Metric("robot_joint_friction_power_watts", "watts", "Predicted friction power.",
               ("robot", "joint")),
        Metric("robot_joint_temperature_celsius", "celsius", "Motor temperature in use.",
               ("robot", "joint")),
        Metric("robot_auxiliary_energy_joules", "joules",
               "Energy of a load outside of the cabinet while its power is known.",
               ("robot", "load")),
        Metric("robot_auxiliary_missing_seconds", "seconds",
               "Observed time for which the power of the load is not known.",
               ("robot", "load"), True),
        Metric("robot_auxiliary_power_watts", "watts",
               "Power of a load outside of the cabinet; NaN where unknown or stale.",
               ("robot", "load")),
        Metric("robot_outlet_energy_joules", "joules",
               "Energy of cabinet and loads while all are known; NaN without loads."),
        Metric("robot_coverage_ratio", "ratio", "Share of the period with valid joint states."),
        Metric("robot_phase", "", "1 for the phase the robot is in.", ("robot", "phase")),
        Metric("robot_energy_up", "", "1 while power states arrive."),
        Metric("robot_energy_persisted", "", "1 if the registers are on disk."),
        Metric("robot_energy_findings", "", "Diagnostic statuses by level.", ("robot", "level")),
    )
}  # fmt: skip
REGISTERS = {
    "predicted_import": "predicted_import_energy",
    "predicted_return": "predicted_return_energy",
    "brake_resistor": "brake_energy",
    "cabinet_dc": "loss_dc_energy",
    "cabinet_grid": "loss_grid_energy",
}
AT_METER = {"measured": "measured_energy", "predicted": "predicted_energy_at_meter"}
SOURCES = {
    "predicted": "predicted_grid_power",
    "measured": "measured_power",
    "predicted_at_meter": "predicted_power_at_meter",
    "predicted_lower": "predicted_power_lower",
    "predicted_upper": "predicted_power_upper",
}
PARTS = ("loss_dc", "loss_grid", "brake_power", "capacitor_power", "returned_power")
LEVELS = ("WARN", "ERROR", "STALE")


def metrics_text(hub: PageHub, now: float) -> bytes:
    """Return all metrics as OpenMetrics; time as in `robot_energy_report.page.hub.PageHub.tick`."""
    registry = CollectorRegistry()
    registry.register(_Robots(hub.snapshots(now)))
    written: bytes = cast("Any", exposition).generate_latest(registry)
    return written


class _Robots(Collector):
    def __init__(self, robots: Sequence[dict[str, Any]]) -> None:
        self._robots = robots

    def collect(self) -> Iterator[Any]:
        families: dict[str, Any] = {}
        for metric in METRICS.values():
            kind = CounterMetricFamily if metric.counter else GaugeMetricFamily
            families[metric.name] = kind(
                metric.name, metric.text, labels=metric.labels, unit=metric.unit
            )
        for robot in self._robots:
            registers = robot["registers"]
            nothing = registers is not None and registers["observed_time"] == 0.0
            found: dict[tuple[str, Labels], float | None] = {}
            for name, labels, value in _samples(robot):  # the first of each, as of two equal joints
                found.setdefault((name, labels), value)
            for (name, labels), value in found.items():
                words: dict[str, Any] = {}
                if METRICS[name].counter:
                    value = 0.0 if value is None and nothing else value  # where it begins
                    words = {"created": robot["registers"]["energy_start"]}
                    if value is None or value < 0:  # not known: no sample
                        continue
                known = math.nan if value is None else value
                families[name].add_metric((robot["name"], *labels), known, **words)
        yield from families.values()


Sample = tuple[str, Labels, float | None]


def _samples(robot: Mapping[str, Any]) -> Iterator[Sample]:
    power, registers = robot["power"], robot["registers"]
    means: dict[str, Any] = robot["means"] or {}
    for source, name in SOURCES.items():
        yield "robot_power_watts", (source,), power.get(name)
    for part in PARTS:
        yield "robot_power_part_watts", (part,), means.get(part)
    for joint in robot["joints"]:
        label = (joint["name"],)
        yield "robot_joint_friction_power_watts", label, joint["friction_power"]
        yield "robot_joint_temperature_celsius", label, joint["motor_temperature_degc"]
    for load in robot["auxiliary"]:
        yield "robot_auxiliary_power_watts", (load["name"],), load["power"]
        yield "robot_auxiliary_energy_joules", (load["name"],), load["energy"]
    yield "robot_coverage_ratio", (), robot["coverage"]
    for phase in Phase:
        yield "robot_phase", (phase.name.lower(),), float(power.get("phase") == phase.name)
    yield "robot_energy_up", (), float(not power["stale"])
    for level in LEVELS:
        count = sum(one["level"] == level for one in robot["findings"])
        yield "robot_energy_findings", (level.lower(),), float(count)
    if registers is None:
        return
    if not registers["recording"]:
        for part, register in REGISTERS.items():
            yield "robot_energy_joules", (part,), registers[register]
        for joint in registers["joints"]:
            label = (joint["name"],)
            yield "robot_joint_friction_energy_joules", label, joint["friction_energy"]
            yield "robot_joint_drive_loss_energy_joules", label, joint["drive_loss_energy"]
        for load in robot["auxiliary"]:
            yield "robot_auxiliary_missing_seconds", (load["name"],), load["missing_time"]
        yield "robot_energy_observed_seconds", (), registers["observed_time"]
        yield "robot_energy_gap_seconds", (), registers["gap_time"]
    yield "robot_energy_persisted", (), float(registers["persisted"])
    if registers["predicted_energy_at_meter"] is not None:  # of both, so that changes compare
        for source, name in AT_METER.items():
            yield "robot_energy_at_meter_joules", (source,), registers[name]
    yield "robot_energy_band_joules", (), registers["predicted_energy_band"]
    yield "robot_outlet_energy_joules", (), registers["outlet_energy"]
