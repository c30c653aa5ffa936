"""What a URDF may say, and what is made of it."""

import numpy as np
import pytest

import robots
from robot_energy.foundation.errors import RobotDescriptionError, RobotEnergyError
from robot_energy.physics.rigid_body import Robot

MASS = (
    '<inertial><mass value="{}"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
)


def link(name, mass: float | str | None = 1.0):
    return f'<link name="{name}">{"" if mass is None else MASS.format(mass)}</link>'


def joint(name, parent, child, kind="revolute", extra='<limit lower="-1" upper="2" velocity="3"/>'):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="0 0 1"/>{extra}</joint>'
    )


def urdf(*parts):
    return f'<robot name="r">{link("base", None)}{link("a")}{"".join(parts)}</robot>'


ONE = joint("j", "base", "a")
TIP = link("b")


@pytest.mark.parametrize(
    ("text", "state", "remark"),
    [
        (urdf(ONE, TIP, joint("k", "a", "b", "continuous", "")), "locked at 0", "not in the model"),
        (
            urdf(ONE, TIP, joint("k", "a", "b", extra='<limit/><mimic joint="j"/>')),
            "locked at 0",
            "mimics j",
        ),
        (urdf(ONE, TIP, joint("k", "a", "b", "floating", "")), "locked at 0", "of this type"),
        (urdf(ONE, TIP, joint("k", "a", "b", "planar", "")), "locked at 0", "of this type"),
        (urdf(ONE, TIP, joint("k", "a", "b", "prismatic")), "locked at 0", "not in the model"),
    ],
)
def test_what_is_not_modelled_is_listed_with_its_reason_and_its_place(text, state, remark):
    inventory = Robot(text, ("j",)).inventory
    assert inventory.locked_joints == ("k",)
    assert inventory.joints[1].state == state
    assert remark in inventory.joints[1].remark
    assert any(line.startswith("k ") and state in line for line in inventory.sentences())


@pytest.mark.parametrize(
    ("kind", "extra", "remark"),
    [
        ("revolute", '<limit lower="-1" upper="2" velocity="3"/>', "-1 to 2 rad, up to 3 rad/s"),
        ("prismatic", '<limit lower="0" upper="2" velocity="3"/>', "0 to 2 m, up to 3 m/s"),
        ("continuous", "", "in rad, without limits"),
        ("revolute", '<limit lower="0" upper="0" velocity="0"/>', "in rad, without limits"),
    ],
)
def test_what_is_modelled_is_listed_with_type_and_limits(kind, extra, remark):
    robot = Robot(urdf(joint("j", "base", "a", kind, extra)), ("j",))
    assert robot.inventory.joints[0].state == "modelled"
    assert robot.inventory.joints[0].remark == remark
    assert robot.limits.prismatic[0] == (kind == "prismatic")
    assert robot.limits.wraps[0] == (kind == "continuous")


def test_a_prismatic_joint_lifts_its_weight_in_newton():
    """1 kg on a vertical slide: 9.81 N however far it is out."""
    robot = Robot(urdf(joint("j", "base", "a", "prismatic")), ("j",), (0, 0, -robots.G))
    place = np.array([[0.0], [1.5]])
    np.testing.assert_allclose(robot.joint_torque(place, place, 0 * place), robots.G, rtol=1e-12)


def test_links_without_mass_of_their_own_are_listed():
    text = urdf(ONE, link("flange", None), joint("f", "a", "flange", "fixed", ""))
    inventory = Robot(text, ("j",)).inventory
    assert inventory.massless_links == ("flange",)
    assert inventory.fixed_joints == 1
    assert any("flange" in line for line in inventory.sentences())
    text = text.replace('<mass value="1.0"/>', '<mass value="0"/>')
    allowed = Robot(text, ("j",), massless_links=("a",)).inventory
    assert set(allowed.allowed_massless) == {"a", "flange"}
    assert any("as massless_links allows" in line for line in allowed.sentences())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "well-formed"),
        ("<robot/>", "no links"),
        (urdf(joint("j", "base", "a", "floating", "")), "type 'floating'"),
        (urdf(joint("j", "base", "a", "planar", "")), "type 'planar'"),
        (
            urdf(TIP, joint("k", "a", "b"), joint("j", "base", "a", extra='<mimic joint="k"/>')),
            "mimics",
        ),
        (urdf(TIP, joint("j", "base", "a"), joint("j", "a", "b")), "2 joints of the name 'j'"),
        (urdf(ONE, link("a")), "2 links of the name 'a'"),
        (urdf(ONE, TIP), "2 roots: base, b"),
        (urdf(ONE, TIP, joint("k", "a", "b"), joint("l", "b", "a")), "loop"),
        (urdf(link("b"), link("c"), ONE, joint("k", "b", "c"), joint("l", "c", "b")), "loop"),
        (urdf(joint("j", "base", "nowhere")), "'nowhere'"),
        (urdf(ONE).replace('mass value="1.0"', 'mass value="nan"'), "mass 'nan'"),
        (urdf(ONE).replace('mass value="1.0"', 'mass value="-1"'), "mass '-1'"),
        (urdf(ONE).replace('ixx="1"', 'ixx="inf"'), "ixx='inf'"),
        (urdf(ONE).replace('lower="-1"', 'lower="nan"'), "lower='nan'"),
        (urdf(ONE).replace('upper="2"', 'upper="wide"'), "upper='wide'"),
        (urdf(ONE).replace(MASS.format(1.0), ""), "no mass to moving links.*a"),
    ],
)
def test_what_cannot_be_modelled_is_refused_in_one_sentence(text, words):
    with pytest.raises(RobotEnergyError, match=words) as caught:
        Robot(text, ("j",))
    assert "\n" not in str(caught.value)


def test_an_infinite_limit_is_none():
    text = urdf(ONE).replace('velocity="3"', 'velocity="inf"')
    assert Robot(text, ("j",)).limits.velocity[0] == np.inf


def test_error_of_a_urdf_is_its_own_class():
    with pytest.raises(RobotDescriptionError):
        Robot(urdf(ONE, TIP), ("j",))
