"""Positions of linear and rotary axes in other units, with the line that mends them."""

import numpy as np
import pytest
import yaml

from mistakes import rewrite, scaled
from robot_energy.inputs.inputs_file import read_inputs
from robot_energy.model import load, parse_yaml, validate
from robot_energy_cli import main
from robot_energy_identify.check import check
from robot_energy_identify.starter import RobotText, read_arm, starter_text
from sound_recordings import write_states

URDF = """<robot name="slide"><link name="base"/>
<link name="l1"><inertial><mass value="5"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="l2"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="base"/><child link="l1"/><axis xyz="1 0 0"/>
<limit lower="0" upper="2" effort="500" velocity="2"/></joint>
<joint name="turn" type="revolute"><parent link="l1"/><child link="l2"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" effort="50" velocity="3"/></joint></robot>"""
TEXT = starter_text(read_arm(URDF), RobotText(URDF, "URDF"), ".")
MODEL = validate(parse_yaml(TEXT, "slide"), "slide")


def positions():
    time = np.arange(2500) / 250
    return np.stack([1 + 0.8 * np.sin(time), 1.5 * np.sin(0.7 * time)], axis=1)


def units(result):
    """Remedies by the unit that was found."""
    return {one.cause: one.remedy for one in result.findings if one.severity == "error"}


@pytest.mark.parametrize(
    ("factors", "scales"),
    [
        ((1e3, 180 / np.pi), {"millimetres": [0.001, 0.0174533], "degrees": [0.001, 0.0174533]}),
        ((1e3, 1.0), {"millimetres": [0.001, 1.0]}),
        ((1.0, 180 / np.pi), {"degrees": [1.0, 0.0174533]}),
        ((1.0, 1.0), {}),
    ],
)
def test_linear_and_rotary_axes_have_units_of_their_own(tmp_path, factors, scales):
    write_states(
        tmp_path / "bag", ("slide", "turn"), 250, positions() * factors, np.empty((2500, 0))
    )
    found = units(check(tmp_path / "bag", MODEL))
    lines = {name: yaml.safe_load(line)["joint_states"] for name, line in found.items()}
    assert {name: line["position"]["scale"] for name, line in lines.items()} == scales
    if found:
        path = tmp_path / "inputs.yaml"
        line = {"/**": {"ros__parameters": yaml.safe_load(found.popitem()[1])}}
        path.write_text(yaml.safe_dump(line))
        assert not units(check(tmp_path / "bag", MODEL, inputs=read_inputs(path)[0]))


def test_an_axis_beyond_its_limits_in_any_unit_is_a_warning(tmp_path):
    """The slide counts the other way: 0.2 to 1.8 m below a limit of 0."""
    write_states(
        tmp_path / "bag", ("slide", "turn"), 250, positions() * [-1, 1], np.empty((2500, 0))
    )
    result = check(tmp_path / "bag", MODEL)
    assert [(one.cause, one.subject) for one in result.findings if one.severity == "warning"] == [
        ("position_limit", ("slide",))
    ]
    assert not result.errors


@pytest.fixture(scope="module")
def gantry(tmp_path_factory):
    """Three linear axes of the rig."""
    bag = tmp_path_factory.mktemp("gantry") / "bag"
    assert main(["simulate", "--robot", "testbed", "--duration", "8", "--out", str(bag)]) == 0
    return bag


@pytest.mark.parametrize(
    ("fields", "joints", "scale"),
    [
        (("position", "velocity"), [0, 1, 2], [0.001]),
        (("position",), [0, 1, 2], [0.001]),
        (("position", "velocity"), [1], [1.0, 0.001, 1.0]),
    ],
)
def test_only_what_is_in_millimetres_is_corrected(gantry, tmp_path, fields, joints, scale):
    bag = rewrite(gantry, tmp_path / "bag", scaled(fields, 1e3, joints))
    found = units(check(bag, load("testbed")))
    assert list(found) == ["millimetres"]
    line = yaml.safe_load(found["millimetres"])["joint_states"]
    assert line == {field: {"scale": scale} for field in fields}
