"""The statuses of the monitors: joint states, motor temperatures, energy and meter."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

from robot_energy.blocks import Quality
from robot_energy.ingest import Accounting, JointStateIngest, MeterIngest, TemperatureIngest
from robot_energy.ingest.sources import INTERFACE_NAMES
from robot_energy.model_file import RobotModel
from robot_energy.pipeline import FrictionStage, Ledger
from robot_energy.pipeline.temperature_watch import TemperatureWatch
from ros2_energy_monitor.drain import Inbox
from ros2_energy_monitor.findings import ERROR, STALE, WARN, Findings, Number, Source
from ros2_energy_monitor.input_watch import InputWatch, accounting
from ros2_energy_monitor.time_watch import TimeWatch

RECENT = 10.0  # a finding of joint states that was true this long ago still shows [s]


def joint_state_source(inboxes: list[Inbox], ingest: JointStateIngest, timeout: float) -> Source:
    """Judge joint states; the topics share one account, which is shown with the first."""
    accounts = [ingest.account, *(Accounting() for _ in inboxes[1:])]
    watches = [
        InputWatch("joint state", inbox, account, timeout)
        for inbox, account in zip(inboxes, accounts, strict=True)
    ]
    topics = ", ".join(inbox.topic for inbox in inboxes)

    def findings() -> Findings:
        found = Findings("joint states")
        missing = ", ".join(sorted(ingest.missing_joints))
        if missing and not ingest.samples:
            found.add(ERROR, f"the joint names of {topics} lack {missing}")
        for finding in ingest.findings(RECENT):
            found.add(ERROR if finding.severe else WARN, finding.sentence)
        for number, (inbox, watch) in enumerate(zip(inboxes, watches, strict=True)):
            watch.judge(found, f"{inbox.topic}." if number else "")
        found.values |= {
            "gaps": ingest.order.gaps,
            "backward_jumps": ingest.order.jumps,
            "conflicts": ingest.conflicts.count,
            "joints_missing": len(ingest.missing_joints),
            "joints_ignored": len(ingest.ignored_joints),
            **{f"age.{name}": age for name, age in ingest.ages.items()},
        }
        found.remarks += strangers(topics, ingest.ignored_joints)
        return found

    return findings


def strangers(topics: str, names: Iterable[str]) -> list[str]:
    """Name joints that a topic brings and the model does not know, one sentence each."""
    return [
        f"{topics} also names '{name}', which the model does not know: ignored"
        for name in sorted(names)
    ]


def temperature_source(
    inboxes: list[Inbox], ingest: TemperatureIngest, stage: FrictionStage, model: RobotModel
) -> Source:
    """Judge motor temperatures and the friction that follows from them."""

    def findings() -> Findings:
        found = Findings("motor temperatures")
        ages = [inbox.age for inbox in inboxes if inbox.received]
        topics = ", ".join(inbox.topic for inbox in inboxes) or "any topic"
        silent = [
            inbox
            for inbox in inboxes
            if inbox.msgtype != INTERFACE_NAMES and inbox.age > model.temperature.stale_after
        ]
        fallback = f"friction is taken at {model.temperature.fallback_degc:g} degC"
        latest = stage.latest()
        degc = dict(zip(model.joint_names, latest.motor_temperature_degc[0].tolist(), strict=True))
        unknown = [name for name, value in degc.items() if math.isnan(value)]
        found.values |= {
            "input_age": min(ages, default=math.nan),
            "input_publishers": sum(inbox.publishers for inbox in inboxes),
            **accounting(ingest.account),
            **_by_source(ingest),
            "joints_ignored": len(ingest.ignored_joints),
            **{f"readings_{key}": value for key, value in _readings(stage).items()},
            **{f"motor_temperature_degc.{name}": value for name, value in degc.items()},
        }
        found.remarks += strangers(topics, ingest.ignored_joints)
        for doubt in ingest.doubts:
            found.add(WARN, doubt)
        if unknown and ingest.account.rejected and not ingest.account.accepted:
            worst = ingest.account.rejected.most_common(1)[0][0]
            found.add(WARN, f"every message on {topics} is rejected as {worst}; {fallback}")
        elif len(unknown) == len(model.joint_names):
            found.add(WARN, f"no motor temperature has arrived on {topics}; {fallback}")
        elif silent:
            age = min(inbox.age for inbox in silent)
            topics = ", ".join(inbox.topic for inbox in silent)
            found.add(STALE, f"no motor temperature for {age:.1f} s on {topics}; {fallback}")
        elif unknown:
            found.add(WARN, f"no motor temperature of {', '.join(unknown)}; there {fallback}")
        quality = Quality(int(latest.quality[0]))
        if quality & Quality.TEMPERATURE_IMPLAUSIBLE:
            found.add(WARN, "the last reading of a motor temperature is implausible")
        if quality & Quality.EXTRAPOLATED:
            found.add(WARN, "a motor temperature lies outside the range its friction was fitted in")
        return found

    return findings


def stuck_temperatures(watch: TemperatureWatch, model: RobotModel) -> Callable[[Findings], None]:
    """Judge whether the temperatures follow the losses of the motors."""

    def judge(found: Findings) -> None:
        stuck = [name for name, is_so in zip(model.joint_names, watch.stuck, strict=True) if is_so]
        found.values["temperatures_stuck"] = len(stuck)
        if stuck:
            found.add(
                WARN,
                f"the motor temperature of {', '.join(stuck)} has not changed although the "
                f"losses must have warmed it by {watch.rise.max():.0f} K",
            )

    return judge


def energy_source(
    ledger: Ledger,
    meter: Sequence[Inbox],
    readings: MeterIngest,
    meter_timeout: float,
    *inputs: Callable[[Findings], None],
) -> Source:
    """Judge the books and the meter.

    Args:
        ledger: The books.
        meter: Where meter readings arrive: one topic, voltage and current, or none.
        readings: What became of them.
        meter_timeout: Silence beyond which the meter counts as missing. [s]
        inputs: Each judges another input of the node.
    """
    names = ("meter_voltage_", "meter_current_") if len(meter) > 1 else ("meter_",)
    watches = [
        (name, InputWatch("meter reading", inbox, readings.account, meter_timeout, needed=False))
        for name, inbox in zip(names, meter, strict=False)
    ]

    watch_of_time = TimeWatch()

    def findings() -> Findings:
        found = Findings("energy")
        for judge in inputs:
            judge(found)
        wrong = watch_of_time.judge(ledger.registers.time)
        if wrong:
            found.add(ERROR, wrong)
        for name, watch in watches:
            watch.judge(found, name)
        time, comparison = ledger.registers.time, ledger.comparison
        residual = comparison.measured_energy - comparison.predicted_energy
        measured = comparison.measured_energy
        found.values |= {
            "coverage": time.coverage,
            "observed_time": time.observed_ns * 1e-9,
            "gap_time": time.gap_ns * 1e-9,
            "gaps": time.gap_count,
            "comparison_time": comparison.compared_ns * 1e-9,
            "residual_energy": residual if comparison.compared_ns else math.nan,
            "residual_share": residual / measured if measured else math.nan,
            "residual_share_last_minute": ledger.judgement.residual_share,
            "meter_counter_resets": comparison.curve.counter.resets,
            "meter_counter_wraps": comparison.curve.counter.wraps,
            **accounting(comparison.curve, "meter_readings_"),
            "extrapolated_share": _share(ledger, Quality.EXTRAPOLATED),
            "drive_extrapolated_share": _share(ledger, Quality.DRIVE_EXTRAPOLATED),
            "temperature_missing_share": _share(ledger, Quality.TEMPERATURE_MISSING),
            "temperature_stale_share": _share(ledger, Quality.TEMPERATURE_STALE),
            "temperature_stuck_share": _share(ledger, Quality.TEMPERATURE_STUCK),
            "not_finite_share": _share(ledger, Quality.NOT_FINITE),
        }
        if ledger.quality[Quality.NOT_FINITE]:
            found.add(
                WARN, f"the power of {ledger.quality[Quality.NOT_FINITE]} samples is not finite"
            )
        for sentence in ledger.judgement.findings(comparison):
            found.add(WARN, sentence)
        return found

    return findings


def _share(ledger: Ledger, bit: Quality) -> float:
    return ledger.quality[bit] / ledger.samples if ledger.samples else math.nan


def _by_source(ingest: TemperatureIngest) -> dict[str, Number]:
    """Accounts of the sources by name, where there are several."""
    values: dict[str, Number] = {}
    for reader in ingest.readers if len(ingest.readers) > 1 else ():
        values |= accounting(reader.account, f"{reader.name}.")
    return values


def _readings(stage: FrictionStage) -> dict[str, int]:
    return {
        "received": stage.received,
        "accepted": stage.accepted,
        **{f"rejected.{reason}": count for reason, count in stage.rejected.items() if count},
    }
