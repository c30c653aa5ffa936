"""Advice from recordings alone: what would save how much, and how to try it."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Unpack

import numpy as np

from robot_energy.certainty.deviation import Z90
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import MotionError, ParameterError, RobotEnergyError
from robot_energy.foundation.options import takes
from robot_energy.foundation.shown import Shown
from robot_energy.foundation.units import DAY, JOULE_PER_KWH
from robot_energy.model import RobotModel
from robot_energy.replay.bag_replay import replay
from robot_energy.replay.options import ReplayOptions
from robot_energy.replay.setup import ModelName, ReplaySetup, model_of
from robot_energy.results.base import model_used
from robot_energy.timeline.blocks import NANOSECOND, MeterLocation
from robot_energy_fleet.advice.claims import (
    Claim,
    of_all,
    regenerative,
    shared_bus,
    standby,
    waiting_pose,
    warm_up,
)
from robot_energy_fleet.advice.evidence import (
    LONG_REST,
    MIN_BAGS,
    MIN_REST,
    EvidenceSums,
    RecordedEvidence,
    SampledBag,
    dataset_evidence,
    evenly,
)
from robot_energy_fleet.options import AdviseOptions
from robot_energy_fleet.results.advice import Advice, AdviceBasis, AdviceReport
from robot_energy_fleet.tables import is_history
from robot_energy_plan.api.optimize import optimize
from robot_energy_plan.optimization.rest_states import ASSUMED, read_rest_states
from robot_energy_report.formats import percent
from robot_energy_report.repeats import given_once, overlaps

MAX_PART = 30.0  # s of one bag that are looked at
MIN_MOVES = 2
MARGIN = 0.2  # s of the rests at both ends


def speeds(
    path: str,
    evidence: RecordedEvidence,
    model: RobotModel,
    options: ReplayOptions,
    named: str,
) -> Claim | None:
    """Return what other speeds save, by the moves of the first part between rests.

    All motion of the bag is taken to save the same share as that part. The cycle takes as long as
    now: in the time that faster moves win, a cell with the same work waits.
    """
    part = _part(evidence)
    if part is None:
        return None
    start, end, moving = part
    topics: Any = options.get("joint_states")
    topic = topics if isinstance(topics, str) else (topics[0] if topics else None)
    degc = evidence.mean_degc
    if np.isnan(degc):
        degc = model.temperature.fallback_degc
    try:
        found = optimize(
            path, model, degc, cycle_time=end - start, topic=topic, start=start, end=end
        )
    except MotionError as error:
        evidence.notes.append(f"speeds were not analysed: {error}")
        return None
    measures = {one.name: one for one in found.report.measures}
    one = measures["move_overrides"].saving
    if one is None:
        return None
    whole = float(np.max(evidence.observed_time - evidence.rest_time))
    scale = whole / moving
    less = percent(one.relative or 0.0)
    return Claim(
        "speeds",
        one.energy * scale,
        np.array([one.half / Z90 * scale]),
        "predicted",
        f"the moves from {start:.1f} to {end:.1f} s of {path}, taken for all {whole / 60:.3g} "
        f"min of motion, need {less} less at other speeds in the same time",
        "set the speeds and accelerations of each move that the next command prints",
        shlex.join(
            ["robot-energy", "optimize", path, "--model", named, "--temperature",
             f"{degc:.0f}", "--start", f"{start:.2f}", "--end", f"{end:.2f}",
             "--cycle-time", f"{end - start:.2f}"]
        ),
    )  # fmt: skip


def _part(evidence: RecordedEvidence) -> tuple[float, float, float] | None:
    """Start and end of a part with moves between short rests, and its motion. [s]"""
    if evidence.start_ns is None:
        return None
    origin = evidence.start_ns
    rests = evidence.rests
    for first, rest in enumerate(rests):
        last = first
        for behind in range(first + 1, len(rests)):
            at = (rests[behind].start_ns - rest.end_ns) * NANOSECOND
            if at > MAX_PART or rests[behind - 1].duration >= LONG_REST > 0 < behind - 1 - first:
                break
            last = behind
        if last - first >= MIN_MOVES:
            start = (rest.end_ns - origin) * NANOSECOND - MARGIN
            end = (rests[last].start_ns - origin) * NANOSECOND + MARGIN
            resting = sum(one.duration for one in rests[first + 1 : last])
            return start, end, end - start - 2.0 * MARGIN - resting
    return None


MIN_SAVING = 5e-4  # of the energy from the grid; what is less is not listed [-]
LABELS = {
    "standby": "standby instead of drives that hold, in breaks and at night",
    "regenerative": "a regenerative supply",
    "shared_bus": "one DC bus for two robots",
    "warm_up": "a warmer start",
    "speeds": "other speeds and accelerations, in the same cycle time",
    "waiting_pose": "wait where holding costs least",
}
OVERLAPS = (
    ("speeds", "warm_up"), ("speeds", "regenerative"), ("speeds", "shared_bus"),
    ("regenerative", "shared_bus"),
)  # fmt: skip
ABSENT = {
    "standby": "standby: no rest of a minute or more that a state would pay for",
    "regenerative": "regenerative supply: nothing went into a brake resistor",
    "shared_bus": "one DC bus: nothing went into a brake resistor, or no samples are known",
    "warm_up": "warm-up: no measured temperatures, or motors as warm all the time",
    "speeds": "speeds: no part of a bag that starts and ends at rest with two moves, or not asked "
    "for",
    "waiting_pose": "waiting pose: fewer than two places of rest, or no bags of the dataset are "
    "where they were",
}


class AdviceResult(Described, Shown):
    """What would save how much."""

    report: Annotated[AdviceReport, "All figures."]

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain values: the JSON of ``robot-energy advise``."""
        return self.report.to_dict()


