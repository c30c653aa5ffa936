"""Logs of drives, identified from without a bag."""

import gzip
import re

import numpy as np
import polars as pl
import pytest
import yaml

import robots
from excited import recorded
from logbook import read_bag
from robot_energy.foundation.errors import LogFormatError
from robot_energy.model import load
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy_cli import main
from robot_energy_identify.data.log_channels import model_of, read_channels
from robot_energy_logs.log_import import import_log
from robot_energy_logs.mapping import LogMapping, load_mapping

MODEL = robots.two_link()
DRIVETRAIN = Drivetrain.from_model(MODEL)
ZERO = [0.5, -1.0]


def mapping(position=None, effort=None, **changes):
    """Motor positions and torques in files of their own; keys of either may be replaced."""
    data = {
        "schema_version": 1,
        "description": "two-link arm",
        "time": {"rate": 500},
        "robot": {
            "urdf": "arm.urdf",
            "gear_ratio": [100, -50],
            "coupling": [{"motor": "elbow", "joint": "shoulder", "ratio": 10}],
        },
        **changes,
    }
    data["joints"] = {
        "names": ["shoulder", "elbow"],
        "position": {
            "file": "position.csv.gz", "side": "motor", "unit": "deg", "zero": ZERO,
            **(position or {}),
        },
        "effort": {
            "file": "torque.csv", "columns": ["first", "second"], "side": "motor",
            "unit": "newton_metre", **(effort or {}),
        },
    }  # fmt: skip
    data["joints"]["effort"] = {k: v for k, v in data["joints"]["effort"].items() if v is not None}
    return {name: value for name, value in data.items() if value is not None}


def several(names):
    """Keys for recordings in files of their own."""
    return {
        "recordings": names,
        "position": {"file": "position_{recording}.csv.gz"},
        "effort": {"file": "torque_{recording}.csv"},
    }


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
    write(tmp_path)
    return tmp_path


def write(folder, **changes):
    (folder / "log.yaml").write_text(yaml.safe_dump(mapping(**changes)))
    return folder / "log.yaml"


def channels_of(path, folder, model=None):
    """The only stretch of every recording."""
    log = load_mapping(path)
    found = read_channels([folder], log, model or model_of(log, [folder]))
    return {name: part for name, (part,) in found.items()}


def test_channels_are_joint_positions_and_motor_torques(folder):
    (channels,) = channels_of(folder / "log.yaml", folder).values()
    expected = recorded(MODEL, duration=12.0, noise=0.02)
    assert channels.rate == 500.0
    np.testing.assert_allclose(channels.joint_position, expected.joint_position, atol=1e-12)
    np.testing.assert_allclose(channels.motor_torque, expected.motor_torque, atol=1e-12)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_one_table_with_a_clock_gives_the_same_channels(folder, suffix):
    """Time, positions and torques in one table; a pause of 2 s cuts it into two stretches."""
    expected = channels_of(folder / "log.yaml", folder)["position.csv.gz"]
    time = np.arange(len(expected.joint_position)) * 2_000_000
    time[3000:] += 2 * 10**9
    names = ["q_shoulder", "q_elbow", "first", "second"]
    values = np.hstack([expected.joint_position, expected.motor_torque])
    table = pl.DataFrame({"t": time, **dict(zip(names, values.T, strict=True))})
    path = folder / f"all{suffix}"
    (table.write_csv if suffix == ".csv" else table.write_parquet)(path)
    joints = mapping()["joints"]
    joints["position"] = {"column": "q_{joint}", "unit": "rad"}
    del joints["effort"]["file"]
    data = {**mapping(time={"column": "t", "unit": "ns"}), "joints": joints}
    log = LogMapping.model_validate(data)
    first, second = read_channels([path], log, MODEL)[path.name]
    assert (len(first.joint_position), len(second.joint_position)) == (3000, len(time) - 3000)
    assert first.rate == pytest.approx(500.0)
    np.testing.assert_allclose(first.joint_position, expected.joint_position[:3000], atol=1e-9)
    np.testing.assert_allclose(second.motor_torque, expected.motor_torque[3000:], atol=1e-9)
    out = folder / "one_table.yaml"
    out.write_text(yaml.safe_dump(data))
    command = ["identify", "dynamics", "--log", str(path), "--mapping", str(out)]
    assert main(command) == 0


