"""Serialized ROS 2 messages (CDR) to numpy columns and back, without ROS."""

from robot_energy.bag.cdr.decode import Decoder, RawBatch, Run, stamp_ns
from robot_energy.bag.cdr.encode import Encoder, stamp_columns
from robot_energy.bag.cdr.types import typestore

__all__ = ["Decoder", "Encoder", "RawBatch", "Run", "stamp_columns", "stamp_ns", "typestore"]
