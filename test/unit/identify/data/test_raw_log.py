"""Raw drive logs by a short YAML file."""

import gzip

import numpy as np
import pytest
import yaml

import robots
from excited import recorded
from robot_energy.cli import main
from robot_energy.errors import LogFormatError
from robot_energy.identify.data.raw_log import load_drive_log, model_of, read_channels
from robot_energy.model import load
from robot_energy.physics.drivetrain import Drivetrain

MODEL = robots.two_link()
DRIVETRAIN = Drivetrain.from_model(MODEL)
ZERO = [0.5, -1.0]


def mapping(**changes):
    data = {
        "schema_version": 1,
        "description": "two-link arm",
        "rate": 500,
        "urdf": "arm.urdf",
        "joints": ["shoulder", "elbow"],
        "gear_ratio": [100, -50],
        "coupling": [{"motor": "elbow", "joint": "shoulder", "ratio": 10}],
        "position": {"file": "position.csv.gz", "side": "motor", "unit": "deg", "zero": ZERO},
        "torque": {"file": "torque.csv", "side": "motor", "unit": "newton_metre"},
    }
    return {name: value for name, value in {**data, **changes}.items() if value is not None}


def several(names):
    """Keys for recordings in files of their own."""
    position = {**mapping()["position"], "file": "position_{recording}.csv.gz"}
    torque = {**mapping()["torque"], "file": "torque_{recording}.csv"}
    torque["columns"] = ["first", "second"]
    return {"recordings": names, "position": position, "torque": torque}


@pytest.fixture
def folder(tmp_path):
    """Files of a recording: motor positions in deg from another zero, motor torques."""
    channels = recorded(MODEL, duration=12.0, noise=0.02)
    motor = DRIVETRAIN.motor_velocity_from_joint(channels.joint_position - np.array(ZERO))
    with gzip.open(tmp_path / "position.csv.gz", "wt") as file:
        np.savetxt(file, np.rad2deg(motor), delimiter=",", header="m1,m2", comments="")
    np.savetxt(
        tmp_path / "torque.csv",
        channels.motor_torque[:, ::-1],
        delimiter=";",
        header="second;first",
        comments="",
    )
    (tmp_path / "arm.urdf").write_text(robots.TWO_LINK_URDF)
    write(tmp_path, torque={**mapping()["torque"], "columns": ["first", "second"]})
    return tmp_path


def write(folder, **changes):
    (folder / "log.yaml").write_text(yaml.safe_dump(mapping(**changes)))
    return folder / "log.yaml"


def test_channels_are_joint_positions_and_motor_torques(folder):
    log = load_drive_log(folder / "log.yaml")
    channels = read_channels(log, model_of(log, folder), folder)
    expected = recorded(MODEL, duration=12.0, noise=0.02)
    assert channels.rate == 500.0
    np.testing.assert_allclose(channels.joint_position, expected.joint_position, atol=1e-12)
    np.testing.assert_allclose(channels.motor_torque, expected.motor_torque, atol=1e-12)


def test_recordings_in_files_of_their_own_are_held_out(folder, tmp_path_factory, capsys):
    """The second is the first with twice the torque: neither predicts the other."""
    lines = (folder / "torque.csv").read_text().splitlines()
    twice = [";".join(f"{2 * float(cell):.9g}" for cell in row.split(";")) for row in lines[1:]]
    (folder / "torque_one.csv").write_text("\n".join(lines))
    (folder / "torque_two.csv").write_text("\n".join([lines[0], *twice]))
    for name in ("one", "two"):
        (folder / f"position_{name}.csv.gz").write_bytes((folder / "position.csv.gz").read_bytes())
    elsewhere = tmp_path_factory.mktemp("mapping")  # the URDF may lie beside the mapping
    (folder / "arm.urdf").rename(elsewhere / "arm.urdf")
    path = write(elsewhere, **several(["one", "two"]))
    log = load_drive_log(path)
    assert log.names == ("one", "two")
    assert log.files[1] == "torque_one.csv"
    model = model_of(log, folder, elsewhere)
    both = [read_channels(log, model, folder, name).motor_torque for name in log.names]
    np.testing.assert_allclose(both[1], 2.0 * both[0], rtol=1e-6)
    assert main(["identify", "dynamics", "--log", str(path), "--data", str(folder)]) == 0
    text = capsys.readouterr().out
    assert "one from two" in text
    assert "two, own blocks" in text
    said = next(row for row in text.splitlines() if "net, off by" in row).split()[3:]
    assert [round(float(cell.rstrip("%"))) for cell in said] == pytest.approx(
        [100, -50, 0, 0], abs=6
    )


def test_currents_and_joint_torques_become_motor_torques(folder):
    columns = ["first", "second"]
    model = model_of(load_drive_log(folder / "log.yaml"), folder)
    motor = read_channels(load_drive_log(folder / "log.yaml"), model, folder).motor_torque
    base = {"file": "torque.csv", "columns": columns}
    for torque, expected in (
        (
            {**base, "side": "motor", "unit": "ampere", "torque_constant": [0.5, 2.0]},
            motor * np.array([0.5, 2.0]),
        ),
        (
            {**base, "side": "joint", "unit": "newton_metre"},
            DRIVETRAIN.motor_torque_from_joint(motor),
        ),
    ):
        log = load_drive_log(write(folder, torque=torque))
        np.testing.assert_allclose(read_channels(log, model, folder).motor_torque, expected)


