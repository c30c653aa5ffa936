"""Deliberate mistakes in a recording of the virtual rig are named; a sound one raises none."""

import json

import numpy as np
import pytest
import yaml

import robot_energy as re
from mistakes import both, delayed, mistakes, rewrite, scaled, turned
from places import ROOT
from robot_energy.foundation.errors import RobotEnergyError
from robot_energy.inputs.inputs_file import read_inputs
from robot_energy.model import load, validate
from robot_energy.timeline.blocks import EffortMeaning
from robot_energy_cli import main
from robot_energy_identify.check import check
from robot_energy_identify.check.finding import MODEL, PARAMETERS
from robot_energy_identify.check.torque_fit import TorqueFit
from robot_energy_identify.data.recordings import read_recording
from robot_energy_identify.refused_recordings import torque_evidence
from sound_recordings import mended, plain, read_with

SOUND = ROOT / "bags/kr16_cold"
SECONDS = 15.0
JOINT, OTHER = 2, 4
NOISIER = "standstill_velocity"  # is advised, as velocities of positions have more noise
MOTOR_TORQUE = EffortMeaning.MOTOR_TORQUE
NAMES = load("kr16").joint_names
CASES = mistakes(JOINT, OTHER, len(NAMES))
LONG = pytest.mark.long
# Tests of one remedy more and of the command name these two as well.
NAMED_AGAIN = ("sign of one torque", "sign of all torques")


def changed(change):
    """The model with one change of its plain values."""
    data = plain(load("kr16"))
    change(data)
    return validate(data, "changed")


def loud(result):
    return [entry.cause for entry in result.findings if entry.severity != "note"]


def misfit(bag, inputs=None):
    """Of torque and model; a cause is named where it takes 12 of it away."""
    recording = read_recording(bag, load("kr16"), MOTOR_TORQUE, inputs=inputs)
    return TorqueFit(torque_evidence(recording, MOTOR_TORQUE)).cost


@pytest.fixture(scope="module")
def sound_misfit(tmp_path_factory):
    bag = rewrite(SOUND, tmp_path_factory.mktemp("sound") / "bag", None, None, SECONDS)
    return pytest.approx(misfit(bag), abs=1.0)


@pytest.mark.parametrize("name", ["kr16_cold", "kr16_warm"])
def test_a_sound_recording_has_no_mistake(name):
    result = check(ROOT / "bags" / name, load("kr16"), MOTOR_TORQUE)
    assert not loud(result)
    assert len(result.checked) == 5
    unseen = {entry.cause: entry.subject for entry in result.findings}
    assert "joint_a1" in unseen["unjudged.zero_offset"]  # a vertical axis has no zero in gravity
    assert "joint_a2" not in unseen["unjudged.zero_offset"]


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=LONG if name in NAMED_AGAIN else ()) for name in CASES]
)
def test_a_mistake_is_named(name, sound_misfit, tmp_path):
    mistake = CASES[name]
    bag = rewrite(SOUND, tmp_path / "bag", mistake.states, mistake.meter, SECONDS)
    effort = MOTOR_TORQUE if mistake.states else EffortMeaning.NONE  # of the meter it says nothing
    found = check(bag, load("kr16"), effort).errors
    assert {entry.cause for entry in found} == {mistake.cause}  # and no other cause
    if mistake.joints:
        assert set(found[0].subject) == {NAMES[joint] for joint in mistake.joints}
    assert found[0].remedy_in == PARAMETERS
    inputs = read_with(found[0].remedy, tmp_path / "inputs.yaml")
    if mistake.states:
        assert misfit(bag, inputs) == sound_misfit
    else:
        assert not loud(check(bag, load("kr16"), effort, inputs))


def test_temperatures_of_two_robots_are_named(tmp_path):
    """Every second message is of a robot that is 40 K colder."""
    colder = [0.0]

    def change(message):
        message.temperature_degc = message.temperature_degc + colder[0]
        colder[0] = -40.0 - colder[0]

    others = {"ros2_energy_msgs/msg/MotorTemperatures": change}
    bag = rewrite(ROOT / "bags/kr16_warm", tmp_path / "bag", None, None, SECONDS, others)
    (found,) = [one for one in check(bag, load("kr16")).findings if one.cause == "temperature"]
    assert "two sensors or robots may share a topic" in found.sentence


