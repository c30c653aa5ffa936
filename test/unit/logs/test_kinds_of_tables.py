"""The same log as CSV, gzip, Parquet, in several files or without a header: the same bag."""

import gzip
import subprocess
from datetime import UTC, date, datetime, timedelta
from datetime import time as time_of_day

import numpy as np
import polars as pl
import pytest

from logbook import WHEEL_MAPPING, mapping, read_bag, table_rows, wheel_csv, write_csv
from robot_energy.foundation.errors import LogFormatError
from robot_energy_cli import main
from robot_energy_logs.log_import import import_log
from robot_energy_logs.table import LogTable

START_NS = 1714979289_000_000_000  # of the mapping


def gz(folder, text):
    (folder / "log").write_bytes(gzip.compress(text.encode()))
    return [folder / "log"]


def parquet(folder, text):
    pl.read_csv(text.encode()).write_parquet(folder / "log")
    return [folder / "log"]


def parts(folder, text):
    """Two files that overlap by a row, the later one named first."""
    header, *rows = text.splitlines()
    (folder / "a.csv").write_text("\n".join([header, *rows[500:]]))
    (folder / "b.csv").write_text("\n".join([header, *rows[:501]]))
    return [folder / "a.csv", folder / "b.csv"]


def headerless(folder, text):
    (folder / "log").write_text(text.partition("\n")[2])
    return [folder / "log"]


def own_files(folder, text):
    """Positions and all else in files side by side."""
    table = pl.read_csv(text.encode())
    table.select("t", "q_axle", "p").write_csv(folder / "position.csv", separator=";")
    table.select("w_axle").write_parquet(folder / "velocity")
    return [folder]


JOINTS = WHEEL_MAPPING["joints"]
SIDE_BY_SIDE = {
    **JOINTS,
    "position": {**JOINTS["position"], "file": "position.csv"},
    "velocity": {**JOINTS["velocity"], "file": "velocity"},
}


@pytest.mark.parametrize(
    ("store", "changes"),
    [
        (gz, {}),
        (parquet, {}),
        (parts, {}),
        (headerless, {"column_names": ["t", "q_axle", "w_axle", "p"]}),
        (own_files, {"joints": SIDE_BY_SIDE}),
    ],
)
def test_every_table_gives_the_same_bag(tmp_path, store, changes):
    log = wheel_csv(tmp_path / "wheel.csv")
    expected = import_log(log, mapping(), tmp_path / "expected")
    folder = tmp_path / "stored"
    folder.mkdir()
    report = import_log(store(folder, log.read_text()), mapping(**changes), tmp_path / "bag")
    assert report.joint_states == expected.joint_states == 1001
    bags = [read_bag(tmp_path / name, ["axle"]) for name in ("bag", "expected")]
    for found, known in zip(*bags, strict=True):
        if known is not None:
            for name, values in known.__dict__.items():
                np.testing.assert_array_equal(getattr(found, name), values)
    assert all(account.balanced for account in report.files)
    assert sum(account.rejected["not_newer"] for account in report.files) == (store is parts)


def test_the_command_imports_several_tables(tmp_path, capsys):
    import yaml

    files = parts(tmp_path, wheel_csv(tmp_path / "wheel.csv").read_text())
    (tmp_path / "wheel.yaml").write_text(yaml.safe_dump(WHEEL_MAPPING))
    for kind in ("table", "csv"):
        words = ["--mapping", str(tmp_path / "wheel.yaml"), "--out", str(tmp_path / kind)]
        assert main(["import", kind, *map(str, files), *words]) == 0
        said = capsys.readouterr().out
        assert "1001" in said
        assert "1 not newer (first at line 2, where t is '5.000000')" in said


def test_files_that_each_count_from_zero_follow_each_other(tmp_path):
    """Rows at a rate, or with a column of runs: each file is a run of its own."""
    for name in ("one", "two"):
        write_csv(tmp_path / name, "t,run,q_axle", ["0,7,1", "0.5,7,2"])
    joints = {"names": ["axle"], "position": {"column": "q_{joint}", "unit": "rad"}}
    for number, time in enumerate(({"rate": 2.0}, {"column": "t", "run": "run"})):
        spec = mapping(time={**time, "start": "2024-05-06T07:08:09Z"}, joints=joints, power=None)
        files = [tmp_path / "one", tmp_path / "two"]
        report = import_log(files, spec, tmp_path / f"bag{number}")
        assert report.joint_states == 4
        assert (report.start_ns, report.end_ns) == (START_NS, START_NS + 11 * 10**9)