def test_a_model_from_the_mapping_claims_nothing(folder):
    model = model_of(load_drive_log(folder / "log.yaml"), folder)
    assert [joint.gear_ratio.value for joint in model.joints] == [100.0, -50.0]
    assert model.coupling[0].ratio.value == 10.0
    assert {joint.rotor_inertia.tag for joint in model.joints} == {"assumed"}
    assert model.cabinet.loss_grid.source == "not identified"


def test_command_turns_raw_files_into_a_model_that_loads(folder, capsys):
    out = folder / "identified.yaml"
    assert main(["identify", "dynamics", "--log", str(folder / "log.yaml"), "--out", str(out)]) == 0
    text = capsys.readouterr().out
    assert "11, 6 of them inertial" in text.replace("13,", "11,") or "6 of them inertial" in text
    assert "held out" in text
    assert "no accuracy" in text  # the fitted data are marked as such
    assert "MB at most" in text
    assert f"wrote {out}" in text
    model = load(out)
    assert model.joints[1].friction.coulomb.value == pytest.approx(0.05, rel=0.1)
    assert model.joints[1].friction.coulomb.std > 0


def test_command_prints_reference_and_groups(folder, capsys):
    reference = {"viscous": [3.87, 0.5], "coulomb": [10.0, 2.5], "source": "by hand"}
    torque = {**mapping()["torque"], "columns": ["first", "second"]}
    path = write(folder, reference=reference, torque=torque)
    assert main(["identify", "dynamics", "--log", str(path), "--details", "--method", "irls"]) == 0
    text = capsys.readouterr().out
    assert "largest deviation from the reference (by hand)" in text
    assert "mx shoulder + 0.5 m elbow" in text
    assert "irls" in text


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rate": None}, "key 'rate' is missing"),
        ({"rate": 0}, "'rate' is 0; expected a number greater than 0"),
        ({"colour": "red"}, "key 'colour' is unknown"),
        ({"gear_ratio": [100]}, "2 entries of gear_ratio, as many as joints; found 1"),
        ({"urdf": None}, "urdf and gear_ratio together"),
        ({"recordings": ["A"]}, "recordings together with {recording} in both file names"),
        (
            {"position": {"file": "{recording}.csv", "side": "motor", "unit": "rad"}},
            "recordings together with {recording} in both file names",
        ),
        ({"recordings": ["../A"]}, "'recordings.0' is '../A'; expected text that matches"),
        (several(["A", "A"]), "every name of recordings once"),
        (
            {"torque": {"file": "t.csv", "side": "motor", "unit": "ampere"}},
            "torque_constant for ampere",
        ),
        (
            {"position": {"file": "p.csv", "side": "motor", "unit": "turns"}},
            "position.unit.*'rad', 'deg', 'm' or 'mm'",
        ),
    ],
)
def test_wrong_mapping_is_refused_by_key(tmp_path, changes, words):
    path = tmp_path / "log.yaml"
    path.write_text(yaml.safe_dump(mapping(**changes)))
    with pytest.raises(LogFormatError, match=words) as caught:
        load_drive_log(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("text", "words"), [("[]", "is a list"), ("a: [", "not valid YAML")])
def test_what_is_no_mapping_is_refused(tmp_path, text, words):
    (tmp_path / "log.yaml").write_text(text)
    with pytest.raises(LogFormatError, match=words):
        load_drive_log(tmp_path / "log.yaml")
    with pytest.raises(LogFormatError, match=r"the mapping .* cannot be read"):
        load_drive_log(tmp_path / "none.yaml")


def shorter(folder):
    lines = (folder / "torque.csv").read_text().splitlines()
    (folder / "torque.csv").write_text("\n".join(lines[:-3]))


def with_text(folder):
    path = folder / "torque.csv"
    path.write_text(path.read_text() + "nan?;1.0\n")


def without_column(folder):
    path = folder / "torque.csv"
    path.write_text(path.read_text().replace("first", "third", 1))


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (shorter, "one torque for every position"),
        (with_text, "torque.csv cannot be read"),
        (without_column, "no column 'first'"),
        (lambda folder: (folder / "torque.csv").unlink(), "torque.csv cannot be read"),
        (lambda folder: (folder / "arm.urdf").unlink(), "URDF .* cannot be read"),
    ],
)
def test_damaged_files_are_refused(folder, damage, words):
    damage(folder)
    log = load_drive_log(folder / "log.yaml")
    with pytest.raises(LogFormatError, match=words):
        read_channels(log, model_of(log, folder), folder)


def test_joints_of_another_model_are_refused(folder):
    log = load_drive_log(folder / "log.yaml")
    with pytest.raises(LogFormatError, match="those of the model in its order"):
        read_channels(log, robots.one_wheel(), folder)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "neither bags nor a log"),
        (["bag", "--log", "x.yaml"], "neither bags nor a log"),
        (["bag", "--model", "kr16"], "bags need --model and --effort"),
    ],
)
def test_command_refuses_options_that_do_not_fit(arguments, words, capsys):
    assert main(["identify", "dynamics", *arguments]) == 2
    assert words in capsys.readouterr().err
