"""Bag files that are packed as a whole: bounded, with room left, and gone afterwards."""

import gc
import os
import signal
import subprocess
import sys
import tempfile
from types import SimpleNamespace

import numpy as np
import pytest
import zstandard
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from refusals import refused
from robot_energy.bag import BagReader, packed
from robot_energy.bag.cdr import typestore
from robot_energy.foundation.errors import BagError
from robot_energy.foundation.files.temporary_folder import PREFIX, TemporaryFolder


@pytest.fixture
def bag(tmp_path, bags):
    """A bag whose one file is packed."""
    writer = Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3)
    writer.set_compression(CompressionMode.FILE, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/heat", bags.TEMPERATURE, typestore=typestore())
        for stamp, row in enumerate(bags.temperature_rows(np.arange(100))):
            writer.write(connection, stamp, row.tobytes())
    return tmp_path / "bag"


@pytest.fixture
def place(tmp_path, monkeypatch):
    """The temporary folder of the system."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    monkeypatch.setenv("TMPDIR", str(folder))
    return folder


def test_the_unpacked_file_goes_with_its_reader(bag, place):
    reader = BagReader(bag)
    assert reader.message_count == 100
    assert len(os.listdir(place)) == 1
    del reader
    gc.collect()
    assert os.listdir(place) == []


@pytest.fixture
def unwritten(monkeypatch):
    """Fails where a file is begun before it is known how large it becomes."""

    opened = packed.Path.open

    def unless_written(path, mode="r", *rest, **named):
        assert "x" not in mode, "something is written"
        return opened(path, mode, *rest, **named)

    monkeypatch.setattr(packed.Path, "open", unless_written)


def test_no_file_becomes_larger_than_the_bound(bag, place, unwritten, monkeypatch):
    monkeypatch.setattr(packed, "MAX_UNPACKED_BYTES", 10_000)
    with refused(BagError, found="10000", expected=str(packed.MAX_RATIO), remedy="zstd -d"):
        BagReader(bag)
    assert os.listdir(place) == []


def test_what_is_no_bag_file_is_not_unpacked(bag, place, unwritten):
    (file,) = bag.glob("*.zstd")
    file.write_bytes(zstandard.compress(bytes(10_000)))
    with refused(BagError, found=("unpacked", "00 00"), expected="MCAP"):
        BagReader(bag)
    assert os.listdir(place) == []


def test_the_room_for_all_of_it_is_there_before_it_is_written(bag, place, unwritten, monkeypatch):
    reserve = packed.MIN_FREE_BYTES // 4096

    def statvfs(_):  # room for some of the 12 kB or more, not for all
        return SimpleNamespace(f_blocks=2**30, f_frsize=4096, f_bavail=reserve + 2)

    monkeypatch.setattr(packed.os, "statvfs", statvfs)
    with refused(BagError, remedy="TMPDIR"):
        BagReader(bag)
    assert os.listdir(place) == []


def test_a_file_that_grows_meanwhile_is_refused(bag, place, monkeypatch):
    monkeypatch.setattr(packed, "_unpacked_bytes", lambda *_: 100)
    with refused(BagError, found="changed"):
        BagReader(bag)
    assert os.listdir(place) == []


def test_some_of_the_disk_is_left_free(bag, place, monkeypatch):
    def statvfs(_):
        return SimpleNamespace(f_blocks=2**30, f_frsize=4096, f_bavail=2**18 + 1)

    monkeypatch.setattr(packed.os, "statvfs", statvfs)
    with refused(BagError, remedy="TMPDIR"):
        BagReader(bag)
    assert os.listdir(place) == []


def test_a_full_disk_is_said_and_leaves_nothing(bag, place, monkeypatch):
    def full(*_args, **_options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(tempfile, "mkdtemp", full)
    with pytest.raises(BagError, match="No space left"):
        BagReader(bag)


def test_what_a_killed_run_left_goes_and_what_a_running_one_has_stays(bag, place):
    code = (
        "import sys; from robot_energy.bag import BagReader\n"
        "reader = BagReader(sys.argv[1]); print('ready', flush=True); sys.stdin.read()\n"
    )
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", code, str(bag)], **pipes) as running:
        assert running.stdout.readline() == b"ready\n"
        with TemporaryFolder():
            assert len(os.listdir(place)) == 2
        running.send_signal(signal.SIGKILL)
        running.wait()
    (place / f"{PREFIX}foreign").write_text("a file is none of ours")
    assert len(os.listdir(place)) == 2
    with TemporaryFolder() as mine:
        assert set(os.listdir(place)) == {mine.path.name, f"{PREFIX}foreign"}
