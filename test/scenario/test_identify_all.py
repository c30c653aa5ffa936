"""One command from recordings to a model file and a report, on a robot it does not know.

The plant is the two-link rig; the model file it begins with has other friction, other
losses and no drives. Everything that is compared was held out.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mistakes import delayed, metered, rewrite
from pages import read
from places import ROOT
from plants import PROGRAM, two_link_profile
from robot_energy.model import load
from robot_energy.pipeline import Settings
from robot_energy.replay.bag_replay import replay
from robot_energy.replay.setup import ReplaySetup
from robot_energy.results.replay import replay_report
from robot_energy.timeline.blocks import EffortMeaning
from robot_energy_cli.main import main
from robot_energy_identify.api.evaluate import evaluate
from robot_energy_identify.api.identify import identify_all, identify_cabinet
from robot_energy_rig import RigConfig, VirtualRig
from robot_energy_rig.record import record
from terminal_tables import WIDTHS, lost, recorded_tables

TEMPERATURES = (25, 55, 70)
UNSEEN = 40


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    where = tmp_path_factory.mktemp("campaign")
    profile = two_link_profile(where)
    for number, degc in enumerate((*TEMPERATURES, UNSEEN)):
        rig = VirtualRig(profile, PROGRAM, RigConfig(), number, float(degc), rate_hz=100.0)
        record(rig, 20.0, where / f"at_{degc}")
    return where


@pytest.fixture(scope="module")
def outcome(folder: Path) -> Path:
    """The command, once."""
    bags = [str(folder / f"at_{degc}") for degc in TEMPERATURES]
    model = ["--model", str(folder / "two_link.yaml"), "--effort", "motor_torque"]
    test = ["--test", str(folder / f"at_{UNSEEN}")]
    names = (("--out", "model.yaml"), ("--report", "report.html"), ("--json", "report.json"))
    files = [word for option, name in names for word in (option, str(folder / name))]
    with recorded_tables() as tables:
        assert main(["identify", "all", *bags, *model, *test, *files, "--details"]) == 0
    assert len(tables) > 10
    for columns, rows, total in tables:
        for width in WIDTHS:
            assert not lost(columns, rows, total, width), (columns, width)
    return folder


def error(bag: Path, model: Path) -> float:
    settings = Settings(effort=EffortMeaning.MOTOR_TORQUE)
    comparison = replay_report(replay(bag, load(model), ReplaySetup(settings=settings))).comparison
    return float(comparison.predicted_minus_measured_relative)


def test_the_model_file_predicts_an_unseen_run_at_an_unseen_temperature(outcome: Path) -> None:
    unseen = outcome / f"at_{UNSEEN}"
    before, after = (error(unseen, outcome / name) for name in ("two_link.yaml", "model.yaml"))
    assert abs(before) > 0.3
    assert abs(after) < 0.01
    known = json.loads((outcome / "report.json").read_text())
    (entry,) = known["energy"]["tested"]
    for stage, error_ in (("given", before), ("capacitor", after)):
        predicted = entry["predictions"][stage]["energy"]
        assert predicted / entry["measured"] - 1.0 == pytest.approx(error_)
        assert known["mean_error"][stage] == pytest.approx(abs(error_))
    joints = evaluate(unseen, outcome / "model.yaml", effort="motor_torque").together[0].all_joints
    assert joints is not None
    off = (entry["predictions"]["capacitor"]["shaft"] - entry["shaft"]) / entry["shaft_either_way"]
    # which leaves out the first samples, whose acceleration is not known
    assert off == pytest.approx(joints.shaft_energy_relative, rel=0.05)


def test_the_report_is_whole_and_says_everything(outcome: Path) -> None:
    page = (outcome / "report.html").read_text()
    reader = read(page)
    for title in (
        "In short",
        "What was read",
        "Dynamics",
        "Friction over",
        "Drives",
        "Energy of the DC link",
        "Energy on",
    ):
        assert title in page
    for name in ("at_25", "at_40", "dynamics", "friction", "viscous elbow", "elbow Coulomb"):
        assert any(name in cell for cell in reader.cells), name
    assert page.count("<img ") == 3  # friction, DC link, power
    assert "virtual rig" in page
    assert "readings lie inside rest" in page  # why the cabinet was left as it is
    assert "robot-energy identify all" in page
    assert "weakly excited: 95 % interval wider" in page
    model = load(outcome / "model.yaml")
    assert all(name in page for name in model.provenance.bags)


def test_weakly_excited_parameters_are_those_whose_interval_exceeds_them(outcome: Path) -> None:
    steps = json.loads((outcome / "report.json").read_text())["steps"]
    found = {step["subject"]: step for step in steps}
    parameters = found["dynamics"]["found"]["base_parameters"]
    for entry in parameters:
        assert entry["weakly_excited"] == (abs(entry["value"]) < entry["interval_95"])
    assert any(entry["weakly_excited"] for entry in parameters)
    assert not found["cabinet"]["taken"]
    assert "record at least ten seconds of rest" in found["cabinet"]["reason"].lower()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (
            ["BAG", "--skip", "dynamics", "friction", "cabinet", "drives", "capacitor", "thermal"],
            "leaves nothing",
        ),
        (["BAG", "--test", "BAG"], "named twice"),
        (["BAG", "--test", "BAG", "--no-test"], "exclude each other"),
        (["BAG", "--drive-joints", "elbow"], "without --drive-power"),
        (["BAG", "--skip", "drives", "cabinet", "capacitor"], "nothing can be identified"),
        (["BAG", "--report", "."], "which is a folder"),
        (["none"], "none"),
    ],
)
def test_what_cannot_be_done_is_refused_in_one_sentence(
    folder: Path, capsys: pytest.CaptureFixture[str], words: list[str], sentence: str
) -> None:
    bag = str(folder / "at_25")
    words = [bag if word == "BAG" else word for word in words]
    assert main(["identify", "all", *words, "--model", str(folder / "two_link.yaml")]) == 2
    found = capsys.readouterr().err
    assert found.startswith("robot-energy: ")
    assert found.count("\n") == 1
    assert sentence in found


@pytest.mark.parametrize("subject", ["friction", "dynamics", "drives"])
def test_single_commands_write_reports_too(folder: Path, tmp_path: Path, subject: str) -> None:
    bags = [str(folder / f"at_{degc}") for degc in TEMPERATURES]
    model = ["--model", str(folder / "two_link.yaml"), "--effort", "motor_torque"]
    report = tmp_path / "page.html"
    words = ["identify", subject, *bags, *model, "--json", str(tmp_path / "x.json")]
    assert main([*words, "--report", str(report)]) == 0
    page = report.read_text()
    assert read(page).cells
    assert f"robot-energy identify {subject}" in page
    assert json.loads((tmp_path / "x.json").read_text())


def test_a_meter_clock_that_is_off_in_one_recording_changes_little(tmp_path):
    bags = [
        rewrite(ROOT / "bags" / f"drawn_train_{name}", tmp_path / name, None, seconds=24.0)
        for name in ("cold", "middle", "warm")
    ]
    late = rewrite(bags[2], tmp_path / "late", None, delayed(0.4))
    others = ("dynamics", "friction", "drives", "capacitor", "thermal")

    def found(paths: list[Path]) -> tuple[float, str]:
        whole = identify_all(paths, "kr16", "motor_torque", held_out=False, skip=others)
        cabinet = whole.model.cabinet
        return cabinet.loss_grid.value + cabinet.loss_dc.value, json.dumps(whole.to_dict())

    (sound, said), (off, said_off) = found(bags), found([*bags[:2], late])
    assert off == pytest.approx(sound, rel=0.01)
    assert "its meter is" not in said
    moved = "late: its meter is 0.4"
    assert moved in said_off
    assert moved in json.dumps(identify_cabinet([*bags[:2], late], "kr16").to_dict())


def test_a_model_that_misses_the_energy_of_its_own_recordings_says_so(outcome, tmp_path):
    """A meter that reads 1.5 times as much in one of them."""
    own = "of its own fit"
    assert own not in (outcome / "report.json").read_text()
    bags = [outcome / f"at_{degc}" for degc in TEMPERATURES]
    off = rewrite(bags[2], tmp_path / "off", None, metered("power", 1.5))
    model = outcome / "two_link.yaml"
    found = identify_all([*bags[:2], off], model, "motor_torque", held_out=False).found
    assert [one for one in found.notes if own in one]
    skip = ("cabinet", "drives", "capacitor")
    found = identify_all([*bags[:2], off], model, "motor_torque", held_out=False, skip=skip).found
    assert not [one for one in found.notes if own in one]
