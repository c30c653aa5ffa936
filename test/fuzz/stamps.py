"""Messages of every input with any stamps, mixed into a clean recording.

A message whose stamp is none changes nothing of what the clean ones give, bit for bit; one
whose stamp is possible may, but every account stays exact and nothing raises.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from online import METERS, SOURCES, TOPIC_OF, example
from target import JOINTS

import robots
from joint_messages import message
from robot_energy.accounting.account import EnergyAccount
from robot_energy.bag.cdr import RawBatch
from robot_energy.condition.learner import ConditionLearner
from robot_energy.inputs.joint_states.joint_states import JOINT_STATE, JointStateIngest
from robot_energy.inputs.meter.meter import MeterIngest
from robot_energy.inputs.meter.source import BATTERY_STATE, FLOAT32, FLOAT64, POWER_READING
from robot_energy.inputs.sources import JointStateSource
from robot_energy.inputs.temperatures.kinds import (
    EXAMPLE_FLOAT_ARRAY,
    FLOAT_ARRAY,
    INTERFACE_NAMES,
)
from robot_energy.inputs.temperatures.temperatures import TemperatureIngest
from robot_energy.messages.friction import JOINT_FRICTION, FrictionReader, FrictionWriter
from robot_energy.messages.payload import PAYLOAD, PayloadReader
from robot_energy.messages.torque import JOINT_TORQUE, TorqueReader, TorqueWriter
from robot_energy.pipeline import EnergyPipeline, PowerStage, Settings
from robot_energy.timeline.stamps import MAX_STAMP_NS, is_valid_time

SECOND = 10**9
START = 1000 * SECOND  # of the clean recording [ns]
HEADED = (
    JOINT_STATE,
    POWER_READING,
    BATTERY_STATE,
    PAYLOAD,
    JOINT_TORQUE,
    JOINT_FRICTION,
    *(kind for kind in SOURCES if kind not in (FLOAT_ARRAY, EXAMPLE_FLOAT_ARRAY)),
)
RECEIVED = (
    FLOAT_ARRAY,
    EXAMPLE_FLOAT_ARRAY,
    FLOAT32,
    FLOAT64,
)  # dated by their time of receipt alone
KINDS = (*HEADED, *RECEIVED)


class Message(NamedTuple):
    """One message: its type, when it was received [ns], its bytes."""

    kind: str
    log_ns: int
    data: bytes


def stamped(data: bytes, seconds: int, nanoseconds: int) -> bytes:
    """A message that begins with a header, with another stamp."""
    stamp = seconds.to_bytes(4, "little", signed=True) + nanoseconds.to_bytes(4, "little")
    return data[:4] + stamp + data[12:]


def spoiled(kind: str, seconds: int, nanoseconds: int, log_ns: int) -> Message:
    """A message of a kind with any stamp and time of receipt."""
    data = message(1.0, JOINTS, (0.3, 0.2), (0.1, 0.1)) if kind == JOINT_STATE else example(kind)
    if kind in RECEIVED:
        return Message(kind, log_ns, data)
    return Message(kind, START, stamped(data, seconds, nanoseconds))


def is_bad(one: Message) -> bool:
    """Whether a message must be refused for its stamp."""
    if one.kind in RECEIVED:
        return not 0 <= one.log_ns <= MAX_STAMP_NS
    seconds = int.from_bytes(one.data[4:8], "little", signed=True)
    return not is_valid_time(seconds, int.from_bytes(one.data[8:12], "little"))


@functools.cache
def clean() -> tuple[Message, ...]:
    """A third of a second of every input; names of values come first."""
    model = robots.two_link()
    stage = EnergyPipeline(model)
    torque, friction = TorqueWriter(JOINTS, model.model_id), FrictionWriter(model)
    ingest = JointStateIngest(JOINTS)
    messages = [Message(INTERFACE_NAMES, START, example(INTERFACE_NAMES))]
    for index in range(30):
        now = START + index * SECOND // 100
        angle = 0.01 * index
        state = message(now / SECOND, JOINTS, (angle, -angle), (1.0, -1.0))
        messages.append(Message(JOINT_STATE, now, state))
        output = stage.step(ingest.step(_batch(messages[-1], 0)))
        if output.torque is not None:
            messages += [
                Message(JOINT_TORQUE, now, row.tobytes()) for row in torque.encode(output.torque)
            ]
        if index % 10 == 0:
            at = divmod(now, SECOND)
            for kind in (*HEADED[1:4], *SOURCES):
                data = example(kind, 30.0 if kind in SOURCES else 1.0)
                headed = kind in HEADED
                messages.append(Message(kind, now, stamped(data, *at) if headed else data))
            messages += [Message(kind, now, example(kind, 20.0 + index)) for kind in RECEIVED[2:]]
            rows = friction.encode(stage.friction.latest())
            messages.append(Message(JOINT_FRICTION, now, stamped(rows[0].tobytes(), *at)))
    return tuple(messages)


def _batch(one: Message, number: int) -> RawBatch:
    topic = TOPIC_OF.get(one.kind, "/t")
    if one.kind == FLOAT32:  # voltage and current in turn
        topic = ("/volt", "/ampere")[number % 2]
    return RawBatch.from_messages(topic, one.kind, [one.log_ns], [one.data])


class Monitors:
    """Every reader with what stands behind it.

    Args:
        receive: Whether joint states count by their time of receipt.
    """

    def __init__(self, receive: bool = False) -> None:
        model = robots.two_link()
        self.pipeline = EnergyPipeline(model)
        settings = Settings()
        self.power = PowerStage(model, settings, ConditionLearner(model, settings))
        self.account = EnergyAccount(2)
        source = JointStateSource(stamp_source="receive" if receive else "header")
        limits = self.pipeline.torque.robot.limits
        self.joints = JointStateIngest(JOINTS, limits=limits, source=source)
        self.meters = {kind: MeterIngest(meter) for kind, meter in METERS.items()}
        self.temperatures = TemperatureIngest(JOINTS, {s.topic: s for s in SOURCES.values()})
        self.torque = TorqueReader(JOINTS, model.model_id)
        self.friction = FrictionReader(model)
        self.payload = PayloadReader(self.pipeline.torque.set_payload)
        self.readings: list[Any] = []
        self._given: dict[tuple[str, bool], int] = {}
        self._takers: dict[str, Callable[[RawBatch], Any]] = {
            JOINT_STATE: lambda batch: self.pipeline.step(self.joints.step(batch)),
            PAYLOAD: self.payload.step,
            JOINT_TORQUE: self._take_torque,
            JOINT_FRICTION: self._take_friction,
            **dict.fromkeys(METERS, self._measure),
        }

    def rejections(self, kind: str) -> Any:
        """The rejection log of the messages of a type."""
        logs = {
            JOINT_STATE: self.joints.rejections,
            PAYLOAD: self.payload.rejections,
            JOINT_TORQUE: self.torque.rejections,
            JOINT_FRICTION: self.friction.rejections,
            **{name: meter.rejections for name, meter in self.meters.items()},
            **{reader.source.type: reader.rejections for reader in self.temperatures.readers},
        }
        return logs[kind]

    def take(self, one: Message, mixed_in: bool = False) -> None:
        """Take one message; what is mixed in takes turns of its own."""
        number = self._given.get((one.kind, mixed_in), 0)
        self._given[one.kind, mixed_in] = number + 1
        batch = _batch(one, number)
        if one.kind in self._takers:
            self._takers[one.kind](batch)
        else:
            self.pipeline.step(temperatures=self.temperatures.step([batch]))

    def finish(self) -> tuple[Any, ...]:
        """Finish the accounts, check every rejection log, and return all figures."""
        self.pipeline.step(self.joints.flush())
        self.pipeline.flush()
        last = self.power.flush()
        if last is not None:
            self.account.step(last)
        for kind in KINDS:
            log = self.rejections(kind)
            given = sum(self._given.get((kind, mixed), 0) for mixed in (False, True))
            assert log.balanced, (kind, log)
            assert log.received == given, (kind, log)
        accounts = (self.pipeline.account, self.account)
        for account in accounts:
            time = account.registers.time
            assert min(time.observed_ns, time.gap_ns) >= 0
        return (
            *(account.registers.microjoule.tolist() for account in accounts),
            *(repr(account.registers.time) for account in accounts),
            self.pipeline.account.comparison.microjoule.tolist(),
            self.pipeline.account.comparison.compared_ns,
            self.pipeline.friction.latest().viscous.tolist(),
            [change.from_ns for change in self.payload.changes],
            self.readings,
        )

    def _measure(self, batch: RawBatch) -> None:
        block = self.meters[batch.msgtype].step([batch])
        if block is not None and len(block):
            values = [block.stamp_ns.tolist(), block.power.tolist(), block.energy.tolist()]
            self.readings.append((batch.msgtype, repr(values)))
            if batch.msgtype == POWER_READING:
                self.pipeline.step(meter=block)

    def _take_torque(self, batch: RawBatch) -> None:
        torque = self.torque.decode(batch)
        power = None if torque is None else self.power.step(torque)
        if power is not None:
            self.account.step(power)

    def _take_friction(self, batch: RawBatch) -> None:
        friction = self.friction.decode(batch)
        if friction is not None:
            self.power.timeline.add(friction)


@functools.cache
def clean_figures() -> tuple[Any, ...]:
    """What the clean recording gives."""
    return mixed([])[0]


def mixed(extra: Sequence[tuple[int, Message]]) -> tuple[tuple[Any, ...], Monitors]:
    """Figures of the clean recording with more messages, each before that of a number."""
    monitors = Monitors()
    waiting = sorted(extra, key=lambda entry: entry[0])
    for number, one in enumerate(clean()):
        while waiting and waiting[0][0] <= number:
            monitors.take(waiting.pop(0)[1], mixed_in=True)
        monitors.take(one)
    for _, one in waiting:
        monitors.take(one, mixed_in=True)
    return monitors.finish(), monitors


def stamps(data: bytes) -> bool:
    """Any stamps: bytes are place, type, seconds, nanoseconds, time of receipt, over and over."""
    extra: list[tuple[int, Message]] = []
    while len(data) >= 18 and len(extra) < 20:
        place = max(data[0] * len(clean()) // 255, 1)  # after the names of the values
        kind = KINDS[data[1] % len(KINDS)]
        seconds = int.from_bytes(data[2:6], "little", signed=True)
        nanoseconds = int.from_bytes(data[6:10], "little")
        log_ns = int.from_bytes(data[10:18], "little", signed=True)
        extra.append((place, spoiled(kind, seconds, nanoseconds, log_ns)))
        data = data[18:]
    figures, monitors = mixed(extra)
    if all(is_bad(one) for _, one in extra):
        assert figures == clean_figures()
        for kind in {one.kind for _, one in extra}:
            count = sum(one.kind == kind for _, one in extra)
            assert monitors.rejections(kind).rejected["bad_stamp"] == count, kind
    return True


def stamps_seeds() -> list[bytes]:
    """Nothing added; and one of each type at the end of its range."""
    ends = [(2**31 - 1, 2**32 - 1, 2**63 - 1), (-(2**31), 0, -(2**63)), (0, SECOND, -1)]
    packed = [
        bytes([40 * index % 256, index])
        + seconds.to_bytes(4, "little", signed=True)
        + nanoseconds.to_bytes(4, "little")
        + log_ns.to_bytes(8, "little", signed=True)
        for index in range(len(KINDS))
        for seconds, nanoseconds, log_ns in ends
    ]
    return [b"", *(b"".join(packed[start::6]) for start in range(6))]
