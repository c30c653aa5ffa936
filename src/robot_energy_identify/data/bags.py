"""Bags that are seen again with every model that identification makes of them.

What a recording gives depends on the model: the rigid-body torque on its bodies, the power
of the drives on its friction. So each step of an identification sees the bags with the
model that the steps before it left.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from robot_energy.bag.reader import TimeRange
from robot_energy.foundation.described import Described
from robot_energy.inputs.sources import Inputs
from robot_energy.model import RobotModel
from robot_energy.replay.bag_replay import Progress
from robot_energy.timeline.blocks import NANOSECOND, EffortMeaning, Float, MeterLocation
from robot_energy_identify.data.observations import Rows
from robot_energy_identify.data.recordings import EVER, MotionBlock, Recording, read_recording
from robot_energy_identify.data.thinned import MOST
from robot_energy_identify.drives.drive_power import MeasuredDrivePower
from robot_energy_identify.provenance import require_distinct, sha256_of
from robot_energy_identify.stats.cross_validation import FOLDS
from robot_energy_identify.stats.lag import Delay, applied
from robot_energy_identify.stats.systematic import DEFAULT_LIMITS, SensorLimits

Span = tuple[int, int]  # [ns), from and to
MAX_MOTION_TIME = 240.0  # s of motion for the dynamics: more adds little, and memory grows with it
MIN_PIECE = 20.0  # s of motion in one piece: filters lose some of both of its ends
HeldOutKind = Literal["test", "recordings", "blocks"]
MARGIN = 1.0  # s by which the times of messages and of their stamps may differ
YEAR = 3.2e7  # s
GUARD = 0.5  # s left out of the fit on both sides of a block
VIRTUAL = "virtual rig"  # whose stamps are not dates
YEAR_2000 = 946_684_800_000_000_000  # ns: stamps before it are not dates


class Kept:
    """A bag that was read, what later models and folds ask of it again, and rows of dynamics."""

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self.rows: Rows = {}
        self._newest = recording
        self._pieces: dict[Span, MotionBlock] = {}

    def with_model(self, model: RobotModel) -> Recording:
        """Return the recording as another model sees it, see `Recording.with_model`.

        Torque and friction are those of the newest model where that is alike.
        """
        known = self.recording
        if model is not known.model and not known.differs_in_supply(model):
            newest = self._newest
            if model is not newest.model and not newest.differs_in_supply(model):
                self.forget()  # all is computed again: nothing of it is of use
                newest = known
            self._newest = newest.with_model(model)
            return self._newest
        return known.with_model(model)

    def forget(self) -> None:
        """Keep no view of another model, which takes as much memory as the recording."""
        self._newest = self.recording

    def piece(self, span: Span, read: Callable[[], Recording]) -> MotionBlock:
        """Return the motion in a part of the bag with every sample, which is read once."""
        if span not in self._pieces:
            self._pieces[span] = read().motion
        return self._pieces[span]


class Bag(Described):
    """One bag, or some stretches of it."""

    path: Path
    effort: EffortMeaning = EffortMeaning.NONE
    inputs: Annotated[Inputs | None, "Of the live monitor as which it is read."] = None
    drive_power: MeasuredDrivePower | None = None
    spans: Annotated[tuple[Span, ...], "Stretches that count. [ns]"] = (EVER,)
    meter_delay: Annotated[float, "Of the meter behind the joint states, undone. [s]"] = 0.0
    meter_time_constant: Annotated[float, "Of a low pass in the meter, undone. [s]"] = 0.0
    sensors: SensorLimits = DEFAULT_LIMITS
    most: Annotated[float, "Samples that are kept, see `Thinned`."] = MOST
    kept: Annotated[
        Kept | None, "The bag as it was read; None: it is read again with each model."
    ] = field(default=None, repr=False)

    @property
    def name(self) -> str:
        return self.path.resolve().name

    def whole(self, model: RobotModel, progress: Progress | None = None) -> Recording:
        if self.kept is None:
            recording = self._read(model, progress, self.most)
        else:
            recording = self.kept.with_model(model)
        return recording.with_meter_earlier(self.meter_delay, self.meter_time_constant)

    def _read(
        self,
        model: RobotModel,
        progress: Progress | None = None,
        most: float = np.inf,
        time_range: TimeRange | None = None,
    ) -> Recording:
        recording = read_recording(
            self.path, model, self.effort, progress, self.inputs, most, time_range
        )
        return replace(recording, sensors=self.sensors)

    def motion(self, model: RobotModel, seconds: float) -> list[MotionBlock]:
        """Return motion for the dynamics, with every sample of it.

        All stretches that count, or the begin of each block that the folds hold out: every fold
        has the same pieces of the others. The begin of the bag where these were too short.

        Args:
            seconds: That all pieces of the bag last together; infinite for all of it. [s]
        """
        whole = self.whole(model)
        if not np.isfinite(seconds) and whole.every == 1:
            return [part.motion for part in self._parts(whole)]
        blocks, guard = blocks_of(whole.span_ns)
        if seconds < len(blocks) * MIN_PIECE:
            blocks = [whole.span_ns]
        length = round(min(seconds, YEAR) / len(blocks) / NANOSECOND)
        spans = [(a + guard, min(a + guard + length, b - guard)) for a, b in blocks]
        found = [
            self._piece(whole, span)
            for span in spans
            if any(first <= span[0] and span[1] <= last for first, last in self.spans)
        ]
        return [part for part in found if len(part) > 1]

    def _piece(self, whole: Recording, span: Span) -> MotionBlock:
        """A part with every sample; what was kept is not all of them where it is thinned."""
        first, last = span
        if whole.every == 1 or self.kept is None:
            return whole.between(first, last + 1).motion
        model, origin = self.kept.recording.model, int(whole.torque.stamp_ns[0])

        def read() -> Recording:
            since, until = ((at - origin) * NANOSECOND for at in span)
            around = TimeRange(max(since - MARGIN, 0.0), until + MARGIN)
            return self._read(model, time_range=around).between(first, last + 1)

        return self.kept.piece(span, read)

    def read(self, model: RobotModel) -> list[Recording]:
        return self._parts(self.whole(model))

    def _parts(self, recording: Recording) -> list[Recording]:
        if self.spans == (EVER,):
            return [recording]
        parts = [recording.between(*span) for span in self.spans]
        return [part for part in parts if len(part) > 1]

    def with_meter_undone(self, low_pass: Delay | None, delay: Delay | None) -> Bag:
        """Return the bag with what its meter shows late undone when it is read."""
        return replace(self, meter_delay=applied(delay), meter_time_constant=applied(low_pass))


class BagFacts(Described):
    """What a bag holds, as far as identification cares."""

    name: Annotated[str, "Of the bag."]
    sha256: Annotated[str, "First digits of its hash."]
    origin: Annotated[str, "Where it comes from, as its writer said; may be empty."]
    date: Annotated[str, "Of its first sample, empty where stamps are not dates."]
    duration: Annotated[float, "From first to last sample. [s]"]
    rate: Annotated[float, "Median of the samples. [Hz]"]
    range_degc: Annotated[tuple[float, float] | None, "Of all motors; None where unknown. [degC]"]
    effort: Annotated[EffortMeaning, "What it is; NONE if not stated, or never measured."]
    meter: Annotated[MeterLocation | None, "Where the meter sits; None without one."]
    readings: Annotated[int, "Of the meter."]
    drives: Annotated[bool, "Whether the power of the drives is measured."]
    problems: Annotated[tuple[str, ...], "What was wrong with the bag, one sentence each."]


def facts(bag: Bag, recording: Recording) -> BagFacts:
    start, end = recording.span_ns
    degc = recording.power.motor_temperature_degc
    warm = np.isfinite(degc)
    known = bool(np.isfinite(recording.torque.motor_torque_measured).any())
    step = float(np.median(np.diff(recording.torque.stamp_ns))) if len(recording) > 1 else np.nan
    meter = recording.meter
    return BagFacts(
        name=bag.name,
        sha256=sha256_of(bag.path),
        origin=recording.origin,
        date=datetime.fromtimestamp(start * NANOSECOND, UTC).date().isoformat()
        if start > YEAR_2000 and VIRTUAL not in recording.origin
        else "",
        duration=(end - start) * NANOSECOND,
        rate=recording.every / (step * NANOSECOND) if step > 0 else float("nan"),
        range_degc=(float(degc[warm].min()), float(degc[warm].max())) if warm.any() else None,
        effort=bag.effort if known else EffortMeaning.NONE,
        meter=None if meter is None else meter.location,
        readings=0 if meter is None else len(meter),
        drives=bag.drive_power is not None,
        problems=recording.problems,
    )


def temperature_ranges(recordings: Sequence[Recording]) -> Float:
    """Return lowest and highest temperature of each motor, NaN if unknown, shape (2, n). [degC]"""
    parts = [part.power.motor_temperature_degc for part in recordings if len(part)]
    if not parts:
        return np.full((2, 1), np.nan)
    degc = np.concatenate(parts)
    return np.stack([np.fmin.reduce(degc), np.fmax.reduce(degc)])


def read_all(bags: Sequence[Bag], model: RobotModel) -> list[Recording]:
    return [part for bag in bags for part in bag.read(model)]


def motion_time(recordings: Sequence[Recording], bags: int) -> float:
    """Return how much of each bag the dynamics see: an equal share of `MAX_MOTION_TIME`. [s]"""
    total = sum(end - start for start, end in (part.span_ns for part in recordings)) * NANOSECOND
    return MAX_MOTION_TIME / bags if total > MAX_MOTION_TIME else np.inf


def powers_of(
    bags: Sequence[Bag], model: RobotModel
) -> tuple[list[Recording], list[MeasuredDrivePower | None]]:
    """Return all stretches of all bags, and the measured power of drives that belongs to each."""
    read = [(part, bag.drive_power) for bag in bags for part in bag.read(model)]
    return [part for part, _ in read], [power for _, power in read]


class Fold(Described):
    """What is fitted together and what is tested on it."""

    train: tuple[Bag, ...]
    test: Annotated[tuple[Bag, ...], "Bags, or stretches, that the fit does not see."]


def blocks_of(span: Span) -> tuple[list[Span], int]:
    """Return the blocks of a span that are held out in turn, and the time around each. [ns]"""
    start, end = span
    edges = np.linspace(0, end - start, FOLDS + 1).astype(np.int64).tolist()
    guard = round(min(GUARD / NANOSECOND, (end - start) / (4 * FOLDS)))
    return [(start + edges[k], start + edges[k + 1]) for k in range(FOLDS)], guard


def folds_of(
    bags: Sequence[Bag], tests: Sequence[Bag], spans: Sequence[Span]
) -> tuple[HeldOutKind, list[Fold]]:
    """Return what is held out, by kind, and the folds.

    ``test`` where bags are for the test alone, ``recordings`` where there are several, else blocks
    of the span, from first to last stamp [ns], of the only one.
    """
    if tests:
        require_distinct([bag.path for bag in bags], [bag.path for bag in tests])
        return "test", [Fold(tuple(bags), tuple(tests))]
    if len(bags) > 1:
        count = min(FOLDS, len(bags))  # neighbours, often alike in temperature, go apart
        return "recordings", [
            Fold(
                tuple(bag for place, bag in enumerate(bags) if place % count != number),
                tuple(bags[number::count]),
            )
            for number in range(count)
        ]
    blocks, guard = blocks_of(spans[0])
    return "blocks", [
        Fold(
            (replace(bags[0], spans=((EVER[0], first - guard), (last + guard, EVER[1]))),),
            (replace(bags[0], spans=((first, last),)),),
        )
        for first, last in blocks
    ]
