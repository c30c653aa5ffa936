from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from logbook import WHEEL_MAPPING, mapping, read_bag, wheel_csv, write_csv
from places import ROOT
from robot_energy.foundation.errors import BagError, LogFormatError
from robot_energy.timeline.blocks import MeterLocation, MeterMeaning
from robot_energy_identify.drives.drive_power import drive_topics
from robot_energy_logs.log_import import import_log, open_logs
from robot_energy_logs.mapping import load_mapping

EXAMPLES = ROOT / "src" / "examples" / "mappings"
DATA = os.environ.get("ROBOT_ENERGY_DATA", "")


@pytest.mark.parametrize(
    ("unit", "degrees"),
    [("kelvin", (293.15, 300.15, 301.15)), ("fahrenheit", (68.0, 80.6, 82.4))],
)
def test_units_signs_and_meter_reach_the_bag_in_si(
    unit: str, degrees: tuple[float, float, float], tmp_path: Path
) -> None:
    log = write_csv(
        tmp_path / "log.csv",
        "ms,q1,q2,v1,v2,i1,i2,k1,k2,e",
        [
            f"0,180,90,18,9,100,200,{degrees[0]},{degrees[1]},1",
            f"10,181,91,18,9,100,200,,{degrees[2]},2",
            "20,182,92,18,9,100,200,,,",
        ],
    )
    joints = {
        "names": ["one", "two"],
        "keys": ["1", "2"],
        "position": {"column": "q{joint}", "unit": "deg", "sign": [1, -1]},
        "velocity": {"columns": ["v1", "v2"], "unit": "deg_per_s", "sign": [1, -1]},
        "effort": {"column": "i{joint}", "unit": "milliampere"},
        "temperature": {"column": "k{joint}", "unit": unit},
    }
    meter = {
        "location": "dc_bus",
        "meaning": "cumulative",
        "reading": {"column": "e", "unit": "Wh"},
    }
    time = {"column": "ms", "unit": "ms", "start": "2024-05-06T07:08:09"}
    report = import_log(log, mapping(time=time, joints=joints, power=meter), tmp_path / "bag")
    block, temperatures, readings = read_bag(tmp_path / "bag", ("one", "two"))
    assert block.stamp_ns[0] == 1714979289_000_000_000  # without zone: UTC
    np.testing.assert_array_equal(np.diff(block.stamp_ns), 10_000_000)
    np.testing.assert_allclose(block.joint_position[0], [np.pi, -np.pi / 2])
    np.testing.assert_allclose(block.joint_velocity[0], [np.pi / 10, -np.pi / 20])
    assert temperatures is not None
    assert readings is not None
    np.testing.assert_allclose(temperatures.motor_temperature_degc, [[20.0, 27.0], [np.nan, 28.0]])
    np.testing.assert_allclose(readings.energy, [3600.0, 7200.0])
    assert readings.meaning is MeterMeaning.CUMULATIVE
    assert readings.location is MeterLocation.DC_BUS
    assert (report.joint_states, report.temperatures, report.readings) == (3, 2, 2)


def test_voltage_times_current_is_power(tmp_path: Path) -> None:
    log = write_csv(tmp_path / "log.csv", "t,q_axle,w_axle,u,i", ["0,0,0,48,500", "1,0,0,50,"])
    meter = {
        "location": "dc_bus",
        "meaning": "mean_over_interval",
        "interval": 0.5,
        "voltage": {"column": "u", "unit": "V"},
        "current": {"column": "i", "unit": "mA"},
    }
    import_log(log, mapping(power=meter), tmp_path / "bag")
    _, _, readings = read_bag(tmp_path / "bag", ("axle",))
    assert readings is not None
    assert readings.power.tolist() == [24.0]
    assert readings.interval.tolist() == [0.5]


def test_power_of_the_drives_reaches_the_bag_in_watt(tmp_path: Path) -> None:
    log = write_csv(tmp_path / "log.csv", "t,q_axle,w_axle,p", ["0,0,0,1.5", "1,0,0,", "2,0,0,-2"])
    joints = {
        "names": ["axle"],
        "position": {"column": "q_{joint}", "unit": "rad"},
        "drive_power": {"columns": ["p"], "unit": "kW"},
    }
    report = import_log(log, mapping(joints=joints), tmp_path / "bag")
    assert report.drive_powers == 2
    power = drive_topics("/drive_power").read(tmp_path / "bag", ["axle"])
    assert power.power.tolist() == [[1500.0], [-2000.0]]
    assert np.diff(power.stamp_ns).tolist() == [2_000_000_000]
    middle = power.stamp_ns[:1] + 1_000_000_000
    assert power.at(middle, 3.0).tolist() == [[-250.0]]  # straight between the readings
    assert np.isnan(power.at(middle, 1.0)).all()  # too far apart