@pytest.fixture
def unpacked_here(monkeypatch):
    """Parquet files that are sound are unpacked by this process, which takes no start."""

    def run(command, **_):
        path, out, _ = command[-3:]
        pl.scan_parquet(path, glob=False).sink_ipc(out, compression="uncompressed")
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr("robot_energy_logs.table.subprocess.run", run)


@pytest.mark.usefixtures("unpacked_here")
def test_stamps_of_parquet_are_exact(tmp_path):
    stamps = [1633435693122408123, 1633435693122408124]
    path = tmp_path / "log.parquet"
    for column, unit, expected in (
        (pl.Series(stamps), "ns", stamps),
        (pl.Series(stamps).cast(pl.Datetime("ns", "UTC")), "s", stamps),
        (pl.Series([datetime(2021, 10, 5, tzinfo=UTC)] * 2), "s", [1633392000 * 10**9] * 2),
        (pl.Series([0.1, 1633435693.25]), "s", [100_000_000, 1633435693_250_000_000]),
        (pl.Series(["1.5", " 2"]), "ms", [1_500_000, 2_000_000]),
        (pl.Series([0, 1]).cast(pl.Duration("ms")), "s", [0, 1_000_000]),
    ):
        pl.DataFrame({"t": column, "a": [1.0, 2.0]}).write_parquet(path)
        _, found, account = table_rows(path, ["a"], {"column": "t", "unit": unit})
        assert found.tolist() == sorted(set(expected))
        assert account.received == 2


@pytest.mark.usefixtures("unpacked_here")
def test_cells_of_parquet_are_numbers_text_or_nothing(tmp_path):
    path = tmp_path / "log.parquet"
    table = {
        "t": [0.0, 1.0, None, 3.0, 4.0],
        "a": [1, None, 3, 4, 2**53],
        "b": ["1e-3", "x", "2", "", " 7 "],
        "c": [[1], [2], [3], [4], [5]],
    }
    pl.DataFrame(table).write_parquet(path)
    values, _, account = table_rows(path, ["a", "b"])
    np.testing.assert_array_equal(values, [[1, 1e-3], [4, np.nan], [2**53, 7]])
    assert dict(account.rejected) == {"not_numeric": 1, "bad_time": 1}
    assert account.first_line == {"not_numeric": 2, "bad_time": 3}  # rows from 1 on
    with pytest.raises(LogFormatError, match=r"'c'.*holds List\(Int64\); expected numbers"):
        table_rows(path, ["c"])


@pytest.mark.usefixtures("unpacked_here")
def test_categories_of_parquet_are_their_text(tmp_path):
    """Of times, positions and readings; the bag is that of the numbers."""
    path = tmp_path / "log.parquet"
    plain = pl.read_csv(wheel_csv(tmp_path / "wheel.csv", seconds=0.2).read_bytes())
    text = plain.cast(pl.String)
    kinds = [text.cast(pl.Categorical)]
    kinds.append(
        text.select(pl.col(name).cast(pl.Enum(text[name].unique())) for name in text.columns)
    )
    kinds.append(plain.cast(pl.Decimal(20, 9)))
    import_log(tmp_path / "wheel.csv", mapping(), tmp_path / "expected")
    expected = read_bag(tmp_path / "expected", ["axle"])
    for table in kinds:
        table.write_parquet(path)
        report = import_log(path, mapping(), tmp_path / "bag", overwrite=True)
        assert report.files[0].accepted == len(plain)
        found = read_bag(tmp_path / "bag", ["axle"])
        np.testing.assert_array_equal(found[0].stamp_ns, expected[0].stamp_ns)
        np.testing.assert_array_equal(found[0].joint_position, expected[0].joint_position)
        np.testing.assert_array_equal(found[2].power, expected[2].power)


@pytest.mark.parametrize(
    ("values", "as_time"),
    [
        ([True, False], False),
        ([timedelta(seconds=1), timedelta(seconds=2)], True),
        ([datetime(2026, 7, 1, tzinfo=UTC), datetime(2026, 7, 2, tzinfo=UTC)], True),
        ([date(2026, 7, 1), date(2026, 7, 2)], False),
        ([time_of_day(1), time_of_day(2)], False),
        ([b"1", b"2"], False),
        ([[1.0], [2.0]], False),
        ([{"a": 1.0}, {"a": 2.0}], False),
    ],
)
@pytest.mark.usefixtures("unpacked_here")
def test_what_is_no_number_never_passes_as_one(tmp_path, values, as_time):
    path = tmp_path / "log.parquet"
    pl.DataFrame({"t": [1.0, 2.0], "a": values}).write_parquet(path)
    with pytest.raises(LogFormatError, match=r"'a' of .* holds \w+.*expected numbers, or text"):
        table_rows(path, ["a"])
    pl.DataFrame({"t": values, "a": [1.0, 2.0]}).write_parquet(path)
    if as_time:
        assert table_rows(path, ["a"])[2].accepted == 2
    else:
        with pytest.raises(LogFormatError, match=r"'t' of .* holds \w+.*dates with time"):
            table_rows(path, ["a"])


