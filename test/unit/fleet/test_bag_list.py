"""The bags of a fleet: found in folders, by patterns, in tables, on other file systems."""

import os
import re
import shutil

import fsspec
import pytest

from places import ROOT
from robot_energy.foundation import kinds
from robot_energy.foundation.errors import DatasetError
from robot_energy.model import load
from robot_energy_fleet import bag_row
from robot_energy_fleet.bag_list import FleetModels, list_bags
from robot_energy_fleet.bag_places import find_bags
from robot_energy_fleet.dataset import Dataset
from robot_energy_fleet.fleet_run import in_turn, run_fleet

BAG = ROOT / "bags" / "kr16_all_topics"
FILE = BAG / "kr16_all_topics_0.mcap"


@pytest.fixture
def hall(tmp_path):
    """A rosbag2 folder of one robot, two bare MCAP files of another."""
    shutil.copytree(BAG, tmp_path / "hall" / "r1" / "monday")
    (tmp_path / "hall" / "r2").mkdir()
    for name in ("a.mcap", "b.mcap"):
        shutil.copy(FILE, tmp_path / "hall" / "r2" / name)
    (tmp_path / "hall" / "notes.txt").write_text("no bag")
    return tmp_path / "hall"


def names(places):
    return [place.address.rpartition("hall/")[2] for place in places]


def test_folders_with_metadata_and_bare_files_are_bags(hall):
    assert names(find_bags(str(hall))) == ["r1/monday", "r2/a.mcap", "r2/b.mcap"]
    assert names(find_bags(str(hall / "r2" / "*"))) == ["r2/a.mcap", "r2/b.mcap"]
    assert names(find_bags(str(hall / "r1" / "monday"))) == ["r1/monday"]
    assert names(find_bags(f"file://{hall}/r2/a.mcap")) == ["r2/a.mcap"]


def test_files_of_a_split_recording_can_be_bags_of_their_own(hall):
    found = names(find_bags(str(hall / "r1"), split=True))
    assert found == ["r1/monday/kr16_all_topics_0.mcap"]


def test_what_is_still_being_written_is_left_out(hall):
    whole = FILE.read_bytes()
    (hall / "r2" / "b.mcap").write_bytes(whole[:-1])
    (hall / "r1" / "monday" / "metadata.yaml").write_text("")
    assert names(find_bags(str(hall), complete=True)) == ["r2/a.mcap"]
    assert len(names(find_bags(str(hall)))) == 3
    (hall / "r2" / "b.mcap").write_bytes(whole)
    assert names(find_bags(str(hall), complete=True)) == ["r2/a.mcap", "r2/b.mcap"]


def test_a_recording_without_metadata_is_the_bag_that_it_will_be(hall):
    monday = hall / "r1" / "monday"
    (monday / "kr16_all_topics_0.mcap").rename(monday / "monday_0.mcap")
    shutil.copy(FILE, monday / "monday_1.mcap")
    closed = list_bags(str(hall / "r1"), FleetModels(), "kr16", {})
    (monday / "metadata.yaml").unlink()
    going_on = list_bags(str(hall / "r1"), FleetModels(), "kr16", {})
    assert len(closed) == len(going_on) == 1
    assert going_on[0].place.address == closed[0].place.address == str(monday)
    assert going_on[0].robot == closed[0].robot == "r1"
    assert len(going_on[0].place.files) == 2
    assert list(find_bags(str(hall / "r1"), complete=True)) == []
    files = list_bags(str(hall / "r1"), FleetModels(), "kr16", {}, split=True)
    assert names(bag.place for bag in files) == [
        "r1/monday/monday_0.mcap",
        "r1/monday/monday_1.mcap",
    ]
    assert {bag.robot for bag in files} == {"r1"}
    (one,) = list_bags(str(monday / "*_0.mcap"), FleetModels(), "kr16", {})
    assert (one.place.is_folder, one.robot) == (False, "r1")
    shutil.copy(FILE, monday / "other.mcap")
    assert len(names(find_bags(str(monday)))) == 3


def test_the_state_of_a_bag_changes_with_its_files(hall):
    before = [place.state for place in find_bags(str(hall))]
    assert before == [place.state for place in find_bags(str(hall))]
    (hall / "r2" / "b.mcap").write_bytes(FILE.read_bytes()[:-1])
    after = [place.state for place in find_bags(str(hall))]
    assert after[:2] == before[:2]
    assert after[2] != before[2]