def test_a_load_that_switches_is_named(tmp_path):
    """300 W of it, every ten seconds."""
    begin = []

    def change(message):
        begin.append(message.header.stamp.sec)
        message.power += 300.0 * ((message.header.stamp.sec - begin[0]) // 10 % 2)

    bag = rewrite(SOUND, tmp_path / "bag", None, change)
    (found,) = [one for one in check(bag, load("kr16")).findings if one.cause == "meter_step"]
    assert abs(found.evidence) == pytest.approx(300.0, rel=0.4)
    assert "another load" in found.sentence


def test_a_remedy_replaces_the_entry_that_is_there(tmp_path):
    """Read with one sign turned already, the line has both."""
    bag = rewrite(SOUND, tmp_path / "bag", turned("effort", [0, JOINT]), None, SECONDS)
    path = tmp_path / "inputs.yaml"
    path.write_text("/**: {ros__parameters: {joint_states: {effort: {sign: [-1, 1, 1, 1, 1, 1]}}}}")
    (found,) = check(bag, load("kr16"), MOTOR_TORQUE, read_inputs(path)[0]).errors
    assert found.subject == (NAMES[JOINT],)
    assert yaml.safe_load(found.remedy) == {
        "joint_states": {"effort": {"sign": [-1, 1, -1, 1, 1, 1]}}
    }


@pytest.mark.long
def test_the_size_of_a_mistake_is_found(tmp_path):
    sizes = {
        "zero offset 0.1 rad": 0.1,
        "torque scale sqrt 2": 2**0.5,
        "meter clock 0.3 s": 0.3,
    }
    for name, size in sizes.items():
        mistake, place = CASES[name], tmp_path / name.replace(" ", "_")
        bag = rewrite(SOUND, place, mistake.states, mistake.meter, SECONDS)
        first = check(bag, load("kr16"), MOTOR_TORQUE).errors[0]
        assert first.evidence == pytest.approx(size, rel=0.15)


@pytest.mark.parametrize(
    ("joint", "factor"),
    [
        (4, 2.0),
        *(
            pytest.param(*case, marks=LONG)
            for case in [(1, 0.5), (1, 2.0), (2, 0.5), (2, 2.0), (4, 0.5)]
        ),
    ],
)
def test_a_wrong_gear_ratio_is_named(joint, factor):
    def gears(data):
        data["joints"][joint]["gear_ratio"]["value"] *= factor

    model = changed(gears)
    found = check(SOUND, model, MOTOR_TORQUE).errors
    assert [(entry.cause, entry.subject) for entry in found] == [("gear_ratio", (NAMES[joint],))]
    assert found[0].evidence == pytest.approx(factor)
    assert found[0].remedy_in == MODEL
    gear, sound = (one.joints[joint] for one in (mended(found[0].remedy, model), load("kr16")))
    assert gear.gear_ratio.value == pytest.approx(sound.gear_ratio.value)


@pytest.mark.parametrize("mass", [pytest.param(11.0, marks=LONG), 19.0])
def test_a_wrong_payload_is_named_with_its_size(mass):
    def payload(data):
        data["payload"][0]["mass"] = mass

    model = changed(payload)
    found = check(SOUND, model, MOTOR_TORQUE).errors
    assert [entry.cause for entry in found] == ["payload"]
    assert found[0].evidence == pytest.approx(15.0 - mass, abs=1.0)
    assert not loud(check(SOUND, mended(found[0].remedy, model), MOTOR_TORQUE))


def test_a_small_payload_is_said_to_be_out_of_reach():
    def payload(data):
        data["payload"][0]["mass"] -= 0.5

    result = check(SOUND, changed(payload), MOTOR_TORQUE)
    assert not result.errors
    (note,) = [entry for entry in result.findings if entry.cause == "unjudged.payload"]
    assert 0.5 < note.evidence < 4.0


@pytest.mark.parametrize("stated", ["joint_torque", pytest.param("motor_current", marks=LONG)])
def test_motor_torque_stated_as_something_else_is_named(stated, tmp_path):
    def constants(data):
        for entry in data["joints"]:
            entry["torque_constant"] = {"value": 0.1, "tag": "assumed"}

    model = changed(constants)
    (found,) = check(SOUND, model, EffortMeaning(stated)).errors
    assert found.cause == "effort_meaning"
    assert found.remedy == "joint_states: {effort_meaning: motor_torque}"
    size = {"motor_current": 0.1, "joint_torque": 0.01}[stated]
    assert size / 3 < abs(found.evidence) < 3 * size
    without = check(SOUND, model)
    (hint,) = [entry for entry in without.findings if entry.cause == "effort_not_stated"]
    assert hint.remedy == found.remedy


def test_current_and_torque_of_a_cobot_are_distinguished(tmp_path):
    """A driver that sends torque where the setting says current, and the reverse."""
    model = load("kr16")
    ratios = np.array([joint.gear_ratio.value for joint in model.joints])

    def constants(data):
        for entry in data["joints"]:
            entry["torque_constant"] = {"value": 0.12, "tag": "assumed"}

    cobot = changed(constants)
    for factor, stated, right in (
        (1 / 0.12, "joint_torque", "motor_current"),
        (ratios, "motor_current", "joint_torque"),
    ):

        def send(message, factor=factor):
            message.effort = message.effort * factor

        bag = rewrite(SOUND, tmp_path / stated, send, None, SECONDS)
        (found,) = check(bag, cobot, EffortMeaning(stated)).errors
        assert found.cause == "effort_meaning"
        assert found.remedy == f"joint_states: {{effort_meaning: {right}}}"


def test_velocities_are_compared_with_positions(sound_misfit, tmp_path):
    for change, cause in (
        (turned("velocity", [JOINT]), "velocity_sign"),
        (scaled(("velocity",), 180 / np.pi, [JOINT]), "velocity_scale"),
    ):
        bag = rewrite(SOUND, tmp_path / cause, change, None, SECONDS)
        found = check(bag, load("kr16"), MOTOR_TORQUE).errors
        assert [(entry.cause, entry.subject) for entry in found] == [(cause, (NAMES[JOINT],))]
        inputs = read_with(found[0].remedy, tmp_path / f"{cause}.yaml")
        assert misfit(bag, inputs) == sound_misfit


def test_one_line_mends_the_velocities_of_all_joints(sound_misfit, tmp_path):
    bag = rewrite(SOUND, tmp_path / "bag", scaled(("velocity",), 180 / np.pi), None, SECONDS)
    (found,) = check(bag, load("kr16"), MOTOR_TORQUE).errors
    assert (found.cause, found.subject) == ("velocity_scale", NAMES)
    inputs = read_with(found.remedy, tmp_path / "inputs.yaml")
    assert misfit(bag, inputs) == sound_misfit


def test_rounded_stamps_are_no_scale_of_the_velocities_and_the_remedy_works(tmp_path):
    """Stamps in steps of 2.5 ms for states every 4 ms."""

    def rounded(message):
        stamp = message.header.stamp
        stamp.nanosec = round(stamp.nanosec / 2_500_000) * 2_500_000 % 1_000_000_000

    bag = rewrite(SOUND, tmp_path / "bag", rounded, None, SECONDS)
    found = check(bag, load("kr16"))
    assert "stamps_uneven" in loud(found)
    assert "velocity_scale" not in loud(found)
    (uneven,) = [one for one in found.findings if one.cause == "stamps_uneven"]
    inputs = read_with(uneven.remedy, tmp_path / "inputs.yaml")
    assert not loud(check(bag, load("kr16"), inputs=inputs))


def test_a_velocity_that_stays_zero_is_named_and_the_remedy_works(tmp_path):
    bag = rewrite(SOUND, tmp_path / "bag", scaled(("velocity",), 0.0, [JOINT]), None, SECONDS)
    found = check(bag, load("kr16")).errors
    assert [(entry.cause, entry.subject) for entry in found] == [("velocity_zero", (NAMES[JOINT],))]
    inputs = read_with(found[0].remedy, tmp_path / "inputs.yaml")
    assert loud(check(bag, load("kr16"), inputs=inputs)) == [NOISIER]


def test_velocities_that_are_held_are_named_and_the_remedy_works(tmp_path):
    """A driver that reads velocities at a tenth of its rate."""
    seen = []

    def held(message):
        seen.append(message.velocity.copy())
        message.velocity = seen[(len(seen) - 1) // 10 * 10]

    bag = rewrite(SOUND, tmp_path / "bag", held, None, SECONDS)
    found = check(bag, load("kr16"))
    assert loud(found) == ["velocity_held"]
    path = tmp_path / "inputs.yaml"
    inputs = read_with(found.findings[0].remedy, path)
    assert loud(check(bag, load("kr16"), inputs=inputs)) == [NOISIER]
    truth = re.replay(SOUND, "kr16", end=SECONDS).report.energy.net
    stepped, mended = (
        re.replay(bag, "kr16", **more).report.energy.net for more in ({}, {"inputs": path})
    )
    assert abs(mended / truth - 1) < 0.002 < 0.02 < abs(stepped / truth - 1)


def test_coarse_stamps_that_cost_joint_states_are_named_and_the_remedy_works(tmp_path):
    def coarse(message):
        message.header.stamp.nanosec -= message.header.stamp.nanosec % 20_000_000

    bag = rewrite(SOUND, tmp_path / "bag", coarse, None, 4.0)
    result = check(bag, load("kr16"))
    (error,) = result.errors
    assert error.cause == "joint_states_refused"
    assert "set joint_states.stamp_source to receive" in error.remedy
    (setting,) = [entry.remedy for entry in result.findings if entry.cause == "joint_states"]
    inputs = read_with(setting, tmp_path / "inputs.yaml")
    assert not check(bag, load("kr16"), inputs=inputs).errors


def test_torques_that_no_drive_has_are_named(tmp_path):
    """Velocities with much noise: their slope is noise."""
    random = np.random.default_rng(5)

    def noisy(message):
        message.velocity = message.velocity + random.normal(scale=0.2, size=len(NAMES))

    result = check(rewrite(SOUND, tmp_path / "bag", noisy, None, 6.0), load("kr16"))
    found = [entry for entry in result.findings if entry.cause == "torque_limit"]
    assert found
    assert "needs more than its torque limit in" in found[0].sentence
    assert "lengthen derivative_window" in found[0].remedy


def test_a_recording_without_a_usable_state_names_the_setting_or_the_fault(tmp_path):
    def prefixed(message):
        message.name = [f"left/{name}" for name in message.name]

    def short(message):
        message.velocity = message.velocity[:2]

    for change, words in ((prefixed, r"joint_names to \[left/joint_a1, "), (short, "one velocity")):
        bag = rewrite(SOUND, tmp_path / change.__name__, change, None, 1.0)
        with pytest.raises(RobotEnergyError, match=words):
            check(bag, load("kr16"))


def test_noise_at_rest_is_compared_with_the_standstill_velocity(tmp_path):
    random = np.random.default_rng(3)

    def noisy(message):
        message.velocity = message.velocity + random.normal(0.0, 3e-3, len(NAMES))

    bag = rewrite(SOUND, tmp_path / "bag", noisy, None, SECONDS)
    (found,) = [
        entry for entry in check(bag, load("kr16")).findings if entry.cause == "standstill_velocity"
    ]
    assert set(found.subject) == set(NAMES)
    assert found.evidence == pytest.approx(3e-3, rel=0.4)
    model = mended(found.remedy, load("kr16"))
    assert "standstill_velocity" not in loud(check(bag, model))


def test_a_meter_that_reads_far_more_or_less_than_the_robot_takes_is_named(tmp_path):
    def factor(value):
        def change(message):
            message.power *= value

        return change

    more = rewrite(SOUND, tmp_path / "more", None, factor(2.5), SECONDS)
    assert loud(check(more, load("kr16"))) == ["meter_exceeds"]
    less = rewrite(SOUND, tmp_path / "less", None, factor(0.25), SECONDS)
    assert "shafts_exceed_meter" in loud(check(less, load("kr16"), MOTOR_TORQUE))
    far = rewrite(SOUND, tmp_path / "far", None, factor(0.03), SECONDS)  # of no known unit
    result = check(far, load("kr16"))
    assert "unjudged.meter_unit" in {entry.cause for entry in result.findings}


def test_temperatures_in_degrees_fahrenheit_are_asked_about_where_they_show(tmp_path):
    def fahrenheit(message):
        message.temperature_degc = 1.8 * message.temperature_degc + 32.0

    kind = "ros2_energy_msgs/msg/MotorTemperatures"
    warm = ROOT / "bags/kr16_warm"
    bag = rewrite(warm, tmp_path / "bag", None, None, 8.0, others={kind: fahrenheit})
    (finding,) = [
        entry for entry in check(bag, load("kr16")).findings if entry.cause == "temperature_hot"
    ]
    assert finding.subject == NAMES
    inputs = read_with(
        "temperature_sources: [motors]\nmotors: {topic: motor_temperatures, unit: fahrenheit}",
        tmp_path / "inputs.yaml",
    )
    mended = check(bag, load("kr16"), inputs=inputs)
    assert "temperature_hot" not in loud(mended)


def test_temperatures_missing_of_a_joint_are_named(tmp_path):
    def without(message):
        message.temperature_degc = message.temperature_degc.copy()
        message.temperature_degc[JOINT] = float("nan")

    kind = "ros2_energy_msgs/msg/MotorTemperatures"
    bag = rewrite(SOUND, tmp_path / "bag", None, None, SECONDS, {kind: without})
    (found,) = [
        entry for entry in check(bag, load("kr16")).findings if entry.cause == "temperature_missing"
    ]
    assert found.subject == (NAMES[JOINT],)


@pytest.mark.parametrize("late", [-4.0, 7.3])
def test_a_clock_that_is_seconds_off_is_found(late, tmp_path):
    bag = rewrite(SOUND, tmp_path / "bag", None, delayed(late))
    (found,) = [one for one in check(bag, load("kr16")).findings if one.cause == "meter_clock"]
    assert found.evidence == pytest.approx(late, abs=0.1)


def test_a_delay_that_the_model_states_is_no_mistake_of_the_clock(tmp_path):
    bag = rewrite(SOUND, tmp_path / "bag", None, delayed(0.25), SECONDS)
    delay = {"delay": {"value": 0.25, "tag": "identified"}}
    stated = changed(lambda data: data.update(meter=delay))
    clocks = [
        [one for one in check(bag, model).findings if one.cause == "meter_clock"]
        for model in (load("kr16"), stated)
    ]
    assert [len(found) for found in clocks] == [1, 0]


def test_without_torque_the_other_checks_are_made():
    result = check(SOUND, load("kr16"))
    assert set(result.skipped) == {"torque"}
    assert not result.errors
    assert "no_torque" in {entry.cause for entry in result.findings}


def test_what_a_recording_of_two_seconds_cannot_show_is_said(tmp_path):
    backwards = both(turned("position", [JOINT]), turned("velocity", [JOINT]))
    bag = rewrite(SOUND, tmp_path / "bag", backwards, None, 2.0)
    result = check(bag, load("kr16"), MOTOR_TORQUE)
    said = {entry.cause for entry in result.findings}
    assert "unjudged.meter_clock" in said or "power meter" in result.skipped


def test_the_command_prints_findings_and_ends_with_two(tmp_path, capsys):
    turned_all = CASES["sign of all torques"]
    bag, out = (
        rewrite(SOUND, tmp_path / "bag", turned_all.states, None, SECONDS),
        tmp_path / "c.json",
    )
    arguments = ["check", str(bag), "--model", "kr16", "--effort", "motor_torque"]
    assert main([*arguments, "--json", str(out)]) == 2
    printed = capsys.readouterr().out
    assert "opposite sign" in printed
    assert "joint_states: {effort: {sign: [-1]}}" in printed
    assert "parameter file" in printed
    [recording] = json.loads(out.read_text())["recordings"]
    assert recording["findings"][0]["cause"] == "torque_sign"
    assert main(["check", str(SOUND), "--model", "kr16"]) == 0
