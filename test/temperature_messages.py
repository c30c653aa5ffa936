"""Messages of every type that says motor temperatures, as bytes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from robot_energy.bag.cdr.decode import RawBatch
from robot_energy.bag.cdr.encode import Encoder, stamp_columns
from robot_energy.bag.cdr.types import typestore
from robot_energy.inputs.temperatures.kinds import (
    DIAGNOSTICS,
    DYNAMIC_JOINT_STATE,
    FLOAT_ARRAY,
    INTERFACE_NAMES,
    INTERFACE_VALUES,
    MOTOR_TEMPERATURES,
    TEMPERATURE,
)

Values = Sequence[float] | np.ndarray


def header(stamp_ns: int, frame: str = "") -> Any:
    types = typestore().types
    stamp = types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def serialise(msgtype: str, **fields: Any) -> bytes:
    store = typestore()
    return bytes(store.serialize_cdr(store.types[msgtype](**fields), msgtype))


@cache
def _encoder(names: tuple[str, ...]) -> Encoder:
    return Encoder(MOTOR_TEMPERATURES, {"joint_names": names}, {"temperature_degc": len(names)})


def motor_temperatures(stamp_ns: int, values: Values, names: Sequence[str]) -> bytes:
    encoder = _encoder(tuple(names))
    stamp = stamp_columns(np.array([stamp_ns]))
    return encoder.encode({**stamp, "temperature_degc": np.array([values])}, 1)[0].tobytes()


def temperature(stamp_ns: int, value: float, frame: str) -> bytes:
    return serialise(TEMPERATURE, header=header(stamp_ns, frame), temperature=value, variance=0.0)


def float_array(values: Values) -> bytes:
    layout = typestore().types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    return serialise(FLOAT_ARRAY, layout=layout, data=np.asarray(values, dtype=float))


def dynamic_joint_state(
    stamp_ns: int, joints: Sequence[str], interfaces: Sequence[dict[str, float]]
) -> bytes:
    values = [
        typestore().types["control_msgs/msg/InterfaceValue"](
            interface_names=list(entry), values=np.array(list(entry.values()), dtype=float)
        )
        for entry in interfaces
    ]
    return serialise(
        DYNAMIC_JOINT_STATE,
        header=header(stamp_ns),
        joint_names=list(joints),
        interface_values=values,
    )


def interface_names(stamp_ns: int, keys: Sequence[str]) -> bytes:
    return serialise(INTERFACE_NAMES, header=header(stamp_ns), keys=list(keys))


def interface_values(stamp_ns: int, values: Values) -> bytes:
    return serialise(
        INTERFACE_VALUES, header=header(stamp_ns), values=np.asarray(values, dtype=float)
    )


def diagnostics(stamp_ns: int, statuses: dict[str, dict[str, str]]) -> bytes:
    types = typestore().types
    return serialise(
        DIAGNOSTICS,
        header=header(stamp_ns),
        status=[
            types["diagnostic_msgs/msg/DiagnosticStatus"](
                level=0,
                name=name,
                message="",
                hardware_id="",
                values=[
                    types["diagnostic_msgs/msg/KeyValue"](key=key, value=value)
                    for key, value in values.items()
                ],
            )
            for name, values in statuses.items()
        ],
    )


def batch(topic: str, msgtype: str, messages: Sequence[bytes], log_ns: Sequence[int]) -> RawBatch:
    return RawBatch.from_messages(topic, msgtype, list(log_ns), list(messages))
