"""Sound recordings of foreign robots are not blamed; what is wrong with them is named."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from mistakes import mistakes, rewrite, shifted
from places import ROOT
from refusals import refused
from robot_energy.foundation.errors import ImplausibleIdentificationError
from robot_energy.model import load
from robot_energy.model.figure import PositiveFigure
from robot_energy.pipeline import Output, Settings
from robot_energy.replay.bag_replay import replay
from robot_energy.replay.setup import ReplaySetup
from robot_energy.timeline.blocks import EffortMeaning
from robot_energy_identify.api.identify import identify_friction
from robot_energy_identify.check import check, check_together
from robot_energy_identify.check.evidence import MAX_SAMPLES, Windows
from robot_energy_identify.check.torque import check_torque, clearly_likelier
from robot_energy_identify.data.recordings import read_recording
from robot_energy_identify.refused_recordings import torque_evidence
from sound_recordings import foreign, on_the_rig, with_remedy, write_states

SOUND, MODEL = ROOT / "bags/kr16_cold", load("kr16")
MOTOR_TORQUE = EffortMeaning.MOTOR_TORQUE
SECONDS = 15.0


def causes(result):
    return {one.cause for one in result.findings}


def noisy(size):
    """A change of messages to an effort that is noise."""
    noise = np.random.default_rng(0)

    def change(message):
        message.effort = noise.normal(0.0, size, len(message.effort))

    return change


def source(result):
    (note,) = [one.sentence for one in result.findings if one.cause == "effort_source"]
    return note


@pytest.mark.parametrize(
    ("robot", "seed", "words"),
    [
        pytest.param("arm6", 202, "computed from the motor current", marks=pytest.mark.long),
        ("ur10e", 201, "measured behind the gear"),
    ],
)
def test_bodies_of_a_urdf_that_are_off_are_not_blamed_on_anything(robot, seed, words, tmp_path):
    """Masses by 8 %, centres by 12 mm, rotors by half; the driver sends joint torque."""
    one = foreign(robot, seed, "pick", tmp_path)
    result = check(one.bag, one.model, one.effort)
    assert not result.errors
    assert words in source(result)


@pytest.mark.long
def test_a_payload_of_two_kilograms_is_named_with_such_bodies(tmp_path):
    one = foreign("ur5e", 203, "random", tmp_path, carried=2.0)
    (found,) = check(one.bag, one.model, one.effort).errors
    assert found.cause == "payload"
    assert found.evidence == pytest.approx(2.0, abs=0.6)
    assert " +- " in found.sentence
    model, _ = with_remedy(found, one.model, tmp_path)
    assert not check(one.bag, model, one.effort).errors


@pytest.fixture(scope="module")
def ur5e(tmp_path_factory):
    return on_the_rig("ur5e", 1, tmp_path_factory.mktemp("ur5e"))


def test_a_robot_of_another_size_with_the_same_joint_names_is_named(ur5e):
    """One scale explains the torque of a UR5e nearly as well as the bodies of a UR5e do."""
    one = ur5e
    (found,) = check(one.bag, load("ur10e"), one.effort).errors
    assert found.cause == "other_robot"
    assert "the shipped model ur5e" in found.sentence
    assert "take ur5e as the model" in found.remedy
    assert not check(one.bag, one.model, one.effort).errors
    with refused(ImplausibleIdentificationError, found="ur5e", remedy="take ur5e as the model"):
        identify_friction(one.bag, load("ur10e"), "motor_current")


def test_a_robot_with_two_mistakes_is_not_another_robot(tmp_path):
    """The search ends where the first is open; the bodies of a UR10e fit better, but not well."""
    one = foreign("ur5e", 203, "random", tmp_path, carried=3.0)
    bag = rewrite(one.bag, tmp_path / "shifted", shifted(1, 0.3), None)
    assert "other_robot" not in causes(check(bag, one.model, one.effort))


def test_effort_that_is_no_torque_is_not_that_of_another_robot(tmp_path):
    one = on_the_rig("ur5e", 2, tmp_path)
    result = check(rewrite(one.bag, tmp_path / "noisy", noisy(2.0), None), one.model, one.effort)
    assert "torque_unexplained" in causes(result)
    assert "other_robot" not in causes(result)


def test_a_model_without_torque_constants_is_not_that_of_a_recorded_current(tmp_path):
    """The KR 16 has none: no torque of it is known, which costs nothing."""
    constant = PositiveFigure(value=1.0, tag="assumed")
    model = MODEL.with_joints("torque_constant", dict.fromkeys(MODEL.joint_names, constant))
    model = model.changed(robot=model.robot.model_copy(update={"type": "KUKA KR 10"}))
    bag = rewrite(SOUND, tmp_path / "bag", noisy(3.0), None, SECONDS)
    assert "other_robot" not in causes(check(bag, model, EffortMeaning.MOTOR_CURRENT))


def test_another_robot_is_not_named_against_one_of_the_recordings(ur5e, tmp_path):
    wrong = load("ur10e")
    small, large = (
        torque_evidence(read_recording(one.bag, wrong, one.effort), one.effort)
        for one in (ur5e, on_the_rig("ur10e", 1, tmp_path))
    )
    for parts, named in (((small,), True), ((small, large), False)):
        found, _ = check_torque(small, [part.thinned() for part in parts])
        assert ("other_robot" in {one.cause for one in found}) is named


def test_velocities_that_are_held_blame_nothing_else(tmp_path):
    """At a twentieth of the rate their slope is a staircase, and all torques are wrong."""
    seen = []

    def held(message):
        seen.append(message.velocity.copy())
        message.velocity = seen[(len(seen) - 1) // 20 * 20]

    bag = rewrite(SOUND, tmp_path / "bag", held, None, SECONDS)
    result = check(bag, MODEL, MOTOR_TORQUE)
    assert [one.cause for one in result.findings if one.severity != "note"] == ["velocity_held"]
    assert result.skipped["torque"] == "correct velocity_held first"


@pytest.fixture(scope="module")
def off(tmp_path_factory):
    """A recording with the zero of a joint off."""
    mistake = mistakes(2, 4, 6)["zero offset 0.1 rad"]
    folder = tmp_path_factory.mktemp("off")
    return rewrite(SOUND, folder / "bag", mistake.states, None, SECONDS)


def test_a_cause_that_all_recordings_show_is_blamed_in_all(off):
    results = check_together([off, off], MODEL, MOTOR_TORQUE)
    for result in results:
        (found,) = result.errors
        assert (found.cause, found.subject) == ("zero_offset", ("joint_a3",))
        assert found.evidence == pytest.approx(0.1, rel=0.15)


@pytest.mark.long
def test_a_cause_that_one_recording_shows_against_the_others_is_not_blamed(off):
    sound, other = check_together([SOUND, off], MODEL, MOTOR_TORQUE)
    assert not sound.errors
    assert not other.errors
    (found,) = [one for one in other.findings if one.cause == "zero_offset"]
    assert "the 2 recordings together do not show it" in found.sentence
    assert not found.remedy


def test_two_causes_that_explain_the_same_are_named_and_none_is_blamed(tmp_path):
    """Around a vertical axis alone, the sign of a torque and of the motion are one mistake."""
    time = np.arange(6000) / 200
    position = np.zeros((6000, 6))
    position[:, 0] = 1.2 * np.sin(1.5 * time) + 0.2 * np.sin(4.0 * time)
    velocity = np.gradient(position, time, axis=0)
    inertia = 60.0
    torque = np.gradient(velocity, time, axis=0) * [[inertia / 125.0, 0, 0, 0, 0, 0]]
    torque[:, 0] += 0.6 * np.sign(velocity[:, 0]) + 0.004 * 125 * velocity[:, 0]
    torque += np.random.default_rng(1).normal(scale=0.02, size=torque.shape)
    write_states(tmp_path / "bag", MODEL.joint_names, 200, position, -torque)
    result = check(tmp_path / "bag", MODEL, MOTOR_TORQUE)
    assert not result.errors
    found = next(one for one in result.findings if one.alternatives)
    assert {found.cause, *found.alternatives} >= {"torque_sign", "joint_sign"}
    assert found.sentence.startswith("this recording does not distinguish: ")
    assert not found.remedy_in


def test_a_long_recording_is_kept_in_windows_that_are_spread_over_it():
    outputs: list[Output] = []
    replay(
        SOUND, MODEL, ReplaySetup(settings=Settings(power_period=None)), on_output=outputs.append
    )
    length = 45_000_000_000
    windows, samples, rounds = Windows(MODEL), 0, 0
    while samples < 4 * MAX_SAMPLES:
        for output in outputs:
            later = {
                name: replace(block, stamp_ns=block.stamp_ns + rounds * length)
                for name in ("torque", "power", "meter")
                if (block := getattr(output, name)) is not None
            }
            windows.take(Output(**later))
            samples += len(later.get("torque", ()))
        rounds += 1
    torque, power, meter = windows.blocks()
    assert MAX_SAMPLES / 3 < len(torque) <= MAX_SAMPLES
    assert torque.joint_torque_rigid.size == 0  # what no check needs is not kept
    middle = np.searchsorted(torque.stamp_ns, torque.stamp_ns[0] + rounds * length / 2)
    assert middle / len(torque) == pytest.approx(0.5, abs=0.1)
    assert len(power) == pytest.approx(len(torque), rel=0.01)
    gap = np.flatnonzero(np.diff(torque.stamp_ns) > 5e9)
    assert len(gap) > 3
    assert (np.diff(torque.segment)[gap] != 0).all()
    assert (np.diff(meter.stamp_ns) > 5e9).any()


@pytest.mark.parametrize(
    ("gain", "joints", "named"), [(12.1, 6, True), (11.9, 6, False), (99.0, 5, False)]
)
def test_another_robot_must_be_clearly_likelier_by_the_torque_of_the_same_joints(
    gain, joints, named
):
    """A joint whose torque a model does not give costs nothing."""

    def fit(cost, known=6):
        return SimpleNamespace(cost=cost, known=np.arange(6) < known)

    fits = {"ur3e": fit(100.0 - gain, joints), "ur10e": fit(200.0)}
    assert clearly_likelier(fits, fit(100.0)) == ("ur3e" if named else "")
