"""Deliberate mistakes in a recording of the virtual rig are named; a sound one raises none."""

import json

import pytest

from mistakes import mistakes, rewrite
from places import ROOT
from robot_energy.blocks import EffortMeaning
from robot_energy.check import check
from robot_energy.cli import main
from robot_energy.model import load, validate

SOUND = ROOT / "bags/kr16_cold"
SECONDS = 15.0
JOINT, OTHER = 2, 4
NAMES = load("kr16").joint_names
CASES = mistakes(JOINT, OTHER, len(NAMES))
OF_JOINT = ("torque_sign", "joint_sign", "zero_offset")


def changed(change):
    """The model with one change of its plain values."""
    model = load("kr16")
    data = model.model_dump(exclude_none=True, mode="json")
    data["urdf"] = {"xml": model.urdf_xml}
    change(data)
    return validate(data, "changed")


@pytest.mark.parametrize("name", ["kr16_cold", "kr16_warm"])
def test_a_sound_recording_has_no_mistake(name):
    result = check(ROOT / "bags" / name, load("kr16"), EffortMeaning.MOTOR_TORQUE)
    assert not [entry for entry in result.findings if entry.severity != "note"]
    assert len(result.checked) == 5


@pytest.mark.parametrize("name", CASES)
def test_a_mistake_is_named(name, tmp_path):
    cause, states, meter = CASES[name]
    bag = rewrite(SOUND, tmp_path / "bag", states, meter, SECONDS)
    found = check(bag, load("kr16"), EffortMeaning.MOTOR_TORQUE).errors
    assert found[0].cause == cause
    assert {entry.cause for entry in found} == {cause}  # and nothing else is blamed
    if cause in OF_JOINT and "all" not in name:
        assert found[0].subject == (NAMES[JOINT],)
    if cause == "joint_order":
        assert set(found[0].subject) == {NAMES[JOINT], NAMES[OTHER]}


def test_the_size_of_a_mistake_is_found(tmp_path):
    sizes = {
        "zero offset 0.1 rad": 0.1,
        "torque scale sqrt 2": 2**0.5,
        "meter clock 0.3 s": 0.3,
    }
    for name, size in sizes.items():
        _, states, meter = CASES[name]
        bag = rewrite(SOUND, tmp_path / name.replace(" ", "_"), states, meter, SECONDS)
        first = check(bag, load("kr16"), EffortMeaning.MOTOR_TORQUE).errors[0]
        assert first.evidence == pytest.approx(size, rel=0.15)


@pytest.mark.parametrize("joint", [0, 2, 4])
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_wrong_gear_ratio_is_named(joint, factor):
    def gears(data):
        data["joints"][joint]["gear_ratio"]["value"] *= factor

    found = check(SOUND, changed(gears), EffortMeaning.MOTOR_TORQUE).errors
    assert [(entry.cause, entry.subject) for entry in found] == [("gear_ratio", (NAMES[joint],))]
    assert found[0].evidence == pytest.approx(factor)


@pytest.mark.parametrize("mass", [12.5, 18.0])
def test_a_wrong_payload_is_named_with_its_size(mass):
    def payload(data):
        data["payload"][0]["mass"] = mass

    found = check(SOUND, changed(payload), EffortMeaning.MOTOR_TORQUE).errors
    assert [entry.cause for entry in found] == ["payload"]
    assert found[0].evidence == pytest.approx(15.0 - mass, abs=1.2)


def test_joint_torque_stated_for_motor_torque_is_named():
    found = check(SOUND, load("kr16"), EffortMeaning.JOINT_TORQUE).errors
    assert [entry.cause for entry in found] == ["effort_meaning"]


def test_without_torque_the_other_checks_are_made():
    result = check(SOUND, load("kr16"))
    assert set(result.skipped) == {"torque"}
    assert not result.errors
    assert "no_torque" in {entry.cause for entry in result.findings}


def test_the_command_prints_findings_and_ends_with_two(tmp_path, capsys):
    _, states, meter = CASES["sign of all torques"]
    bag, out = rewrite(SOUND, tmp_path / "bag", states, meter, SECONDS), tmp_path / "check.json"
    arguments = ["check", str(bag), "--model", "kr16", "--effort", "motor_torque"]
    assert main([*arguments, "--json", str(out)]) == 2
    assert "opposite sign" in capsys.readouterr().out
    [recording] = json.loads(out.read_text())["recordings"]
    assert recording["findings"][0]["cause"] == "torque_sign"
    assert main(["check", str(SOUND), "--model", "kr16", "--effort", "motor_torque"]) == 0
