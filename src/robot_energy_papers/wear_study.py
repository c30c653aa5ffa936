"""When wear is found on the rig, and how often it is found where there is none.

Detection runs the rig with real wear: friction of one axis is multiplied in the plant, and the
monitor sees joint states, temperatures and motor torque alone. The hall swings between 15 and
60 degC once a day, and the payload changes every half hour; half of the changes are
unknown to the monitor.

A thousand hours of a rig are too long to compute. For false alarms a day is recorded as the
detector takes it, in parts of five seconds, several times with other noise and payloads. Each
simulated hour is one hour of such a day, drawn among the recordings at the same time of day, with
fresh scatter on every record. So temperatures, loads, the error of the model and its
autocorrelation within an hour are those of the rig; what is longer than an hour comes from the
time of day alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from robot_energy.condition.drift_test import DriftTest
from robot_energy.condition.joint_friction import MotionSums
from robot_energy.condition.learner import Learning
from robot_energy.condition.wear import WearMonitor
from robot_energy.condition.wear_records import MotionGatherer, WearRecord
from robot_energy.model import load
from robot_energy.model.payload import payload
from robot_energy.rig import PlantProfile, RigConfig, VirtualRig
from robot_energy_papers.learning_study import joint_block, pipeline_of, work

HOUR_NS = 3_600_000_000_000
DAY = 24  # h
COLD, HOT = 15.0, 60.0  # of the hall [degC]
RATE = 25.0  # of the joint states [Hz]
CHANGE_EVERY = 30  # min between two payloads
HIDDEN = 3.0  # greatest mass that the monitor does not get [kg]


@dataclass(frozen=True)
class WearRow:
    """One axis that was made to wear.

    Attributes:
        joint: Its index.
        found: Time from the beginning of wear until the alarm; NaN if there was none. [h]
        motion: Motion of this axis in that time. [h]
        named: Axes with an alarm that somebody should look at.
        size: Change stated at the end. [-]
        std: Its standard deviation. [-]
    """

    joint: int
    found: float
    motion: float
    named: tuple[int, ...]
    size: float
    std: float


class Shift:
    """A rig at work in a hall that swings, with payloads that change, watched by a monitor.

    Args:
        profile: The plant.
        seed: Of work, noise and payloads.
        hard: Whether all effects without a term in models are on.

    Attributes:
        monitor: The learner's monitor of wear.
        parts: What it has taken.
    """

    def __init__(self, profile: PlantProfile, seed: int, hard: bool = True) -> None:
        self._model = load(profile.body)
        config = RigConfig.hard() if hard else RigConfig()
        start = (COLD + HOT) / 2
        self._rig = VirtualRig(
            profile, work(profile, seed), config, seed, start, start, rate_hz=RATE
        )
        self._pipeline = pipeline_of(self._model, Learning.OBSERVE, True)
        self._random = np.random.default_rng(seed)
        self._minute = 0
        learner = self._pipeline.power.condition
        self.monitor: WearMonitor = learner.wear
        self.parts: list[MotionSums] = []
        take = learner.wear.step

        def noted(part: MotionSums) -> None:
            self.parts.append(part)
            take(part)

        learner.wear.step = noted  # type: ignore[method-assign]

    def run(self, minutes: int, wear: np.ndarray | None = None) -> None:
        """Work on.

        Args:
            minutes: How long.
            wear: Factor on the friction of each axis, shape (n,); None leaves it. [-]
        """
        for _ in range(minutes):
            swing = np.sin(2 * np.pi * self._minute / (60 * DAY))
            ambient = (COLD + HOT) / 2 + (HOT - COLD) / 2 * swing
            self._rig.change(ambient_degc=float(ambient), wear=wear)
            if self._minute % CHANGE_EVERY == 0:
                self._carry()
            output = self._rig.step(round(60 * RATE))
            self._pipeline.step(joint_block(output.joints), output.temperatures, output.meter)
            self._minute += 1

    def _carry(self) -> None:
        """Take another payload, known to the monitor or not."""
        if not self._model.payload:
            return
        body = self._model.payload[0]
        kind = self._random.integers(4)
        known = body.mass * (self._random.uniform(0.2, 1.0) if kind == 2 else 1.0)
        true = known + (self._random.uniform(0.0, HIDDEN) if kind == 3 else 0.0)
        carried = [
            payload(body.link, float(mass), body.centre_of_mass, body.inertia)
            for mass in (true, known)
        ]
        self._rig.change(payload=carried[:1])
        self._pipeline.torque.set_payload(carried[1])

    @property
    def alarms(self) -> tuple[int, ...]:
        """Axes whose friction has risen, by the monitor."""
        tests = self.monitor.joints
        return tuple(
            joint for joint, test in enumerate(tests) if test.changes and not test.drift.fell
        )


def detection(
    profile: PlantProfile,
    joint: int,
    rise: float,
    before: float,
    after: float,
    per_hour: float = 0.0,
    seed: int = 0,
    hard: bool = True,
) -> WearRow:
    """Let one axis wear, at once or slowly, and see when it is found.

    Args:
        profile: The plant.
        joint: The axis.
        rise: Of its friction at once. [-]
        before: Time without wear. [h]
        after: Time with it. [h]
        per_hour: Further rise in an hour. [-]
        seed: Of work, noise and payloads.
        hard: Whether all effects without a term in models are on.

    Returns:
        What was found.
    """
    shift = Shift(profile, seed, hard)
    shift.run(round(60 * before))
    test = shift.monitor.joints[joint]
    found, motion, worn = float("nan"), float("nan"), np.ones(profile.n_joints)
    begun = shift.monitor.state().hours[joint]
    for minute in range(1, round(60 * after) + 1):
        worn[joint] = 1.0 + rise + per_hour * minute / 60
        shift.run(1, worn)
        if np.isnan(found) and joint in shift.alarms:
            found, motion = minute / 60, shift.monitor.state().hours[joint] - begun
    return WearRow(joint, found, motion, shift.alarms, test.drift.size, test.drift.std)


def recorded_days(
    profile: PlantProfile, days: int, seed: int = 0, hard: bool = True
) -> list[list[list[WearRecord]]]:
    """Record days as the detector takes them.

    Args:
        profile: The plant.
        days: How many, each with other noise and payloads.
        seed: Of the first.
        hard: Whether all effects without a term in models are on.

    Returns:
        Records of each day and joint.
    """
    found: list[list[list[WearRecord]]] = []
    for day in range(days):
        shift = Shift(profile, seed + day, hard)
        shift.run(60 * DAY)
        gatherer = MotionGatherer(profile.n_joints)
        records: list[list[WearRecord]] = [[] for _ in range(profile.n_joints)]
        for part in shift.parts:
            for joint, record in gatherer.step(part).items():
                records[joint].append(record)
        found.append(records)
    return found


def _simulated(
    days: list[list[list[WearRecord]]], joint: int, hours: float, random: np.random.Generator
) -> Iterator[tuple[int, WearRecord]]:
    """Yield simulated records of a joint with their hours, see the module."""
    start_ns = days[0][joint][0].stamp_ns
    by_hour = [
        [
            [r for r in day[joint] if (r.stamp_ns - start_ns) % (DAY * HOUR_NS) // HOUR_NS == h]
            for day in days
        ]
        for h in range(DAY)
    ]
    moved = 0.0
    for hour in range(round(hours)):
        choice = by_hour[hour % DAY]
        for record in choice[int(random.integers(len(choice)))]:
            moved += record.time / 3600.0
            excess = record.excess + record.variance**0.5 * random.standard_normal()
            stamp_ns = start_ns + hour * HOUR_NS + record.stamp_ns % HOUR_NS
            yield hour, record._replace(excess=excess, hours=moved, stamp_ns=stamp_ns)


def false_alarms(days: list[list[list[WearRecord]]], hours: float, seed: int = 0) -> int:
    """Count the alarms of simulated hours without wear.

    Args:
        days: Of `recorded_days`, of one plant.
        hours: How many. [h]
        seed: Of the draws.

    Returns:
        Alarms of all joints.
    """
    random, count = np.random.default_rng(seed), 0
    for joint in range(len(days[0])):
        test = DriftTest()
        count += sum(test.step(record) for _, record in _simulated(days, joint, hours, random))
    return count


@dataclass(frozen=True)
class SlowWearRow:
    """One axis whose friction rises slowly.

    Attributes:
        joint: Its index.
        found: Time from the beginning of wear until the alarm; NaN if there was none. [h]
        motion: Motion of this axis in that time. [h]
        true: Rise at the alarm. [-]
        size: Stated then. [-]
        std: Its standard deviation. [-]
    """

    joint: int
    found: float
    motion: float
    true: float
    size: float
    std: float


def slow_wear(
    days: list[list[list[WearRecord]]],
    joint: int,
    per_hour: float,
    before: float = 48.0,
    after: float = 240.0,
    seed: int = 0,
) -> SlowWearRow:
    """Let one axis wear slowly in simulated hours, and see when it is found.

    Args:
        days: Of `recorded_days`, of one plant.
        joint: The axis.
        per_hour: Rise of its friction in an hour of motion. [-]
        before: Time without wear. [h]
        after: Time with it. [h]
        seed: Of the draws.

    Returns:
        What was found.
    """
    test, begun = DriftTest(), 0.0
    random = np.random.default_rng(seed)
    for hour, record in _simulated(days, joint, before + after, random):
        if hour < before:
            begun = record.hours
        rise = per_hour * max(record.hours - begun, 0.0)
        worn = record._replace(excess=record.excess + float(np.log1p(rise)))
        if test.step(worn) and hour >= before and not test.drift.fell:
            motion = record.hours - begun
            drift = test.drift
            return SlowWearRow(joint, hour - before, motion, rise, drift.size, drift.std)
    nan = float("nan")
    return SlowWearRow(joint, nan, nan, per_hour * after, nan, nan)
