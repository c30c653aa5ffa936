"""Kinds of a user, and a recording of the robot that has them."""

import numpy as np
import pytest

from robot_energy.bag import BagWriter
from robot_energy.bag.cdr.types import typestore
from robot_energy.foundation import kinds
from toy_kinds import INT32, RATE, SECOND, SPAN, TENTHS, TOYS, forget

STORE = typestore()


@pytest.fixture
def toys(monkeypatch):
    """The kinds of both files, until the end of the test."""
    monkeypatch.setenv(kinds.VARIABLE, TOYS)
    kinds.load_kinds()
    yield
    forget()


@pytest.fixture
def bag(tmp_path):
    """The wheel turns at 1 rad/s; a meter reads 60 W in milliwatts."""
    folder = tmp_path / "bag"
    time, header = STORE.types["builtin_interfaces/msg/Time"], STORE.types["std_msgs/msg/Header"]
    layout, tenths = STORE.types["std_msgs/msg/MultiArrayLayout"], STORE.types[TENTHS]
    state, number = STORE.types["sensor_msgs/msg/JointState"], STORE.types[INT32]
    with BagWriter(folder) as out:
        out.add_topic("/joint_states", "sensor_msgs/msg/JointState")
        out.add_topic("/milliwatts", INT32)
        out.add_topic("/tenths", TENTHS)
        for row in range(SPAN * RATE + 1):
            stamp = 1_700_000_000 * SECOND + row * SECOND // RATE
            head = header(time(*divmod(stamp, SECOND)), "")
            position, none = np.array([row / RATE]), np.array([])
            message = state(head, ["axle"], position, np.array([1.0]), none)
            raw = bytes(STORE.serialize_cdr(message, "sensor_msgs/msg/JointState"))
            out.write("/joint_states", np.array([stamp]), [raw])
            raw = bytes(STORE.serialize_cdr(number(60_000), INT32))
            out.write("/milliwatts", np.array([stamp]), [raw])
            if row % 10 == 0:
                raw = layout([], 0)
                raw = bytes(STORE.serialize_cdr(tenths(raw, np.array([400], np.int32)), TENTHS))
                out.write("/tenths", np.array([stamp]), [raw])
    return folder
