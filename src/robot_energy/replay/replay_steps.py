"""What of a replay comes before the power: reading a bag, and the torque of what was read.

Both are iterators without a return path, so each can run in a process of its own, and nothing
depends on whether it does.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.bag import BagReader
from robot_energy.bag.cdr.decode import RawBatch
from robot_energy.bag.mcap_records import LogTimes
from robot_energy.foundation.units import SECOND_NS
from robot_energy.inputs.auxiliary import LoadTopics
from robot_energy.inputs.joint_states.joint_states import JointStateIngest
from robot_energy.inputs.meter.meter import MeterIngest
from robot_energy.inputs.temperatures.temperatures import TemperatureIngest
from robot_energy.messages.payload import PayloadReader
from robot_energy.pipeline import TorqueStage
from robot_energy.pipeline.torque_stage import PayloadChange
from robot_energy.replay.recorded_jobs import RecordedJobs
from robot_energy.replay.setup import Topics
from robot_energy.timeline.blocks import JointBlock, MeterBlock, TemperatureBlock, TorqueBlock

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

ROWS = 13312  # samples in one step at most
MESSAGES = 13312  # of parts that are read together, at most; four chunks of most recorders


LoadReadings = tuple[MeterBlock | None, MeterBlock | None]
"""What came from the meter of a load, and the numbers of its states."""


class LoadIngest:
    """Reads meter and states of one auxiliary load.

    Attributes:
        meter: Accounting of its meter; None without one.
        state: Accounting of its states; None without them.
    """

    def __init__(self, topics: LoadTopics, typestore: Typestore) -> None:
        self.meter, self.state = (
            MeterIngest(source, typestore) if source is not None else None
            for source in (topics.meter, topics.state)
        )
        self.readers = [reader for reader in (self.meter, self.state) if reader is not None]

    def step(self, part: Mapping[str, RawBatch]) -> LoadReadings:
        return self._each(
            lambda reader: reader.step([part[t] for t in reader.source.topics if t in part])
        )

    def flush(self) -> LoadReadings:
        return self._each(lambda reader: reader.flush())

    def restart(self) -> None:
        for reader in self.readers:
            reader.restart()

    def _each(self, take: Callable[[MeterIngest], MeterBlock | None]) -> LoadReadings:
        meter, state = (None if r is None else take(r) for r in (self.meter, self.state))
        return meter, state


@dataclass
class BagInputs:
    """What reads a bag, and has counted what it read."""

    joint_states: JointStateIngest
    temperatures: TemperatureIngest
    meter: MeterIngest
    problems: Annotated[list[str], "What was wrong with the bag, one sentence each."]
    auxiliary: Annotated[
        dict[str, LoadIngest], "Accounting of meters and states of auxiliary loads, by load."
    ] = field(default_factory=dict[str, LoadIngest])


@dataclass
class BagStep:
    """What one step took from a bag.

    Attributes:
        joints: Joint states; None after they have become torque.
        auxiliary: What came from each auxiliary load, by its name.
        payload: Messages of payloads, before they are in force.
        share: How much of the bag is read, 0 to 1; None within a part.
        stages: After the last step: the stage of the torque, and the reader of payloads.
    """

    joints: JointBlock | None = None
    torque: TorqueBlock | None = None
    temperatures: TemperatureBlock | None = None
    meter: MeterBlock | None = None
    auxiliary: dict[str, LoadReadings] = field(default_factory=dict[str, LoadReadings])
    payload: RawBatch | None = None
    changes: tuple[PayloadChange, ...] = ()
    share: float | None = None
    inputs: BagInputs | None = None
    stages: tuple[TorqueStage, PayloadReader] | None = None


def read_steps(
    bag: BagReader,
    inputs: BagInputs,
    topics: Topics,
    spans: Mapping[str, LogTimes],
    by_second: bool,
    jobs: RecordedJobs,
) -> Generator[BagStep]:
    """Yield steps without torque, a part of the bag each; the last one has the inputs."""
    metered = tuple(inputs.meter.source.topics) if topics.meter else ()
    states = topics.joint_states or ()
    auxiliary = [
        topic
        for load in inputs.auxiliary.values()
        for reader in load.readers
        for topic in reader.source.topics
    ]
    wanted = (*states, topics.payload, *(topics.temperatures or ()), *metered, *auxiliary)
    start, end = next((spans[name] for name in states if name in spans), (bag.start_ns, bag.end_ns))
    for part in _joined(bag.parts([name for name in wanted if name], spans)):
        readings = [part[topic] for topic in topics.temperatures or () if topic in part]
        metering = [part[topic] for topic in metered if topic in part]
        batches = [part[topic] for topic in states if topic in part]
        first = BagStep(
            temperatures=inputs.temperatures.step(readings) if readings else None,
            meter=inputs.meter.step(metering) if metering else None,
            auxiliary={name: load.step(part) for name, load in inputs.auxiliary.items()},
            payload=part[topics.payload].copy() if topics.payload in part else None,
        )
        joints = inputs.joint_states.step(batches) if batches else None
        newest = int(batches[0].log_time_ns[-1]) if batches else None
        del part, readings, metering, batches  # while what came of them goes on
        *steps, last = _cut(joints, by_second, jobs, first)
        del joints, first
        while steps:
            yield steps.pop(0)
        if newest is not None and start is not None and end is not None:
            last.share = min(1.0, (newest - start) / max(end - start, 1))
        yield last
    yield BagStep(
        temperatures=inputs.temperatures.flush(),
        meter=inputs.meter.flush(),
        auxiliary={name: load.flush() for name, load in inputs.auxiliary.items()},
    )
    if (joints := inputs.joint_states.flush()) is not None:
        yield from _cut(joints, by_second, jobs, BagStep())
    inputs.problems += bag.problems
    yield BagStep(share=1.0, inputs=inputs)


def torque_steps(
    steps: Iterator[BagStep], stage: TorqueStage, payload: PayloadReader, whole: bool
) -> Generator[BagStep]:
    """Yield the steps with torque, ``whole`` with its joint side; the last one has both stages."""
    for step in steps:
        if step.payload is not None:
            known = len(payload.changes)
            payload.step(step.payload)
            step.changes, step.payload = tuple(payload.changes[known:]), None
        if step.joints is not None:
            step.torque, step.joints = stage.step(step.joints), None
        if step.inputs is not None:
            step.torque, step.stages = stage.flush(), (stage, payload)
        if step.torque is not None and not whole:
            step.torque = step.torque.motor_side()
        yield step


def _joined(parts: Iterator[dict[str, RawBatch]]) -> Iterator[dict[str, RawBatch]]:
    """Join small parts, as each costs a step of every stage; log times still rise in a batch."""
    held: list[dict[str, RawBatch]] = []
    messages = 0
    for part in parts:
        count = sum(map(len, part.values()))
        falls = held and any(
            t in held[-1] and batch.log_time_ns[0] < held[-1][t].log_time_ns[-1]
            for t, batch in part.items()
        )
        if held and (messages + count > MESSAGES or falls):
            yield _taken(held)
            messages = 0
        held.append(part)
        messages += count
    if held:
        yield _taken(held)


def _taken(held: list[dict[str, RawBatch]]) -> dict[str, RawBatch]:
    """Join what is held, and hold nothing."""
    parts = held.copy()
    held.clear()
    if len(parts) == 1:
        return parts[0]
    buffers: dict[int, tuple[int, NDArray[np.uint8]]] = {}
    size = 0
    found: dict[str, list[RawBatch]] = {}
    for part in parts:
        for topic, batch in part.items():
            found.setdefault(topic, []).append(batch)
            if id(batch.buffer) not in buffers:
                buffers[id(batch.buffer)] = size, batch.buffer
                size += len(batch.buffer)
    buffer = np.concatenate([each for _, each in buffers.values()])
    return {
        topic: replace(
            batches[0],
            log_time_ns=np.concatenate([b.log_time_ns for b in batches]),
            buffer=buffer,
            offset=np.concatenate([b.offset + buffers[id(b.buffer)][0] for b in batches]),
            length=np.concatenate([b.length for b in batches]),
        )
        for topic, batches in found.items()
    }


def _cut(
    block: JointBlock | None, by_second: bool, jobs: RecordedJobs, first: BagStep
) -> list[BagStep]:
    """Cut into steps that fit the caches; at whole seconds for the registers' rate; for jobs."""
    if block is None:
        return [first]
    cuts = {*range(ROWS, len(block), ROWS)}
    if by_second:
        cuts = {*(np.flatnonzero(np.diff(block.stamp_ns // SECOND_NS)) + 1).tolist()}
    bounds = [0, *sorted(cuts.union(jobs.cuts(block.stamp_ns).tolist())), len(block)]
    parts = [block[slice(start, stop)] for start, stop in pairwise(bounds)]
    return [replace(first, joints=parts[0]), *(BagStep(joints=part) for part in parts[1:])]
