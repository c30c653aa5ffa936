"""When wear is found on the rig, and how often it is found where there is none.

Runs of the rig itself (`robot_energy_studies.learning_study`) take too long to be repeated on ten
plants. `simulated` runs many days by the rows of `wear_rows`, and asks of each
axis four things: how often an alarm is raised without wear, and when a step, a slow rise and a
fall are found that begin at a given hour of its motion. For these three the excess of the records
is changed, which leaves out the heat that wear makes. `worn_in_plant` has no such simplification:
friction in the plant rises.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from copy import deepcopy
from dataclasses import dataclass

import numpy as np

from robot_energy.condition.drift import DriftTest
from robot_energy.condition.joint_friction import MotionSums
from robot_energy.condition.wear import WearMonitor
from robot_energy.condition.wear_records import MotionGatherer, WearRecord
from robot_energy.foundation.units import HOUR_NS
from robot_energy.timeline.blocks import Float
from robot_energy_rig import PlantProfile
from robot_energy_studies.learning_study import DAY_HOURS
from wear_rows import START_NS, WearRows

METER_PART = 5.0  # s of a window of the meter
BEGINS = (48.0, 96.0)  # when wear begins, in hours of motion of the axis [h]
STEP = 0.15  # rise of friction at once; a fall is as large [-]
PER_HOUR = 0.0005  # rise of friction in an hour of motion, where it is slow [-]
METER_BEGIN = 96.0  # when wear begins that a meter alone is to find [h]


@dataclass(frozen=True)
class FoundRow:
    """A change of friction that was simulated.

    Attributes:
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
        falls: The same of a fall, as after re-greasing.
    """

    hours: float
    motion: float
    alarms: tuple[tuple[int, float], ...]
    steps: tuple[FoundRow, ...]
    slow: tuple[FoundRow, ...]
    falls: tuple[FoundRow, ...]


def simulated(
    profile: PlantProfile,
    seed: int,
    days: int,
    changes: tuple[float, float] | None = None,
) -> SimulatedRow:
    """Return what is found of wear that begins at some hours of motion, and without any.

    Args:
        changes: Shortest and longest time with one program; None for one program always. [h]
    """
    rows = WearRows(profile, seed, changes=changes)
    records = records_of(rows.days(days), profile.n_joints)
    alarms: list[tuple[int, float]] = []
    steps: list[FoundRow] = []
    slow: list[FoundRow] = []
    falls: list[FoundRow] = []
    for joint, own in enumerate(records):
        test, open_begins = DriftTest(), list(BEGINS)
        for number, record in enumerate(own):
            if open_begins and record.hours >= open_begins[0]:
                begin, rest = open_begins.pop(0), own[number:]
                steps.append(_found(joint, test, rest, begin, lambda _: STEP, 2.0))
                falls.append(_found(joint, test, rest, begin, lambda _: -STEP, 2.0))
                slow.append(_found(joint, test, rest, begin, lambda passed: PER_HOUR * passed))
            if test.step(record):
                alarms.append((joint, record.hours))
    motion = float(np.mean([own[-1].hours for own in records]))
    return SimulatedRow(24.0 * days, motion, tuple(alarms), tuple(steps), tuple(slow), tuple(falls))


def records_of(days: Iterable[list[MotionSums]], n_joints: int) -> list[list[WearRecord]]:
    """Return the records of every axis, oldest first.

    Args:
        days: Parts of each day.
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
        if test.step(worn) and test.drift.fell == (now < 0):
            return FoundRow(joint, passed, now, test.changes[-1].size, test.drift.std)
    nan = math.nan
    return FoundRow(joint, nan, nan, nan, nan)


@dataclass(frozen=True)
class WornRow:
    """Axes whose friction rises in the plant.

    Attributes:
        worn: Which, with hours of their motion until the alarm; NaN if there was none.
    """

    worn: dict[int, float]
    named: tuple[int, ...]


def worn_in_plant(
    profile: PlantProfile,
    seed: int,
    days: int,
    joints: tuple[int, ...],
    rise: Callable[[float], float],
) -> WornRow:
    """Return when axes of the plant itself that wear are found, with the heat that this makes.

    Args:
        rise: Of their friction, by hours of motion since the beginning. [-]
    """

    def wear(hours: Float) -> Float:
        worn = np.ones(profile.n_joints)
        for joint in joints:
            passed = float(hours[joint]) - BEGINS[0]
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
                    found[joint] = record.hours - BEGINS[0]
                break
    return WornRow(found, tuple(named))


def meter_only(
    profile: PlantProfile, seed: int, days: int, joints: tuple[int, ...] = ()
) -> tuple[float, ...]:
    """Return when friction of a plant was said to have risen, by its power meter alone. [h]

    Axes may wear at once, in the plant itself. Times are since then, or since the start.
    """
    monitor = WearMonitor([str(number) for number in range(profile.n_joints)])

    whole = np.ones(profile.n_joints)
    worn = whole + STEP * np.isin(np.arange(profile.n_joints), joints)
    begun = METER_BEGIN if joints else 0.0
    done = 0.0

    def wear(_: Float) -> Float:
        return whole if done < begun else worn

    found: list[float] = []
    rows = WearRows(profile, seed, METER_PART)
    for day in rows.meter_days(days, wear):
        done += DAY_HOURS
        for row in day:
            known = len(monitor.robot.changes)
            monitor.step_meter(*row)
            if len(monitor.robot.changes) > known and not monitor.robot.drift.fell:
                found.append((row.stamp_ns - START_NS) / HOUR_NS - begun)
    return tuple(found)
