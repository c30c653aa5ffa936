"""The report of a fleet, from its tables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields
from itertools import pairwise
from typing import Any, TypeVar
from zoneinfo import ZoneInfo

import numpy as np
import polars as pl

from robot_energy.foundation.time_zone import local_time
from robot_energy.foundation.units import DAY_NS, HOUR_NS, JOULE_PER_KWH
from robot_energy.timeline.blocks import Float
from robot_energy_fleet.bag_joints import BagJoints, bag_joints
from robot_energy_fleet.findings import MIN_HOURS, MIN_RECORDS, NET_ENERGY, compare, ordered
from robot_energy_fleet.results.fleet import (
    DamagedBag,
    FleetFinding,
    FleetReport,
    FrictionCurve,
    ModelError,
    ProgrammeEnergy,
    RefusedBag,
    RobotEnergy,
    ShiftEnergy,
)
from robot_energy_fleet.sisters import MIN_BAGS, MIN_SISTERS, Levels
from robot_energy_fleet.tables import FleetTables, counted_twice
from robot_energy_report.formats import counted, jobs_left_out
from robot_energy_report.page.settings import PageSettings

DEGC_STEP = 10.0  # of the table of the model's error [K]
CURVE_STEP = 5.0  # of the curves of friction [K]
MIN_ROBOTS = 3  # that make a middle and a range
RANGE = (0.1, 0.9)
WEEK_NS = 7 * DAY_NS
UNPLACED = 1e-6  # share of the energy beyond which that of no hour is said
R = TypeVar("R", RobotEnergy, ProgrammeEnergy, ModelError)
SHIFTS = (6, 14, 22)  # hours at which a shift begins, where nothing else is said


def fleet_report(
    tables: FleetTables,
    dataset: str,
    settings: PageSettings | None = None,
    shifts: Sequence[int] = SHIFTS,
) -> FleetReport:
    """Return the report of a fleet.

    Args:
        settings: Prices, emissions and the time zone; None for none and UTC.
        shifts: Hours of the day, local time, at which a shift begins; rising.
    """
    used = settings or PageSettings()
    read = tables.runs.filter(pl.col("reason") == "")
    hours = _priced(tables.hours, read, used, shifts)
    robots = sorted(read["robot"].unique().to_list())
    notes = counted_twice(read)
    models = sorted(read["model_id"].unique().to_list())
    findings: list[FleetFinding] = []
    friction: list[FrictionCurve] = []
    comparisons = 0
    with_sisters, with_before = frozenset[str](), frozenset[str]()
    newest_last = read.group_by("model_id").agg(pl.col("end_ns").max()).sort("end_ns", "model_id")
    for model_id in newest_last["model_id"].to_list():
        own = tables.of_model(model_id)
        sisters = sorted(own.runs["robot"].unique().to_list())
        bags = bag_joints(own, sisters)
        compared = compare(own, bags, duty_of(own.hours, sisters), len(models))
        findings += compared.findings
        friction += [
            _curve(bags, joint, own, compared.findings)
            for joint, own in enumerate(compared.friction)
            if np.isfinite(own.rest).any()  # else too little motion in each bag
        ]
        comparisons = max(comparisons, compared.comparisons)
        with_sisters |= compared.with_sisters
        with_before |= compared.with_before
    if not read["measured_energy"].is_not_null().any():
        notes.append("no bag has a power meter: all energies are predicted")
    if len(hours) > len(tables.hours):
        notes.append(
            "a price or a shift changes within a UTC hour, and a dataset holds sums of UTC hours: "
            "those of such an hour are shared by the time that the bag has before and after"
        )
    energy, placed = (float(one["grid_energy"].sum()) for one in (read, tables.hours))
    if (unplaced := energy - placed) > UNPLACED * energy:
        notes.append(
            f"{unplaced / JOULE_PER_KWH:.3f} kWh were used while no recorder ran: no shift holds "
            "them, and what was standby of them is not known"
        )
    if left_out := int(read["jobs_left_out"].sum()):
        notes.append(jobs_left_out(left_out))
    refused = tables.runs.filter(pl.col("reason") != "")
    damaged = read.filter(pl.col("problems").list.len() > 0)
    return FleetReport(
        dataset,
        tuple(models),
        _known(read["start_ns"].min()),
        _known(read["end_ns"].max()),
        len(read),
        tuple(RefusedBag(*row) for row in refused.select("bag", "robot", "reason").iter_rows()),
        tuple(
            DamagedBag(bag, robot, tuple(problems))
            for bag, robot, problems in damaged.select("bag", "robot", "problems").iter_rows()
        ),
        _robots(read, tables.jobs, hours, robots),
        _programmes(tables.jobs),
        _shifts(hours, shifts),
        _model_errors(read),
        ordered(findings),
        tuple(friction),
        comparisons,
        len(with_sisters),
        len(with_before),
        tuple(_not_compared(len(robots), len(with_sisters), len(with_before))),
        tuple(notes),
    )


def _not_compared(robots: int, with_sisters: int, with_before: int) -> Iterator[str]:
    """How many robots could be compared, and what it takes, where not all could be."""
    if with_sisters < robots:
        yield (
            f"compared with sisters: {with_sisters} of {counted(robots, 'robot')}; it takes "
            f"{MIN_SISTERS} robots of a model with {MIN_BAGS} bags of each"
        )
    if with_before < robots:
        yield (
            f"compared with itself before: {with_before} of {counted(robots, 'robot')}; it takes "
            f"{MIN_RECORDS} bags with measured torque that span {MIN_HOURS:g} h of motion"
        )


def _known(value: Any) -> int | None:
    return None if value is None else int(value)


def _priced(
    hours: pl.DataFrame, read: pl.DataFrame, settings: PageSettings, shifts: Sequence[int]
) -> pl.DataFrame:
    """Hours with their price and the number of their shift.

    An hour in which one of them changes becomes several rows: its sums are shared by the time of
    the bag in each part.
    """
    parts = [
        (hour_ns, *part)
        for hour_ns in hours["hour_ns"].unique().to_list()
        for part in _parts_of_hour(hour_ns, settings, shifts)
    ]
    schema = {"hour_ns": pl.Int64, "from_ns": pl.Int64, "to_ns": pl.Int64, "price": pl.Float64,
              "shift": pl.Int64}  # fmt: skip
    known = pl.DataFrame(parts, schema=schema, orient="row")
    recorded = pl.min_horizontal("to_ns", "end_ns") - pl.max_horizontal("from_ns", "start_ns")
    whole = pl.col("recorded").sum().over("key", "hour_ns")
    length = (pl.col("to_ns") - pl.col("from_ns")) / HOUR_NS  # where the bag is too short to say
    share = pl.when(whole > 0).then(pl.col("recorded") / whole).otherwise(length)
    sums = pl.col("observed_time", "motion_time", "grid_energy", "standby_time", "standby_energy")
    price = pl.col("price") / JOULE_PER_KWH
    return (
        hours.join(known, on="hour_ns", how="left", maintain_order="left_right")
        .join(read.select("key", "start_ns", "end_ns"), on="key", how="left", maintain_order="left")
        .with_columns(recorded=recorded.clip(lower_bound=0))
        .with_columns(share=share)
        .with_columns(sums * pl.col("share"))
        .with_columns(
            cost=pl.col("grid_energy") * price, standby_cost=pl.col("standby_energy") * price
        )
    )


def _parts_of_hour(
    hour_ns: int, settings: PageSettings, shifts: Sequence[int]
) -> list[tuple[int, int, float | None, int]]:
    """Begin, end, price and number of the shift of each part of a UTC hour in which both hold."""
    zone = ZoneInfo(settings.timezone)
    parts: list[tuple[int, int, float | None, int]] = []
    for first, last in pairwise(settings.edges(hour_ns, hour_ns + HOUR_NS)):
        local = local_time(first, zone)
        shift = (sum(local.hour >= one for one in shifts) - 1) % len(shifts)
        holds = settings.price_at(first), shift
        if parts and parts[-1][2:] == holds:
            first = parts.pop()[0]
        parts.append((first, last, *holds))
    return parts


def _results(kind: type[R], rows: pl.DataFrame) -> tuple[R, ...]:
    """Rows as results of a kind, whose fields are their columns."""
    names = [one.name for one in fields(kind)]
    return tuple(kind(**row) for row in rows.select(names).iter_rows(named=True))


def _sum_known(name: str) -> pl.Expr:
    return pl.when(pl.col(name).is_not_null().any()).then(pl.col(name).sum()).alias(name)


def _robots(
    read: pl.DataFrame, jobs: pl.DataFrame, hours: pl.DataFrame, robots: Sequence[str]
) -> tuple[RobotEnergy, ...]:
    metered = pl.col("measured_energy").is_not_null()
    runs = read.group_by("robot", maintain_order=True).agg(
        pl.len().alias("bags"),
        pl.col("observed_time", "grid_energy").sum(),
        _sum_known("measured_energy"),
        pl.col("predicted_energy_at_meter").filter(metered).sum(),
    )
    standby = hours.group_by("robot", maintain_order=True).agg(
        pl.col("standby_time", "standby_energy").sum(), _sum_known("standby_cost")
    )
    count = jobs.group_by("robot", maintain_order=True).agg(pl.len().alias("jobs"))
    rows = (
        pl.DataFrame({"robot": robots}, schema={"robot": pl.String})
        .join(runs, on="robot", how="left", maintain_order="left")
        .join(standby, on="robot", how="left", maintain_order="left")
        .join(count, on="robot", how="left", maintain_order="left")
        .with_columns(pl.col("jobs", "standby_time", "standby_energy").fill_null(0))
        .with_columns(error=pl.col("predicted_energy_at_meter") / pl.col("measured_energy") - 1.0)
        .sort("robot")
    )
    return _results(RobotEnergy, rows)


def _programmes(jobs: pl.DataFrame) -> tuple[ProgrammeEnergy, ...]:
    whole = jobs.filter(pl.col("gap_time") == 0.0)
    metered = pl.col("measured_energy").is_not_null()
    robots = whole.group_by("name", "robot", maintain_order=True).agg(NET_ENERGY.mean())
    rows = (
        whole.group_by("name", maintain_order=True)
        .agg(
            pl.col("robot").n_unique().alias("robots"),
            pl.len().alias("jobs"),
            pl.col("observed_time").mean().alias("mean_time"),
            NET_ENERGY.mean().alias("mean_energy"),
            (
                pl.col("predicted_energy_at_meter").filter(metered).sum()
                / pl.when(metered.any()).then(pl.col("measured_energy").sum())
                - 1.0
            ).alias("error"),
        )
        .join(
            robots.group_by("name", maintain_order=True).agg(
                pl.col("energy").min().alias("lowest"), pl.col("energy").max().alias("highest")
            ),
            on="name",
        )
        .sort("jobs", "name", descending=[True, False])
    )
    return _results(ProgrammeEnergy, rows)


def _shifts(hours: pl.DataFrame, shifts: Sequence[int]) -> tuple[ShiftEnergy, ...]:
    sums = hours.group_by("shift", maintain_order=True).agg(
        pl.col("observed_time", "grid_energy", "standby_time", "standby_energy").sum(),
        _sum_known("cost"),
        _sum_known("standby_cost"),
    )
    found: list[ShiftEnergy] = []
    for row in sums.sort("shift").iter_rows(named=True):
        number = int(row.pop("shift"))
        end = shifts[(number + 1) % len(shifts)]
        found.append(ShiftEnergy(f"{shifts[number]:02d}:00 to {end:02d}:00", **row))
    return tuple(found)


def _model_errors(read: pl.DataFrame) -> tuple[ModelError, ...]:
    known = read.filter(
        (pl.col("measured_energy") > 0.0) & pl.col("motor_temperature_degc").is_not_null()
    )
    error = pl.col("predicted_energy_at_meter") / pl.col("measured_energy") - 1.0
    low = (pl.col("motor_temperature_degc") // DEGC_STEP * DEGC_STEP).alias("low_degc")
    rows = known.group_by(low, maintain_order=True).agg(
        pl.len().alias("bags"),
        (pl.col("predicted_energy_at_meter").sum() / pl.col("measured_energy").sum() - 1.0).alias(
            "error"
        ),
        error.quantile(RANGE[0], "linear").alias("low"),
        error.quantile(RANGE[1], "linear").alias("high"),
    )
    upper = (pl.col("low_degc") + DEGC_STEP).alias("high_degc")
    return _results(ModelError, rows.sort("low_degc").with_columns(upper))


def duty_of(hours: pl.DataFrame, robots: Sequence[str]) -> list[float]:
    """Return the share of motion in the time of the bags of each robot."""
    sums = hours.group_by("robot", maintain_order=True).agg(
        pl.col("motion_time", "observed_time").sum()
    )
    share = {robot: motion / time if time else 0.0 for robot, motion, time in sums.iter_rows()}
    return [share.get(robot, 0.0) for robot in robots]


def _curve(
    bags: BagJoints, joint: int, own: Levels, findings: Sequence[FleetFinding]
) -> FrictionCurve:
    name = bags.joints[joint]
    named = [one.robot for one in findings if one.subject == name]
    named = list(dict.fromkeys(named))
    numbers = [bags.robots.index(one) for one in named]
    degc = bags.degc[:, joint]
    multiplier = bags.figures.multiplier[:, joint]
    place = np.where(np.isfinite(degc), degc, -1.0) // CURVE_STEP
    seen = np.unique(place[np.isfinite(multiplier) & (place >= 0)])
    by_degc = _medians(multiplier, bags.robot, place, seen, len(bags.robots))
    week = (bags.stamp_ns - bags.stamp_ns.min()) // WEEK_NS
    weeks = np.unique(week)
    usual = np.exp(own.rest - np.nanmedian(own.rest)) * np.nanmedian(multiplier)
    by_week = _medians(usual, bags.robot, week, weeks, len(bags.robots))
    (low, middle, high), (week_low, week_middle, week_high) = (
        [_across(values, share) for share in (RANGE[0], 0.5, RANGE[1])]
        for values in (by_degc, by_week)
    )
    first_ns = int(bags.stamp_ns.min())
    return FrictionCurve(
        joint=name,
        degc=tuple(((seen + 0.5) * CURVE_STEP).tolist()),
        middle=middle,
        low=low,
        high=high,
        robots=tuple(named),
        by_degc=tuple(_numbers(by_degc[number]) for number in numbers),
        weeks_ns=tuple(first_ns + round((one + 0.5) * WEEK_NS) for one in weeks.tolist()),
        week_low=week_low,
        week_middle=week_middle,
        week_high=week_high,
        by_week=tuple(_numbers(by_week[number]) for number in numbers),
    )


def _medians(values: Float, robot: Any, place: Any, places: Any, robots: int) -> Float:
    """Median of each robot at each place, shape (robots, places); NaN where it has none."""
    frame = pl.DataFrame({"robot": robot, "place": place, "value": values})
    rows = (
        frame.filter(pl.col("value").is_finite())
        .group_by("robot", "place", maintain_order=True)
        .median()
    )
    found = np.full((robots, len(places)), np.nan)
    column = np.searchsorted(places, rows["place"].to_numpy())
    inside = column < len(places)
    found[rows["robot"].to_numpy()[inside], column[inside]] = rows["value"].to_numpy()[inside]
    return found


def _across(values: Float, share: float) -> tuple[float | None, ...]:
    """Quantile over the robots at each place; None where too few were seen."""
    enough = np.isfinite(values).sum(axis=0) >= MIN_ROBOTS
    known = np.where(enough, values, 0.0)
    return _numbers(np.where(enough, np.nanquantile(known, share, axis=0), np.nan))


def _numbers(values: Float) -> tuple[float | None, ...]:
    return tuple(float(one) if np.isfinite(one) else None for one in values)
