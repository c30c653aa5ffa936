from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from logbook import read_bag, write_csv
from robot_energy.foundation.errors import LogFormatError
from robot_energy.model import load
from robot_energy.physics.rigid_body import Robot
from robot_energy.pipeline.torque_stage import PayloadChange
from robot_energy.replay.bag_replay import replay
from robot_energy.timeline.blocks import Float
from robot_energy_logs.ur_rtde import UR_JOINTS, import_ur_rtde

DATA = os.environ.get("ROBOT_ENERGY_DATA", "")
GROUPS = ("actual_q", "actual_qd", "actual_current", "joint_temperatures")
HEADER = ",".join(
    [
        "time",
        "timestamp",
        *(f"{group}_{i}" for group in GROUPS for i in range(6)),
        "actual_robot_voltage",
        "actual_robot_current",
    ]
)


def row(clock: float, wall: str = "2021:10:05:12:08:13.5") -> list[object]:
    """Axis i stands at i, turns at 0.1 i, draws i A and has 30 + i degC; 48 V, 0.5 A."""
    axes = range(6)
    return [wall, clock, *axes, *(0.1 * i for i in axes), *axes, *(30 + i for i in axes), 48, 0.5]


def test_all_quantities_reach_the_bag(tmp_path: Path) -> None:
    log = write_csv(tmp_path / "log.csv", HEADER, [row(1000.01), row(1000.05), row(1000.09)])
    report = import_ur_rtde([log], tmp_path / "bag")
    block, temperatures, readings = read_bag(tmp_path / "bag", UR_JOINTS)
    start = 1633435693_500_000_000  # 2021-10-05 12:08:13.5 UTC
    assert block.stamp_ns.tolist() == [start, start + 40_000_000, start + 80_000_000]
    np.testing.assert_array_equal(block.joint_position[0], np.arange(6))
    np.testing.assert_allclose(block.joint_velocity[2], 0.1 * np.arange(6))
    assert temperatures is not None
    assert readings is not None
    np.testing.assert_array_equal(temperatures.motor_temperature_degc[1], 30 + np.arange(6))
    np.testing.assert_array_equal(readings.power, 24.0)
    assert any("taken as UTC" in note for note in report.notes)


def test_files_are_joined_in_the_order_of_their_time(tmp_path: Path) -> None:
    first = write_csv(tmp_path / "z.csv", HEADER, [row(10.0), row(10.04), row(10.08)])
    second = write_csv(tmp_path / "a.csv", HEADER, [row(10.08, "x"), row(10.12), "1,2"])
    report = import_ur_rtde([second, first], tmp_path / "bag", [f"left_{n}" for n in UR_JOINTS])
    assert [account.path.name for account in report.files] == ["z.csv", "a.csv"]
    assert dict(report.files[1].rejected) == {"wrong_length": 1, "not_newer": 1}
    assert all(account.balanced for account in report.files)
    assert report.joint_states == 4
    assert report.contents.joint_names[0] == "left_shoulder_pan_joint"


def test_a_recording_of_positions_alone_is_enough(tmp_path: Path) -> None:
    header = " ".join(["timestamp", *(f"actual_q_{i}" for i in range(6))])
    log = write_csv(tmp_path / "log.csv", header, ["5.0 0 1 2 3 4 5", "5.1 0 1 2 3 4 5"])
    report = import_ur_rtde([log], tmp_path / "bag")
    block, temperatures, readings = read_bag(tmp_path / "bag", UR_JOINTS)
    assert np.isnan(block.joint_velocity).all()
    assert temperatures is None
    assert readings is None
    assert sum("the recording has no" in note for note in report.notes) == 5
    assert any("controller's own clock" in note for note in report.notes)


def test_decimal_commas_are_read_and_named(tmp_path: Path) -> None:
    rows = [row(1000.01), row(1000.05), row(1000.09)]
    import_ur_rtde([write_csv(tmp_path / "log.csv", HEADER, rows)], tmp_path / "expected")
    text = (tmp_path / "log.csv").read_text().replace(",", ";")
    head, _, body = text.partition("\n")
    wall = "2021:10:05:12:08:13.5"
    log = tmp_path / "commas.csv"
    log.write_text(f"{head}\n{body.replace('.', ',').replace(wall.replace('.', ','), wall)}")
    report = import_ur_rtde([log], tmp_path / "bag")
    assert any("decimal commas" in note for note in report.notes)
    found, expected = (read_bag(tmp_path / name, UR_JOINTS) for name in ("bag", "expected"))
    for block, known in zip(found, expected, strict=True):
        assert block is not None
        for name, values in known.__dict__.items():
            np.testing.assert_array_equal(getattr(block, name), values)


def test_a_recording_appended_with_its_header_is_read(tmp_path: Path) -> None:
    """The robot was started again: its clock begins again."""
    first, second = [row(1000.0), row(1000.04)], [row(3.0), row(3.04)]
    log = write_csv(tmp_path / "log.csv", HEADER, [*first, HEADER, *second])
    report = import_ur_rtde([log], tmp_path / "bag")
    assert report.joint_states == 4
    assert report.end_ns is not None
    assert report.start_ns is not None
    assert report.end_ns - report.start_ns == 10_080_000_000
    assert any("line 4 of log.csv repeats the header" in note for note in report.notes)


