"""Which robots of a fleet need somebody to look, why, and how sure that is.

In the test for wear over the bags of a robot, a bag stands for the time around it: its hours of
motion are the hours since the first bag times the share of motion in the bags. Bags differ by more
than their own scatter, as gears are warmer or colder than their motors say. How much, the
differences of neighbours in time show, which a change of friction hardly touches; it is added to
the variance of every record.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import exp, expm1

import numpy as np
import polars as pl
from numpy.typing import NDArray

from robot_energy.certainty.deviation import MEDIAN_TO_STD
from robot_energy.condition.drift import BAGS, MIN_AFTER, MIN_BEFORE, DriftTest
from robot_energy.condition.joint_friction import DEGC_BUCKETS, degc_place, shares
from robot_energy.condition.wear import REMEDY, WearAlarm
from robot_energy.condition.wear_records import WearRecord
from robot_energy.foundation.time_zone import local_time
from robot_energy.foundation.units import DAY_NS, HOUR_NS
from robot_energy.timeline.blocks import Float, Int
from robot_energy_fleet.bag_joints import BagJoints, wear_records
from robot_energy_fleet.results.fleet import FleetFinding
from robot_energy_fleet.sisters import MIN_SISTERS, Deviation, Levels, levels, stand_out
from robot_energy_fleet.tables import FleetTables

MIN_RECORDS = MIN_BEFORE + MIN_AFTER  # without which no change is seen
MIN_HOURS = BAGS.min_hours  # of motion that they span, likewise [h]
MAX_KEPT = 48  # records of a joint; more are merged, neighbour with neighbour


def wear_history(records: Sequence[WearRecord], duty: float) -> DriftTest:
    """Return the test of one joint of one robot, after all records.

    Args:
        duty: Share of motion in the time of the bags. [-]
    """
    test = DriftTest(BAGS)
    if not records:
        return test
    first_ns = records[0].stamp_ns
    dated = [
        record._replace(hours=(record.stamp_ns - first_ns) / HOUR_NS * duty) for record in records
    ]
    merged = _merged(dated)
    between = _between(merged)
    test.take([record._replace(variance=record.variance + between) for record in merged])
    return test


def _merged(records: list[WearRecord]) -> list[WearRecord]:
    groups = min(len(records), MAX_KEPT)
    edges = [number * len(records) // groups for number in range(groups + 1)]
    found: list[WearRecord] = []
    for first, last in pairwise(edges):
        one = records[first]
        for later in records[first + 1 : last]:
            one = one.merged(later)
        found.append(one)
    return found


def _between(records: list[WearRecord]) -> float:
    """Variance between neighbours beyond that of their own scatter."""
    if len(records) < 3:
        return 0.0
    steps = np.abs(np.diff([record.excess for record in records]))
    variance = (MEDIAN_TO_STD * float(np.median(steps))) ** 2 / 2.0
    return max(variance - float(np.median([record.variance for record in records])), 0.0)


RECENT = 0.25  # share of the time, at its end, for which robots are compared
MIN_FRICTION = 0.10  # difference of friction that is worth a look [-]
MIN_MASS = 0.5  # of a payload [kg]
MIN_ENERGY = 0.05  # of a job [-]
MIN_STANDBY = 0.25  # hours of a recorded day
STANDBY_SCALE = 0.1  # below it, hours of standby are all alike [h]
MIN_RECENT = 5  # newest bags of a robot that count, however old they are
KINDS = ("payload", "wear", "friction", "standby", "energy")
NET_ENERGY = (pl.col("grid_energy") - pl.col("predicted_return_energy")).alias("energy")
"""Of a job. [J]"""


@dataclass(frozen=True)
class RobotsCompared:
    """Robots of one model after all comparisons.

    Attributes:
        friction: Levels of the friction of each joint, logarithms; in the order of the model.
        with_sisters: Robots that were compared with sisters, by one kind of figure at least.
        with_before: Robots that were compared with themselves before, by one joint at least.
    """

    findings: tuple[FleetFinding, ...]
    friction: tuple[Levels, ...]
    comparisons: int
    with_sisters: frozenset[str]
    with_before: frozenset[str]


def compare(
    tables: FleetTables, bags: BagJoints, duty: Sequence[float], models: int = 1
) -> RobotsCompared:
    """Return what differs between robots of one model, and in each from before, and the levels.

    Args:
        duty: Share of motion in the time of the bags of each robot. [-]
    """
    jobs = tables.jobs.filter(pl.col("gap_time") == 0.0)
    programmes = sorted(jobs["name"].unique().to_list())
    comparisons = models * (len(bags.joints) + 2 + len(programmes))
    recent = _recent(bags.stamp_ns, bags.robot)
    findings: list[FleetFinding] = []
    with_sisters = set[str]()

    def found(levels: Levels) -> list[Deviation]:
        known: list[int] = np.flatnonzero(np.isfinite(levels.level)).tolist()
        if len(known) >= MIN_SISTERS:
            with_sisters.update(bags.robots[one] for one in known)
        return stand_out(levels.level, levels.std, comparisons)

    speeds = bags.work[..., -2]
    usual = np.where(np.isfinite(speeds), speeds, 0.0)
    mass = levels(bags.figures.mass, bags.robot, usual, recent)
    findings += [
        _payload(bags.robots[one.robot], one) for one in found(mass) if abs(one.size) >= MIN_MASS
    ]
    friction: list[Levels] = []
    for joint, name in enumerate(bags.joints):
        figure = np.log(bags.figures.multiplier[:, joint])
        own = levels(figure, bags.robot, bags.work[:, joint], recent)
        friction.append(own)
        findings += [
            _relative(bags.robots[one.robot], "friction", name, one)
            for one in found(own)
            if abs(expm1(one.size)) >= MIN_FRICTION
        ]
    worn, with_before = _worn(tables, bags, friction, duty)
    findings += worn
    standby, number = _standby(tables, bags.robots)
    by_day = levels(standby, number, np.empty((len(standby), 0)), np.ones(len(standby), bool))
    findings += [
        _standing(bags.robots[one.robot], one, by_day)
        for one in found(by_day)
        if _hours(by_day.level[one.robot]) >= MIN_STANDBY and one.size > 0
    ]
    for name in programmes:
        part = jobs.filter(pl.col("name") == name)
        findings += [
            _relative(bags.robots[one.robot], "energy", name, one)
            for one in found(_of_jobs(part, tables.runs, bags.robots))
            if abs(expm1(one.size)) >= MIN_ENERGY
        ]
    return RobotsCompared(
        ordered(findings), tuple(friction), comparisons, frozenset(with_sisters), with_before
    )


def _recent(stamp_ns: Int, robot: Int) -> NDArray[np.bool_]:
    found = np.zeros(len(stamp_ns), dtype=np.bool_)
    if len(stamp_ns):
        found = stamp_ns >= stamp_ns.max() - RECENT * (stamp_ns.max() - stamp_ns.min())
    for one in np.unique(robot).tolist():
        own = np.flatnonzero(robot == one)
        found[own[np.argsort(stamp_ns[own])[-MIN_RECENT:]]] = True
    return found


def _of_jobs(jobs: pl.DataFrame, runs: pl.DataFrame, robots: Sequence[str]) -> Levels:
    """Levels of the logarithm of the energy of a job, measured where all have a meter."""
    measured = jobs["measured_energy"].null_count() == 0
    figure = pl.col("measured_energy") if measured else NET_ENERGY
    own = (
        jobs.group_by("key", maintain_order=True)
        .agg(figure.mean().alias("energy"))
        .filter(pl.col("energy") > 0.0)
        .join(runs.select("key", "robot", "start_ns", "motor_temperature_degc"), on="key")
        .sort("start_ns", "key")
    )
    number = _numbers(own["robot"].to_list(), robots)
    degc = own["motor_temperature_degc"].fill_null(np.nan).to_numpy()
    warm = np.where(np.isnan(degc)[:, None], 0.0, shares(degc_place(degc), DEGC_BUCKETS))
    return levels(
        np.log(own["energy"].to_numpy()), number, warm, _recent(own["start_ns"].to_numpy(), number)
    )


def _numbers(names: Sequence[str], robots: Sequence[str]) -> Int:
    place = {name: number for number, name in enumerate(robots)}
    return np.array([place[name] for name in names], dtype=np.int64)


def _standby(tables: FleetTables, robots: Sequence[str]) -> tuple[Float, Int]:
    """Logarithm of the standby of every robot and recorded day, and its robot."""
    days = (
        tables.hours.group_by("robot", pl.col("hour_ns") // DAY_NS, maintain_order=True)
        .agg(pl.col("standby_time").sum() / 3600.0)
        .sort("robot", "hour_ns")
    )
    number = _numbers(days["robot"].to_list(), robots)
    return np.log1p(days["standby_time"].to_numpy() / STANDBY_SCALE), number


def _hours(level: float) -> float:
    return STANDBY_SCALE * expm1(level)


def _worn(
    tables: FleetTables, bags: BagJoints, friction: Sequence[Levels], duty: Sequence[float]
) -> tuple[list[FleetFinding], frozenset[str]]:
    """Joints whose friction has changed for good, by the test for wear over all their bags.

    Returns:
        What was found, and the robots with enough bags to find something.
    """
    findings: list[FleetFinding] = []
    tested = set[str]()
    rows = (
        tables.joints.lazy()
        .filter(pl.col("friction_rows") > 0)
        .select("robot", "joint", pl.col("^wear_.*$"))
        .collect()
    )
    for (robot, joint), own in rows.partition_by("robot", "joint", as_dict=True).items():
        number, place = bags.robots.index(str(robot)), bags.joints.index(str(joint))
        mine = bags.robot == number
        rest = friction[place].rest[mine]
        if not np.isfinite(rest).any():  # too little motion in each bag to say how much
            continue
        test = wear_history(wear_records(own), duty[number])
        if len(test.records) >= MIN_RECORDS and test.records[-1].hours >= MIN_HOURS:
            tested.add(str(robot))
        if not test.changes:
            continue
        size, std = _change(rest, bags.stamp_ns[mine])
        if abs(size) < MIN_FRICTION or (size < 0) != test.drift.fell:
            continue
        alarm = WearAlarm(str(joint), test.drift)
        since = local_time(test.drift.since_ns or 0)
        what = "fell, as after re-greasing or running in" if alarm.drift.fell else "has risen"
        text = (
            f"friction of {joint} {what}: in the last quarter of the time it is "
            f"{_percent(size, std)} that of the first, changing since {since:%F}"
            + ("" if alarm.drift.fell else f"; {REMEDY}")
        )
        findings.append(
            FleetFinding(
                str(robot), "wear", str(joint), size, std, alarm.sure, test.drift.since_ns, text
            )
        )
    return findings, frozenset(tested)


def _change(rest: Float, stamp_ns: Int) -> tuple[float, float]:
    """Friction of the last quarter of the time over that of the first, less 1; its deviation."""
    known = np.isfinite(rest)
    rest, stamp_ns = rest[known], stamp_ns[known]
    edge = RECENT * (stamp_ns.max() - stamp_ns.min())
    first, last = rest[stamp_ns <= stamp_ns.min() + edge], rest[stamp_ns >= stamp_ns.max() - edge]
    size = float(np.median(last) - np.median(first))
    spread = [float(part.var()) * 0.5 * np.pi / len(part) for part in (first, last)]
    return expm1(size), exp(size) * float(np.sqrt(sum(spread)))


def _payload(robot: str, one: Deviation) -> FleetFinding:
    more = "more" if one.size > 0 else "less"
    text = (
        f"gravity says that it carries {abs(one.size):.1f} +- {one.std:.1f} kg {more} than its "
        "sisters by the same model file: state its payload, or check what it carries"
    )
    return FleetFinding(robot, "payload", "", one.size, one.std, one.certainty, None, text)


def _relative(robot: str, kind: str, subject: str, one: Deviation) -> FleetFinding:
    """Friction of a joint or energy of a job, whose levels are logarithms."""
    size, std = expm1(one.size), exp(one.size) * one.std
    how = _percent(size, std)
    text = f"a job '{subject}' takes {how} what its sisters need, equally warm"
    if kind == "friction":
        text = f"friction of {subject} is {how} that of its sisters at equal temperature and speed"
    return FleetFinding(robot, kind, subject, size, std, one.certainty, None, text)


def _standing(robot: str, one: Deviation, by_day: Levels) -> FleetFinding:
    own = _hours(float(by_day.level[one.robot]))
    others = _hours(float(by_day.level[one.robot]) - one.size)
    std = (own + STANDBY_SCALE) * one.std
    text = (
        f"stands with its drives on for {own:.1f} h of a recorded day, its sisters "
        f"{max(others, 0.0):.1f} h: switch its drives off between shifts"
    )
    return FleetFinding(robot, "standby", "", own - others, std, one.certainty, None, text)


def _percent(size: float, std: float) -> str:
    return f"{100 * abs(size):.0f} +- {100 * std:.0f} % {'above' if size > 0 else 'below'}"


def ordered(findings: Iterable[FleetFinding]) -> tuple[FleetFinding, ...]:
    """Return those of one robot together, the robot with the gravest cause first, each once.

    Args:
        findings: Of several models the newest last: of what was found with several of them, that
            of the newest stays.
    """
    once = {(one.robot, one.kind, one.subject, one.since_ns): one for one in findings}
    gravest: dict[str, int] = {}
    for one in once.values():
        gravest[one.robot] = min(gravest.get(one.robot, len(KINDS)), KINDS.index(one.kind))
    return tuple(
        sorted(
            once.values(),
            key=lambda one: (gravest[one.robot], one.robot, KINDS.index(one.kind), one.subject),
        )
    )