@takes(AdviseOptions)
def advise(
    recordings: str | Path | Sequence[str | Path],
    model: ModelName,
    **options: Unpack[AdviseOptions],
) -> AdviceResult:
    """Return a ranked list of what would save energy, from recordings alone.

    Args:
        recordings: Bags of one robot model, or the folder of a dataset of a fleet or of a history.
        model: A model, its file, or the name of a shipped one.
        **options: What savings are computed from: see `AdviseOptions`.

    Raises:
        ParameterError: If a figure makes no sense.
        RobotEnergyError: If recordings or model cannot be used.
    """
    used = model_of(model)
    named = str(model) if isinstance(model, str | Path) else used.source
    paths = [recordings] if isinstance(recordings, str | Path) else list(recordings)
    if not paths:
        raise ParameterError("no recording was named", "bags, or a dataset")
    places = [Path(path).resolve() for path in paths]
    rows, notes = given_once([str(path) for path in paths], places)
    paths = [paths[row] for row in rows]
    problems: list[str] = []
    if len(paths) == 1 and (any(Path(paths[0]).glob("robot=*")) or is_history(paths[0])):
        evidence, sampled = dataset_evidence(paths[0], used, options)
        fine = _sampled(sampled, evidence, used, named, problems, options)
    else:
        each = [_recorded(path, used, problems, options) for path in paths]
        names = [str(path) for path in paths]
        # equal for the same recording, wherever the bag lies
        contents = [
            (
                *(one.start_ns, one.end_ns, one.observed_time, one.grid_energy),
                one.motion_time.tobytes(),
            )
            for one in each
        ]
        rows, more = given_once(names, contents)
        paths, each = [paths[row] for row in rows], [each[row] for row in rows]
        names = [names[row] for row in rows]
        notes += [*more, *overlaps(names, [(one.start_ns, one.end_ns) for one in each])]
        evidence = RecordedEvidence()
        for one in each:
            evidence.add(one)
        moving = [row for row, one in enumerate(each) if not math.isnan(one.mean_degc)]
        coldest = min(moving, key=lambda row: each[row].mean_degc, default=0)
        fine = _fine(names[coldest], evidence, used, named)
        if options.get("look_at_speeds", True):
            places = evenly(len(names))
            by_bag = [speeds(names[k], each[k], used, options, named) for k in places]
            time = [one.observed_time for one in each]
            part = [time[k] for k in places]
            fine["speeds"] = (
                by_bag[0] if len(names) == 1 else of_all(by_bag, part, sum(time), len(names))
            )
            evidence.notes += [
                note for one in each for note in one.notes if note not in evidence.notes
            ]
    states = options.get("rest_states")
    claims = {
        "standby": standby(evidence, used, read_rest_states(states or ASSUMED), states is None),
        "regenerative": regenerative(evidence, used),
        **fine,
    }
    basis = _basis(evidence, options)
    least, small = MIN_SAVING * evidence.grid_energy, percent(MIN_SAVING, digits=2)
    without = [
        ABSENT[name] if one is None else f"{LABELS[name]}: less than {small} of the energy"
        for name, one in claims.items()
        if one is None or abs(one.energy) < least
    ]
    worth = [one for one in claims.values() if one is not None and abs(one.energy) >= least]
    found = [_advice(one, basis) for one in worth]
    found.sort(key=lambda one: -one.energy)
    claimed = [one for one in found if one.claimed]
    counted: list[Advice] = []
    for one in claimed:
        if not set(one.overlaps) & {other.name for other in counted}:
            counted.append(one)
    year = _year(basis)
    hourly = sum(one.energy_per_hour for one in counted)
    half = sum(one.half_per_hour for one in counted)
    return AdviceResult(
        AdviceReport(
            source=tuple(map(str, paths)),
            model=model_used(used),
            basis=basis,
            advice=tuple(claimed),
            unproven=tuple(one for one in found if not one.claimed),
            without=tuple(without),
            energy_per_hour=hourly,
            half_per_hour=half,
            energy_per_year=None if year is None else hourly * year,
            half_per_year=None if year is None else half * year,
            counted=tuple(one.name for one in counted),
            notes=(*notes, *evidence.notes),
            problems=tuple(problems),
        )
    )