@pytest.mark.usefixtures("unpacked_here")
def test_dates_beyond_all_stamps_are_no_times(tmp_path):
    """In nanoseconds they would wrap around 64 bits, to a date that looks sound."""
    path = tmp_path / "log.parquet"
    for kind in (pl.Datetime("ms"), pl.Datetime("us", "UTC"), pl.Duration("ms")):
        beyond = pl.Series([2**62 + 1_700_000_000_000, 1_700_000_000_000, None]).cast(kind)
        pl.DataFrame({"t": beyond, "a": [1.0, 2.0, 3.0]}).write_parquet(path)
        values, _, account = table_rows(path, ["a"])
        assert values.tolist() == [[2.0]]
        assert dict(account.rejected) == {"bad_time": 2}
        assert account.first_cell["bad_time"][0] == "t"


def test_a_damaged_or_swollen_parquet_is_refused(tmp_path):
    """A byte that would end the process that reads it, and a kilobyte that holds 200 MB."""
    path = tmp_path / "log.parquet"
    pl.DataFrame({"a": np.random.default_rng(0).normal(size=500)}).write_parquet(path)
    data = path.read_bytes()
    refused = 0
    for place in range(0, len(data), len(data) // 12):
        path.write_bytes(data[:place] + bytes([data[place] ^ 0x80]) + data[place + 1 :])
        try:
            list(LogTable(path).rows(["a"]))
        except LogFormatError:
            refused += 1
    assert refused
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(LogFormatError, match="damaged"):
        LogTable(path)
    pl.DataFrame({"a": pl.zeros(25_000_000, pl.Int64, eager=True)}).write_parquet(path)
    assert path.stat().st_size < 2**19
    with pytest.raises(LogFormatError, match="200 times as large"):
        LogTable(path)


@pytest.mark.parametrize("cells", ["1,2,3", '"1","2","3"', ' "1" , 2 ,3', '1,2,"3"'])
def test_quotes_and_spaces_around_cells_do_not_count(tmp_path, cells):
    log = write_csv(tmp_path / "log.csv", '"t","a",b', [cells, '2,"x\ny",3', "3,4", "", "4,5,6"])
    values, _, account = table_rows(log, ["a", "b"])
    np.testing.assert_array_equal(values, [[2, 3], [5, 6]])
    assert account.first_line == {"not_numeric": 4, "wrong_length": 5}
    assert account.received == 4


def test_columns_lined_up_by_spaces_are_read(tmp_path):
    log = tmp_path / "log.txt"
    log.write_text("  t     a\n  0     1\n  0.5  -2\n")
    values, instants, account = table_rows(log, ["a"])
    assert (values.ravel().tolist(), instants.tolist()) == ([1.0, -2.0], [0, 500_000_000])
    assert account.balanced


def test_names_of_columns_that_do_not_fit_are_refused(tmp_path):
    log = write_csv(tmp_path / "log.csv", "0,1,2", ["1,2,3"])
    spec = mapping(column_names=["t", "q_axle", "p"])
    with pytest.raises(LogFormatError, match=r"no column 'w_axle'.*column_names"):
        import_log(log, spec, tmp_path / "bag")
    spec = mapping(column_names=["t", "q_axle", "w_axle", "p"])
    with pytest.raises(LogFormatError, match=r"none of the 2 rows.*2 wrong_length"):
        import_log(log, spec, tmp_path / "bag")


def test_files_of_a_mapping_that_differ_are_refused(tmp_path):
    write_csv(tmp_path / "position.csv", "t,q_axle,p", ["0,1,2", "1,1,2"])
    write_csv(tmp_path / "velocity", "w_axle", ["0"])
    with pytest.raises(LogFormatError, match=r"'position.csv' has 2 rows and 'velocity' has 1"):
        import_log(tmp_path, mapping(joints=SIDE_BY_SIDE), tmp_path / "bag")
    with pytest.raises(LogFormatError, match="the folder with the files"):
        import_log(tmp_path / "position.csv", mapping(joints=SIDE_BY_SIDE), tmp_path / "bag")
