# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The statuses of the monitors: joint states, motor temperatures, energy and meter."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from functools import partial

import numpy as np

from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.registers import Coverage
from robot_energy.inputs.joint_states.joint_states import JointStateIngest
from robot_energy.inputs.meter.meter import MeterIngest
from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.inputs.remedies import (
    JOINT_STATE_REMEDIES,
    METER_REMEDIES,
    TEMPERATURE_REMEDIES,
    remedy_of,
)
from robot_energy.inputs.sources import fitting_names, names_remedy
from robot_energy.inputs.temperatures.kinds import INTERFACE_NAMES
from robot_energy.inputs.temperatures.stuck import StuckTemperatureDetector
from robot_energy.inputs.temperatures.temperatures import TemperatureIngest
from robot_energy.model import RobotModel
from robot_energy.pipeline import FrictionStage, TorqueStage
from robot_energy.pipeline.friction_timeline import FallbackUse
from robot_energy.timeline.blocks import NANOSECOND, Quality
from robot_energy.timeline.stamps import sentence_of
from robot_energy.timeline.streams import EpochSplitter
from robot_energy_report.page.alarms import OUTSIDE_FIT, QUALITY_REMEDIES
from ros2_energy_monitor.base.inbox import INACTIVE, Inbox
from ros2_energy_monitor.diagnostics.inputs import InputWatch, accounting
from ros2_energy_monitor.diagnostics.reporter import (
    ERROR,
    STALE,
    WARN,
    Number,
    Source,
    StatusBuilder,
)


class TimeWatch:
    """Compares the time between two newest stamps with what was booked between them.

    The end of the account moves with the stamps, observed time and gaps are added up by
    other lines of code: they can only agree if both are right. Where stamps jumped back,
    or the account began again, there is nothing to compare.
    """

    def __init__(self) -> None:
        self._before: tuple[object, int | None, int] | None = None

    def check(self, time: Coverage) -> str:
        """Return what does not add up since the last call; there must never be anything."""
        begun, end = (time.start_ns, time.jumps), time.end_ns
        counted = time.observed_ns + time.gap_ns
        before, self._before = self._before, (begun, end, counted)
        if before is None or before[0] != begun or before[1] is None or end is None:
            return ""
        passed, booked = end - before[1], counted - before[2]
        if passed == booked:
            return ""
        return (
            f"accounting of time does not add up: {passed} ns passed, {booked} ns were booked as "
            f"observed or gap"
        )


NO_STATES = "start the driver or set joint_states.topics"
NO_JOINT = "start its driver or name the topics of all joints in joint_states.topics"
NO_TEMPERATURE = "start its driver, set its topic, or temperature_sources to [] if there is none"
WARM_UP = QUALITY_REMEDIES[Quality.EXTRAPOLATED][1]
SILENT_TEMPERATURE = "check its driver or topic"
NOT_KNOWN = (
    "the power of some joint states of the last second is not known: each is alone between two "
    "gaps, or the power is beyond 1 MW"
)
SPACINGS, SLOWEST = 1.5, 60.0  # of its readings a meter may be late [-], and at most [s]
APART = 5.0  # stamps that far from the clock are another clock's [s]
RECENT = 10.0  # a finding of joint states that was true this long ago still shows [s]


