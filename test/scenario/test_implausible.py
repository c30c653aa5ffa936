"""Every command of identification refuses what no robot can be, and writes nothing."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import robots
from mistakes import metered, rewrite, scaled
from places import ROOT
from plants import LIMITS, two_link_profile
from refusals import refused
from robot_energy.foundation.errors import BagError, ImplausibleIdentificationError
from robot_energy.model import load
from robot_energy.replay.api import replay as replayed
from robot_energy.timeline.blocks import EffortMeaning, Float
from robot_energy_cli.main import main
from robot_energy_identify import refused_recordings
from robot_energy_identify.api.identify import identify_all, identify_friction
from robot_energy_identify.check.evidence import Evidence
from robot_energy_identify.check.finding import Finding
from robot_energy_identify.data.recordings import Recording, read_recording
from robot_energy_identify.refused_recordings import (
    notes_on_torque,
    refuse_motion,
    refuse_shared,
    refuse_torque,
    torque_evidence,
)
from robot_energy_plan.motion import Program
from robot_energy_rig import RigConfig, VirtualRig
from robot_energy_rig.record import record

VIA = np.array([[0.3, -1.0], [1.4, 0.8], [-0.6, 1.2]])
SHOULDER, ELBOW = 1.0, 1.0  # torque constants that leave the recorded torque as it is


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rig")
    slow = Program(VIA, LIMITS, dwell=1.5)  # long enough to read the meter at rest
    rig = VirtualRig(two_link_profile(folder), slow, RigConfig(), 0, 25.0, rate_hz=100.0)
    record(rig, 30.0, folder / "bag")
    return folder / "bag"


def model(
    folder: Path,
    constants: tuple[float, float],
    gears: tuple[float, float] = (1, 1),
    masses: str = "published",
) -> str:
    data = robots.two_link_data()
    if masses:
        data["urdf"]["tags"] = {"masses": masses}
    for joint, constant, gear in zip(data["joints"], constants, gears, strict=True):
        joint["torque_constant"] = robots.figure(constant)
        joint["gear_ratio"]["value"] *= gear
    path = folder / "model.yaml"
    path.write_text(yaml.safe_dump(data))
    return str(path)


def run(folder: Path, capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """The one sentence of a command that must refuse."""
    files = ("--out", "x.yaml"), ("--json", "x.json"), ("--report", "x.html")
    extra = [word for option, name in files for word in (option, str(folder / name))]
    assert main(["identify", *words, *extra]) == 2
    assert not list(folder.glob("x.*"))
    out, err = capsys.readouterr()
    assert err.startswith("robot-energy: ")
    assert err.count("\n") == 1
    assert "Traceback" not in out + err
    return err


@pytest.mark.parametrize("subject", ["all", "dynamics", "friction", "drives"])
@pytest.mark.parametrize(
    ("constants", "joints"),
    [((-1.0, -1.0), "all joints"), ((1.0, -1.0), "elbow"), ((-1.0, 1.0), "shoulder")],
)
def test_torque_of_the_wrong_sign(
    bag: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    subject: str,
    constants: tuple[float, float],
    joints: str,
) -> None:
    words = [subject, str(bag), "--model", model(tmp_path, constants), "--effort", "motor_current"]
    said = run(tmp_path, capsys, *words)
    assert f"torque of {joints} is opposite in sign" in said
    assert f"urn the sign of torque_constant of {joints} in the model file" in said


@pytest.mark.parametrize("subject", ["all", "dynamics", "friction"])
def test_one_gear_sign_wrong(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], subject: str
) -> None:
    path = model(tmp_path, (SHOULDER, ELBOW), (-1, 1))
    said = run(tmp_path, capsys, subject, str(bag), "--model", path, "--effort", "motor_torque")
    assert "torque of shoulder" in said
    assert "urn the sign of gear_ratio of" in said


@pytest.mark.parametrize(
    ("subject", "masses"),
    [("all", "published"), ("dynamics", "published"), ("friction", "published"),
     ("drives", "published"), ("all", "")],
)  # fmt: skip
@pytest.mark.parametrize(
    ("constants", "gears", "cause"),
    [
        ((2**0.5, 2**0.5), (1, 1), "1.41 times what the model expects"),
        ((1, 1), (0.5, 1), "of a gear ratio 2 times the model's"),
    ],
)
def test_what_a_fit_would_take_up_in_its_bodies_is_refused_with_its_cause(
    bag: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    subject: str,
    masses: str,
    constants: tuple[float, float],
    gears: tuple[float, float],
    cause: str,
) -> None:
    words = ["--model", model(tmp_path, constants, gears, masses), "--effort", "motor_current"]
    said = run(tmp_path, capsys, subject, str(bag), *words)
    assert cause in said
    assert "masses: assumed" in said


def test_bodies_that_are_a_guess_refuse_no_scale(bag: Path, tmp_path: Path) -> None:
    path = model(tmp_path, (2**0.5, 2**0.5), masses="assumed")
    words = ["identify", "friction", str(bag), "--model", path, "--effort", "motor_current"]
    assert main([*words, "--out", str(tmp_path / "x.yaml")]) == 0


def test_bodies_that_are_a_guess_leave_a_note(bag: Path, tmp_path: Path) -> None:
    path = model(tmp_path, (1, 1), (0.5, 1), masses="assumed")
    words = ["identify", "all", str(bag), "--model", path, "--effort", "motor_current"]
    words += ["--skip", "cabinet", "drives", "capacitor", "thermal"]
    out = tmp_path / "x.json"
    assert main([*words, "--no-test", "--json", str(out)]) == 0
    assert "of a gear ratio 2 times the model's" in str(json.loads(out.read_text())["notes"])


GEAR = Finding("gear_ratio", "error", ("elbow",), "the gear", 2.0)


@pytest.mark.parametrize(
    ("finding", "refused"),
    [
        (GEAR, True),
        (replace(GEAR, severity="warning", alternatives=("torque_scale",)), True),
        (replace(GEAR, severity="warning", alternatives=("torque_scale", "bodies")), False),
        (replace(GEAR, severity="warning"), False),
        (replace(GEAR, cause="payload"), False),
    ],
)
def test_what_only_mistakes_explain_is_refused(
    bag: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    finding: Finding,
    refused: bool,
) -> None:
    monkeypatch.setattr(refused_recordings, "check_torque", lambda *_: ([finding], ""))
    used, effort = load(model(tmp_path, (1.0, 1.0))), EffortMeaning.MOTOR_CURRENT
    parts = [torque_evidence(read_recording(bag, used, effort), effort)]
    if refused:
        with pytest.raises(ImplausibleIdentificationError, match="the gear"):
            refuse_torque(parts)
    else:
        assert refuse_torque(parts) == ("the gear",)


def evidence(path: Path) -> Evidence:
    effort = EffortMeaning.MOTOR_TORQUE
    return torque_evidence(read_recording(path, load("kr16"), effort), effort)


@pytest.fixture(scope="module")
def sound() -> list[Evidence]:
    names = ("cold", "middle", "warm")
    found = [evidence(ROOT / "bags" / f"drawn_train_{name}") for name in names]
    assert refuse_torque(found) == ()
    return found


@pytest.mark.parametrize(
    ("factor", "said"), [(1.25, "the torque of all joints is"), (0.0, "its torque is 0 throughout")]
)
def test_one_recording_with_another_torque_is_refused_by_name(
    factor: float, said: str, sound: list[Evidence], tmp_path: Path
) -> None:
    off = rewrite(ROOT / "bags/drawn_train_warm", tmp_path / "off", scaled(("effort",), factor))
    with pytest.raises(ImplausibleIdentificationError, match=f"off: {said}"):
        refuse_torque([*sound[:2], evidence(off)])
    too = rewrite(ROOT / "bags/drawn_train_cold", tmp_path / "too", scaled(("effort",), factor))
    with pytest.raises(ImplausibleIdentificationError, match=f"off: {said}.*too: {said}"):
        refuse_torque([*sound, *sound, evidence(off), evidence(too)])


def test_a_refusal_behind_a_fit_names_the_cause(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = model(tmp_path, (8.0, 8.0), masses="assumed")
    words = ["dynamics", str(bag), "--model", path, "--effort", "motor_current"]
    said = run(tmp_path, capsys, *words)
    assert "times the torque that those of the URDF" in said
    assert "The likeliest cause: the torque of all joints is" in said


def test_what_does_not_fit_in_a_test_recording_is_a_note(bag: Path, tmp_path: Path) -> None:
    def notes(factor: float, masses: str = "published") -> tuple[str, ...]:
        used = load(model(tmp_path, (factor, factor), masses=masses))
        effort = EffortMeaning.MOTOR_CURRENT
        parts = [torque_evidence(read_recording(bag, used, effort), effort)]
        return notes_on_torque(parts, "in the test: ")

    assert notes(1.0) == ()
    (note,) = notes(2**0.5)
    assert note.startswith("in the test: ")
    assert "the torque of all joints is 1.41 times" in note
    assert notes(1.0, "assumed") == ()


@pytest.mark.parametrize("subject", ["all", "dynamics", "friction", "cabinet", "drives"])
@pytest.mark.parametrize(
    ("factor", "cause"),
    [
        (0.0, "the velocity of shoulder stays 0 while its positions move"),
        (-1.0, "the velocity of shoulder has the opposite sign"),
        (180 / np.pi, "one of them is in degrees"),
    ],
)
def test_velocities_that_are_not_the_change_of_the_positions(
    bag: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    subject: str,
    factor: float,
    cause: str,
) -> None:
    """In one recording of two: each figure would take it up, and the model read much too low."""
    other = rewrite(bag, tmp_path / "other", scaled(("velocity",), factor))
    effort = [] if subject == "cabinet" else ["--effort", "motor_torque"]
    path = model(tmp_path, (SHOULDER, ELBOW))
    said = run(tmp_path, capsys, subject, str(bag), str(other), "--model", path, *effort)
    assert "robot-energy: other: " in said
    assert cause in said
    assert "joint_states: {velocity" in said


def test_readings_that_are_refused_are_named(bag: Path, tmp_path: Path) -> None:
    def unknown(message: Any) -> None:
        message.meaning = 0

    other = rewrite(bag, tmp_path / "other", None, unknown)
    path = model(tmp_path, (SHOULDER, ELBOW))
    (note,) = refuse_motion(
        read_recording(other, load(path), EffortMeaning.NONE), EffortMeaning.NONE
    )
    assert "other: of 299 messages of the power meter 299 unknown_meaning were refused" in note
    assert note in "; ".join(f"other: {one}" for one in replayed(other, path).report.notes)
    assert not refuse_motion(
        read_recording(bag, load(path), EffortMeaning.NONE), EffortMeaning.NONE
    )


@pytest.mark.parametrize("effort", [EffortMeaning.MOTOR_CURRENT, EffortMeaning.NONE])
def test_the_same_moments_in_two_recordings_are_refused(
    bag: Path, tmp_path: Path, effort: EffortMeaning
) -> None:
    """A part of one has another hash; the same motion another day has another torque."""
    used = load(model(tmp_path, (SHOULDER, ELBOW)))
    part = rewrite(bag, tmp_path / "part", None, None, 12.0)
    again = rewrite(bag, tmp_path / "again", scaled(("effort",), 1.01), metered("power", 1.01))
    whole, cut, day = (read_recording(path, used, effort) for path in (bag, part, again))
    refuse_shared([whole, day])
    with refused(BagError, found=("part hold the same 12 s",)):
        refuse_shared([day, whole, cut])
    refuse_shared([replace(one, meter=None) for one in (whole, day)])


@pytest.mark.parametrize("rest", [0.0, np.nan])
def test_torque_that_rests_or_is_missing_is_no_moment_of_two_recordings(
    bag: Path, tmp_path: Path, rest: float
) -> None:
    """Brakes hold both in the last 0.6 of the same stamps; they differ where torque is known."""
    used = load(model(tmp_path, (SHOULDER, ELBOW)))
    one = read_recording(bag, used, EffortMeaning.MOTOR_CURRENT)
    measured = one.torque.motor_torque_measured

    def with_torque(values: Float) -> Recording:
        return replace(one, torque=replace(one.torque, motor_torque_measured=values))

    begin = round(0.4 * len(measured))
    braked, other = measured.copy(), 1.01 * measured
    braked[begin:] = other[begin:] = rest
    refuse_shared([with_torque(braked), with_torque(other)])
    with refused(BagError, found="hold the same 12 s"):
        refuse_shared([with_torque(braked), with_torque(measured)])
    partly = measured.copy()
    partly[round(0.6 * len(measured)) :] *= 1.01
    with refused(BagError, found="hold the same 18 s"):
        refuse_shared([with_torque(partly), with_torque(measured)])
    without = with_torque(0.0 * measured)
    with refused(BagError, found="hold the same 30 s"):
        refuse_shared([without, without])
    missing = measured.copy()
    missing[:, 0] = np.nan
    with refused(BagError, found="hold the same 30 s"):
        refuse_shared([with_torque(missing), with_torque(missing)])


def test_a_test_with_moments_of_the_fit_is_refused(bag: Path, tmp_path: Path) -> None:
    used = load(model(tmp_path, (SHOULDER, ELBOW)))
    part = rewrite(bag, tmp_path / "part", None, None, 12.0)
    with refused(BagError, found="bag and part hold the same 12 s"):
        identify_all(bag, used, "motor_current", test=part)
    with refused(BagError, found="bag and part hold the same 12 s"):
        identify_friction([bag, part], used, "motor_current")


def test_temperatures_of_two_robots_are_named_where_a_model_is_identified(
    bag: Path, tmp_path: Path
) -> None:
    colder = itertools.cycle([0.0, 40.0])

    def change(message: Any) -> None:
        message.temperature_degc = message.temperature_degc - next(colder)

    others = {"ros2_energy_msgs/msg/MotorTemperatures": change}
    other = rewrite(bag, tmp_path / "other", None, None, others=others)
    path = model(tmp_path, (SHOULDER, ELBOW))
    (note,) = refuse_motion(
        read_recording(other, load(path), EffortMeaning.NONE), EffortMeaning.NONE
    )
    assert "two sensors or robots may share a topic" in note


def test_a_meter_that_shows_less_than_the_shafts_take(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parameters = tmp_path / "inputs.yaml"
    parameters.write_text("/**:\n  ros__parameters:\n    meter: {scale: 0.3}\n")
    words = ["--model", "kr16", "--inputs", str(parameters), "--effort", "motor_torque"]
    said = run(tmp_path, capsys, "all", str(ROOT / "bags/kr16_cold"), *words)
    assert "by the recorded torque, more than the" in said


def test_a_meter_of_the_wrong_sign(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parameters = tmp_path / "inputs.yaml"
    parameters.write_text("/**:\n  ros__parameters:\n    meter: {sign: load_negative}\n")
    path = model(tmp_path, (SHOULDER, ELBOW))
    said = run(tmp_path, capsys, "cabinet", str(bag), "--model", path, "--inputs", str(parameters))
    assert "where the robot takes about" in said
    assert "its sign is reversed" in said