def _fine(
    path: str, evidence: RecordedEvidence, model: RobotModel, named: str
) -> dict[str, Claim | None]:
    """What needs samples; speeds are looked for apart."""
    shown = shlex.join(["robot-energy", "replay", path, "--model", named])
    return {
        "shared_bus": shared_bus(evidence, model),
        "warm_up": warm_up(evidence, model, shown),
        "speeds": None,
        "waiting_pose": waiting_pose(evidence, model),
    }


def _sampled(
    bags: Sequence[SampledBag],
    whole: RecordedEvidence,
    model: RobotModel,
    named: str,
    problems: list[str],
    options: ReplayOptions,
) -> dict[str, Claim | None]:
    """The same in some bags of a dataset, for all of them."""
    found: list[dict[str, Claim | None]] = []
    time: list[float] = []
    for bag in bags:
        given: Any = {**bag.options, "progress": options.get("progress")}
        try:
            own = _recorded(bag.address, model, problems, given)
            fine = _fine(bag.address, own, model, named)
            if options.get("look_at_speeds", True):
                fine["speeds"] = speeds(bag.address, own, model, given, named)
            found.append(fine)
        except RobotEnergyError as error:
            problems.append(f"{bag.address} was not analysed: {error}")
            continue
        time.append(own.observed_time)
    if len(found) < len(bags):
        few = ", too few for warm-up, speeds and waiting poses" if len(found) < MIN_BAGS else ""
        whole.notes.append(f"{len(found)} of these {len(bags)} bags could be analysed{few}")
    names = ("shared_bus", "warm_up", "speeds", "waiting_pose")
    return {
        name: of_all([one[name] for one in found], time, whole.observed_time, whole.recordings)
        for name in names
    }