def joint_state_source(
    inboxes: list[Inbox],
    ingest: JointStateIngest,
    timeout: Callable[[], float],
    stage: TorqueStage,
) -> Source:
    """Return what checks joint states; the topics share one account, shown with the first.

    Args:
        timeout: Gives the silence beyond which they count as missing. [s]
    """
    accounts = [ingest.rejections, *(RejectionLog() for _ in inboxes[1:])]

    def names() -> str:
        return names_remedy(tuple(ingest.ages), ingest.ignored_joints)

    def remedy(reason: str) -> str:
        if not ingest.samples:  # a finding of its own
            return ""
        if reason == "unknown_joint":  # the driver has new names, or only a gripper is left
            fits = fitting_names(tuple(ingest.ages), ingest.ignored_joints)
            return names() if fits else NO_STATES
        return remedy_of(reason, JOINT_STATE_REMEDIES, receive_time=ingest.receive_time)

    watches = [
        InputWatch("joint state", inbox, account, timeout, remedy=NO_STATES, remedy_of=remedy)
        for inbox, account in zip(inboxes, accounts, strict=True)
    ]
    topics = ", ".join(inbox.topic for inbox in inboxes)
    late = set[str]()  # joints, at the last look

    def findings() -> StatusBuilder:
        nonlocal late
        found = StatusBuilder("joint states")
        before, late = late, {name for name, age in ingest.ages.items() if age > timeout()}
        if ingest.samples and (gone := ", ".join(sorted(before & late))):
            age = max(ingest.ages[name] for name in before & late)
            found.add(ERROR, f"no {gone} for {age:.1f} s on {topics}, while others come", NO_JOINT)
        missing = ", ".join(sorted(ingest.missing_joints))
        if missing and not ingest.samples:
            met = ", ".join(sorted(ingest.ignored_joints))
            they = f"; they are {met}" if met else ""
            found.add(ERROR, f"the joint names of {topics} lack {missing}{they}", names())
        for finding in ingest.findings(RECENT):
            found.add(ERROR if finding.severe else WARN, finding.sentence)
        for doubt in stage.effort_check.doubts():
            found.add(WARN, doubt)
        _clock(found, ingest.lag_ns)
        for number, (inbox, watch) in enumerate(zip(inboxes, watches, strict=True)):
            watch.check(found, f"{inbox.topic}." if number else "")
        silence = min((inbox.age for inbox in inboxes if inbox.received), default=0.0)
        found.values |= {
            "gaps": ingest.order.gaps,
            "backward_jumps": ingest.order.jumps,
            "conflicts": ingest.conflicts.count,
            "joints_missing": len(ingest.missing_joints),
            "joints_ignored": len(ingest.ignored_joints),
            **{f"age_s.{name}": age + silence for name, age in ingest.ages.items()},
        }
        found.remarks += unknown_joints(topics, ingest.ignored_joints)
        return found

    return findings


def _clock(found: StatusBuilder, ahead_ns: int | None) -> None:
    """Say how far the stamps of joint states are from the clock of this node.

    Ahead none can be rightly; behind they are also where a recording is played.
    """
    if ahead_ns is None:
        return
    ahead = ahead_ns * NANOSECOND
    found.values["stamps_ahead_s"] = ahead
    if ahead > APART:
        found.add(
            WARN,
            f"joint states are stamped {ahead:.1f} s ahead of the clock of this node",
            "synchronise the clocks, set use_sim_time where both are simulated, or set "
            "joint_states.stamp_source to receive",
        )
    elif ahead < -APART:
        found.notes.append(
            f"joint states are stamped {-ahead:.1f} s behind the clock of this node: a recording "
            "that is played, or clocks to synchronise"
        )


def unknown_joints(topics: str, names: Iterable[str]) -> list[str]:
    """Return a sentence for each joint that a topic brings and the model lacks, by name."""
    return [
        f"{topics} also names '{name}', which the model does not know: ignored"
        for name in sorted(names)
    ]


