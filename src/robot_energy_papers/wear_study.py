"""When wear is found on the rig, and how often it is found where there is none.

Detection runs the rig with real wear: friction of one axis is multiplied in the plant, and the
monitor sees joint states, temperatures and motor torque alone. The hall swings between 15 and
60 degC once a day, and the payload changes every half hour; half of the changes are
unknown to the monitor.

Detection runs take too long to be repeated on ten plants. `simulated` runs many days by the rows
of `robot_energy_papers.wear_rows`, and asks of each axis three things: how often an alarm is
raised without wear, and when a step and a slow rise are found that begin at a given hour of its
motion. For these two the excess of the records is raised, which leaves out the heat that wear
makes. `worn_in_plant` has no such simplification: friction in the plant rises.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from copy import deepcopy
from dataclasses import dataclass

import numpy as np

from robot_energy.blocks import Float
from robot_energy.condition.drift_test import DriftTest
from robot_energy.condition.joint_friction import MotionSums
from robot_energy.condition.learner import Learning
from robot_energy.condition.wear import WearMonitor
from robot_energy.condition.wear_records import MotionGatherer, WearRecord
from robot_energy.model import load
from robot_energy.model.payload import payload
from robot_energy.rig import PlantProfile, RigConfig, VirtualRig
from robot_energy_papers.learning_study import joint_block, pipeline_of, work
from robot_energy_papers.wear_rows import START_NS, WearRows

DAY = 24  # h
HOUR_NS = 3_600_000_000_000
METER_PART = 5.0  # s of a window of the meter
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


@dataclass(frozen=True)
class FoundRow:
    """A change of friction that was simulated.

    Attributes:
        joint: The axis.
        motion: Motion of this axis from its beginning to the alarm; NaN if there was none. [h]
        true: Change at the alarm. [-]
        size: Stated then. [-]
        std: Its standard deviation. [-]
    """

    joint: int
    motion: float
    true: float
    size: float
    std: float


@dataclass(frozen=True)
class SimulatedRow:
    """One plant.

    Attributes:
        hours: Simulated. [h]
        motion: Of these in motion, mean over the axes. [h]
        alarms: Without wear: axis and hours of its motion.
        steps: Of every axis, one for each beginning.
        slow: The same of slow wear.
    """

    hours: float
    motion: float
    alarms: tuple[tuple[int, float], ...]
    steps: tuple[FoundRow, ...]
    slow: tuple[FoundRow, ...]


def simulated(
    profile: PlantProfile,
    seed: int,
    days: int,
    begins: tuple[float, ...] = (48.0, 96.0),
    step: float = 0.15,
    per_hour: float = 0.0005,
    changes: tuple[float, float] | None = None,
) -> SimulatedRow:
    """Run a plant for days without wear, and let wear begin at some hours of motion.

    Args:
        profile: The plant.
        seed: Of work, payloads, weather and sensors.
        days: How many.
        begins: When wear begins, in hours of motion of the axis. [h]
        step: Rise of friction at once. [-]
        per_hour: Rise of friction in an hour of motion, where it is slow. [-]
        changes: Shortest and longest time with one program; None for one program always. [h]

    Returns:
        What was found.
    """
    rows = WearRows(profile, seed, changes=changes)
    records = records_of(rows.days(days), profile.n_joints)
    alarms: list[tuple[int, float]] = []
    steps: list[FoundRow] = []
    slow: list[FoundRow] = []
    for joint, own in enumerate(records):
        test, open_begins = DriftTest(), list(begins)
        for number, record in enumerate(own):
            if open_begins and record.hours >= open_begins[0]:
                begin, rest = open_begins.pop(0), own[number:]
                steps.append(_found(joint, test, rest, begin, lambda _: step, 2.0))
                slow.append(_found(joint, test, rest, begin, lambda passed: per_hour * passed))
            if test.step(record):
                alarms.append((joint, record.hours))
    motion = float(np.mean([own[-1].hours for own in records]))
    return SimulatedRow(24.0 * days, motion, tuple(alarms), tuple(steps), tuple(slow))


def records_of(days: Iterable[list[MotionSums]], n_joints: int) -> list[list[WearRecord]]:
    """Gather the records of every axis.

    Args:
        days: Parts of each day.
        n_joints: Number of axes.

    Returns:
        Of each axis, oldest first.
    """
    gatherer = MotionGatherer(n_joints)
    records: list[list[WearRecord]] = [[] for _ in range(n_joints)]
    for parts in days:
        for part in parts:
            for joint, record in gatherer.step(part).items():
                records[joint].append(record)
    return records


def _found(
    joint: int,
    test: DriftTest,
    records: list[WearRecord],
    begin: float,
    rise: Callable[[float], float],
    longest: float = math.inf,
) -> FoundRow:
    """Continue a copy of a test with wear."""
    test = deepcopy(test)
    for record in records:
        passed = record.hours - begin
        if passed > longest:
            break
        now = rise(passed)
        worn = record._replace(excess=record.excess + math.log1p(now))
        if test.step(worn) and not test.drift.fell:
            return FoundRow(joint, passed, now, test.changes[-1].size, test.drift.std)
    nan = math.nan
    return FoundRow(joint, nan, nan, nan, nan)


@dataclass(frozen=True)
class WornRow:
    """Axes whose friction rises in the plant.

    Attributes:
        worn: Which, with hours of their motion until the alarm; NaN if there was none.
        named: All axes with an alarm of a rise.
    """

    worn: dict[int, float]
    named: tuple[int, ...]


def worn_in_plant(
    profile: PlantProfile,
    seed: int,
    days: int,
    joints: tuple[int, ...],
    rise: Callable[[float], float],
    begin: float = 48.0,
) -> WornRow:
    """Let axes of the plant itself wear, with the heat that this makes.

    Args:
        profile: The plant.
        seed: Of work, payloads, weather and sensors.
        days: How many.
        joints: Which axes wear.
        rise: Of their friction, by hours of motion since the beginning. [-]
        begin: Hours of motion without wear. [h]

    Returns:
        What was found.
    """

    def wear(hours: Float) -> Float:
        worn = np.ones(profile.n_joints)
        for joint in joints:
            passed = float(hours[joint]) - begin
            worn[joint] += rise(passed) if passed > 0 else 0.0
        return worn

    found: dict[int, float] = dict.fromkeys(joints, math.nan)
    named: list[int] = []
    records = records_of(WearRows(profile, seed).days(days, wear), profile.n_joints)
    for joint, own in enumerate(records):
        test = DriftTest()
        for record in own:
            if test.step(record) and not test.drift.fell:
                named.append(joint)
                if joint in found:
                    found[joint] = record.hours - begin
                break
    return WornRow(found, tuple(named))


def meter_only(
    profile: PlantProfile,
    seed: int,
    days: int,
    joints: tuple[int, ...] = (),
    rise: float = 0.15,
    begin: float = 96.0,
) -> tuple[float, ...]:
    """Watch a plant by its power meter alone; axes may wear at once, in the plant itself.

    Args:
        profile: The plant.
        seed: Of work, payloads, weather and sensors.
        days: How many.
        joints: The axes that wear.
        rise: Of its friction. [-]
        begin: When it begins. [h]

    Returns:
        When friction of the robot was said to have risen, since the wear began, or since the start
        without wear. [h]
    """
    monitor = WearMonitor([str(number) for number in range(profile.n_joints)])

    whole = np.ones(profile.n_joints)
    worn = whole + rise * np.isin(np.arange(profile.n_joints), joints)
    begun = begin if joints else 0.0
    done = 0.0

    def wear(_: Float) -> Float:
        return whole if done < begun else worn

    found: list[float] = []
    rows = WearRows(profile, seed, METER_PART)
    for day in rows.meter_days(days, wear):
        done += DAY
        for row in day:
            known = len(monitor.robot.changes)
            monitor.step_meter(*row)
            if len(monitor.robot.changes) > known and not monitor.robot.drift.fell:
                found.append((row.stamp_ns - START_NS) / HOUR_NS - begun)
    return tuple(found)
