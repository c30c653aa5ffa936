"""Logs that are packed badly or to fill the memory."""

import contextlib
import gzip
import resource

import pytest

from robot_energy.foundation.errors import LogFormatError
from robot_energy_logs.table import LogTable


def test_a_damaged_gzip_is_refused(tmp_path):
    path = tmp_path / "log.csv.gz"
    data = bytearray(gzip.compress(b"t,q\n" + b"0.1,0.2\n" * 1000))
    for place in range(len(data)):
        damaged = data.copy()
        damaged[place] ^= 0x55
        path.write_bytes(damaged)
        with contextlib.suppress(LogFormatError):
            table = LogTable(path)
            for _ in table.rows(table.columns):
                pass


@pytest.mark.parametrize("head", [b"", b"t,q\n"])
def test_a_line_that_fills_the_memory_is_refused(tmp_path, head):
    """200 kB of gzip that hold one line of 200 MB."""
    path = tmp_path / "log.csv.gz"
    with gzip.open(path, "wb") as file:
        file.write(head)
        for _ in range(200):
            file.write(b"x" * 2**20)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(LogFormatError, match="over 1048576 characters"):
        list(LogTable(path).rows(["t"]))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50 * 1024
