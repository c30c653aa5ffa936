"""Serialised joint states, and a recording of them as an ingest meets it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from robot_energy.bag.cdr.decode import Encoder, RawBatch, stamp_columns
from robot_energy.inputs.joint_states.joint_states import JointStateIngest
from robot_energy.physics.urdf.checks import JointLimits
from robot_energy.timeline.blocks import JointBlock

NAMES = ("a", "b")
SECOND = 10**9
JOINT_STATE = "sensor_msgs/msg/JointState"


def message(
    stamp_s: float,
    names: Sequence[str] = NAMES,
    position: Sequence[float] = (1.0, 2.0),
    velocity: Sequence[float] = (3.0, 4.0),
    effort: Sequence[float] = (),
) -> bytes:
    """One serialised JointState."""
    arrays = {"position": position, "velocity": velocity, "effort": effort}
    encoder = _encoder(tuple(names), *map(len, arrays.values()))
    columns = stamp_columns(np.array([round(stamp_s * SECOND)])) | {
        key: np.asarray(array, dtype=float).reshape(1, -1) for key, array in arrays.items()
    }
    return encoder.encode(columns, 1)[0].tobytes()


@cache
def _encoder(names: tuple[str, ...], position: int, velocity: int, effort: int) -> Encoder:
    lengths = {"position": position, "velocity": velocity, "effort": effort}
    return Encoder(JOINT_STATE, {"name": names}, lengths)


def batch(
    messages: Sequence[bytes], topic: str = "/joint_states", received: Sequence[int] | None = None
) -> RawBatch:
    """Messages of one topic; received one after the other unless said otherwise."""
    times = np.arange(len(messages)) if received is None else np.asarray(received)
    return RawBatch.from_messages(topic, JOINT_STATE, times.astype(np.int64), messages)


def take(ingest: JointStateIngest, messages: Sequence[bytes], flush: bool = True) -> Any:
    """Run messages through an ingest, to the end."""
    blocks = [ingest.step(batch(messages))]
    assert ingest.rejections.balanced
    if flush:
        blocks.append(ingest.flush())
        assert ingest.rejections.balanced
        assert ingest.rejections.waiting == 0
    found = [block for block in blocks if block is not None]
    return JointBlock.concatenate(found) if found else None


def limits(
    names: Sequence[str] = NAMES,
    lower: float = -3.0,
    upper: float = 3.0,
    velocity: float = 4.0,
    prismatic: bool = False,
    wraps: bool = False,
) -> JointLimits:
    """The same limits for every joint."""
    size = len(names)
    return JointLimits(
        joint_names=tuple(names),
        lower=np.full(size, -np.inf if wraps else lower),
        upper=np.full(size, np.inf if wraps else upper),
        velocity=np.full(size, velocity),
        effort=np.full(size, np.inf),
        prismatic=np.full(size, prismatic),
        wraps=np.full(size, wraps),
    )
