"""State of one robot on the page: the newest of every topic, and the history of its power."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, cast

import numpy as np

from robot_energy.bag.cdr import RawBatch, Run, stamp_ns
from robot_energy.foundation.shown_text import shown
from robot_energy.foundation.units import JOULE_PER_KWH, JOULE_PER_WH
from robot_energy.timeline.blocks import (
    NANOSECOND,
    Float,
    MeterLocation,
    Phase,
    Quality,
    TemperatureOrigin,
)
from robot_energy_report.page.alarms import PageFinding, quality_alarms
from robot_energy_report.page.energy_flow import FlowParts, flow_picture, registers_picture
from robot_energy_report.page.history import HistoryRing
from robot_energy_report.page.json_numbers import json_number
from robot_energy_report.page.messages import (
    ENERGIES,
    JOINT_ENERGIES,
    JOINT_POWERS,
    JOINT_STATE,
    OUTLET,
    POWERS,
    STATE,
    TIMES,
    TOTALS,
    PageReaders,
    job_rows,
    last_job,
    load_alarms,
    load_rows,
    net_energy,
    newest_loads,
    phase_rows,
)
from robot_energy_report.page.settings import CostCounter, PageSettings
from robot_energy_report.page.stale import is_stale

OVERVIEW = (
    "stale", "phase", "predicted_grid_power", "measured_power", "predicted_power_at_meter",
)  # fmt: skip
MEAN_OVER = 1.0  # of the powers in tables and in the flow picture [s]
MAX_POWER = 1e9  # of a robot, either way [W]
MAX_PERIOD = 86_400.0  # of a power state [s]
MAX_FINDINGS = 64  # statuses kept, so that ever new names cannot fill the memory
LIVE_WIDTH, HOUR_WIDTH = 0.2, 6.0  # of a bucket [s]; 600 of them: two minutes, one hour


class _Recent(NamedTuple):
    stamp_ns: Any
    period: Float
    parts: Float  # (N, terms of a flow and the powers)


def _possible(values: Float, most: float) -> Float:
    """NaN for what no robot has, either way: sums of such numbers overflow."""
    return np.where(np.abs(values) <= most, values, np.nan)


class RobotState:
    """Keeps the latest of every topic of one robot, and its history.

    Time of receipt comes as an argument, so that live page and recording are one code path.
    """

    def __init__(self, name: str, settings: PageSettings, live: bool = True) -> None:
        self.name = shown(name)
        self._settings, self._live = settings, live
        self._readers = PageReaders()
        n = len(POWERS)
        shift = settings.shift_hours * 3600.0 / 600.0
        self.rings = {
            "live": HistoryRing(LIVE_WIDTH, n),
            "hour": HistoryRing(HOUR_WIDTH, n),
            "shift": HistoryRing(shift, n),
            "all": HistoryRing(LIVE_WIDTH, n, whole=True),
        }
        self._newest: dict[str, Any] | None = None
        self._joint_names: tuple[str, ...] = ()
        self._recent: _Recent | None = None
        self._received: float | None = None
        self._friction: dict[str, dict[str, Any]] = {}
        self._registers: dict[str, Any] | None = None
        self._findings: dict[str, PageFinding] = {}
        self._intervals: list[dict[str, Any]] | None = None
        self._cost = CostCounter(settings)

    def take_power(self, batch: RawBatch, now: float) -> None:
        """Take power states.

        Args:
            now: Time of receipt on any steady clock. [s]
        """
        for run in self._readers.power(batch):
            self._take_run(run)
            self._received = now

    def take_registers(self, batch: RawBatch) -> None:
        """Take energy registers; the newest counts."""
        found = self._readers.registers(batch)
        if found is not None:
            self._registers = found
            self._cost.add(found["start_ns"], found["stamp_ns"], found["predicted_import_energy"])

    def take_friction(self, batch: RawBatch) -> None:
        """Take friction coefficients; the newest count."""
        found = self._readers.friction(batch)
        if found is not None:
            self._friction = found

    def take_findings(self, findings: Sequence[PageFinding]) -> None:
        """Take diagnostic statuses, each in place of the one before it of the same name."""
        for finding in findings:
            if finding.name in self._findings or len(self._findings) < MAX_FINDINGS:
                self._findings[finding.name] = finding

    def take_intervals(self, intervals: Sequence[dict[str, Any]]) -> None:
        """Take job intervals, each with the fields of `interval_fields`, newest last."""
        self._intervals = list(intervals)

    def stale(self, now: float) -> bool:
        """Whether no power state has arrived for too long; time as in `RobotState.take_power`."""
        if not self._live:
            return False
        if self._received is None or self._newest is None:
            return True
        return is_stale(now - self._received, self._newest["period"])

    @property
    def registers(self) -> dict[str, Any] | None:
        """Fields of the newest register message, as `PageReaders.registers` returns them."""
        return self._registers

    def power(self, now: float) -> dict[str, Any]:
        """Return the figures that change several times a second; as in `RobotState.take_power`."""
        newest, stale = self._newest, self.stale(now)
        if newest is None:
            return {"stale": stale, "time": None}
        return {
            "stale": stale,
            "time": newest["stamp_ns"] * NANOSECOND,
            "phase": Phase.UNKNOWN.name if stale else Phase(newest["phase"]).name,
            "corrected": Quality.LEARNED in Quality(newest["quality"]),
            **{name: None if stale else json_number(newest[name], 5) for name in POWERS},
            "live": self.rings["live"].table(2),
        }

    def history(self) -> dict[str, Any]:
        """Return all rings as plain values."""
        return {name: ring.table() for name, ring in self.rings.items()}

    def snapshot(self, now: float) -> dict[str, Any]:
        """Return all but the history, None where unknown; time as in `RobotState.take_power`."""
        newest, stale = self._newest, self.stale(now)
        location = MeterLocation(newest["meter_location"]) if newest else MeterLocation.UNKNOWN
        seen = newest is not None and not stale
        mean, n = self._mean() if seen else None, len(self._joint_names)
        registers, loads = self._registers, () if newest is None else newest["auxiliary"]
        flow = None if registers is None else registers_picture(registers)
        return {
            "name": self.name,
            "model_id": newest["model_id"] if newest else None,
            "meter": location.name,
            "power": self.power(now),
            **{name: json_number(newest[name], 4) if newest and seen else None for name in STATE},
            "means": None
            if mean is None
            else {
                name: json_number(value, 5)
                for name, value in zip(TOTALS + POWERS, mean[3 * n :].tolist(), strict=True)
            },
            "joints": self._joints(seen, mean),
            "auxiliary": load_rows(loads, (registers or {}).get("auxiliary", ()), seen),
            "outlet_power": json_number(newest["outlet_power"], 5) if newest and seen else None,
            "flow": None if mean is None else self._power_flow(mean),
            "energy_flow": flow and flow.plain(JOULE_PER_WH),
            "phases": [] if registers is None else phase_rows(registers),
            "registers": self._register_values(),
            "headline": self._headline(),
            "spans": {name: self._span(ring) for name, ring in self.rings.items()},
            "buckets": {name: ring.table(2) for name, ring in self.rings.items() if name != "live"},
            "alarms": self._alarms(seen),
            "findings": [finding.plain() for finding in self._findings.values()],
            "intervals": None if self._intervals is None else job_rows(self._intervals),
        }

    def overview(self, now: float) -> dict[str, Any]:
        """Return a row among many robots; argument as in `RobotState.take_power`."""
        power, found = self.power(now), self._registers
        return {
            "name": self.name,
            **{name: power.get(name) for name in OVERVIEW},
            "energy": None if found is None else json_number(net_energy(found)),
            "alarms": len(self._alarms(self._newest is not None and not power["stale"])),
        }

    def _take_run(self, run: Run) -> None:
        names = run.names("joints.name")
        stamp, period = stamp_ns(run), run.array("period")
        if names != self._joint_names or (
            self._recent is not None and stamp[0] < self._recent.stamp_ns[-1]
        ):
            self._recent = None
        self._joint_names = names
        powers = np.stack([run.array(name) for name in POWERS], axis=1)
        joints = [run.array(f"joints.{name}").reshape(len(stamp), -1) for name in JOINT_POWERS]
        totals = np.stack([run.array(name) for name in TOTALS], axis=1)
        parts = _possible(np.concatenate([*joints, totals, powers], axis=1), MAX_POWER)
        powers, period = parts[:, -powers.shape[1] :], _possible(period, MAX_PERIOD)
        recent = _Recent(stamp, period, parts)
        if self._recent is not None:
            recent = _Recent(*map(np.concatenate, zip(self._recent, recent, strict=True)))
        keep = recent.stamp_ns > stamp[-1] - MEAN_OVER / NANOSECOND
        self._recent = _Recent(*(part[keep] for part in recent))
        covered = np.where(np.isfinite(period) & (period > 0), period, 0.0)
        for ring in self.rings.values():
            ring.add(stamp, powers, covered)
        phase = np.minimum(run.array("phase"), len(Phase) - 1)
        location = int(run.array("meter_location")[-1])
        self._newest = {
            "stamp_ns": int(stamp[-1]),
            "model_id": shown(str(cast("str", run.columns["model_id"]))),
            "period": float(covered[-1]),
            "quality": int(np.bitwise_or.reduce(run.array("quality"))),
            "phase": int(phase[-1]),
            "auxiliary": newest_loads(run),
            "outlet_power": float(run.array("outlet_power")[-1]),
            "meter_location": location if location < len(MeterLocation) else 0,
            **{name: float(run.array(name)[-1]) for name in POWERS + STATE},
            **{
                name: run.array(f"joints.{name}").reshape(len(stamp), -1)[-1]
                for name in JOINT_STATE
            },
        }

    def _span(self, ring: HistoryRing) -> dict[str, Any]:
        seconds, joule = float(ring.seconds()[0]), float(ring.energy()[0])
        return {
            "energy": json_number(joule),
            "seconds": json_number(seconds),
            "coverage": json_number(min(1.0, seconds / ring.length) if ring.length else None),
        }

    def _mean(self) -> Float | None:
        """Means of all parts over the last second; NaN where one is unknown."""
        recent = self._recent
        if recent is None or not (recent.period > 0).any():
            return None
        weight = np.where(recent.period > 0, recent.period, 0.0)
        return np.asarray(weight @ recent.parts / weight.sum())

    def _power_flow(self, mean: Float) -> dict[str, Any] | None:
        n = len(self._joint_names)
        rigid, friction, loss = mean[: 3 * n].reshape(3, n).tolist()
        totals = mean[3 * n :][: len(TOTALS)].tolist()
        loads = [
            (shown(load["name"]), load["power"])
            for load in (self._newest or {}).get("auxiliary", ())
            if math.isfinite(load["power"])
        ]
        names = [shown(name) for name in self._joint_names]
        picture = flow_picture(FlowParts(names, rigid, friction, loss, *totals, auxiliary=loads))
        return None if picture is None else picture.plain()

    def _joints(self, seen: bool, mean: Float | None) -> list[dict[str, Any]]:
        newest, n = self._newest, len(self._joint_names)
        rows: list[dict[str, Any]] = []
        for place, name in enumerate(self._joint_names if newest is not None else ()):
            friction, values = self._friction.get(name, {}), dict[str, float]()
            origin = TemperatureOrigin(min(friction.get("source", 0), len(TemperatureOrigin) - 1))
            if newest is not None and seen:
                values = {key: newest[key][place] for key in JOINT_STATE}
                taken = friction.get("temperature_time")
                if taken and newest["stamp_ns"] * NANOSECOND - taken > friction["stale_after"]:
                    origin = TemperatureOrigin.FALLBACK
                if origin is TemperatureOrigin.FALLBACK and math.isfinite(
                    values["motor_temperature_degc"]
                ):
                    origin = TemperatureOrigin.ESTIMATED  # the power monitor has a temperature
            if mean is not None:
                values |= {key: mean[n * row + place] for row, key in enumerate(JOINT_POWERS)}
            shown_keys = JOINT_STATE + JOINT_POWERS
            rows.append(
                {
                    "name": shown(name),
                    **{key: json_number(values.get(key), 4) for key in shown_keys},
                    "temperature_source": (origin if seen else TemperatureOrigin.UNKNOWN).name,
                }
            )
        return rows

    def _register_values(self) -> dict[str, Any] | None:
        found = self._registers
        if found is None:
            return None
        return {
            "time": found["stamp_ns"] * NANOSECOND,
            "energy_start": found["start_ns"] * NANOSECOND,
            "persisted": found["persisted"],
            "recording": found["recording"],
            **{name: json_number(found[name]) for name in ENERGIES + TIMES + OUTLET},
            "joints": [
                {
                    "name": shown(joint["name"]),
                    **{name: json_number(joint[name]) for name in JOINT_ENERGIES},
                }
                for joint in found["joints"]
            ],
        }

    def _headline(self) -> dict[str, Any]:
        found = self._registers
        energy = math.nan if found is None else net_energy(found)
        factor, since = self._settings.co2_kg_per_kwh, self._cost.since_ns
        return {
            "energy": json_number(energy),
            "cost": self._cost.cost,
            "cost_since": None if since is None else since * NANOSECOND,
            "price": self._cost.price,
            "currency": self._settings.currency,
            "co2": None if factor is None else json_number(energy / JOULE_PER_KWH * factor),
            "co2_factor": factor,
            "co2_source": self._settings.co2_source,
            "job": last_job(self._intervals or ()),
        }

    def _alarms(self, seen: bool) -> list[dict[str, Any]]:
        """What is wrong now: findings of the nodes above OK, then the quality bits in force."""
        alarms = [one.plain() for one in self._findings.values() if one.level != "OK"]
        if not seen and self._live and self._received is not None:
            alarms.insert(0, PageFinding.no_power(self.name).plain())
        quality = Quality(self._newest["quality"]) if seen and self._newest else Quality.OK
        alarms += [one.plain() for one in quality_alarms(quality, self._findings.values())]
        loads = self._newest["auxiliary"] if seen and self._newest else ()
        return [*alarms, *(one.plain() for one in load_alarms(loads))]
