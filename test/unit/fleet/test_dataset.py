"""The dataset of a fleet: rows whole or not at all, each bag once."""

import fcntl
from itertools import permutations

import pytest

from robot_energy.errors import DatasetError
from robot_energy.fleet.dataset import RUNS, SCHEMA, TABLES, Dataset, read_tables, row_bytes, scan

DAY = "2026-03-02"


def put(dataset, name, robot="r1", date=DAY, **row):
    row = {"name": name, "key": name, "robot": robot, "reason": "", **row}
    return dataset.add(name, robot, date, row_bytes(row))


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
    jobs = [{"name": "pick", "grid_import_microjoule": 5_000_000, "grid_return_microjoule": 10**6}]
    whole = [{name: job.get(name) for name in TABLES["jobs"]} for job in jobs]
    put(dataset, "a-1-x", jobs=whole, grid_import_microjoule=2**60 + 1)
    assert scan(tmp_path / "d").collect()["grid_import_microjoule"].to_list() == [2**60 + 1]
    tables = read_tables(tmp_path / "d")
    assert tables.jobs["energy"].to_list() == [4.0]
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


def test_copies_of_a_bag_count_once(tmp_path):
    dataset = Dataset(tmp_path / "d")
    for name in ("a-1-x", "b-1-x"):
        put(dataset, name, key="same")
    assert len(read_tables(tmp_path / "d").runs) == 1


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
    with pytest.raises(DatasetError, match="is no folder"):
        Dataset(tmp_path / "mine.txt")
    with pytest.raises(DatasetError, match="holds no row"):
        scan(tmp_path / "none")
