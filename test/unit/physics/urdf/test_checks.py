"""A URDF that lies, bombs or holds nonsense is refused in one sentence; nothing is opened."""

import os
import subprocess
import sys
import time
from itertools import pairwise

import numpy as np
import pytest

import robots
from refusals import refused
from robot_energy.foundation.errors import RobotDescriptionError
from robot_energy.physics.rigid_body import Robot
from robot_energy.physics.urdf.checks import parse
from robot_energy_identify.starter.model_remarks import prefix_remarks

GOOD = robots.TWO_LINK_URDF
NAMES = ("shoulder", "elbow")
INERTIA = 'ixx="0.001" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"'


def changed(old, new):
    assert old in GOOD
    return GOOD.replace(old, new)


def with_element(text):
    return GOOD.replace("</robot>", f"{text}</robot>")


def chain(count):
    """Links one after another behind the fore arm."""
    names = ["fore", *(f"z{i}" for i in range(count))]
    return with_element(
        "".join(
            f'<link name="{child}"/><joint name="j{child}" type="fixed">'
            f'<parent link="{parent}"/><child link="{child}"/></joint>'
            for parent, child in pairwise(names)
        )
    )


NUMBERS = ["nan", "inf", "-inf", "1e308", "1e400", "", "abc", "0x10", "4,0", "4 5", "1_000", "٤"]
BAD_NUMBERS = [
    *(changed('mass value="2.0"', f'mass value="{text}"') for text in [*NUMBERS, "-4"]),
    *(changed(INERTIA, INERTIA.replace('ixx="0.001"', f'ixx="{text}"')) for text in NUMBERS),
    *(
        changed('origin xyz="0.15 0 0"', f'origin {key}="{text}"')
        for key in ("xyz", "rpy")
        for text in [*(f"{number} 0 0" for number in NUMBERS), "1 2", "1 2 3 4", ""]
    ),
    *(changed('origin xyz="0.5 0 0"', f'origin xyz="{text} 0 0"') for text in NUMBERS if text),
    *(changed('axis xyz="0 -1 0"', f'axis xyz="0 {text} 0"') for text in NUMBERS if text),
    changed('lower="-3"', 'lower="nan"'),
    changed('lower="-3"', 'lower="1,5"'),
]


@pytest.mark.parametrize("urdf", BAD_NUMBERS)
def test_a_number_that_is_none_is_refused_with_its_owner(urdf):
    with pytest.raises(RobotDescriptionError, match=r"(link|joint) '\w+' has the ") as caught:
        Robot(urdf, NAMES)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("urdf", "words"),
    [
        (changed('axis xyz="0 -1 0"', 'axis xyz="0 0 0"'), "axis with a direction"),
        (changed('axis xyz="0 -1 0"', 'axis xyz="1e-320 0 0"'), "axis with a direction"),
        (changed(INERTIA, 'ixx="1"'), "inertia lacks iyy, izz"),
        (changed(f"<inertia {INERTIA}/>", ""), "inertia lacks ixx"),
        (changed('<mass value="2.0"/>', ""), "without mass"),
        (changed('<mass value="2.0"/>', "<mass/>"), "without mass"),
        (changed(INERTIA, INERTIA.replace('iyy="0.02"', 'iyy="-0.02"')), "principal moment"),
        (changed(INERTIA, INERTIA.replace('ixy="0"', 'ixy="5"')), "principal moment"),
        (with_element('<link/><joint name="a" type="fixed"/>'), "a link of the name None"),
        (with_element('<link name=""/>'), "a link of the name ''"),
        (GOOD.replace('"shoulder"', '"universe"'), "'universe'"),
        (GOOD.replace('"base"', '"universe"'), "'universe'"),
        (with_element("<a>" * 60 + "</a>" * 60), "nests elements more than"),
        (with_element("<a>" * 200_000 + "</a>" * 200_000), "nests elements more than"),
        (with_element("<a/>" * 200_001), "over 200000 elements"),
        (with_element(f"<!-- {'x' * 2**23} -->"), "characters; expected at most"),
        (chain(1000), "over 1000 links"),
        ('<!DOCTYPE r [<!ENTITY a "b">]>' + GOOD, "DOCTYPE"),
        (f'<?xml version="1.0"?>\n<!DOCTYPE robot SYSTEM "file:///etc/passwd">{GOOD}', "DOCTYPE"),
        (changed('axis xyz="0 -1 0"', 'axis xzy="0 -1 0"'), "<axis xzy=...>, and no xyz"),
        (changed('axis xyz="0 -1 0"', "axis"), "axis without xyz"),
        (changed('effort="100"', 'efort="100"'), "<limit efort=...>, and no effort"),
        ('<robot name="r"><material name="m"/></robot>', "no links"),
        (changed('type="continuous"', 'type="hinge"'), "joint 'elbow' is of type 'hinge'"),
        (changed('type="continuous"', ""), "joint 'elbow' is of type 'None'"),
        (GOOD.replace("<link ", '<xacro:if value="1"/><link ', 1), "xacro file"),
        (with_element('<x:if xmlns:x="http://www.ros.org/wiki/xacro"/>'), "xacro file"),
        (with_element("&unknown;"), "not well-formed"),
        (with_element("\0"), "not well-formed"),
        (with_element("\ud800"), "not well-formed"),
        ('<r:robot xmlns:r="u" name="t"/>', "root"),
    ],
)
def test_what_no_robot_has_is_refused(urdf, words):
    begin = time.process_time()
    with pytest.raises(RobotDescriptionError, match=words):
        Robot(urdf, NAMES)
    assert time.process_time() - begin < 20