def temperature_source(
    inboxes: list[Inbox],
    ingest: TemperatureIngest,
    stage: FrictionStage,
    model: RobotModel,
    states: JointStateIngest | None = None,
    *,
    wanted: bool = True,
) -> Source:
    """Return what makes the status of motor temperatures and the friction that follows.

    The temperature of a motor is NaN while it is missing or too old to be used.

    Args:
        wanted: Whether any source is set; that a robot has none is not a fault.
    """
    fallback = f"friction is taken at {model.temperature.fallback_degc:g} degC"
    networks = [joint.thermal is not None for joint in model.joints]
    if any(networks):
        fixed = "" if all(networks) else f", and where the model has no network {fallback}"
        fallback = f"they are estimated from the losses{fixed}"

    def findings() -> StatusBuilder:
        found = StatusBuilder("motor temperatures")
        ages = [inbox.age for inbox in inboxes if inbox.received]
        topics = ", ".join(inbox.topic for inbox in inboxes) or "any topic"
        valued = [inbox for inbox in inboxes if inbox.msgtype != INTERFACE_NAMES]
        silent = [inbox for inbox in valued if inbox.age > model.temperature.stale_after]
        latest = stage.latest()
        given = latest.motor_temperature_degc[0]
        names = model.joint_names
        unknown = [name for name, value in zip(names, given, strict=True) if math.isnan(value)]
        silence = min((inbox.age for inbox in valued if inbox.received), default=0.0)
        now_ns = states.newest_ns if states is not None else None
        if now_ns is None:
            now_ns = int(latest.stamp_ns[0]) + round(silence / NANOSECOND)
        stale_after = model.temperature.stale_after
        oldest_ns = now_ns - round(stale_after / NANOSECOND)
        old = (latest.temperature_stamp_ns[0] < oldest_ns) | (silence > stale_after)
        in_use = np.where(old, math.nan, given).tolist()
        absent = [inbox for inbox in inboxes if not inbox.received and not inbox.publishers]
        refused = ingest.rejections.rejected - Counter({INACTIVE: ingest.rejections.received})
        found.values |= {
            "input_age_s": min(ages, default=math.nan),
            "input_publishers": sum(inbox.publishers for inbox in inboxes),
            **accounting(ingest.rejections),
            **_by_source(ingest),
            "joints_ignored": len(ingest.ignored_joints),
            **accounting(stage.rejections, "readings_"),
            **{
                f"motor_temperature_degc.{name}": value
                for name, value in zip(names, in_use, strict=True)
            },
        }
        found.remarks += unknown_joints(topics, ingest.ignored_joints)
        for doubt in (*ingest.doubts, *ingest.clock_doubts(states, RECENT)):
            found.add(WARN, doubt)
        if not wanted:
            sentence = f"temperature_sources is empty: {fallback}"
            found.notes.append(sentence)
            found.remarks.append(sentence)
        elif unknown and refused and not ingest.rejections.accepted:
            worst = refused.most_common(1)[0][0]
            those = [one for one in ingest.readers if one.rejections.rejected[worst]]
            received = all(reader.receive_time for reader in those)
            found.add(
                WARN,
                f"every message on {topics} is rejected as {worst}; {fallback}",
                remedy_of(worst, TEMPERATURE_REMEDIES, receive_time=received),
            )
        elif len(unknown) == len(names):
            have = ", which has no publisher" if absent == inboxes and len(inboxes) == 1 else ""
            remedy = NO_TEMPERATURE if absent else ""
            found.add(
                WARN, f"no motor temperature has arrived on {topics}{have}; {fallback}", remedy
            )
        elif silent:
            age = min(inbox.age for inbox in silent)
            topics = ", ".join(inbox.topic for inbox in silent)
            found.add(
                STALE,
                f"no new motor temperature for {age:.1f} s on {topics}; {fallback}",
                SILENT_TEMPERATURE,
            )
        elif unknown:
            where = f" on {', '.join(inbox.topic for inbox in absent)}" if absent else ""
            remedy = NO_TEMPERATURE if absent else ""
            found.add(
                WARN,
                f"no motor temperature of {', '.join(unknown)}{where}; there {fallback}",
                remedy,
            )
        if absent and not unknown:
            found.notes.append(f"no publisher on {', '.join(inbox.topic for inbox in absent)}")
        if int(latest.quality[0]) & Quality.TEMPERATURE_IMPLAUSIBLE:
            found.add(WARN, "the last reading of a motor temperature is implausible")
        if outside := stage.outside():
            motors = "; ".join(
                f"the motor of {name} is at {text}" for name, text in outside.items()
            )
            found.add(WARN, motors, WARM_UP)
            found.values |= {f"{OUTSIDE_FIT}{name}": text for name, text in outside.items()}
        return found

    return findings


def stuck_temperatures(
    watch: StuckTemperatureDetector, model: RobotModel
) -> Callable[[StatusBuilder], None]:
    """Return a check that adds how many temperatures do not follow the losses, and a warning."""

    def check(found: StatusBuilder) -> None:
        stuck = [name for name, is_so in zip(model.joint_names, watch.stuck, strict=True) if is_so]
        found.values["temperatures_stuck"] = len(stuck)
        if stuck:
            found.add(
                WARN,
                f"the motor temperature of {', '.join(stuck)} has not changed although the "
                f"losses must have warmed it by {watch.rise.max():.0f} K",
            )

    return check


def fallback_temperatures(
    use: FallbackUse, ahead_ns: Callable[[], int | None]
) -> Callable[[StatusBuilder], None]:
    """Return a check of samples that had to do without temperatures that arrive; warns if more do.

    Args:
        ahead_ns: Gives how far the stamps of the temperatures are ahead of those of the joint
            states on arrival; None where that is not known. [ns]
    """
    before = 0

    def check(found: StatusBuilder) -> None:
        nonlocal before
        count = use.missing + use.stale
        found.values["fallback_temperature_samples"] = count
        if count > before and use.of_another_time(ahead_ns()):
            found.add(WARN, use.sentence(ahead_ns()))
        before = count

    return check


