"""A file of another kind is named, with the way to use it; the way is tried."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.convert.__main__ import main as convert
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from logbook import read_bag, wheel_bag, wheel_csv
from robot_energy.bag import BagReader
from robot_energy.foundation.errors import BagError, LogFormatError
from robot_energy.foundation.files.first_bytes import FIRST_BYTES, MAX_MAGIC, named
from robot_energy_logs.table import LogTable


def ros1_bag(path: Path) -> Path:
    """A bag of ROS 1, written by a library of its own."""
    store: Any = get_typestore(Stores.ROS1_NOETIC)
    kind = "sensor_msgs/msg/JointState"
    header, time = store.types["std_msgs/msg/Header"], store.types["builtin_interfaces/msg/Time"]
    with Writer(path) as bag:
        topic = bag.add_connection("/joint_states", kind, typestore=store)
        for number in range(50):
            stamp = 1_700_000_000 * 10**9 + number * 10_000_000
            state = store.types[kind](
                header=header(number, time(stamp // 10**9, stamp % 10**9), ""),
                name=["axle"],
                position=np.array([0.01 * number]),
                velocity=np.array([1.0]),
                effort=np.array([]),
            )
            bag.write(topic, stamp, store.serialize_ros1(state, kind))
    return path


@pytest.mark.parametrize("of_folder", [False, True])
def test_a_bag_of_ros_1_is_named_and_the_way_to_convert_it_works(
    tmp_path: Path, of_folder: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = ros1_bag(tmp_path / "old day.bag")
    with pytest.raises(BagError, match=r"old day.bag is a ROS 1 bag; expected") as caught:
        BagReader(tmp_path if of_folder else path)
    assert "b'" not in str(caught.value)
    program, *words = shlex.split(caught.value.remedy.split("`")[1])
    assert program == "rosbags-convert"
    monkeypatch.setattr("sys.argv", [program, *words])
    with pytest.raises(SystemExit) as done:
        convert()
    assert not done.value.code
    block, _, _ = read_bag(tmp_path / "old day", ("axle",))
    np.testing.assert_allclose(block.joint_position[:, 0], 0.01 * np.arange(50))


def test_a_log_named_as_a_bag_and_a_bag_named_as_a_log(tmp_path: Path) -> None:
    log = wheel_csv(tmp_path / "log.csv")
    with pytest.raises(BagError, match=r"is a text that begins with 't,q_axle.*import table"):
        BagReader(log)
    (bag,) = wheel_bag(tmp_path).glob("*.mcap")
    with pytest.raises(LogFormatError, match=r"is an MCAP file; expected a table.*robot-energy re"):
        LogTable(bag)


@pytest.mark.parametrize("magic", [magic for magic in FIRST_BYTES if magic != b"\x89MCAP0\r\n"])
def test_every_known_kind_is_named_as_no_bag(tmp_path: Path, magic: bytes) -> None:
    path = tmp_path / "x.any"
    path.write_bytes(magic + bytes(100))
    found, remedy = named(path, path.read_bytes()[:MAX_MAGIC])
    assert found.startswith(f"{path} is ")
    if magic.startswith(b"SQLite"):  # opened as such
        return
    with pytest.raises(BagError) as caught:
        BagReader(path)
    assert (caught.value.found, caught.value.remedy) == (found, remedy)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "x is empty"),
        (b"\x00\x01\xff", "begins with the bytes 00 01 ff"),
        ("\u4e00\u4e01\u4e02\u4e03\u4e04\u4e05".encode(), "begins with the bytes e4"),
    ],
)
def test_what_nobody_knows_is_shown_without_python(
    tmp_path: Path, content: bytes, words: str
) -> None:
    path = tmp_path / "x"
    path.write_bytes(content)
    with pytest.raises(BagError, match=words) as caught:
        BagReader(path)
    assert "b'" not in str(caught.value)