def test_times_from_zero_need_a_start(tmp_path: Path) -> None:
    with pytest.raises(LogFormatError, match=r"give time\.start"):
        import_log(wheel_csv(tmp_path / "l.csv"), mapping(time={"column": "t"}), tmp_path / "bag")
    assert not (tmp_path / "bag").exists()  # nothing half-written stays


def test_a_log_without_usable_rows_leaves_no_bag(tmp_path: Path) -> None:
    log = write_csv(tmp_path / "log.csv", "t,q_axle,w_axle,p", ["a,b,c,d", "1,2"])
    with pytest.raises(LogFormatError, match=r"none of the 2 rows.*1 not_numeric from line 2"):
        import_log(log, mapping(), tmp_path / "bag")
    assert not (tmp_path / "bag").exists()


def test_an_existing_bag_is_replaced_only_when_asked(tmp_path: Path) -> None:
    log = wheel_csv(tmp_path / "log.csv", seconds=1.0)
    import_log(log, mapping(), tmp_path / "bag")
    with pytest.raises(BagError, match="exists"):
        import_log(log, mapping(), tmp_path / "bag")
    assert import_log(log, mapping(), tmp_path / "bag", overwrite=True).joint_states == 101


@pytest.mark.parametrize(
    ("path", "value", "text"),
    [
        (("schema_version",), 2, "schema_version"),
        (("time", "column"), None, "either column or rate"),
        (("time", "start"), "4048-01-01T00:00:00", "a start within the years 1824 to 2116"),
        (
            ("time", "unit"),
            "h",
            r"'time.unit' is 'h'; expected 's', 'ms', 'us', 'ns' or 'excel_day'",
        ),
        (("joints", "position", "column"), "q", r"a pattern with \{joint\}"),
        (("joints", "position", "unit"), "degree", r"joints.position.unit' is 'degree'"),
        (("joints", "keys"), ["a", "b"], "as many keys as names"),
        (("joints", "names"), [], "joints.names"),
        (("joints", "speed"), {}, r"key 'joints.speed' is unknown"),
        (("joints", "names"), None, r"key 'joints.names' is missing"),
        (("joints", "position", "sign"), [2], r"joints.position.sign.0"),
        (("joints", "position", "scale"), [0.0], r"joints.position.scale.0"),
        (("joints", "position", "zero"), [0.0, 1.0], "position.zero has 2 entries; expected 1 for"),
        (("power", "interval"), 1.0, "interval for mean_over_interval"),
        (("power", "meaning"), "cumulative", "an energy unit"),
        (("power", "voltage"), {"column": "u", "unit": "V"}, "either reading, or both"),
    ],
)
def test_a_wrong_key_is_named_with_its_path(
    tmp_path: Path, path: tuple[str, ...], value: Any, text: str
) -> None:
    data = yaml.safe_load(yaml.safe_dump(WHEEL_MAPPING))
    entry = data
    for key in path[:-1]:
        entry = entry[key]
    if value is None:
        entry.pop(path[-1])
    else:
        entry[path[-1]] = value
    file = tmp_path / "mapping.yaml"
    file.write_text(yaml.safe_dump(data))
    with pytest.raises(LogFormatError, match=text) as caught:
        load_mapping(file)
    assert "\n" not in str(caught.value)


def test_files_that_are_no_mapping_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "mapping.yaml"
    for content, text in (("- 1", "is a list"), ("a: [", "not valid YAML"), ("", "is empty")):
        file.write_text(content)
        with pytest.raises(LogFormatError, match=text):
            load_mapping(file)
    with pytest.raises(LogFormatError, match=r"the mapping .* cannot be read"):
        load_mapping(tmp_path / "none.yaml")


@pytest.mark.parametrize("example", sorted(EXAMPLES.glob("*.yaml")), ids=lambda path: path.stem)
def test_the_shipped_examples_are_valid(example: Path) -> None:
    assert load_mapping(example).joints.names


@pytest.mark.skipif(not DATA, reason="no data folder")
def test_a_recorded_kr300_is_imported_whole(tmp_path: Path) -> None:
    log = Path(DATA) / "kr300" / "recorded_A.csv.gz"
    report = import_log(log, load_mapping(EXAMPLES / "kr300.yaml"), tmp_path / "bag")
    assert report.joint_states == report.files[0].received == 2501
    block, _, _ = read_bag(tmp_path / "bag", report.contents.joint_names)
    # The velocity is that of the position: their difference over 10 s says so.
    elapsed = np.diff(block.stamp_ns) * 1e-9
    mean = 0.5 * (block.joint_velocity[1:] + block.joint_velocity[:-1])
    moved = block.joint_position[-1] - block.joint_position[0]
    np.testing.assert_allclose((mean * elapsed[:, None]).sum(axis=0), moved, atol=2e-3)
    assert (np.ptp(block.joint_position, axis=0) > 0.4).all()