def stray_stamps(epochs: EpochSplitter, what: str, found: StatusBuilder) -> None:
    """Check the stamps of a stream of messages.

    Args:
        what: Name of the messages, such as ``messages on /power``.
    """
    sentence = sentence_of(epochs, what, within=RECENT)
    if sentence:
        found.add(WARN, sentence)


def energy_source(
    account: EnergyAccount,
    meter: Sequence[Inbox],
    readings: MeterIngest,
    meter_timeout: float,
    *inputs: Callable[[StatusBuilder], None],
) -> Source:
    """Return what makes the status of energy account and meter.

    Args:
        meter: Where meter readings arrive: one topic, voltage and current, or none.
        meter_timeout: Silence beyond which a meter that is not slower counts as missing. [s]
    """

    def silence() -> float:
        """A meter that sends means over 5 s is not silent for 4 s."""
        spacing = (account.comparison.curve.spacing_ns or 0) * NANOSECOND
        return max(meter_timeout, min(SPACINGS * spacing, SLOWEST))

    names = ("meter_voltage_", "meter_current_") if len(meter) > 1 else ("meter_",)
    watches = [
        (
            name,
            InputWatch(
                "meter reading",
                inbox,
                readings.rejections,
                silence,
                needed=False,
                remedy_of=partial(
                    remedy_of, remedies=METER_REMEDIES, receive_time=readings.receive_time
                ),
            ),
        )
        for name, inbox in zip(names, meter, strict=False)
    ]

    def unknown_of() -> tuple[object, int, int]:
        """What changes from one account to the next, and its samples without a power."""
        return account.counts, account.restarts, account.counts.quality[Quality.NOT_FINITE]

    watch_of_time, before = TimeWatch(), unknown_of()

    def findings() -> StatusBuilder:
        nonlocal before
        found = StatusBuilder("energy")
        for check in inputs:
            check(found)
        wrong = watch_of_time.check(account.registers.time)
        if wrong:
            found.add(ERROR, wrong)
        for name, watch in watches:
            watch.check(found, name)
        time, comparison = account.registers.time, account.comparison
        residual = comparison.comparable_energy - comparison.measured_energy
        measured, response = comparison.measured_energy, comparison.response
        found.values |= {
            "coverage": time.coverage,
            "observed_time_s": time.observed_ns * 1e-9,
            "gap_time_s": time.gap_ns * 1e-9,
            "gaps": time.gap_count,
            "comparison_time_s": comparison.compared_ns * 1e-9,
            "residual_energy_j": residual,
            "residual_share": residual / abs(measured) if measured else math.nan,
            "residual_share_last_minute": comparison.minute.residual_share,
            "meter_time_constant_s": response.time_constant,
            "meter_delay_s": response.delay,
            "meter_response_found_online": bool(response.sentence),
            "meter_counter_resets": comparison.curve.counter.resets,
            "meter_counter_wraps": comparison.curve.counter.wraps,
            **accounting(comparison.curve.rejections, "meter_readings_"),
            "extrapolated_share": _share(account, Quality.EXTRAPOLATED),
            "drive_extrapolated_share": _share(account, Quality.DRIVE_EXTRAPOLATED),
            "temperature_missing_share": _share(account, Quality.TEMPERATURE_MISSING),
            "temperature_stale_share": _share(account, Quality.TEMPERATURE_STALE),
            "temperature_stuck_share": _share(account, Quality.TEMPERATURE_STUCK),
            "not_finite_share": _share(account, Quality.NOT_FINITE),
            "learned_share": _share(account, Quality.LEARNED),
        }
        now = unknown_of()
        if now[:2] == before[:2] and now[2] > before[2]:
            found.add(WARN, NOT_KNOWN)
        before = now
        for sentence in account.judgement.findings(comparison) + readings.clock_doubts(RECENT):
            found.add(WARN, sentence)
        return found

    return findings


def _share(account: EnergyAccount, bit: Quality) -> float:
    counts = account.counts
    return counts.quality[bit] / counts.samples if counts.samples else math.nan


def _by_source(ingest: TemperatureIngest) -> dict[str, Number]:
    """Accounts of the sources by name, where there are several."""
    values: dict[str, Number] = {}
    for reader in ingest.readers if len(ingest.readers) > 1 else ():
        values |= accounting(reader.rejections, f"{reader.name}.")
    return values
