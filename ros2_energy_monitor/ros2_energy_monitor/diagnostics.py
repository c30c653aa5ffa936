"""What the monitors say about themselves on ``/diagnostics``, once a second.

Every status has numeric key values and a message that says in one sentence what is wrong,
or that all is well. The worst finding decides the level.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from lifecycle_msgs.msg import State
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node

from robot_energy.blocks import Quality
from robot_energy.comparison import MeterCurve
from robot_energy.ingest import Accounting, JointStateIngest, MeterIngest, TemperatureIngest
from robot_energy.model_file import RobotModel
from robot_energy.pipeline import FrictionStage, Ledger
from ros2_energy_monitor.drain import Inbox

Number = float | int
OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK,
    DiagnosticStatus.WARN,
    DiagnosticStatus.ERROR,
    DiagnosticStatus.STALE,
)
SEVERITY = {OK: 0, WARN: 1, STALE: 2, ERROR: 3}
REJECTED_SHARE = 0.01  # more than this of the messages of one second is worth a warning


@dataclass
class Findings:
    """What one status collects.

    Attributes:
        name: What the status is about.
        values: Numeric key values.
        level: The worst level so far.
        message: What is wrong, of that level.
    """

    name: str
    values: dict[str, Number] = field(default_factory=lambda: dict[str, Number]())
    level: bytes = OK
    message: str = ""

    def add(self, level: bytes, message: str) -> None:
        """Note something wrong; the first finding of the worst level is shown."""
        if SEVERITY[level] > SEVERITY[self.level]:
            self.level, self.message = level, message


Source = Callable[[], Findings]


class Reporter:
    """Publishes the findings of a node.

    Args:
        node: The node.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)

    def publish(self, sources: list[Source], model_id: str) -> None:
        """Publish one status per source.

        Args:
            sources: Each gives one status.
            model_id: Identity of the model, which becomes the hardware id; empty for none.
        """
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.status = [self._status(source(), model_id) for source in sources]
        self._publisher.publish(message)

    def _status(self, found: Findings, model_id: str) -> DiagnosticStatus:
        return DiagnosticStatus(
            level=found.level,
            name=f"{self._node.get_fully_qualified_name().lstrip('/')}: {found.name}",
            message=found.message or "all is well",
            hardware_id=model_id,
            values=[KeyValue(key=key, value=_text(value)) for key, value in found.values.items()],
        )


def node_source(node: LifecycleNode) -> Source:
    """Judge the node itself: a state in which it counts nothing is worth a warning."""

    def findings() -> Findings:
        found = Findings("node")
        number, label = node._state_machine.current_state
        found.values["lifecycle_state"] = number
        if number != State.PRIMARY_STATE_ACTIVE:
            found.add(WARN, f"the node is {label}: nothing is counted or published")
        return found

    return findings


class InputWatch:
    """Judges one input: is it there, is it fresh, is it accepted.

    Args:
        what: What the input brings, such as ``joint state``.
        inbox: Where it arrives.
        account: What became of it.
        timeout: Silence beyond which it counts as missing. [s]
        needed: Whether its absence from the start is an error.
    """

    def __init__(
        self, what: str, inbox: Inbox, account: Accounting, timeout: float, needed: bool = True
    ) -> None:
        self._what, self._inbox, self._account = what, inbox, account
        self._timeout, self._needed = timeout, needed
        self._before: tuple[int, Mapping[str, int], int] = (0, {}, 0)

    def judge(self, found: Findings, prefix: str = "") -> None:
        """Add the key values of the input and what is wrong with it."""
        inbox, account = self._inbox, self._account
        received, rejected, overflows = self._before
        new = account.received - received
        reasons = {
            reason: count - rejected.get(reason, 0) for reason, count in account.rejected.items()
        }
        lost = inbox.overflows - overflows
        self._before = (account.received, dict(account.rejected), inbox.overflows)
        found.values |= {
            f"{prefix}input_age": inbox.age,
            f"{prefix}input_publishers": inbox.publishers,
            **accounting(account, prefix),
            f"{prefix}queue_overflows": inbox.overflows,
        }
        if not inbox.received:
            if self._needed:
                publishers = inbox.publishers
                found.add(
                    ERROR,
                    f"no {self._what} has arrived on {inbox.topic}, which has "
                    f"{publishers or 'no'} publisher{'s' if publishers > 1 else ''}",
                )
        elif inbox.age > self._timeout:
            found.add(STALE, f"no {self._what} for {inbox.age:.1f} s on {inbox.topic}")
        if new and sum(reasons.values()) > REJECTED_SHARE * new:
            worst = max(reasons, key=lambda reason: reasons[reason])
            found.add(
                WARN,
                f"{sum(reasons.values())} of {new} messages on {inbox.topic} rejected in the "
                f"last second, most as {worst}",
            )
        if lost:
            found.add(
                WARN, f"the queue of {inbox.topic} was full {lost} times: messages may be lost"
            )