def _recorded(
    path: str | Path, model: RobotModel, problems: list[str], options: ReplayOptions
) -> RecordedEvidence:
    sums = EvidenceSums(model)
    setup = ReplaySetup.of(options)
    result = replay(path, model, setup, on_output=sums.take, on_compared=sums.compare)
    at_grid = result.account.comparison.location is MeterLocation.GRID
    found = sums.evidence(at_grid)
    time = result.account.registers.time
    found.start_ns, found.end_ns = time.start_ns, time.end_ns
    found.measured_temperature = bool(result.topics.temperatures)
    found.notes = [] if result.topics.temperatures else ["no motor temperatures were recorded"]
    found.notes += [f"{path}: {one.sentence}" for one in result.joint_states.findings()]
    problems += result.problems
    return found


def _basis(
    evidence: RecordedEvidence,
    options: AdviseOptions,
) -> AdviceBasis:
    span = 0.0
    if evidence.start_ns is not None and evidence.end_ns is not None:
        span = (evidence.end_ns - evidence.start_ns) * NANOSECOND
    recorded = evidence.observed_time
    rests = f"rests of {MIN_REST:g} s and more" if evidence.fine else "rests"
    parts = [f"at work is all but {rests}", f"{recorded / 3600:.3g} h were recorded"]
    hours = options.get("hours_per_day")
    if hours is not None:
        parts.append(f"{hours:g} h of such work a day, as given")
    elif span >= DAY:
        hours = recorded / span * 24.0
        parts.append(f"{hours:.3g} h a day, as recorded over {span / DAY:.3g} days")
    else:
        parts.append("hours of such work a day: not known, give --hours-per-day")
    days = options.get("days_per_year")
    if days is not None:
        parts.append(f"{days:g} days a year, as given")
    elif span >= 7 * DAY:
        days = 365.0
        parts.append("365 days a year: the recordings span a week, its days off included")
    else:
        parts.append("days of such work a year: not known, give --days-per-year")
    parts.append("bands say how sure the model is, not how typical the recordings are")
    duty = 1.0 - evidence.rest_time / recorded if recorded > 0 else math.nan
    return AdviceBasis(
        evidence.recordings, recorded, evidence.grid_energy, hours, days, duty,
        options.get("price"), options.get("currency", "EUR"), options.get("co2"), "; ".join(parts),
    )  # fmt: skip


def _year(basis: AdviceBasis) -> float | None:
    """Hours of such work in a year; None where that is not known. [h]"""
    hours, days = basis.hours_per_day, basis.days_per_year
    return None if hours is None or days is None else hours * days


def _advice(claim: Claim, basis: AdviceBasis) -> Advice:
    per_hour = 3600.0 / basis.recorded_time if basis.recorded_time > 0 else 0.0
    hours = _year(basis)
    year = None if hours is None else claim.energy * per_hour * hours

    def of_a_year(factor: float | None) -> float | None:
        return None if year is None or factor is None else year / JOULE_PER_KWH * factor

    pairs = [pair for pair in OVERLAPS if claim.name in pair]
    return Advice(
        name=claim.name,
        label=LABELS[claim.name],
        energy=claim.energy,
        half=claim.half,
        relative=claim.energy / basis.recorded_energy if basis.recorded_energy > 0 else None,
        claimed=claim.energy > claim.half > 0,
        energy_per_hour=claim.energy * per_hour,
        half_per_hour=claim.half * per_hour,
        energy_per_year=year,
        half_per_year=None if hours is None else claim.half * per_hour * hours,
        cost_per_year=of_a_year(basis.price_per_kwh),
        co2_per_year=of_a_year(basis.co2_kg_per_kwh),
        sure=claim.sure,
        found=claim.found,
        change=claim.change,
        command=claim.command,
        overlaps=tuple(name for pair in pairs for name in pair if name != claim.name),
    )