def test_recordings_in_files_of_their_own_are_held_out(folder, tmp_path_factory, capsys):
    """The second is the first with twice the torque: neither predicts the other."""
    lines = (folder / "torque.csv").read_text().splitlines()
    twice = [";".join(f"{2 * float(cell):.9g}" for cell in row.split(";")) for row in lines[1:]]
    (folder / "torque_one.csv").write_text("\n".join(lines))
    (folder / "torque_two.csv").write_text("\n".join([lines[0], *twice]))
    for name in ("one", "two"):
        (folder / f"position_{name}.csv.gz").write_bytes((folder / "position.csv.gz").read_bytes())
    elsewhere = tmp_path_factory.mktemp("mapping")  # the URDF may lie next to the mapping
    (folder / "arm.urdf").rename(elsewhere / "arm.urdf")
    path = write(elsewhere, **several(["one", "two"]))
    log = load_mapping(path)
    assert log.recordings == ["one", "two"]
    assert log.files[1] == "torque_one.csv"
    model = model_of(log, [folder, elsewhere])
    both = channels_of(path, folder, model)
    np.testing.assert_allclose(both["two"].motor_torque, 2.0 * both["one"].motor_torque, rtol=1e-6)
    assert main(["identify", "dynamics", "--log", str(folder), "--mapping", str(path)]) == 0
    text = capsys.readouterr().out
    assert "one from two" in text
    assert "two, own blocks" in text
    said = next(row for row in text.splitlines() if "net, off by" in row)
    per_cent = [
        float(cell) for cell in re.findall(r"[-+]?[\d.]+(?= ?%)", said.replace("\u2212", "-"))
    ]
    assert per_cent == pytest.approx([100, -50, 0, 0], abs=6)


def test_currents_and_joint_torques_become_motor_torques(folder):
    model = model_of(load_mapping(folder / "log.yaml"), [folder])
    (before,) = channels_of(folder / "log.yaml", folder).values()
    motor = before.motor_torque
    for effort, expected in (
        ({"unit": "ampere", "torque_constant": [0.5, 2.0]}, motor * np.array([0.5, 2.0])),
        ({"side": "joint"}, DRIVETRAIN.motor_torque_from_joint(motor)),
    ):
        (after,) = channels_of(write(folder, effort=effort), folder, model).values()
        np.testing.assert_allclose(after.motor_torque, expected)


def test_an_effort_without_side_is_refused(folder):
    for effort in ({"side": None}, {"unit": "ampere"}):
        with pytest.raises(LogFormatError, match="no torque of motors or joints"):
            channels_of(write(folder, effort=effort), folder)


def test_motor_positions_become_joint_positions_in_a_bag(folder, tmp_path):
    """The mapping that identifies also imports; the bag has a date that nobody gave."""
    mapping = load_mapping(folder / "log.yaml")
    import_log(folder, mapping, tmp_path / "bag")
    block, _, _ = read_bag(tmp_path / "bag", mapping.joints.names)
    expected = recorded(MODEL, duration=12.0, noise=0.02)
    np.testing.assert_allclose(block.joint_position, expected.joint_position, atol=1e-12)
    assert block.stamp_ns[:2].tolist() == [946_684_800_000_000_000, 946_684_800_002_000_000]
    with pytest.raises(LogFormatError, match="no gear ratios"):
        import_log(folder, mapping.model_copy(update={"robot": None}), tmp_path / "other")


