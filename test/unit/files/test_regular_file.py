"""What others name is read only if it is a regular file of bounded size: no wait, no end."""

import gzip
import os
from pathlib import Path

import pytest

import robots
from refusals import refused
from robot_energy.bag import BagReader
from robot_energy.foundation.errors import (
    BagError,
    LogFormatError,
    ModelFileError,
    RobotEnergyError,
)
from robot_energy.foundation.files.regular_file import open_regular, read_regular, read_regular_text
from robot_energy.inputs.inputs_file import read_inputs
from robot_energy.model import load, validate
from robot_energy_cli.result_schema import read_result
from robot_energy_logs import table, text_table
from robot_energy_logs.mapping import load_mapping
from robot_energy_logs.table import LogTable
from robot_energy_plan.motion.gcode import load_gcode
from robot_energy_plan.motion.joint_trajectory import read_csv_trajectory
from robot_energy_plan.motion.ptp_file import read_program

READERS = {
    "model": (load, ".yaml"),
    "inputs": (read_inputs, ".yaml"),
    "mapping": (load_mapping, ".yaml"),
    "moves": (read_program, ".yaml"),
    "gcode": (load_gcode, ".gcode"),
    "trajectory": (read_csv_trajectory, ".csv"),
    "table": (LogTable, ".csv"),
    "mcap": (BagReader, ".mcap"),
    "sqlite": (BagReader, ".db3"),
    "packed": (BagReader, ".zstd"),
    "result": (read_result, ".json"),
}


def pipe(path):
    os.mkfifo(path)


def endless(path):
    path.symlink_to("/dev/zero")


def folder(path):
    path.mkdir()


def loop(path):
    path.symlink_to(path)


@pytest.mark.parametrize("kind", [pipe, endless, folder, loop])
def test_only_a_regular_file_is_opened(tmp_path, kind):
    path = tmp_path / "odd"
    kind(path)
    for read in (open_regular, lambda p: read_regular(p, 10), lambda p: read_regular_text(p, 10)):
        with pytest.raises(OSError, match=r"\w"):
            read(path)


def test_a_name_with_nul_and_a_file_too_large_are_refused(tmp_path):
    with pytest.raises(OSError, match="NUL"):
        read_regular(Path("a\0b"), 10)
    (tmp_path / "a").write_bytes(b"12345678901")
    with pytest.raises(OSError, match="larger than 10"):
        read_regular(tmp_path / "a", 10)
    with pytest.raises(OSError, match="larger than 10"):
        read_regular("/proc/self/status", 10)  # a regular file that says it is empty
    (tmp_path / "a").write_bytes(b"a\r\nb")
    (tmp_path / "link").symlink_to("a")
    assert read_regular(tmp_path / "link", 4) == b"a\r\nb"
    assert read_regular_text(tmp_path / "link", 4) == "a\nb"


@pytest.mark.parametrize("kind", [pipe, endless])
@pytest.mark.parametrize("name", READERS)
def test_no_reader_waits_for_a_pipe_or_reads_a_device(tmp_path, name, kind):
    read, suffix = READERS[name]
    path = tmp_path / f"odd{suffix}"
    kind(path)
    with pytest.raises(RobotEnergyError):
        read(path)


@pytest.mark.parametrize("kind", [pipe, endless])
def test_the_metadata_of_a_bag_may_be_no_pipe(tmp_path, kind):
    kind(tmp_path / "metadata.yaml")
    with pytest.raises(BagError):
        BagReader(tmp_path)


@pytest.mark.parametrize("path", ["a\0b.urdf", "pipe", "zero", ".", "missing"])
def test_a_urdf_that_is_no_file_is_refused_by_its_key(tmp_path, path):
    pipe(tmp_path / "pipe")
    endless(tmp_path / "zero")
    data = {**robots.two_link_data(), "urdf": {"path": path}}
    with pytest.raises(ModelFileError, match="urdf"):
        validate(data, str(tmp_path / "model.yaml"))


def test_a_packed_log_is_unpacked_within_bounds(tmp_path, monkeypatch):
    """A log of a kilobyte that would fill the memory is refused; an honest one is read."""
    monkeypatch.setattr(text_table, "MIN_UNPACKED", 2**16)
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(b"a,b\n" + b"0,0\n" * 2**22))
    with refused(LogFormatError, found=("1048578", "200 times")):
        list(LogTable(path).rows(["a"]))
    path.write_bytes(gzip.compress(b"a,b\n" + b"1,2\n" * 1000))
    (read,) = LogTable(path).rows(["b", "a"])
    assert read.values.tolist() == [[2.0, 1.0]] * 1000


def test_numbers_of_a_log_are_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(table, "MAX_NUMBERS", 20)
    path = tmp_path / "log.csv"
    path.write_text("a,b\n" + "1,2\n" * 10)
    (read,) = LogTable(path).rows(["a", "b"], kept=True)
    assert read.values.shape == (10, 2)
    path.write_text("a,b\n" + "1,2\n" * 11)
    with refused(LogFormatError, found="10 rows of 2 columns", expected="20"):
        list(LogTable(path).rows(["a", "b"], kept=True))
    (read,) = LogTable(path).rows(["a", "b"])  # block by block there is no bound
    assert read.values.shape == (11, 2)
