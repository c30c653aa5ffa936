"""Pump and extruder of the rig, from their messages to a report and to its page."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from places import ROOT
from robot_energy.foundation.errors import ModelFileError, MotionError
from robot_energy.inputs.inputs_file import read_inputs
from robot_energy.model import load, save
from robot_energy.replay.bag_replay import replay
from robot_energy.replay.setup import ReplaySetup
from robot_energy.results.replay import replay_report
from robot_energy_cli.main import main
from robot_energy_plan.motion import Program, random_program
from robot_energy_plan.motion.planned import SampledMotion
from robot_energy_plan.prediction import predict
from robot_energy_plan.results.prediction import prediction_report
from robot_energy_rig import VirtualRig, load_profile
from robot_energy_rig.record import PUMP_OFF, PUMP_ON, record

CELL = ROOT / "src/examples/auxiliary/mantis_cell.yaml"


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    profile = load_profile("mantis")
    robot, _ = profile.mechanics()
    program = random_program(profile.motion_limits(robot), 1, 4)
    rig = VirtualRig(profile, program, None, 3)
    folder = tmp_path_factory.mktemp("cell")
    return record(rig, 40.0, folder / "bag", auxiliary=True)


@pytest.fixture(scope="module")
def report(recording):
    return replay_report(replay(recording.path, load(str(CELL))))


def test_energies_are_those_of_the_rig_within_its_meters(report, recording):
    loads = {one.name: one for one in report.auxiliary.loads}
    for name, truth in recording.auxiliary_energy.items():
        assert loads[name].known_energy == pytest.approx(truth, rel=0.01), name
        assert loads[name].metered
        assert loads[name].known_ns + loads[name].missing_ns == report.time.observed_ns
    panel = loads["panel"]
    assert panel.energy == pytest.approx(35.0 * report.time.observed_time)
    assert loads["pump"].states["on"].mean_power == pytest.approx(PUMP_ON, rel=0.03)
    assert loads["pump"].states["off"].mean_power == pytest.approx(PUMP_OFF, rel=0.02)
    assert report.topics.meter == "/power_meter"  # among three topics of PowerReading


def test_the_outlet_is_the_exact_sum_of_its_branches(report):
    found = report.auxiliary
    total = found.cabinet_energy + found.auxiliary_energy
    assert found.outlet_energy == pytest.approx(total, abs=1e-5)
    assert found.outlet_energy_microjoule == pytest.approx(1e6 * total, abs=10)


def test_the_cabinet_is_that_of_a_replay_without_loads(report, recording):
    model = load(str(CELL)).changed(auxiliary=None)
    assert model.model_id == load("mantis").model_id
    alone = replay_report(replay(recording.path, model))
    assert alone.topics.meter == "/power_meter"  # not one of those of the loads
    assert alone.auxiliary is None
    assert alone.energy == report.energy


def test_processes_change_nothing(report, recording):
    other = replay_report(replay(recording.path, load(str(CELL)), ReplaySetup(processes=3)))
    assert other.auxiliary == report.auxiliary
    assert other.inputs == report.inputs
    assert other.inputs["pump_meter_messages"].accepted == 40


def test_without_their_topics_loads_are_unknown_and_said_so(recording, tmp_path):
    profile = load_profile("mantis")
    rig = VirtualRig(profile, Program([[0.0, 0.0, 0.0]], limits_of(profile), 5.0), None, 3)
    plain = record(rig, 5.0, tmp_path / "plain")
    found = replay_report(replay(plain.path, load(str(CELL))))
    loads = {one.name: one for one in found.auxiliary.loads}
    assert loads["pump"].energy is None
    assert loads["pump"].missing_ns == found.time.observed_ns
    assert found.auxiliary.balanced_ns == 0
    assert any("auxiliary/pump/power" in note for note in found.notes)
    assert sum("is not known for" in problem for problem in found.problems) == 2


def limits_of(profile):
    return profile.motion_limits(profile.mechanics()[0])


def test_inputs_name_topics_and_scale(recording, tmp_path):
    """The same parameters as those of the meter, here half the power."""
    file = tmp_path / "inputs.yaml"
    file.write_text(
        "/**:\n  ros__parameters:\n    auxiliary_meters: [pump, oven]\n"
        "    pump.topic: auxiliary/pump/power\n    pump.scale: 0.5\n    oven.topic: oven\n"
        "    auxiliary_states: [swapped]\n    swapped.load: pump\n"
        "    swapped.topic: auxiliary/extruder/state\n"
    )
    inputs, _ = read_inputs(file)
    found = replay_report(replay(recording.path, load(str(CELL)), ReplaySetup(inputs=inputs)))
    loads = {one.name: one for one in found.auxiliary.loads}
    truth = recording.auxiliary_energy["pump"]
    assert loads["pump"].known_energy == pytest.approx(0.5 * truth, rel=0.01)
    assert found.inputs["pump_state_messages"] == found.inputs["extruder_state_messages"]
    assert any("'oven', which the model lacks" in note for note in found.notes)


def test_commands_show_loads_and_outlet(recording, tmp_path, capsys):
    page, figures = tmp_path / "page.html", tmp_path / "figures.json"
    bag = str(recording.path)
    assert main(["replay", bag, "--model", str(CELL), "--json", str(figures),
                 "--report", str(page)]) == 0  # fmt: skip
    shown = capsys.readouterr().out
    assert "Loads outside of the cabinet" in shown
    assert "from the outlet" in shown
    data = json.loads(figures.read_text())["auxiliary"]
    assert [one["name"] for one in data["loads"]] == ["pump", "extruder", "panel"]
    text = page.read_text()
    assert "Outlet" in text
    assert "extruder" in text


def test_predictions_take_given_states():
    model, profile = load(str(CELL)), load_profile("mantis")
    program = random_program(limits_of(profile), 1, 2)
    motion = SampledMotion(program, model.joint_names, program.period)
    found = prediction_report(
        predict(model, motion, 25.0, auxiliary={"pump": "on", "extruder": "works"})
    )
    loads = {one.name: one for one in found.auxiliary.loads}
    seconds = found.time.predicted_time
    assert loads["pump"].energy == pytest.approx(800.0 * seconds)
    assert loads["extruder"].energy == pytest.approx(200.0 * seconds)
    unsaid = prediction_report(predict(model, motion, 25.0))
    assert unsaid.auxiliary.loads[0].energy is None  # nobody said whether the pump runs
    with pytest.raises(MotionError, match="has no state 'fast'"):
        predict(model, motion, 25.0, auxiliary={"pump": "fast"})
    with pytest.raises(MotionError, match="no auxiliary load 'oven'"):
        predict(model, motion, 25.0, auxiliary={"oven": "on"})


def test_the_model_file_keeps_loads_and_refuses_wrong_ones(tmp_path):
    model = load(str(CELL))
    save(model, tmp_path / "copy.yaml")
    copy = load(str(tmp_path / "copy.yaml"))
    assert copy.auxiliary == model.auxiliary
    assert copy.model_id == model.model_id != load("mantis").model_id
    text = CELL.read_text().replace("../../", f"{ROOT}/src/")
    for old, new, what in (
        ("name: panel", "name: pump", "repeat"),
        ("name: panel", "name: 2nd panel", "auxiliary"),
        ("metered: true", "state: idle", "expected one of"),
    ):
        wrong = tmp_path / "wrong.yaml"
        wrong.write_text(text.replace(old, new, 1))
        with pytest.raises(ModelFileError, match=what):
            load(str(wrong))


def test_simulate_records_them(tmp_path, capsys):
    bag = Path(tmp_path) / "cell"
    assert main(["simulate", "--robot", "mantis", "--auxiliary", "--duration", "3",
                 "--out", str(bag)]) == 0  # fmt: skip
    assert "/auxiliary/pump/power" in capsys.readouterr().out
