"""What other speeds would save: the optimiser on a part of a recording."""

from __future__ import annotations

import shlex
from typing import Any

import numpy as np

from robot_energy.certainty.band import Z90
from robot_energy.foundation.errors import MotionError
from robot_energy.model import RobotModel
from robot_energy.replay.options import ReplayOptions
from robot_energy.timeline.blocks import NANOSECOND
from robot_energy_fleet.advice.claims import LONG_REST, Claim
from robot_energy_fleet.advice.evidence import RecordedEvidence
from robot_energy_plan.api.optimize import optimize
from robot_energy_report.formats import percent

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
