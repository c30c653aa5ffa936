"""Messages of any type, one after another, as a running monitor takes them."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from target import JOINTS

import robots
from robot_energy.accounting.account import EnergyAccount
from robot_energy.bag.cdr import RawBatch, typestore
from robot_energy.inputs.joint_states.joint_states import JOINT_STATE, JointStateIngest
from robot_energy.inputs.meter.meter import MeterIngest
from robot_energy.inputs.meter.source import (
    BATTERY_STATE,
    FLOAT32,
    FLOAT64,
    POWER_READING,
    MeterSource,
)
from robot_energy.inputs.sources import TemperatureSource
from robot_energy.inputs.temperatures.kinds import (
    INTERFACE_NAMES,
    INTERFACE_VALUES,
    TEMPERATURE_KINDS,
)
from robot_energy.inputs.temperatures.temperatures import TemperatureIngest
from robot_energy.messages.friction import JOINT_FRICTION, FrictionReader
from robot_energy.messages.payload import PAYLOAD, PayloadReader
from robot_energy.messages.torque import JOINT_TORQUE, TorqueReader
from robot_energy.pipeline import EnergyPipeline

NAMED = {"key": "temperature", "value": "35.5 degC"}
KEYS = ["shoulder/temperature", "elbow/temperature"]
MESSAGES = (
    JOINT_STATE,
    POWER_READING,
    JOINT_TORQUE,
    JOINT_FRICTION,
    PAYLOAD,
    INTERFACE_NAMES,
    BATTERY_STATE,
    FLOAT32,
    FLOAT64,
    *TEMPERATURE_KINDS,
)
SOURCES = {
    kind: TemperatureSource(
        topic=f"/{index}",
        type=kind,
        joints=JOINTS[:1] if kind.endswith("/Temperature") else JOINTS,
        keys=("temperature",),
        names=JOINTS if kind.endswith("DiagnosticArray") else (),
        stamp_source="receive" if kind.endswith("MultiArray") else "header",
        names_topic="/names" if kind == INTERFACE_VALUES else "",
    )
    for index, kind in enumerate(TEMPERATURE_KINDS)
}
METERS = {
    POWER_READING: MeterSource(topic="/reading"),
    BATTERY_STATE: MeterSource(topic="/battery", type=BATTERY_STATE),
    FLOAT32: MeterSource(
        type=FLOAT32, unit="W", meaning="instantaneous", location="grid",
        voltage_topic="/volt", current_topic="/ampere",
    ),
    FLOAT64: MeterSource(topic="/counter", type=FLOAT64, unit="Wh", location="grid", wraps_at=100),
}  # fmt: skip
TOPIC_OF = {kind: source.topic for kind, source in SOURCES.items()} | {INTERFACE_NAMES: "/names"}


def pack(messages: list[tuple[str, bytes]]) -> bytes:
    """Messages as one string of bytes: type, two bytes of length, content."""
    return b"".join(
        bytes([MESSAGES.index(kind)]) + len(data).to_bytes(2, "little") + data
        for kind, data in messages
    )


def unpack(data: bytes) -> Iterator[tuple[str, bytes]]:
    """Messages out of any bytes."""
    while len(data) > 3:
        kind, size = MESSAGES[data[0] % len(MESSAGES)], int.from_bytes(data[1:3], "little")
        yield kind, data[3 : 3 + size]
        data = data[3 + size :]


def online(data: bytes) -> bool:
    """No message raises, each is counted once, and the counts add up."""
    given = dict.fromkeys(MESSAGES, 0)
    model = robots.two_link()
    pipeline = EnergyPipeline(model)
    joints = JointStateIngest(JOINTS)
    meters = {kind: MeterIngest(source) for kind, source in METERS.items()}
    accounts = {kind: EnergyAccount(2) for kind in METERS}
    accounts[POWER_READING] = pipeline.account

    def measure(batch: RawBatch) -> None:
        if batch.msgtype == FLOAT32:  # voltage and current in turn
            batch = replace(batch, topic=("/volt", "/ampere")[given[FLOAT32] % 2])
        readings = meters[batch.msgtype].step([batch])
        if readings is not None:
            accounts[batch.msgtype].measure(readings)

    temperatures = TemperatureIngest(JOINTS, {source.topic: source for source in SOURCES.values()})
    torque = TorqueReader(JOINTS, model.model_id)
    friction = FrictionReader(model)
    payload = PayloadReader(pipeline.torque.set_payload)
    readers: dict[str, tuple[Any, Callable[[RawBatch], Any]]] = {
        JOINT_STATE: (joints, lambda batch: pipeline.step(joints.step(batch))),
        **{kind: (meter, measure) for kind, meter in meters.items()},
        JOINT_TORQUE: (torque, torque.decode),
        JOINT_FRICTION: (friction, friction.decode),
        PAYLOAD: (payload, payload.step),
    }
    for kind, message in unpack(data):
        given[kind] += 1
        batch = RawBatch.from_messages(
            TOPIC_OF.get(kind, "/t"), kind, [10**9 * sum(given.values())], [message]
        )
        if kind in readers:
            readers[kind][1](batch)
        else:
            pipeline.step(temperatures=temperatures.step([batch]))
    pipeline.step(joints.flush())
    pipeline.flush()
    for kind, (reader, _) in readers.items():
        assert reader.rejections.received == given[kind], kind
        assert reader.rejections.balanced, (kind, reader.rejections)
    assert temperatures.rejections.balanced
    time = pipeline.account.registers.time
    assert min(time.observed_ns, time.gap_ns) >= 0
    assert (pipeline.account.registers.microjoule[:2] >= 0).all()
    rejections = [reader.rejections for reader, _ in readers.values()]
    return any(log.accepted for log in [*rejections, temperatures.rejections])


def example(kind: str, value: float = 1.0) -> bytes:
    """A valid message of a type: two of everything."""
    store = typestore()

    def field(description: Any, name: str) -> Any:
        node, detail = description
        if node == Nodetype.NAME:
            return record(detail)
        if node == Nodetype.BASE:
            if detail[0] == "string":
                named = {**NAMED, "model_id": robots.two_link().model_id}
                if kind == PAYLOAD:
                    named["frame_id"] = "fore"  # the link that carries it
                return named.get(name, JOINTS[0])
            product = name in ("ixy", "ixz", "iyz")  # of inertia
            return 0.0 if product else value if "float" in detail[0] else 1
        count = detail[1] if node == Nodetype.ARRAY else 2
        if detail[0][0] == Nodetype.NAME:
            return [record(detail[0][1])] * count
        base = detail[0][1][0]
        if base == "string":
            names = {"keys": KEYS, "interface_names": ["temperature", "position"]}
            return names.get(name, list(JOINTS))
        return np.full(count, value, dtype=base.replace("byte", "uint8"))

    def record(name: str) -> Any:
        return store.types[name](*(field(d, n) for n, d in store.fielddefs[name][1]))

    return bytes(store.serialize_cdr(record(kind), kind))


def online_seeds() -> list[bytes]:
    """One message of each type, and a second of joint states with a meter."""
    paired = (INTERFACE_NAMES, INTERFACE_VALUES)  # of use together only
    singles = [pack([(kind, example(kind))]) for kind in MESSAGES if kind not in paired]
    singles.append(pack([(kind, example(kind)) for kind in paired]))
    singles.append(pack([(kind, example(kind, 48.0)) for kind in [FLOAT32, FLOAT64] * 4]))
    joint_state = bytearray(example(JOINT_STATE))
    stream: list[tuple[str, bytes]] = []
    for index in range(12):
        joint_state[4:12] = np.array([1000, index * 10**7], dtype="<u4").tobytes()
        stream.append((JOINT_STATE, bytes(joint_state)))
    stream.insert(4, (POWER_READING, example(POWER_READING, 500.0)))
    stream.insert(6, (PAYLOAD, example(PAYLOAD, 0.1)))
    return [*singles, pack(stream)]
