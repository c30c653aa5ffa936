"""Whether a published description is of the modelled robot."""

import re

import pytest

from robot_energy.foundation.errors import RobotDescriptionError
from robot_energy.model import load
from robot_energy.physics.urdf.checks import disagreements

MODEL = load("kr16")


def test_the_same_description_agrees_also_with_other_limits_left_out():
    assert disagreements(MODEL, MODEL.urdf_xml) == []
    assert disagreements(MODEL, re.sub("<limit[^>]*/>", "<limit/>", MODEL.urdf_xml)) == []


def test_another_robot_is_said_by_its_joints():
    (sentence,) = disagreements(MODEL, load("ur3e").urdf_xml)
    assert sentence == "it has no moving joint joint_a1, joint_a2, joint_a3 and 3 more"


def test_a_fixed_joint_does_not_move():
    fixed = MODEL.urdf_xml.replace(
        'name="joint_a6" type="revolute"', 'name="joint_a6" type="fixed"'
    )
    assert fixed != MODEL.urdf_xml
    assert disagreements(MODEL, fixed) == ["it has no moving joint joint_a6"]


@pytest.mark.parametrize(("key", "what"), [("upper", "range"), ("velocity", "velocity limit")])
def test_limits_of_another_size_of_the_robot_are_named(key, what):
    first = re.search(f'{key}="([^"]+)"', MODEL.urdf_xml)
    other = MODEL.urdf_xml.replace(first.group(0), f'{key}="{float(first.group(1)) * 1.05}"', 1)
    assert disagreements(MODEL, other) == [f"its {what} differs for joint_a1"]
    like = MODEL.urdf_xml.replace(first.group(0), f'{key}="{float(first.group(1)) * 1.001}"', 1)
    assert disagreements(MODEL, like) == []


def test_another_kind_of_joint_is_named():
    other = MODEL.urdf_xml.replace(
        'name="joint_a2" type="revolute"', 'name="joint_a2" type="prismatic"'
    )
    assert disagreements(MODEL, other) == ["it has another kind of joint joint_a2"]


def test_what_is_no_urdf_is_refused():
    with pytest.raises(RobotDescriptionError):
        disagreements(MODEL, "garbage")
