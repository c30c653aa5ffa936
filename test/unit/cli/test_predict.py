"""`robot-energy predict`: programs of every kind, several robots, refusals in one sentence."""

import json

import pytest
import yaml

import command_line
from places import ROOT
from robot_energy_cli import main
from robot_energy_papers.wall import Wall

EXAMPLES = ROOT / "src" / "examples" / "programs"
MOVES = EXAMPLES / "kr16_pick_and_place.yaml"
ROBOTS = ["--model", "mantis", "--base=-1.2,-0.2,0", "--model", "testbed", "--base=0,0,0",
          "--model", "irb4600", "--base=-1,0.15,0"]  # fmt: skip


def run(*args):
    return main(["predict", *map(str, args)])


def refused(capsys, *args):
    return command_line.refused(capsys, "predict", *args)


@pytest.fixture
def wall(tmp_path):
    path = tmp_path / "wall.gcode"
    path.write_text(Wall(length=0.3, width=0.1).gcode())
    return path


def test_one_wall_by_three_robots_side_by_side(tmp_path, capsys, wall):
    outputs = [tmp_path / name for name in ("p.json", "p.html", "p.svg")]
    options = [f"--{kind}={path}" for kind, path in zip(("json", "report", "plot"), outputs,
                                                         strict=True)]  # fmt: skip
    assert run(wall, *ROBOTS, "--temperature", "40", *options) == 0
    out = capsys.readouterr().out
    assert "Time, and power from the grid" in out
    assert "planar arm: heights are left to an axis outside of the model" in out
    runs = json.loads(outputs[0].read_text())["runs"]
    assert [one["model"]["robot"].split()[0] for one in runs] == ["Printing", "TestBed", "IRB"]
    for one in runs:
        energy = one["energy"]
        assert energy["balanced"]
        assert one["problems"] == []
        parts = ("rigid", "friction", "drive_loss", "loss_dc", "loss_grid", "brake", "capacitor")
        net = energy["grid_import"] - energy["grid_return"]
        assert sum(energy[part] or 0.0 for part in parts) == pytest.approx(net, abs=1e-4)
        joints = sum(joint["drive_input_energy"] for joint in one["joints"])
        assert joints == pytest.approx(sum(energy[part] for part in parts[:3]), abs=1e-4)
        assert one["tool"]["energy_per_printed_metre"] == pytest.approx(net / 0.8, rel=1e-9)
        assert one["time"]["duration"] == pytest.approx(0.8 / 0.125, abs=0.15)
    html = outputs[1].read_text()
    assert html.count("<figure>") == 2
    assert "predict" in html
    assert "--base=-1.2,-0.2,0" in html
    assert outputs[2].read_text().startswith("<?xml")


def test_moves_at_two_temperatures(tmp_path, capsys):
    report = tmp_path / "p.json"
    assert run(MOVES, "--model", "kr16", "--temperature", "20", "--temperature", "60",
               "--payload", "15,0,0,0.12", "--json", report) == 0  # fmt: skip
    cold, warm = json.loads(report.read_text())["runs"]
    assert cold["energy"]["friction"] > 1.2 * warm["energy"]["friction"]
    assert cold["repeat"] == 5
    assert cold["payload"][0]["mass"] == 15.0
    assert "KR 16 class, 60 degC" in capsys.readouterr().out


def test_a_temperature_outside_of_what_was_fitted_is_flagged(capsys):
    assert run(MOVES, "--model", "kr16", "--temperature", "0,60,60,60,60,60", "--repeat", "1") == 0
    out = capsys.readouterr().out
    assert "EXTRAPOLATED: the friction of joint_a1 was never fitted" in out
    assert "friction law outside its fitted temperatures, edge held" in out


def test_a_trajectory_in_a_bag_and_as_csv_take_the_same_energy(tmp_path, capsys):
    folder = tmp_path / "motion"
    assert main(["identify", "excitation", "--model", "kr16", "--starts", "1", "--iterations",
                 "1", "--rate", "50", "--out", str(folder)]) == 0  # fmt: skip
    report = tmp_path / "p.json"
    assert run(folder / "excitation_bag", folder / "excitation.csv", "--model", "kr16",
               "--temperature", "40", "--json", report) == 0  # fmt: skip
    bag, csv = json.loads(report.read_text())["runs"]
    assert bag["energy"]["grid_import"] == pytest.approx(csv["energy"]["grid_import"], rel=1e-6)
    assert bag["time"]["duration"] == pytest.approx(10.0)


def test_json_alone_on_standard_output(capsys):
    assert run(MOVES, "--model", "kr16", "--temperature", "40", "--repeat", "1", "--json", "-") == 0
    assert json.loads(capsys.readouterr().out)["runs"][0]["energy"]["balanced"]


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--temperature", "hot"], "--temperature is 'hot'"),
        (["--temperature", "20,30"], "--temperature is '20,30'"),
        (["--temperature", "500"], "motor temperatures are"),
        (["--temperature", "20", "--repeat", "0"], "0 repetitions"),
        (["--temperature", "20", "--payload", "-3"], "payload"),
        (["--temperature", "20", "--payload", "3@nowhere"], "nowhere"),
        (["--temperature", "20", "--payload", "3,1"], "--payload is '3,1'"),
        (["--temperature", "20", "--plot", "a.txt"], "no known format"),
        (["--temperature", "20", "--report", "/nowhere/a.html"], "there is no folder"),
        (["--temperature", "20", "--model", "kr16", "--base", "0,0,0", "--base", "1,0,0",
          "--base", "2,0,0"], "--base was given 3 times"),
    ],
)  # fmt: skip
def test_wrong_options_are_refused_in_one_sentence(capsys, options, text):
    assert text in refused(capsys, MOVES, "--model", "kr16", *options)


