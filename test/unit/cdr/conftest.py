"""Messages serialized by rosbags: the other way to the same bytes."""

import numpy as np
import pytest

from robot_energy.bag.cdr import RawBatch, typestore

JOINT_STATE = "sensor_msgs/msg/JointState"


class Messages:
    """Makes serialized messages with rosbags."""

    def __init__(self):
        self.store = typestore()

    def make(self, msgtype, *values):
        return self.store.types[msgtype](*values)

    def header(self, stamp_ns=0, frame="base"):
        stamp = self.make("builtin_interfaces/msg/Time", stamp_ns // 10**9, stamp_ns % 10**9)
        return self.make("std_msgs/msg/Header", stamp, frame)

    def serialize(self, message, little_endian=True):
        data = self.store.serialize_cdr(message, message.__msgtype__, little_endian=little_endian)
        return bytes(data)

    def joint_state(
        self, i, names=("a", "bb", "ccc"), frame="base", little_endian=True, sizes=None
    ):
        n = len(names)
        sizes = (n, n, n) if sizes is None else sizes
        arrays = [np.arange(size, dtype=float) + 100 * i + 10 * k for k, size in enumerate(sizes)]
        message = self.make(JOINT_STATE, self.header(i * 10**6, frame), list(names), *arrays)
        return self.serialize(message, little_endian)

    @staticmethod
    def batch(rows, msgtype=JOINT_STATE):
        return RawBatch.from_messages("/t", msgtype, range(len(rows)), rows)


@pytest.fixture
def messages():
    return Messages()