def test_what_is_no_ur_recording_is_refused(tmp_path: Path) -> None:
    log = write_csv(tmp_path / "log.csv", "time,actual_q_0", ["1,2"])
    with pytest.raises(LogFormatError, match="no column 'timestamp' that a UR RTDE recording"):
        import_ur_rtde([log], tmp_path / "bag")
    with pytest.raises(LogFormatError, match="six different names"):
        import_ur_rtde([log], tmp_path / "bag", ["a"] * 6)


def changes(bag: Path) -> list[PayloadChange]:
    """Payloads that a replay of the bag carries."""
    result = replay(bag, load("ur3e"))
    assert result.payload.rejections.accepted == len(result.payload.changes)
    return result.payload.changes


def test_the_payload_of_the_controller_is_carried_from_each_change_on(tmp_path: Path) -> None:
    """A gripper, then with a part: mass, place and inertia at the flange, in the order of UR."""
    names = ["payload", *(f"payload_cog_{i}" for i in range(3))]
    names += [f"payload_inertia_{i}" for i in range(6)]
    gripper = [1.0, 0.0, 0.01, 0.05, 0.002, 0.003, 0.004, 0.0001, 0.0002, 0.0003]
    loaded = [2.5, 0.0, 0.02, 0.08, 0.012, 0.013, 0.014, 0.0, 0.0, 0.0]
    rows = [[*row(10 + 0.04 * k), *(gripper if k < 2 else loaded)] for k in range(4)]
    log = write_csv(tmp_path / "log.csv", ",".join([HEADER, *names]), rows)
    report = import_ur_rtde([log], tmp_path / "bag")
    assert report.payloads == 2
    first, second = changes(tmp_path / "bag")
    assert (first.payload.link, first.payload.mass) == ("tool0", 1.0)
    assert first.payload.centre_of_mass == (0.0, 0.01, 0.05)
    assert first.payload.inertia == tuple(gripper[4:])
    assert second.payload.mass == 2.5
    assert second.from_ns - first.from_ns == 80_000_000


def test_a_payload_without_inertia_is_a_point_mass_and_gaps_change_nothing(tmp_path: Path) -> None:
    names = ["payload", *(f"payload_cog_{i}" for i in range(3))]
    rows = [[*row(10.0), 1, 0, 0, 0.1], [*row(10.04), "", "", "", ""], [*row(10.08), 1, 0, 0, 0.1]]
    log = write_csv(tmp_path / "log.csv", ",".join([HEADER, *names]), rows)
    import_ur_rtde([log], tmp_path / "bag")
    (change,) = changes(tmp_path / "bag")
    assert (change.payload.mass, change.payload.inertia) == (1.0, (0.0,) * 6)


@pytest.mark.skipif(not DATA, reason="no data folder")
def test_the_recorded_ur3e_is_one_whole(tmp_path: Path) -> None:
    logs = sorted(Path(DATA).glob("rad_ur3e/*.csv"), reverse=True)
    report = import_ur_rtde(logs, tmp_path / "bag")
    assert (report.joint_states, report.temperatures, report.readings) == (134, 134, 134)
    (change,) = changes(tmp_path / "bag")
    assert (change.payload.mass, change.payload.centre_of_mass) == (1.07, (0.0, 0.0, 0.058))
    block, _, readings = read_bag(tmp_path / "bag", UR_JOINTS)
    np.testing.assert_array_equal(np.diff(block.stamp_ns), 40_000_000)  # across the files too
    assert readings is not None
    assert 30.0 < float(readings.power.min()) < float(readings.power.max()) < 70.0


@pytest.mark.skipif(not DATA, reason="no data folder")
def test_the_payload_sits_where_the_controller_has_it(tmp_path: Path) -> None:
    """The controller's own torque of its planned motion: with the payload at ``tool0`` the URDF
    gives that of the elbow and of wrist 1 to a tenth of what it lacks without it."""
    logs = sorted(Path(DATA).glob("rad_ur3e/*.csv"), reverse=True)
    import_ur_rtde(logs, tmp_path / "bag")
    (change,) = changes(tmp_path / "bag")
    table = pl.concat([pl.read_csv(log, infer_schema=False) for log in logs])

    def target(name: str) -> Float:
        columns = [pl.col(f"target_{name}_{i}").cast(pl.Float64, strict=False) for i in range(6)]
        return table.select(columns).to_numpy()

    motion, torque = [target(name) for name in ("q", "qd", "qdd")], target("moment")
    robot = Robot.from_model(load("ur3e"))

    def rms(carrier: Robot) -> Float:
        error = carrier.joint_torque(*motion) - torque
        return np.asarray(np.sqrt(np.nanmean(error**2, axis=0)))

    loaded, bare = rms(robot.with_payload([change.payload])), rms(robot)
    assert (loaded[2:4] < 0.1 * bare[2:4]).all()
    assert (loaded <= bare + 1e-3).all()
