"""Serialized ROS 2 messages (CDR) to numpy columns and back, without ROS."""

from robot_energy.wire.batch import RawBatch
from robot_energy.wire.encode import Encoder, stamp_columns
from robot_energy.wire.layout import Decoded, Decoder, Run, stamp_ns
from robot_energy.wire.types import typestore

__all__ = [
    "Decoded",
    "Decoder",
    "Encoder",
    "RawBatch",
    "Run",
    "stamp_columns",
    "stamp_ns",
    "typestore",
]