def test_a_model_from_the_mapping_claims_nothing(folder):
    model = model_of(load_mapping(folder / "log.yaml"), [folder])
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
    assert "data of the fit" in text  # marked as such, next to what was held out
    assert f"wrote {out}" in text
    model = load(out)
    assert model.joints[1].friction.coulomb.value == pytest.approx(0.05, rel=0.1)
    assert model.joints[1].friction.coulomb.std > 0


def test_command_prints_reference_and_groups(folder, capsys):
    reference = {"viscous": [3.87, 0.5], "coulomb": [10.0, 2.5], "source": "by hand"}
    path = write(folder, reference=reference)
    assert main(["identify", "dynamics", "--log", str(path), "--details", "--method", "irls"]) == 0
    text = capsys.readouterr().out
    assert "largest deviation from the reference (by hand)" in text
    assert "mx shoulder + 0.5 m elbow" in text
    assert "irls" in text


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"time": None}, "key 'time' is missing"),
        ({"time": {"rate": 0}}, "'time.rate' is 0; expected a number greater than 0"),
        ({"colour": "red"}, "key 'colour' is unknown"),
        (
            {"robot": {"urdf": "a", "gear_ratio": [100]}},
            "2 entries of robot.gear_ratio, as many as joints; found 1",
        ),
        ({"robot": {"gear_ratio": [100, 50]}}, "key 'robot.urdf' is missing"),
        ({"recordings": ["A"]}, "together with {recording} in every file name"),
        ({"position": {"file": "{recording}.csv"}}, "together with {recording}"),
        ({"recordings": ["../A"]}, "'recordings.0' is '../A'; expected text that matches"),
        (several(["A", "A"]), "every name of recordings once"),
        ({"effort": {"torque_constant": [1, 1]}}, "torque_constant for ampere"),
        (
            {"position": {"zero": [1, 2, 3]}},
            "position.zero has 3 entries; expected 1 for all",
        ),
        ({"position": {"column_names": ["a"], "file": None}}, "either column or columns"),
        ({"position": {"unit": "turns"}}, "position.unit.*'rad', 'deg', 'm' or 'mm'"),
    ],
)
def test_wrong_mapping_is_refused_by_key(tmp_path, changes, words):
    path = tmp_path / "log.yaml"
    path.write_text(yaml.safe_dump(mapping(**changes)))
    with pytest.raises(LogFormatError, match=words) as caught:
        load_mapping(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("text", "words"), [("[]", "is a list"), ("a: [", "not valid YAML")])
def test_what_is_no_mapping_is_refused(tmp_path, text, words):
    (tmp_path / "log.yaml").write_text(text)
    with pytest.raises(LogFormatError, match=words):
        load_mapping(tmp_path / "log.yaml")
    with pytest.raises(LogFormatError, match=r"the mapping .* cannot be read"):
        load_mapping(tmp_path / "none.yaml")


def shorter(folder):
    lines = (folder / "torque.csv").read_text().splitlines()
    (folder / "torque.csv").write_text("\n".join(lines[:-3]))


def with_text(folder):
    path = folder / "torque.csv"
    path.write_text("\n".join([*path.read_text().splitlines()[:-1], "nan?;1.0"]))


def without_column(folder):
    path = folder / "torque.csv"
    path.write_text(path.read_text().replace("first", "third", 1))


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (shorter, "one torque for every position"),
        (with_text, "torque.csv cannot be used .1 not_numeric from line 6001"),
        (without_column, "no column 'first'"),
        (lambda folder: (folder / "torque.csv").unlink(), "torque.csv cannot be read"),
        (lambda folder: (folder / "arm.urdf").unlink(), "URDF .* cannot be read"),
    ],
)
def test_damaged_files_are_refused(folder, damage, words):
    damage(folder)
    with pytest.raises(LogFormatError, match=words):
        channels_of(folder / "log.yaml", folder)


def test_joints_of_another_model_are_refused(folder):
    with pytest.raises(LogFormatError, match="those of the model in its order"):
        channels_of(folder / "log.yaml", folder, robots.one_wheel())


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