def test_robots_have_the_names_of_folders(hall):
    found = list_bags(str(hall), FleetModels(), "kr16", {})
    assert [bag.robot for bag in found] == ["r1", "r2", "r2"]
    assert len({bag.name for bag in found}) == 3
    named = list_bags(str(hall), FleetModels(), "kr16", {}, robot="left")
    assert {bag.robot for bag in named} == {"left"}


def test_model_options_and_what_a_table_says_change_the_settings(hall):
    place, models = str(hall / "r1"), FleetModels()
    plain = list_bags(place, models, "kr16", {})[0]
    again = list_bags(place, models, "kr16", {"effort": None})[0]
    assert plain.name == again.name
    for other in (
        list_bags(place, models, "ur3e", {}),
        list_bags(place, models, "kr16", {"effort": "motor_torque"}),
        list_bags(place, models, "kr16", {}, robot="left"),
    ):
        assert other[0].name != plain.name


def test_a_table_names_bags_models_and_jobs(hall):
    jobs = "jobs:\n  - {name: pick, begin: 0.0, end: 1.0}\n"
    (hall / "jobs.yaml").write_text(jobs)
    table = hall / "bags.csv"
    table.write_text(
        "bag,model,robot,programme,shift,jobs,effort\n"
        "r1/monday,,left,pick,early,jobs.yaml,motor_torque\n"
        "r2,ur3e,right,,,,\n"
        "gone.mcap,,right,,,,\n"
    )
    first, *files, gone = list_bags(str(table), FleetModels(), "kr16", {})
    said = (first.robot, first.programme, first.shift, first.texts["jobs"], first.options)
    assert said == ("left", "pick", "early", jobs, {"effort": "motor_torque"})
    assert [bag.model for bag in files] == ["ur3e", "ur3e"]
    assert gone.place.files == ()
    assert "does not exist" in str(gone.place.problem)


def test_a_bag_of_a_table_has_one_address_there_or_gone(hall, monkeypatch):
    """Also where the command runs elsewhere, and has a file of that name."""
    table, folder = hall / "bags.csv", hall / "r2"
    table.write_text("bag,robot\nr2/a.mcap,r2\nr2/*.mcap,r2\n")
    monkeypatch.chdir(folder)
    there = list_bags("../bags.csv", FleetModels(), "kr16", {})
    assert [bag.place.address.rpartition("/")[2] for bag in there] == ["a.mcap", "a.mcap", "b.mcap"]
    for name in ("a.mcap", "b.mcap"):
        (folder / name).unlink()
    (folder / "r2").mkdir()
    shutil.copy(FILE, folder / "r2" / "a.mcap")
    gone, pattern = list_bags("../bags.csv", FleetModels(), "kr16", {})
    assert gone.place.files == pattern.place.files == ()
    assert gone.place.address == there[0].place.address
    assert ("r2", pattern.place.address) in there[1].missed
    assert ("r2", "r2/*.mcap") in there[1].missed  # as earlier versions had it


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("bags\nx\n", "has the column 'bags'"),
        ("robot\nx\n", "has no column 'bag'"),
    ],
)
def test_a_wrong_table_is_refused(tmp_path, text, match):
    (tmp_path / "bags.csv").write_text(text)
    with pytest.raises(DatasetError, match=match):
        list_bags(str(tmp_path / "bags.csv"), FleetModels(), "kr16", {})


WRONG = {
    ",b": "line 3 .* has no bag",
    "a,b,,,,,,h": "line 3 .* too many cells",
    '"a' + "x" * 140_000 + '",b': "line 3 .*field larger",
    f"r2,{'r' * 300}": "name of the robot, r+..., is too long",
    "r2,,no_model": "'no_model' cannot be read",
    "r2,,kr16,none.yaml": "none.yaml",
    "zip://r2/a.mcap": "has 'zip'; expected a local path, or one of the protocols file, s3",
    "github://a/b": "has 'github'",
    "memory://a::memory://b": "has '::'",
    "data:text/plain,x": "too many cells|does not exist",
    "data:text/plain": "does not exist",
    "~nobody-has-this-name/x": "does not exist",
    "gone": "does not exist",
    "s3://a/b": "s3://a/b cannot be read",
}