def test_programs_that_a_robot_cannot_make_are_refused_in_one_sentence(tmp_path, capsys, wall):
    text = refused(capsys, MOVES, "--model", "ur5e", "--temperature", "20")
    assert "it lacks shoulder_pan_joint" in text
    text = refused(capsys, wall, "--model", "mantis", "--base=9,0,0", "--temperature", "20")
    assert "wall.gcode, line 9, at 0.000 s: point 1" in text
    assert "the reach of tool0" in text
    text = refused(capsys, wall, "--model", "testbed", "--base=1,0,0", "--temperature", "20")
    assert "puts joint_x at -1 m" in text
    text = refused(capsys, wall, "--model", "mantis", "--tool", "hook", "--temperature", "20")
    assert "no link 'hook'" in text
    text = refused(capsys, wall, "--model", "mantis", "--start", "0,1", "--temperature", "20")
    assert "the start has 2 joint positions" in text
    text = refused(capsys, tmp_path / "none.gcode", "--model", "mantis", "--temperature", "20")
    assert "there is no program" in text
    fast = tmp_path / "fast.gcode"
    fast.write_text("G0 X500 Y500 Z500\nG1 X900 F120000\n")
    text = refused(capsys, fast, "--model", "testbed", "--temperature", "20")
    assert "fast.gcode, line 2: joint 'joint_x' moves at 0.5" in text
    assert "expected at most 0.5 m/s" in text


def test_a_wall_printed_twice_takes_the_same_per_metre(tmp_path, capsys, wall):
    report = tmp_path / "p.json"
    found = []
    for times in ("1", "2"):
        assert run(wall, *ROBOTS[:3], "--temperature=40", "--repeat", times, "--json", report) == 0
        found.append(json.loads(report.read_text())["runs"][0]["tool"])
    assert found[1]["length"] == pytest.approx(2 * found[0]["length"])
    assert found[1]["energy_per_printed_metre"] == pytest.approx(
        found[0]["energy_per_printed_metre"], rel=1e-5
    )


def test_a_program_that_does_not_end_where_it_began_is_not_repeated(tmp_path, capsys):
    path = tmp_path / "line.gcode"
    path.write_text("G0 X500 Y500 Z500\nG1 X900 F6000\n")
    text = refused(capsys, path, "--model", "testbed", "--temperature", "20", "--repeat", "2")
    assert "joint 'joint_x' ends 0.4" in text


def test_the_example_of_moves_is_complete():
    assert set(yaml.safe_load(MOVES.read_text())) == {
        "schema_version", "motion", "angle_unit", "via", "dwell", "override", "acceleration",
        "repeat",
    }  # fmt: skip


LENGTHS = {
    "dwell": (";FLAVOR:Marlin\nG21 G90\nG0 X500 Y500 Z500\nG4 S86400\nG1 X600 F6000\n", []),
    "slow": ("G21 G90\nG0 X500 Y500 Z500\nG1 X600 F6000\n", ["--tool-acceleration", "0.000001"]),
    "often": ("G21 G90\nG0 X500 Y500 Z500\nG1 X600 F6000\nG1 X500\n", ["--repeat", "100000"]),
}


@pytest.mark.parametrize("name", LENGTHS)
def test_a_prediction_that_is_too_long_is_refused_before_it_begins(tmp_path, capsys, name):
    text, options = LENGTHS[name]
    path = tmp_path / "long.gcode"
    path.write_text(text)
    found = refused(capsys, path, "--model", "testbed", "--temperature", "20", *options,
                    "--max-samples", "40000")  # fmt: skip
    assert "samples over" in found
    assert "--max-samples" in found


def test_programs_and_temperatures_count_together(capsys, wall):
    options = [wall, "--model", "testbed", "--temperature", "20", "--json", "-"]
    assert run(*options, "--max-samples", "1000") == 0
    text = refused(capsys, *options, "--temperature", "30", "--max-samples", "1000")
    assert "at most 1000 samples" in text


@pytest.mark.parametrize(
    "options",
    [
        ["--base", "1e308,0,0"], ["--base", "0,0,0,1e300"], ["--start", "1e308,0,0"],
        ["--tool-acceleration", "1e-9"], ["--tool-acceleration", "1e8"], ["--smoothing", "9"],
        ["--corner-tolerance", "1e8"], ["--rapid", "1e6"], ["--payload", "1e308"],
        ["--repeat", "1000000"], ["--max-samples", "0"],
    ],
)  # fmt: skip
def test_absurd_numbers_are_refused_in_one_sentence(capsys, wall, options):
    refused(capsys, wall, "--model", "testbed", "--temperature", "20", *options)


@pytest.mark.parametrize("text", ["nan", "inf", "-inf", "1e10", "x", "", "9" * 400])
@pytest.mark.parametrize("option", ["--rapid", "--smoothing", "--repeat"])
def test_what_is_no_number_is_a_mistake_in_the_command(capsys, wall, option, text):
    assert run(wall, "--model", "testbed", "--temperature", "20", f"{option}={text}") == 2
    assert option in capsys.readouterr().err
