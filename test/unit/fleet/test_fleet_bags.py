"""Which bags count: moved, run otherwise, of several robots, gone, in part, going on."""

import json
import shutil
from pathlib import Path

import pytest

import robot_energy as re
from fleets import short_bags
from logbook import wheel_bag, wheel_model, wheel_start
from mistakes import rewrite, scaled, shifted
from places import ROOT
from robot_energy_cli import main
from robot_energy_fleet.bag_list import FleetModels, list_bags
from robot_energy_fleet.dataset import Dataset, read_tables, scan
from robot_energy_fleet.fleet_run import on_dask, run_fleet
from robot_energy_studies import generated_fleet

BAG = ROOT / "bags" / "kr16_all_topics"
WARM = ROOT / "bags" / "kr16_warm"


def test_a_moved_bag_with_another_option_counts_once(tmp_path):
    def run(where, effort):
        return re.fleet_run(where, tmp_path / "d", "kr16", workers=0, name="r1", effort=effort)

    shutil.copytree(WARM, tmp_path / "old" / "bag")
    assert run(tmp_path / "old", None).replayed == 1
    (tmp_path / "old").rename(tmp_path / "new")
    assert run(tmp_path / "new", "motor_torque").replayed == 1
    (row,) = read_tables(tmp_path / "d").runs.to_dicts()
    assert Path(row["bag"]).parent == tmp_path / "new"
    assert run(tmp_path / "new", "motor_torque").there == 1


def test_two_robots_of_one_bag_stay_and_are_replayed_once(tmp_path, capsys):
    words = ["--model", "kr16", "--workers", "0", "--out", str(tmp_path / "d")]
    table = tmp_path / "bags.csv"
    table.write_text(f"bag,robot\n{BAG},left\n{BAG},right\n")
    assert main(["fleet", "run", str(table), *words]) == 0
    assert main(["fleet", "run", str(table), *words]) == 0
    assert "2 bags: 0 replayed, 2 there already" in capsys.readouterr().out
    for name in ("left", "third"):
        assert main(["fleet", "run", str(BAG), *words, "--name", name]) == 0
    assert "1 bag: 1 replayed, 0 there already" in capsys.readouterr().out
    assert [one.robot for one in re.fleet_report(tmp_path / "d").robots] == [
        "left",
        "right",
        "third",
    ]
    with on_dask(workers=1) as replays:
        models, dataset = FleetModels(), Dataset(tmp_path / "on_dask")
        bags = list_bags(str(table), models, "kr16", {})
        assert run_fleet(bags, models.models, dataset, replays).read == 2
    assert len(scan(tmp_path / "on_dask").collect()) == 2


def test_two_robots_of_one_broken_bag_are_both_named(tmp_path):
    (tmp_path / "broken.mcap").write_bytes(b"no bag at all")
    table = tmp_path / "bags.csv"
    table.write_text("bag,robot\nbroken.mcap,left\nbroken.mcap,right\n")
    done = re.fleet_run(table, tmp_path / "d", "kr16", workers=0)
    assert [one.robot for one in done.refused] == ["left", "right"]


@pytest.mark.parametrize("is_absolute", [True, False])
def test_a_bag_that_is_gone_for_a_while_keeps_its_row(tmp_path, monkeypatch, is_absolute):
    """Said by the run while it is gone; nothing of that is left when it is there again."""
    tables = tmp_path / "hall"
    shutil.copytree(BAG, tables / "bags" / "monday")
    named = tables / "bags" if is_absolute else Path("bags")
    (tables / "bags.csv").write_text(f"bag,robot\n{named / 'monday'},r1\n{named},r2\n")
    monkeypatch.chdir(tmp_path)

    def run():
        return re.fleet_run("hall/bags.csv", tmp_path / "d", "kr16", workers=0)

    def reasons():
        runs = read_tables(tmp_path / "d").runs.sort("robot")
        return [(robot, bool(why)) for robot, why in runs.select("robot", "reason").iter_rows()]

    (tables / "bags").rename(tables / "away")
    assert len(run().refused) == 2
    assert reasons() == [("r1", True), ("r2", True)]
    (tables / "away").rename(tables / "bags")
    assert run().replayed == 2
    assert reasons() == [("r1", False), ("r2", False)]
    (tables / "bags").rename(tables / "away")
    assert [one.robot for one in run().refused] == ["r1", "r2"]
    assert reasons()[0] == ("r1", False)
    (tables / "away").rename(tables / "bags")
    assert run().there == 2
    assert reasons() == [("r1", False), ("r2", False)]


