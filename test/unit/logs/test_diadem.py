"""DIAdem recordings and KUKA traces, on files made in the documented form."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from logbook import read_bag
from places import ROOT
from robot_energy.foundation.errors import LogFormatError
from robot_energy_cli.main import main
from robot_energy_logs.diadem import read_diadem
from robot_energy_logs.log_import import open_logs
from robot_energy_logs.mapping import load_mapping
from robot_energy_logs.table import LogTable

EXAMPLE = ROOT / "src" / "examples" / "mappings" / "kuka_trace.yaml"
STEP = 0.012  # s
AXES = tuple(f"joint_a{axis}" for axis in range(1, 7))


def channel(**entries: Any) -> str:
    lines = [f"{key.removeprefix('_')},{value}" for key, value in entries.items()]
    return "\r\n".join(["#BEGINCHANNELHEADER", *lines, "#ENDCHANNELHEADER", ""])


def header(count: int, stored: list[dict[str, Any]], file: str = "x.r64") -> str:
    """A header with a time that is not stored, and channels that are."""
    time = channel(_200="Zeit", _202="s", _210="IMPLIZIT", _220=count, _240=0, _241=STEP)
    parts = [
        channel(
            **{
                **{"_202": "", "_210": "EXPLIZIT", "_211": file, "_213": "BLOCK"},
                **{"_214": "REAL64", "_220": count, "_221": place, "_240": 0, "_241": 1},
                **entries,
            }
        )
        for place, entries in enumerate(stored, 1)
    ]
    front = "DIAEXTENDED  {@:GERMAN}\r\n#BEGINGLOBALHEADER\r\n1,WINDOWS\r\n#ENDGLOBALHEADER\r\n"
    return front + time + "".join(parts)


def trace(folder: Path, name: str, rows: int = 50, **unit: str) -> np.ndarray[Any, Any]:
    """A trace of six axes: positions in millionths of a degree, by a factor of the header."""
    units = {"position": "\N{DEGREE SIGN}", "torque": "Nm", "temperature": "K", **unit}
    time = np.arange(rows) * STEP
    position = np.column_stack([10 * axis * np.sin(time) for axis in range(1, 7)])  # deg
    for axis in range(6):
        stored = [
            {"_200": "Istposition", "_202": units["position"], "_241": 1e-6},
            {"_200": "Istmoment", "_202": units["torque"]},
            {"_200": "Motortemperatur", "_202": units["temperature"]},
        ]
        values = np.column_stack(
            [position[:, axis] * 1e6, np.full(rows, axis + 0.5), np.full(rows, 300.0 + axis)]
        )
        stem = folder / f"{name}_NextGenDrive#{axis + 1}"
        text = header(rows, stored, f"D:\\TRACE\\{stem.name}.R64")
        Path(f"{stem}.dat").write_text(text, encoding="latin-1", newline="")
        Path(f"{stem}.r64").write_bytes(values.astype("<f8").tobytes())
    return position


def test_a_trace_of_six_axes_becomes_a_bag(tmp_path: Path) -> None:
    position = trace(tmp_path, "run")
    words = ["import", "kuka-trace", str(tmp_path), "--recordings", "run"]
    assert main([*words, "--mapping", str(EXAMPLE), "--out", str(tmp_path / "bag")]) == 0
    block, temperatures, _ = read_bag(tmp_path / "bag", AXES)
    zero = [0, -np.pi / 2, np.pi / 2, 0, 0, 0]
    np.testing.assert_allclose(block.joint_position, np.radians(position) + zero, atol=1e-12)
    np.testing.assert_allclose(np.diff(block.stamp_ns), STEP * 1e9)
    assert temperatures is not None
    expected = 26.85 + np.arange(6)
    np.testing.assert_allclose(temperatures.motor_temperature_degc[-1], expected)


def test_effort_of_each_axis_comes_from_its_own_file(tmp_path: Path) -> None:
    trace(tmp_path, "run", rows=3)
    (log,) = open_logs([tmp_path], load_mapping(EXAMPLE, ["run"]))
    np.testing.assert_array_equal(log.whole().effort, [[0.5, 1.5, 2.5, 3.5, 4.5, 5.5]] * 3)


def test_several_traces_are_runs_with_a_gap_between(tmp_path: Path) -> None:
    trace(tmp_path, "one")
    trace(tmp_path, "two")
    words = ["import", "kuka-trace", str(tmp_path), "--recordings", "two", "one"]
    assert main([*words, "--mapping", str(EXAMPLE), "--out", str(tmp_path / "bag")]) == 0
    block, _, _ = read_bag(tmp_path / "bag", AXES)
    assert block.segment.tolist() == [0] * 50 + [1] * 50


@pytest.mark.parametrize(
    ("unit", "words"),
    [
        (
            {"temperature": "\N{DEGREE SIGN}C"},
            r"temperatur' is in '°C', and the mapping kelvin",
        ),
        ({"position": "rad"}, r"#1.dat says that 'Istposition' is in 'rad'.*position.unit: rad"),
    ],
)
def test_a_unit_that_the_file_contradicts_is_refused(
    tmp_path: Path, unit: dict[str, str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    trace(tmp_path, "run", **unit)
    call = ["import", "kuka-trace", str(tmp_path), "--recordings", "run", "--mapping", str(EXAMPLE)]
    assert main([*call, "--out", str(tmp_path / "bag")]) == 2
    assert re.search(words, capsys.readouterr().err.replace("\n", " "))
    assert not (tmp_path / "bag").exists()


def test_a_unit_that_nobody_knows_is_left_to_the_mapping(tmp_path: Path) -> None:
    trace(tmp_path, "run", position="Inkr")
    mapping = tmp_path / "mapping.yaml"
    data = yaml.safe_load(EXAMPLE.read_text())
    del data["joints"]["position"]["unit"]
    mapping.write_text(yaml.safe_dump(data))
    with pytest.raises(LogFormatError, match=r"joints.position.unit"):  # never guessed
        load_mapping(mapping, ["run"])


def test_values_of_channels_and_blocks_by_hand(tmp_path: Path) -> None:
    stored = [
        {"_200": "a", "_213": "CHANNEL", "_214": "INT16", "_221": 1, "_241": 0.5, "_240": 10},
        {"_200": "b", "_213": "CHANNEL", "_214": "INT16", "_221": 4, "_254": 7},
    ]
    (tmp_path / "x.dat").write_text(header(3, stored))
    (tmp_path / "X.R64").write_bytes(np.array([1, 2, -3, 7, 8, 9], "<i2").tobytes())
    time, first, second = read_diadem(tmp_path / "x.dat")
    np.testing.assert_allclose(time.values, [0, 0.012, 0.024])
    assert first.values.tolist() == [10.5, 11.0, 8.5]
    assert np.isnan(second.values[0])
    assert second.values[1:].tolist() == [8.0, 9.0]
    table = LogTable(tmp_path / "x.dat")
    assert table.columns == ("Zeit", "a", "b")
    assert table.units == {"Zeit": "s"}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("220,3", "220,4"), "x.r64 has 24 bytes, which 4 rows of the channel 'a' do not fit"),
        (("220,3", "220,3.5"), "entry 220 of the channel 'Zeit' .* is '3.5'; expected a whole"),
        (("241,1", "241,x"), "entry 241 of the channel 'a' of .*x.dat is 'x'; expected a number"),
        (
            ("REAL64", "TWOC12"),
            "'a' of .* is EXPLIZIT, BLOCK, TWOC12; expected .*REAL64",
        ),
        (("x.r64", "../../etc/passwd"), "has its values in 'passwd', which is not in"),
        (("200,a", "200,"), "the channel that ends in line .* has no name"),
        (("#ENDCHANNELHEADER", "#END"), "ends within a channel"),
        (("#BEGINCHANNELHEADER", "#B"), "names no channels"),
    ],
)
def test_what_does_not_fit_is_named(tmp_path: Path, change: tuple[str, str], words: str) -> None:
    (tmp_path / "x.dat").write_text(header(3, [{"_200": "a"}]).replace(*change))
    (tmp_path / "x.r64").write_bytes(np.zeros(3).tobytes())
    with pytest.raises(LogFormatError, match=words) as caught:
        LogTable(tmp_path / "x.dat")
    assert "\n" not in str(caught.value)
