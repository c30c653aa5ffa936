from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from logbook import table_rows, write_csv
from robot_energy.foundation.errors import LogFormatError
from robot_energy_logs.instants import Instants
from robot_energy_logs.mapping import Time
from robot_energy_logs.table import LogTable


def test_every_row_is_accounted_for_with_the_first_line_of_each_reason(tmp_path: Path) -> None:
    log = write_csv(
        tmp_path / "log.csv",
        "t,a,b",
        [
            "0,1,2",
            "0.1,oops,2",
            "0.2,1",
            "0.3,,2",
            "0.4,nan,2",
            "later,1,2",
            "",
            "0.5,3,",
            "0.6,1,inf",
            "0.7,4,5",
        ],
    )
    values, _, account = table_rows(log, ["a", "b"], last_ns=0)
    assert account.received == 9  # the blank line is not a row
    assert dict(account.rejected) == {
        "not_numeric": 1,
        "wrong_length": 1,
        "not_finite": 3,
        "bad_time": 1,
        "not_newer": 1,  # than 0 ns
    }
    assert account.first_line == {
        "not_newer": 2,
        "not_numeric": 3,
        "wrong_length": 4,
        "not_finite": 5,
        "bad_time": 7,
    }
    np.testing.assert_array_equal(values, [[3.0, np.nan], [4.0, 5.0]])
    assert account.balanced


def test_times_are_exact_to_the_last_digit_written(tmp_path: Path) -> None:
    log = write_csv(tmp_path / "log.csv", "t,a", ["1633435693.122408123,1", "1.7e9,2"])
    _, instants, _ = table_rows(log, ["a"])
    assert instants.tolist() == [1633435693122408123, 1_700_000_000_000_000_000]


def test_dates_of_a_text_have_their_zone() -> None:
    """2022-10-26 is day 19291 since 1970; the same instant in two zones, and without one UTC."""
    texts = ["2022-10-26T08:17:21.847Z", "2022-10-26T10:17:21.847+02:00", "2022-10-26 08:17:21.847"]
    day, seconds = 19_291 * 86_400, 8 * 3600 + 17 * 60 + 21
    found = Instants(Time(column="t"))(pl.Series([*texts, "08:17", ""]))
    assert found == [(day + seconds) * 10**9 + 847_000_000] * 3 + [None, None]


def test_rows_without_time_are_counted_at_a_rate(tmp_path: Path) -> None:
    log = write_csv(tmp_path / "log.csv", "a", ["1", "x", "3"])
    _, instants, _ = table_rows(log, ["a"], {"rate": 250.0}, delimiter=",")
    assert instants.tolist() == [0, 8_000_000]  # a bad row still takes its time


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " "])
def test_the_delimiter_is_said_from_the_header(tmp_path: Path, delimiter: str) -> None:
    log = tmp_path / "log.csv"
    log.write_text(f"\ufefft{delimiter}a\n1{delimiter}2\n", encoding="utf-8")
    assert LogTable(log).columns == ("t", "a")


def test_gzip_is_said_by_its_content(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_bytes(gzip.compress(b"t,a\n1,2\n"))
    assert table_rows(log, ["a"])[0].tolist() == [[2.0]]


def test_files_that_are_no_log_are_refused_in_one_sentence(tmp_path: Path) -> None:
    empty, binary, cut = tmp_path / "empty", tmp_path / "binary", tmp_path / "cut.csv.gz"
    empty.write_text("\n")
    binary.write_bytes(b"t,a\n\xff\xfe\x00,2\n")
    whole = gzip.compress(b"t,a\n" + b"".join(b"%d,%d\n" % (i, i * 7919) for i in range(9999)))
    cut.write_bytes(whole[: len(whole) // 2])
    for path, text in (
        (empty, "is empty"),
        (tmp_path / "none.csv", "cannot be read"),
    ):
        with pytest.raises(LogFormatError, match=text):
            LogTable(path)
    with pytest.raises(LogFormatError, match="UTF-8"):
        list(LogTable(binary).rows(["a"]))
    with pytest.raises(LogFormatError, match="cannot be read after line"):
        list(LogTable(cut).rows(["a"]))


def test_a_missing_column_is_named_next_to_near_ones(tmp_path: Path) -> None:
    table = LogTable(write_csv(tmp_path / "log.csv", "t,position_a1,position_a2,x,x", ["1"]))
    with pytest.raises(LogFormatError, match=r"'position_a3' that joints.position names.*_a2"):
        table.require("position_a3", "joints.position")
    with pytest.raises(LogFormatError, match="2 times"):
        table.require("x")


def test_runs_that_count_from_zero_are_set_one_after_the_other(tmp_path: Path) -> None:
    log = write_csv(
        tmp_path / "log.csv", "name,t,a", ["x,0,1", "x,0.5,2", "y,0,3", "y,0.5,4", "x,0.1,5"]
    )
    values, instants, _ = table_rows(log, ["a"], {"column": "t", "run": "name", "apart": 10.0})
    expected = np.array([0.0, 0.5, 10.5, 11.0, 21.0])
    np.testing.assert_array_equal(instants, np.rint(expected * 1e9))
    assert values[:, 0].tolist() == [1, 2, 3, 4, 5]


def test_spaces_in_names_of_columns_are_no_delimiters(tmp_path: Path) -> None:
    log = write_csv(tmp_path / "log.csv", "Speed (1 / min),Torque of it (N m)", ["1,2"])
    assert LogTable(log).columns == ("Speed (1 / min)", "Torque of it (N m)")


def test_decimal_commas_are_read_where_they_are_stated(tmp_path: Path) -> None:
    log = write_csv(tmp_path / "log.csv", "0,5;1,25;-2,5e-1", ["0,6;1;3,0", "0,7;1.5;1"])
    names = ["t", "a", "b"]
    values, instants, _ = table_rows(log, ["a", "b"], column_names=names, decimal=",")
    assert values.tolist() == [[1.25, -0.25], [1.0, 3.0], [1.5, 1.0]]
    assert instants.tolist() == [500_000_000, 600_000_000, 700_000_000]
    _, _, account = table_rows(log, ["a", "b"], column_names=names, delimiter=";")
    assert account.rejected["not_numeric"] == 2  # never guessed
