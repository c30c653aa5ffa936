"""The dataset of a fleet: rows whole or not at all, each bag once."""

import fcntl
import io
import os
import subprocess
import sys
from itertools import permutations

import polars as pl
import pytest

from robot_energy.foundation.errors import DatasetError
from robot_energy_fleet.dataset import Dataset, RowKey, read_tables, row_bytes, scan
from robot_energy_fleet.tables import RUNS, SCHEMA, TABLES

DAY = "2026-03-02"
NAMED = {"name": "a-1-x", "key": "a-1-x", "bag": "a"}


def put(dataset, name, robot="r1", date=DAY, **row):
    bag = name.partition("-")[0]
    row = {"name": name, "key": name, "robot": robot, "bag": bag, "reason": "", **row}
    return dataset.add(RowKey(*map(row.get, RowKey._fields)), date, row_bytes(row))


def content(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*.parquet")}


def test_every_column_says_what_it_holds():
    for columns in (RUNS, *TABLES.values()):
        for name, column in columns.items():
            assert column.text, name
            if name.endswith("_ns"):
                assert column.unit.startswith("ns"), name
            if name.endswith("_microjoule"):
                assert column.unit == "uJ", name
    assert set(SCHEMA) == {*RUNS, *TABLES}


def test_a_row_comes_back_with_its_lists(tmp_path):
    dataset = Dataset(tmp_path / "d")
    jobs = [{"name": "pick", "predicted_import_microjoule": 5_000_000, "compared_ns": 0,
             "measured_microjoule": 7}]  # fmt: skip
    whole = [{name: job.get(name) for name in TABLES["jobs"]} for job in jobs]
    put(dataset, "a-1-x", jobs=whole, predicted_import_microjoule=2**60 + 1)
    assert scan(tmp_path / "d").collect()["predicted_import_microjoule"].to_list() == [2**60 + 1]
    tables = read_tables(tmp_path / "d")
    assert tables.jobs["grid_energy"].to_list() == [5.0]
    assert tables.jobs["measured_energy"].to_list() == [None]
    assert tables.runs["grid_energy"].to_list() == [pytest.approx((2**60 + 1) * 1e-6)]
    assert not len(tables.hours)


def test_a_changed_bag_replaces_its_row_wherever_that_lies(tmp_path):
    dataset = Dataset(tmp_path / "d")
    put(dataset, "a-unread-x", date="unknown", reason="no")
    put(dataset, "b-1-x")
    put(dataset, "c-1-x")
    dataset.pack()
    dataset = Dataset(tmp_path / "d")
    assert dataset.has("b-1-x")
    assert not dataset.has("a-1-x")
    put(dataset, "a-1-x")
    put(dataset, "b-2-x", date="2026-03-03")
    assert sorted(scan(tmp_path / "d").collect()["name"]) == ["a-1-x", "b-2-x", "c-1-x"]
    assert not list((tmp_path / "d").glob("*/date=unknown/*"))


def test_the_same_rows_give_the_same_bytes_in_any_order_and_packing(tmp_path):
    found = []
    for number, order in enumerate(permutations(["a-1-x", "b-1-x", "c-1-x"])):
        folder = tmp_path / str(number)
        dataset = Dataset(folder)
        for place, name in enumerate(order):
            put(dataset, name)
            if place == number % 3:
                dataset.pack()
                dataset = Dataset(folder)
        dataset.pack()
        found.append(content(folder))
    assert len(found[0]) == 1
    assert all(one == found[0] for one in found)


def test_a_kill_between_packing_and_removal_leaves_each_bag_once(tmp_path):
    dataset = Dataset(tmp_path / "d")
    paths = [put(dataset, name) for name in ("a-1-x", "b-1-x")]
    before = {path: path.read_bytes() for path in paths}
    dataset.pack()
    after = content(tmp_path / "d")
    for path, data in before.items():
        path.write_bytes(data)
    assert sorted(scan(tmp_path / "d").collect()["name"]) == ["a-1-x", "b-1-x"]
    again = Dataset(tmp_path / "d")
    assert again.has("a-1-x")
    again.pack()
    assert content(tmp_path / "d") == after


KILLED = """
import os, signal, sys
from pathlib import Path
from robot_energy.foundation.files.placement import OutputPlacement
placement = OutputPlacement(Path(sys.argv[1]), print, print)
placement.write_draft(b"")
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_what_a_killed_run_left_is_removed_with_the_next_row(tmp_path):
    path = put(Dataset(tmp_path / "d"), "a-1-x")
    target = path.with_name("b-1-x.parquet")
    subprocess.run([sys.executable, "-c", KILLED, str(target)], check=False)
    assert len(list(path.parent.iterdir())) == 2
    dataset = Dataset(tmp_path / "d")
    put(dataset, "c-1-x", date="2026-03-03")  # of another folder
    put(dataset, "b-1-x")
    assert sorted(path.parent.iterdir()) == [path, target]


def test_copies_of_a_bag_count_once(tmp_path):
    dataset = Dataset(tmp_path / "d")
    for name in ("a-1-x", "b-1-x"):
        put(dataset, name, key="same")
    assert len(read_tables(tmp_path / "d").runs) == 1


@pytest.mark.parametrize("packed", [False, True])
def test_a_moved_bag_that_is_run_otherwise_counts_once(tmp_path, packed):
    """The newest run stays, wherever the other row lies; another robot keeps its own."""
    dataset = Dataset(tmp_path / "d")
    put(dataset, "a-1-x", key="1", bag_hash="same")
    put(dataset, "d-1-x", key="2", bag_hash="same", robot="r2")
    put(dataset, "c-1-x", key="3", bag_hash="other")
    if packed:
        dataset.pack()
        dataset = Dataset(tmp_path / "d")
    put(dataset, "b-1-y", key="4", bag_hash="same")
    found = scan(tmp_path / "d").collect()
    assert sorted(found["name"]) == ["b-1-y", "c-1-x", "d-1-x"]
    assert not Dataset(tmp_path / "d").has("a-1-x")


def test_rows_of_one_bag_that_an_earlier_version_left_count_once(tmp_path):
    dataset = Dataset(tmp_path / "d")
    first, second = (put(dataset, name, key=name, bag_hash="same") for name in ("a-1-x", "b-1-y"))
    first.write_bytes(row_bytes(pl.read_parquet(second).row(0, named=True) | NAMED))
    assert len(scan(tmp_path / "d").collect()) == 1
    assert Dataset(tmp_path / "d").has("b-1-y")  # the next run
    assert scan(tmp_path / "d").collect()["name"].to_list() == ["b-1-y"]
    assert not first.exists()


def test_two_robots_of_one_bag_have_a_row_each(tmp_path):
    dataset = Dataset(tmp_path / "d")
    put(dataset, "a-1-x", robot="left", key="1", bag_hash="same")
    put(dataset, "a-1-y", robot="right", key="2", bag_hash="same")
    for again in (dataset, Dataset(tmp_path / "d")):
        assert again.has("a-1-x")
        assert again.has("a-1-y")
    assert sorted(scan(tmp_path / "d").collect()["robot"]) == ["left", "right"]


def test_a_bag_that_cannot_be_read_takes_no_row_away(tmp_path):
    dataset = Dataset(tmp_path / "d")
    put(dataset, "a-1-x")
    put(dataset, "a-unread-x", date="unknown", reason="gone")
    put(dataset, "b-unread-x", date="unknown", reason="gone")
    assert sorted(scan(tmp_path / "d").collect()["name"]) == ["a-1-x", "b-unread-x"]
    assert dataset.has("b-unread-x")
    dataset.remove([("r1", "a"), ("r1", "b"), ("r1", "c")], unread=True)
    assert scan(tmp_path / "d").collect()["name"].to_list() == ["a-1-x"]
    dataset.remove([("r1", "a")])
    assert not dataset.files()


@pytest.mark.parametrize(
    "change",
    [
        lambda own: own.drop("observed_ns"),
        lambda own: own.with_columns(observed=1),
        lambda own: own.with_columns(jobs=pl.lit([{"name": "a", "peak_grid_power": 1.0}])),
    ],
)
def test_a_dataset_of_another_version_is_refused_as_one(tmp_path, change):
    path = put(Dataset(tmp_path / "d"), "a-1-x")
    change(pl.read_parquet(path)).write_parquet(path)
    with pytest.raises(DatasetError) as met:
        read_tables(tmp_path / "d")
    assert met.value.found == f"{tmp_path / 'd'} has rows of another version ({path})"
    assert "--out" in met.value.remedy


def test_one_command_writes_at_a_time(tmp_path):
    dataset = Dataset(tmp_path / "d")
    with dataset.locked():
        with pytest.raises(DatasetError, match="another command writes"), dataset.locked():
            pass
    with dataset.locked(), (tmp_path / "d" / ".lock").open() as lock:
        with pytest.raises(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)


def test_other_folders_and_empty_ones_are_refused(tmp_path):
    (tmp_path / "mine.txt").write_text("x")
    with pytest.raises(DatasetError, match=r"holds 'mine.txt'"):
        Dataset(tmp_path)
    with pytest.raises(DatasetError, match="is not a folder"):
        Dataset(tmp_path / "mine.txt")
    with pytest.raises(DatasetError, match="does not exist"):
        scan(tmp_path / "none")
    (tmp_path / "none").mkdir()
    with pytest.raises(DatasetError, match="holds no row"):
        scan(tmp_path / "none")


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: b"",
        lambda data: b"nonsense",
        lambda data: data[: len(data) // 2],
        lambda data: data[:100] + bytes(len(data) - 200) + data[-100:],
        lambda data: other_parquet(),
    ],
)
def test_a_file_that_cannot_be_read_is_named(tmp_path, damage):
    dataset = Dataset(tmp_path / "d")
    whole, bad = put(dataset, "a-1-x"), put(dataset, "b-1-x")
    bad.write_bytes(damage(bad.read_bytes()))
    for work in (lambda: Dataset(tmp_path / "d").has("a-1-x"), lambda: read_tables(tmp_path / "d")):
        with pytest.raises(DatasetError) as met:
            work()
        assert str(bad) in met.value.found
        assert "move it away" in met.value.remedy
    bad.unlink()
    assert Dataset(tmp_path / "d").has("a-1-x")
    assert whole.exists()


HOUR = {name: 1 for name in TABLES["hours"]}
JOINT = dict.fromkeys(TABLES["joints"]) | {"joint": "a"}
FOREIGN = {
    "'robot'": {"robot": None},
    "'motor_temperature_degc' is not a finite": {"motor_temperature_degc": float("nan")},
    "'start_ns' is beyond": {"start_ns": 2**63 - 1},
    "in 'hours', a row without 'hour_ns'": {"hours": [HOUR | {"hour_ns": None}]},
    "in 'joints', 'motion_time' is not a finite": {
        "joints": [JOINT | {"motion_time": float("nan")}]
    },
    "in 'hours', 'hour_ns' is beyond": {"hours": [HOUR | {"hour_ns": -(2**63)}]},
}


@pytest.mark.parametrize("why", FOREIGN)
def test_a_row_that_no_run_writes_is_named_with_its_file(tmp_path, why):
    dataset = Dataset(tmp_path / "d")
    put(dataset, "a-1-x")
    row = {"name": "b-1-x", "key": "b", "robot": "r1", "bag": "b", "reason": "", **FOREIGN[why]}
    file = tmp_path / "d" / "robot=r1" / f"date={DAY}" / "foreign.parquet"
    file.write_bytes(row_bytes(row))
    with pytest.raises(DatasetError, match=f"foreign.parquet cannot be read .*{why}"):
        read_tables(tmp_path / "d")


def test_a_pipe_in_a_dataset_is_named(tmp_path):
    put(Dataset(tmp_path / "d"), "a-1-x")
    os.mkfifo(tmp_path / "d" / "robot=r1" / f"date={DAY}" / "pipe.parquet")
    with pytest.raises(DatasetError, match=r"pipe\.parquet is not a file"):
        read_tables(tmp_path / "d")


def test_a_file_that_may_not_be_read_is_not_to_be_moved(tmp_path, monkeypatch):
    file = put(Dataset(tmp_path / "d"), "a-1-x")

    def denied(rows):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(pl.LazyFrame, "collect", denied)
    with pytest.raises(DatasetError) as met:
        read_tables(tmp_path / "d")
    assert str(file) in met.value.found
    assert "permissions" in met.value.remedy


def other_parquet() -> bytes:
    """A table of another kind."""
    target = io.BytesIO()
    pl.DataFrame({"name": [1.5]}).write_parquet(target)
    return target.getvalue()