@pytest.mark.parametrize("row", WRONG)
def test_a_row_that_cannot_be_used_ends_no_fleet(hall, tmp_path, row, monkeypatch):
    def no_client(address):
        raise RuntimeError("a client has errors of its own")

    if row.startswith("s3"):
        monkeypatch.setattr("robot_energy_fleet.bag_places.url_to_fs", no_client)
    table = hall / "bags.csv"
    table.write_text(f"bag,robot,model,jobs\nr2/a.mcap\n{row}\nr2/b.mcap\n")
    models, dataset = FleetModels(), Dataset(tmp_path / "d")
    bags = list_bags(str(table), models, "kr16", {})
    wrong = [bag for bag in bags if bag.place.problem is not None]
    assert len(bags) - len(wrong) == 2
    assert wrong
    for again in range(2):
        done = run_fleet(bags, models.models, dataset, in_turn())
        assert len(done.refused) == len(wrong)
        assert (done.read, done.there) == ((0, 2) if again else (2, 0))
    for one, reason in zip(wrong, done.refused.values(), strict=True):
        assert re.search(WRONG[row], str(one.place.problem))
        assert one.place.problem.found == reason.reason


def test_linked_folders_are_followed_once(hall, tmp_path):
    store = tmp_path / "store"
    (store / "r3").mkdir(parents=True)
    shutil.copy(FILE, store / "r3")
    (hall / "r3").symlink_to(store / "r3")
    (hall / "r0").symlink_to(hall / "r2")  # is there under its own name
    (hall / "r2" / "latest.mcap").symlink_to("b.mcap")
    (hall / "r3" / "round").symlink_to(hall)
    (hall / "r4").symlink_to("gone")
    found = {one.address.rpartition("hall/")[2]: one.problem for one in find_bags(str(hall))}
    assert found.keys() == {"r1/monday", "r2/a.mcap", "r2/b.mcap", f"r3/{FILE.name}", "r4"}
    assert "leads to gone, which is not there" in str(found.pop("r4"))
    assert set(found.values()) == {None}
    by_pattern = names(find_bags(str(hall / "*")))
    assert sorted(by_pattern) == sorted([*found, "r4"])
    robots = [bag.robot for bag in list_bags(str(hall), FleetModels(), "kr16", {})]
    assert sorted(robots) == sorted(["r1", "r2", "r2", "r3", hall.name])


def test_what_cannot_be_looked_into_is_named(hall, monkeypatch):
    os.mkfifo(hall / "r1" / "pipe.mcap")
    scandir = os.scandir

    def refusing(folder):
        if str(folder) == str(hall / "r2"):
            raise PermissionError(13, "Permission denied", str(folder))
        return scandir(folder)

    monkeypatch.setattr(os, "scandir", refusing)
    problems = [str(one.problem) for one in find_bags(str(hall)) if one.problem]
    pipe, folder = sorted(problems)
    assert "pipe.mcap is not a file" in pipe
    assert "r2 cannot be read (Permission denied)" in folder


def test_a_name_that_is_no_text_is_named(hall):
    os.rename(os.fsencode(hall / "r2" / "a.mcap"), os.fsencode(hall / "r2") + b"/\xff.mcap")
    first, *_ = find_bags(str(hall))
    assert "is not UTF-8" in str(first.problem)
    with pytest.raises(DatasetError, match="name of the robot"):
        list_bags(str(hall), FleetModels(), "kr16", {}, robot="\udcff")


def test_a_worker_loads_the_kinds_of_the_user(hall, tmp_path, monkeypatch):
    mine = tmp_path / "mine.py"
    mine.write_text("from pathlib import Path\nPath(__file__).with_suffix('.loaded').touch()\n")
    monkeypatch.setenv(kinds.VARIABLE, str(mine))
    bag_row._load_kinds.cache_clear()
    (bag,) = list_bags(str(hall / "r2" / "a.mcap"), FleetModels(), "kr16", {})
    bag_row.replay_bag(bag, load("kr16"), 0)
    assert mine.with_suffix(".loaded").exists()


def test_bags_are_found_on_other_file_systems():
    system = fsspec.filesystem("memory")
    system.pipe("/hall/r1/a.mcap", FILE.read_bytes())
    system.pipe("/hall/r1/b.mcap", b"half")
    try:
        found = list(find_bags("memory://hall", complete=True))
        assert [place.address for place in found] == ["memory:///hall/r1/a.mcap"]
        assert found[0].size == FILE.stat().st_size
        assert not found[0].is_local
    finally:
        system.rm("/hall", recursive=True)


def test_a_folder_without_bags_and_a_bag_without_model_are_refused(hall):
    with pytest.raises(DatasetError, match="does not exist"):
        list_bags(str(hall / "none"), FleetModels(), "kr16", {})
    (hall / "none").mkdir()
    with pytest.raises(DatasetError, match="holds no bag"):
        list_bags(str(hall / "none"), FleetModels(), "kr16", {})
    with pytest.raises(DatasetError, match="no model for"):
        list_bags(str(hall), FleetModels(), None, {})