def test_jobs_that_a_bag_holds_in_part_are_counted(tmp_path, capsys):
    """Of a list of many bags, those that lie elsewhere do not count."""
    bag, model = wheel_bag(tmp_path), wheel_model(tmp_path)
    jobs, begin = tmp_path / "jobs.yaml", wheel_start(bag)
    spans = [(-50.0, -40.0), (-3.0, 2.0), (2.0, 4.0), (5.0, 5.05), (8.0, 12.0), (60.0, 90.0)]
    lines = [f"  - {{name: spin, begin: {begin + a}, end: {begin + b}}}\n" for a, b in spans]
    jobs.write_text("jobs:\n" + "".join(lines))
    words = ["fleet", "run", str(bag), "--model", str(model), "--out", str(tmp_path / "d")]
    written = tmp_path / "run.json"
    assert main([*words, "--workers", "0", "--jobs", str(jobs), "--json", str(written)]) == 0
    said = "jobs that are not in a bag from beginning to end, left out: 2"
    assert said in capsys.readouterr().out
    assert json.loads(written.read_text())["jobs_left_out"] == 2
    report = re.fleet_report(tmp_path / "d")
    assert said in report.notes
    assert sum(one.jobs for one in report.robots) == 2
    assert main(["fleet", "report", str(tmp_path / "d")]) == 0
    assert said in " ".join(capsys.readouterr().out.split())


def test_joint_states_that_are_doubtful_are_listed(tmp_path, capsys):
    """A driver whose velocities stay 0: the model reads half of the energy."""
    bag = rewrite(WARM, tmp_path / "hall" / "r1" / "zero", scaled(("velocity",), 0.0), None, 12.0)
    words = ["--model", "kr16", "--workers", "0", "--out", str(tmp_path / "d")]
    assert main(["fleet", "run", str(tmp_path / "hall"), *words]) == 3
    sentence = "the velocity of joint_a1 stays 0 while its positions move"
    assert f"damaged or doubtful: {bag}: {sentence}" in capsys.readouterr().out
    assert main(["fleet", "report", str(tmp_path / "d")]) == 0
    assert sentence in " ".join(capsys.readouterr().out.split())
    (note, *_) = re.advise(bag, "kr16", look_at_speeds=False).report.notes
    assert note.startswith(f"{bag}: {sentence}")


def test_remarks_about_joint_states_make_no_bag_doubtful(tmp_path, capsys):
    """Another zero of the vertical axis changes no power."""
    bag = rewrite(WARM, tmp_path / "hall" / "r1" / "turned", shifted(0, 4.0), None, 3.0)
    assert any("is this the model of the robot" in one for one in re.replay(bag, "kr16").notes)
    words = ["--model", "kr16", "--workers", "0", "--out", str(tmp_path / "d")]
    assert main(["fleet", "run", str(tmp_path / "hall"), *words]) == 0
    assert "0 damaged or doubtful" in capsys.readouterr().out


def test_a_recording_that_goes_on_is_one_bag_of_one_robot(tmp_path, capsys):
    """A part of it comes in, is said to be damaged, and makes way for the whole."""
    recording, whole = tmp_path / "hall" / "r1" / "run7", (WARM / "kr16_warm_0.mcap").read_bytes()
    recording.mkdir(parents=True)
    file = recording / "run7_0.mcap"
    file.write_bytes(whole[: len(whole) * 3 // 4])
    words = ["--model", "kr16", "--workers", "0", "--out", str(tmp_path / "d")]
    for where in (tmp_path / "hall", file):  # the second: as a bag of its own
        assert main(["fleet", "run", str(where), *words]) == 3
    said = capsys.readouterr().out
    assert "1 bag: 1 replayed, 0 there already, 0 refused, 1 damaged or doubtful" in said
    assert f"damaged or doubtful: {recording}: run7_0.mcap: the file ends inside a chunk" in said
    html, written = tmp_path / "d.html", tmp_path / "d.json"
    outputs = ["--html", str(html), "--json", str(written)]
    assert main(["fleet", "report", str(tmp_path / "d"), *outputs]) == 0
    for text in (capsys.readouterr().out, html.read_text()):
        assert "the file ends inside a chunk" in " ".join(text.split())
    damaged = json.loads(written.read_text())["damaged"]
    assert {(one["robot"], len(one["problems"])) for one in damaged} == {("r1", 1)}
    file.write_bytes(whole)
    metadata = (WARM / "metadata.yaml").read_text().replace("kr16_warm_0.mcap", file.name)
    (recording / "metadata.yaml").write_text(metadata)
    assert main(["fleet", "run", str(tmp_path / "hall"), *words]) == 0
    (row,) = scan(tmp_path / "d").collect().to_dicts()
    assert (row["bag"], row["robot"], row["problems"]) == (str(recording), "r1", [])


@pytest.mark.long
def test_a_generated_fleet_is_replayed_from_another_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["--robots", "1", "--weeks", "1", "--seed", "1"]
    with short_bags(days=1):
        assert generated_fleet.main(["fleet", *words]) == 0
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    table = ["fleet", "run", "../fleet/bags.csv", "--out", "dataset", "--workers", "0"]
    assert main(table) == 0
    rows = scan("dataset").collect()
    assert len(rows) == 3  # two shifts and a night
    assert rows["jobs"].list.len().max() >= 1