def test_scale_and_zero_of_torque_come_after_the_torque_constant(tmp_path: Path) -> None:
    log = write_csv(tmp_path / "log.csv", "t,q,i", ["0,1,100", "1,1,-200"])
    joints = {
        "names": ["axle"],
        "position": {"columns": ["q"], "unit": "rad", "scale": [2], "zero": [0.5]},
        "effort": {
            "columns": ["i"],
            "unit": "milliampere",
            "torque_constant": [5],
            "sign": [-1],
            "scale": [3],
            "zero": [0.25],
        },
    }
    (opened,) = open_logs([log], mapping(joints=joints, power=None))
    rows = opened.whole()
    assert rows.joint_position.tolist() == [[2.5], [2.5]]
    np.testing.assert_allclose(rows.effort, [[-1.25], [3.25]])  # -3 * 5 * 0.1 + 0.25 N m


def test_sign_and_scale_of_the_meter_have_the_words_of_its_topic(tmp_path: Path) -> None:
    log = write_csv(tmp_path / "log.csv", "t,q_axle,w_axle,p", ["0,0,0,-2", "1,0,0,1"])
    meter = {
        **WHEEL_MAPPING["power"],
        "sign": "load_negative",
        "scale": 40,
        "reading": {"column": "p", "unit": "kW"},
    }
    import_log(log, mapping(power=meter), tmp_path / "bag")
    readings = read_bag(tmp_path / "bag", ("axle",))[2]
    assert readings is not None
    assert readings.power.tolist() == [80_000.0, -40_000.0]


def test_files_that_count_from_zero_are_runs_with_a_gap_between(tmp_path: Path) -> None:
    logs = [wheel_csv(tmp_path / name, seconds=1.0) for name in ("b.csv", "a.csv")]
    report = import_log(logs, mapping(), tmp_path / "lost")
    assert report.joint_states == 101
    assert "no row of a.csv is newer" in report.notes[-1]
    assert "each_file_is_a_run" in report.notes[-1]
    time = {**WHEEL_MAPPING["time"], "each_file_is_a_run": True, "apart": 20}
    report = import_log(logs, mapping(time=time), tmp_path / "bag")
    assert [account.path.name for account in report.files] == ["b.csv", "a.csv"]
    block, _, _ = read_bag(tmp_path / "bag", ("axle",))
    step = np.diff(block.stamp_ns)
    assert step[100] == 20_000_000_000
    assert (np.delete(step, 100) == 10_000_000).all()
    assert block.segment.tolist() == [0] * 101 + [1] * 101


def test_a_log_without_positions_makes_no_bag(tmp_path: Path) -> None:
    joints = {key: entry for key, entry in WHEEL_MAPPING["joints"].items() if key != "position"}
    with pytest.raises(LogFormatError, match=r"names no positions.*identify drives --log"):
        import_log(wheel_csv(tmp_path / "log.csv"), mapping(joints=joints), tmp_path / "bag")
    del joints["velocity"]
    with pytest.raises(ValueError, match="position or velocity, or both"):
        mapping(joints=joints)


@pytest.mark.parametrize(("unit", "noted"), [("s", False), ("ms", True), ("us", True)])
def test_a_unit_of_time_that_nothing_runs_in_is_noted(
    tmp_path: Path, unit: str, noted: bool
) -> None:
    """A log at 25 Hz: read as ms its rows are 0.04 ms apart."""
    rows = [f"{0.04 * row:.3f},0,0" for row in range(50)]
    log = write_csv(tmp_path / "log.csv", "t,q_axle,w_axle", rows)
    spoken = mapping(time={"column": "t", "unit": unit, "start": "2024-01-01T00:00:00"}, power=None)
    report = import_log(log, spoken, tmp_path / "bag")
    assert any("unit of time" in note for note in report.notes) == noted


def test_the_mapping_of_the_how_to_reads_its_table(tmp_path: Path) -> None:
    page = (ROOT / "src/doc/howto_identify.md").read_text(encoding="utf-8")
    text = page.partition("with the columns `")[2]
    path = tmp_path / "mapping.yaml"
    path.write_text(text.partition("```yaml\n")[2].partition("```")[0], encoding="utf-8")
    header = text.partition("`")[0].replace(" ", "")
    log = write_csv(
        tmp_path / "log.csv", header, [f"{10 * k},90,0,1,1,25,26,0.3" for k in range(9)]
    )
    import_log(log, load_mapping(path), tmp_path / "bag")
    block, temperatures, readings = read_bag(tmp_path / "bag", ("shoulder", "elbow"))
    np.testing.assert_allclose(block.joint_position[0], [np.pi / 2, 0.0])
    assert temperatures is not None
    assert readings is not None
    np.testing.assert_allclose(readings.power, 300.0)
