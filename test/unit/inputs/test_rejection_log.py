"""What is kept of the names in messages is bounded, whatever the messages say."""

import subprocess
import sys

import numpy as np

from robot_energy.bag.cdr import Encoder, RawBatch, stamp_columns
from robot_energy.inputs import rejection_log as accounting
from robot_energy.inputs.joint_states import decode
from robot_energy.inputs.rejection_log import ByNames, RejectionLog, remember_names


def test_names_are_added_while_there_is_room():
    kept = {"a"}
    remember_names(kept, (f"n{index}" for index in range(1000)))
    assert len(kept) == accounting.MAX_NAMES
    kept = set()
    remember_names(kept, ["x" * 4_000_000, "\x1b[2J"])
    assert all(len(name) <= 200 and name.isprintable() for name in kept)


def test_lists_of_names_are_kept_within_count_and_characters(monkeypatch):
    known = ByNames[int]()
    for index in range(1000):
        assert known.put((f"n{index}",), index) == index
        assert len(known) <= accounting.MAX_NAMES
    assert known.get(("n999",)) == 999
    monkeypatch.setattr(accounting, "MAX_KEPT_CHARACTERS", 100)
    assert known.put(("x" * 1000,), 5) == 5
    assert known.get(("x" * 1000,)) is None
    lists = [(f"{index:030}",) for index in range(20)]
    for index, names in enumerate(lists):
        known.put(names, index)
        assert sum(len(names[0]) for names in lists if known.get(names) is not None) <= 100
    assert known.get(lists[-1]) == 19


def test_a_large_batch_is_decoded_in_pieces(monkeypatch):
    """What its names take in memory is given back in between."""
    encoder = Encoder(
        decode.JOINT_STATE, {"name": ("a", "b")}, {"position": 2, "velocity": 2, "effort": 0}
    )
    stamps = np.arange(1, 101) * 10**9
    values = {"position": np.ones((100, 2)), "velocity": np.ones((100, 2))}
    columns = {**stamp_columns(stamps), **values, "effort": np.empty((100, 0))}
    rows = [row.tobytes() for row in encoder.encode(columns, 100)]
    batch = RawBatch.from_messages("/j", decode.JOINT_STATE, stamps, rows)
    monkeypatch.setattr(decode, "MAX_DECODED_BYTES", 7 * len(rows[0]))
    log = RejectionLog()
    reader = decode.JointStateReader(("a", "b"), log)
    sizes = []
    whole = reader._decoder.decode
    monkeypatch.setattr(
        reader._decoder, "decode", lambda piece: sizes.append(len(piece)) or whole(piece)
    )
    readings = reader.read([batch])
    assert log.received == 100
    assert readings.stamp_ns.tolist() == stamps.tolist()
    assert sizes == [7] * 14 + [2]


MANY = """
import re, sys
import numpy as np
from robot_energy.inputs.joint_states.decode import JointStateReader
from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.bag.cdr import RawBatch
count, joints = int(sys.argv[1]), int(sys.argv[2])
stamp = bytes(4) + (1).to_bytes(4, "little")
head = b"\\x00\\x01\\x00\\x00" + stamp + (1).to_bytes(4, "little") + bytes(4)
name = (8).to_bytes(4, "little") + b"#%06d\\x00"
names = b"".join(name % j for j in range(joints))
body = head + joints.to_bytes(4, "little") + names + bytes(12)
def message(k):
    return body.replace(b"#", bytes([65 + k]))
def peak():  # of this process alone: ru_maxrss begins with that of the parent
    return int(re.search(r"VmHWM:\\s+(\\d+)", open("/proc/self/status").read())[1])
batch = RawBatch.from_messages("/j", "sensor_msgs/msg/JointState", np.arange(count),
                               [message(k) for k in range(count)])
before = peak()
log = RejectionLog()
assert JointStateReader(("a", "b"), log).read([batch]) is None
print((peak() - before) // 1024, log.rejected.total(), *log.rejected)
"""


def read_many(count, joints):
    """Read messages whose names all differ: memory it took [MiB], rejected, reasons."""
    done = subprocess.run(
        [sys.executable, "-c", MANY, str(count), str(joints)],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    memory, rejected, *reasons = done.stdout.split()
    return int(memory), int(rejected), reasons


def test_messages_of_very_many_joints_are_refused_without_the_memory():
    memory, rejected, reasons = read_many(40, 100_000)
    assert (rejected, reasons) == (40, ["malformed"])
    assert memory < 100
    memory, rejected, reasons = read_many(40, 1_000)
    assert (rejected, reasons) == (40, ["unknown_joint"])
    assert memory < 100