@pytest.mark.parametrize(
    "urdf",
    [
        chain(900),
        with_element('<material name="m"><texture filename="package://a/../b.png"/></material>'),
        with_element('<gazebo reference="x"><a mass="nan"/></gazebo><transmission/>'),
        changed("<axis", '<dynamics damping="nan"/><calibration rising="x"/><axis'),
        changed(INERTIA, 'ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"'),
        changed(INERTIA, INERTIA.replace('ixy="0"', 'ixy="1e-6"')),
        GOOD.replace('"fore"', '"elbow"'),  # a link of the name of a joint
        changed("<limit ", '<limit drake:acceleration="2.5" jerk="x" '),
        with_element('<drake:joint name="a" drake:b="1"/>'),
        changed('<robot name="two_link"', '<robot name="two_link" xmlns="http://a/urdf"'),
        changed('<robot name="two_link"', '<robot name="two_link" xmlns:xacro="http://a/xacro"'),
        changed('axis xyz="0 -1 0"', 'axis xyz="0 -1 0" rpy="0 0 0"'),
        with_element(
            '<link name="z"/><joint name="root_joint" type="fixed"><parent link="fore"/>'
            '<child link="z"/></joint>'
        ),
        f'<?xml version="1.0" encoding="utf-16"?>{GOOD.strip()}',
    ],
)
def test_what_only_looks_odd_is_taken(urdf):
    robot = Robot(urdf, NAMES)
    assert robot.moving_mass == pytest.approx(robots.M1 + robots.M2)
    pose = np.full((1, 2), 0.5)
    reference = Robot(GOOD, NAMES).joint_torque(pose, pose, 0 * pose)
    np.testing.assert_allclose(robot.joint_torque(pose, pose, 0 * pose), reference, atol=1e-5)


def test_a_prefix_that_is_not_declared_is_named():
    text = changed("<limit ", '<limit drake:acceleration="2.5" ')
    (said,) = prefix_remarks(parse(text))
    assert 'add xmlns:drake="..."' in said
    declared = text.replace("<robot ", '<robot xmlns:drake="http://drake.mit.edu" ')
    assert prefix_remarks(parse(declared)) == []


def test_mass_that_the_parser_loses_is_noticed(monkeypatch):
    """Behind all checks of the text stands a sum of the kilograms."""
    monkeypatch.setattr("robot_energy.physics.urdf.checks.check_numbers", lambda root: None)
    for urdf in (changed('origin xyz="0.15 0 0"', 'origin xyz="0.15 0"'), changed("0.15", "x")):
        with refused(RobotDescriptionError, found=("2 kg", "0 kg")):
            Robot(urdf, NAMES)


def test_meshes_are_never_opened(tmp_path):
    """A mesh that is a pipe would block for ever, one of no package would be refused."""
    pipe = tmp_path / "mesh.stl"
    os.mkfifo(pipe)
    meshes = "".join(
        f'<{kind}><geometry><mesh filename="{name}"/></geometry></{kind}>'
        for kind in ("visual", "collision")
        for name in (f"file://{pipe}", str(pipe), "package://no/../../etc/passwd", "/etc/passwd")
    )
    file = tmp_path / "robot.urdf"
    file.write_text(changed('<link name="fore">', f'<link name="fore">{meshes}'))
    code = (
        "import sys; from robot_energy.physics.rigid_body import Robot; "
        f"print(Robot(open({str(file)!r}).read(), {NAMES!r}).moving_mass)"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60,
        env=environment,
    )  # fmt: skip
    assert float(done.stdout) == robots.M1 + robots.M2


@pytest.mark.parametrize("place", ["<link ", "<inertia ", "<origin "])
def test_an_element_of_very_many_attributes_is_refused(place):
    """The parser behind the dynamics compares each with all before it."""
    attributes = " ".join(f'a{index}="1"' for index in range(101))
    with pytest.raises(RobotDescriptionError, match="attributes"):
        Robot(GOOD.replace(place, f"{place}{attributes} ", 1), NAMES)