def accounting(account: Accounting | MeterCurve, prefix: str = "") -> dict[str, Number]:
    """Return received, accepted and rejected messages by reason."""
    return {
        f"{prefix}received": account.received,
        f"{prefix}accepted": account.accepted,
        **{f"{prefix}rejected.{reason}": count for reason, count in account.rejected.items()},
    }


def joint_state_source(inbox: Inbox, ingest: JointStateIngest, timeout: float) -> Source:
    """Judge joint states."""
    watch = InputWatch("joint state", inbox, ingest.account, timeout)

    def findings() -> Findings:
        found = Findings("joint states")
        missing = ", ".join(sorted(ingest.missing_joints))
        if missing and not ingest.account.accepted:
            found.add(ERROR, f"the joint names of {inbox.topic} lack {missing}")
        watch.judge(found)
        found.values |= {
            "gaps": ingest.order.gaps,
            "backward_jumps": ingest.order.jumps,
            "joints_missing": len(ingest.missing_joints),
            "joints_ignored": len(ingest.ignored_joints),
        }
        return found

    return findings


def temperature_source(
    inboxes: list[Inbox], ingest: TemperatureIngest, stage: FrictionStage, model: RobotModel
) -> Source:
    """Judge motor temperatures and the friction that follows from them."""

    def findings() -> Findings:
        found = Findings("motor temperatures")
        ages = [inbox.age for inbox in inboxes if inbox.received]
        topics = ", ".join(inbox.topic for inbox in inboxes) or "any topic"
        fallback = f"friction is taken at {model.temperature.fallback_degc:g} degC"
        latest = stage.latest()
        degc = dict(zip(model.joint_names, latest.motor_temperature_degc[0].tolist(), strict=True))
        unknown = [name for name, value in degc.items() if math.isnan(value)]
        found.values |= {
            "input_age": min(ages, default=math.nan),
            "input_publishers": sum(inbox.publishers for inbox in inboxes),
            **accounting(ingest.account),
            **{f"readings_{key}": value for key, value in _readings(stage).items()},
            **{f"motor_temperature_degc.{name}": value for name, value in degc.items()},
        }
        if unknown and ingest.account.rejected and not ingest.account.accepted:
            worst = ingest.account.rejected.most_common(1)[0][0]
            found.add(WARN, f"every message on {topics} is rejected as {worst}; {fallback}")
        elif len(unknown) == len(model.joint_names):
            found.add(WARN, f"no motor temperature has arrived on {topics}; {fallback}")
        elif min(ages, default=0.0) > model.temperature.stale_after:
            found.add(STALE, f"no motor temperature for {min(ages):.1f} s on {topics}; {fallback}")
        elif unknown:
            found.add(WARN, f"no motor temperature of {', '.join(unknown)}; there {fallback}")
        quality = Quality(int(latest.quality[0]))
        if quality & Quality.TEMPERATURE_IMPLAUSIBLE:
            found.add(WARN, "the last reading of a motor temperature is implausible")
        if quality & Quality.EXTRAPOLATED:
            found.add(WARN, "a motor temperature lies outside the range its friction was fitted in")
        return found

    return findings


def energy_source(
    ledger: Ledger,
    meter: Inbox,
    readings: MeterIngest,
    meter_timeout: float,
    inputs: Callable[[Findings], None] = lambda found: None,
) -> Source:
    """Judge the books and the meter.

    Args:
        ledger: The books.
        meter: Where meter readings arrive.
        readings: What became of them.
        meter_timeout: Silence beyond which the meter counts as missing. [s]
        inputs: Judges the other inputs of the node.
    """
    watch = InputWatch("meter reading", meter, readings.account, meter_timeout, needed=False)

    def findings() -> Findings:
        found = Findings("energy")
        inputs(found)
        watch.judge(found, "meter_")
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


def _readings(stage: FrictionStage) -> dict[str, int]:
    return {
        "received": stage.received,
        "accepted": stage.accepted,
        **{f"rejected.{reason}": count for reason, count in stage.rejected.items() if count},
    }


def _text(value: Number) -> str:
    return str(value) if isinstance(value, int) else f"{value:.6g}"
