"""First model files: figures scaled by hand, joints chosen, and what is refused."""

import json
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import robot_energy as re
import robot_energy_identify.starter.description as description_module
from places import ROOT
from robot_energy.bag import BagWriter
from robot_energy.bag.cdr.types import typestore
from robot_energy.foundation.errors import BagError, RobotDescriptionError, UnknownJointError
from robot_energy.model import load, parse_yaml, validate
from robot_energy.physics.rigid_body import Robot
from robot_energy_cli import main
from robot_energy_identify.starter import (
    RobotText,
    read_arm,
    read_description,
    starter_text,
)
from robot_energy_identify.starter.model_remarks import implausible
from robots import C1, C2, I1, I2, L1, M1, M2, TWO_LINK_URDF, G

MODELS = ROOT / "src/robot_energy/models"


def made(xml, class_name="cobot", joint_names=()):
    """The model that a URDF gives, read back."""
    text = starter_text(read_arm(xml, class_name, joint_names), RobotText(xml, "URDF"), ".")
    return validate(parse_yaml(text, "starter"), "starter")


def link(name, mass=1.0):
    return (
        f'<link name="{name}"><inertial><mass value="{mass}"/><inertia ixx="0.01" iyy="0.01" '
        'izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def joint(name, parent, child, kind="revolute", limit='effort="50" velocity="2"', more=""):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.3 0 0"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" {limit}/>{more}'
        "</joint>"
    )


def robot(*parts):
    return f'<robot name="arm">{"".join(parts)}</robot>'


DRIVE = (
    '<transmission name="t"><joint name="j1"/><actuator name="m">'
    '<drake:gear_ratio value="113.90625"/><drake:rotor_inertia value="2e-05"/></actuator>'
    "</transmission>"
)
LIFTS = ("lift_1", "lift_2")
ONE = robot('<link name="base"/>', link("l1", 4.0), joint("j1", "base", "l1"))


def test_figures_are_those_of_a_hand_calculation():
    found = made(ONE).joints[0]
    # Cobot: gear ratio 100, so 0.5 N m and 200 rad/s motor side of 50 N m and 2 rad/s.
    assert found.gear_ratio.value == 100.0
    assert found.rotor_inertia.value == pytest.approx(0.025 * 0.5 / 200)
    assert found.friction.coulomb.value == pytest.approx(0.05 * 0.5)
    assert found.friction.coulomb.std == pytest.approx(0.6 * 0.05 * 0.5)
    law = found.friction.viscous
    at_20 = law.a.value + law.b.value * np.exp(-20.0 / law.c.value)
    assert at_20 == pytest.approx(0.20 * 0.5 / 200, rel=5e-3)
    assert found.losses.copper.value * 0.5**2 == pytest.approx(0.10 * 50 * 2)
    assert found.losses.constant.value == pytest.approx(0.005 * 100)
    assert found.losses.linear.value * 200 == pytest.approx(0.004 * 100)
    assert found.losses.quadratic.value * 200**2 == pytest.approx(0.002 * 100, rel=5e-3)


def test_figures_of_the_urdf_are_taken_to_the_motor_side_of_a_hand_calculation():
    """At 1 rad/s the joint needs 3 + 4 N m; 100 motor turns a joint turn share these by 100."""
    more = '<dynamics damping="4" friction="3"/>'
    drive = DRIVE.replace("113.90625", "100")
    xml = robot('<link name="base"/>', link("l1", 4.0), joint("j1", "base", "l1", more=more), drive)
    found = made(xml).joints[0]
    given = found.gear_ratio, found.rotor_inertia, found.friction.coulomb
    assert [figure.tag for figure in given] == ["published"] * 3
    assert [figure.value for figure in given] == [100.0, 2e-5, 0.03]
    assert found.friction.viscous.viscous.value == 4e-4
    assert found.friction.viscous.viscous.tag == "published"
    torque = found.friction.coulomb.value + found.friction.viscous.viscous.value * 100.0
    assert torque * 100.0 == pytest.approx(7.0)
    # Prior of drive losses still: 50 N m and 2 rad/s at the joint.
    assert found.losses.constant.value == pytest.approx(0.005 * 100)


def test_a_gear_ratio_of_the_urdf_keeps_its_digits():
    xml = robot('<link name="base"/>', link("l1", 4.0), joint("j1", "base", "l1"), DRIVE)
    found = made(xml).joints[0]
    assert found.gear_ratio.value == 113.90625
    assert found.friction.coulomb.value == pytest.approx(0.05 * 50 / 113.90625, rel=5e-3)
    assert found.friction.coulomb.tag == "assumed"


def test_placeholder_limits_give_the_model_of_a_urdf_without_them(tmp_path, capsys):
    """One joint of three claims 1e7 N m and 1000 rad/s: 10 GW, which once gave no energy at all."""
    parts = (
        '<link name="base"/>', link("l1", 4.0), link("l2", 3.0), link("l3", 2.0),
        joint("j1", "base", "l1"), joint("j2", "l1", "l2"),
    )  # fmt: skip
    placed = robot(*parts, joint("j3", "l2", "l3", limit='effort="1e7" velocity="1000"'))
    without = robot(*parts, joint("j3", "l2", "l3", limit=""))
    assert read_arm(placed).joints == read_arm(without).joints
    urdf, out = tmp_path / "arm.urdf", tmp_path / "arm.yaml"
    urdf.write_text(placed)
    assert main(["model", "init", str(urdf), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "j3: effort limit of 1e+07 N m in the URDF counts as not given" in said
    assert said.count("counts as not given") == 2
    assert "# - j3: velocity limit of 1000 rad/s in the URDF counts as not given" in out.read_text()
    assert main(["model", "check", str(out)]) == 0
    assert "counts as not given" in capsys.readouterr().out


def test_one_effort_limit_far_beyond_need_is_a_placeholder():
    xml = robot(
        '<link name="base"/>', link("l1", 4.0), link("l2", 3.0),
        joint("j1", "base", "l1"), joint("j2", "l1", "l2", limit='effort="50000" velocity="3"'),
    )  # fmt: skip
    arm = read_arm(xml)
    assert arm.joints[0].effort == 50.0
    assert arm.joints[1].effort < 50.0
    assert [text for text in arm.remarks if "50000" in text or "5e+04" in text]


def test_the_missing_effort_limit_is_gravity_and_acceleration_of_a_hand_calculation():
    arm = read_arm(TWO_LINK_URDF, "cobot")
    elbow = arm.joints[1]
    velocity = 3.14  # of the class, since the elbow has none
    assert elbow.velocity == velocity
    worst = M2 * 9.80665 * C2 + (I2 + M2 * C2**2) * velocity / 0.3
    assert elbow.effort == pytest.approx(worst, rel=1e-3)  # 200 configurations drawn
    assert "no usable effort limit" in elbow.why_effort
    shoulder = arm.joints[0]
    assert (shoulder.effort, shoulder.velocity) == (100.0, 4.0)
    needed = (M1 * C1 + M2 * (L1 + C2)) * G + (I1 + M1 * C1**2) * 4 / 0.3
    assert needed < shoulder.effort  # so that the limit of the URDF can be one


@pytest.mark.parametrize("path", sorted(MODELS.glob("*.urdf")), ids=lambda path: path.stem)
def test_every_figure_of_a_shipped_robot_is_an_assumption_with_a_deviation(path):
    shipped = load(path.with_suffix(".yaml"))
    model = made(path.read_text(), None)
    assert set(model.joint_names) == set(shipped.joint_names)
    Robot.from_model(model)
    for entry in model.joints:
        for figure in (entry.gear_ratio, entry.rotor_inertia, entry.friction.coulomb):
            assert figure.tag == "assumed"
            assert figure.std > 0.1 * abs(figure.value)
            assert figure.source


@pytest.mark.parametrize(
    ("name", "expected"),
    [("ur3e", "cobot"), ("ur5e", "cobot"), ("ur10e", "cobot"), ("kr16", "industrial"),
     ("irb4600", "industrial")],
)  # fmt: skip
def test_the_class_follows_from_power_and_mass(name, expected):
    assert read_arm((MODELS / f"{name}.urdf").read_text()).robot_class.name == expected


def test_a_recording_is_replayed_with_the_first_model_at_once(tmp_path):
    out = tmp_path / "first.yaml"
    assert main(["model", "init", str(MODELS / "kr16.urdf"), "--out", str(out)]) == 0
    found = re.replay(ROOT / "bags/kr16_cold", model=out)
    # The rig's own class figures are among the priors' sources, so this proves that the
    # chain works, and nothing about accuracy.
    assert found.energy.balanced
    assert found.energy.grid_import > 0


def remarks(xml, change=None):
    """What is said of the model that a URDF gives, after a change of its joint's entry."""
    text = starter_text(read_arm(xml, "cobot"), RobotText(xml, "URDF"), ".")
    data = parse_yaml(text, "starter")
    for key, value in (change or {}).items():
        entry = data["joints"][0]
        for part in key.split("."):
            entry = entry[part]
        entry["value"] = value
    model = validate(data, "starter")
    return implausible(model, Robot.from_model(model))


@pytest.mark.parametrize(
    ("old", "new", "change", "said"),
    [
        ("", "", {}, None),
        ('mass value="4.0"', 'mass value="4000"', {}, "gravity needs 1.17"),
        ('velocity="2"', 'velocity="120"', {}, "are these degrees per second?"),
        ('ixx="0.01"', 'ixx="2000"', {}, "link 'l1': 4 kg cannot have an inertia of 2000 kg m^2"),
        ('ixx="0.01"', 'ixx="0.9"', {}, "no body has principal moments of inertia of 0.01, 0.01"),
        ("", "", {"friction.coulomb": 0.6}, "Coulomb friction is 60 N m on the joint side"),
        ("", "", {"rotor_inertia": 0.5}, "its rotor alone needs 200 s"),
    ],
)
def test_what_cannot_be_true_is_named_once(old, new, change, said):
    xml = ONE.replace('mass value="4.0"/>', 'mass value="4.0"/><origin xyz="0.3 0 0"/>')
    found = remarks(xml.replace(old, new), change)
    assert [said in sentence for sentence in found] == ([] if said is None else [True])


@pytest.mark.parametrize("path", sorted(MODELS.glob("*.yaml")), ids=lambda path: path.stem)
def test_nothing_in_a_shipped_model_is_implausible(path):
    model = load(path)
    assert implausible(model, Robot.from_model(model)) == []


def test_init_and_check_name_what_cannot_be_true(tmp_path, capsys):
    urdf, out = tmp_path / "arm.urdf", tmp_path / "arm.yaml"
    urdf.write_text(ONE.replace('velocity="2"', 'velocity="120"'))
    assert main(["model", "init", str(urdf), "--out", str(out)]) == 0
    assert "degrees per second" in capsys.readouterr().out
    assert main(["model", "check", str(out)]) == 0
    assert "degrees per second" in capsys.readouterr().out
    assert main(["model", "check", str(out), "--json", str(tmp_path / "check.json")]) == 0
    remarks = json.loads((tmp_path / "check.json").read_text())["remarks"]
    assert [text.split(":")[0] for text in remarks] == ["j1"]


@pytest.mark.parametrize("carrier", ["lift_1", "lift_2"])
def test_a_mimic_that_carries_the_robot_is_named(carrier):
    """A lift of two stages, where either follows the other."""
    follows = {name: '<mimic joint="lift_2"/>' if name == carrier else "" for name in LIFTS}
    if carrier == "lift_2":
        follows["lift_2"] = '<mimic joint="lift_1"/>'
    xml = robot(
        '<link name="base"/>', link("s1", 10.0), link("s2", 10.0), link("l1", 4.0),
        joint("lift_1", "base", "s1", "prismatic", more=follows["lift_1"]),
        joint("lift_2", "s1", "s2", "prismatic", more=follows["lift_2"]),
        joint("j1", "s2", "l1"),
    )  # fmt: skip
    (found,) = remarks(xml)
    assert carrier in found
    assert f"{24 if carrier == 'lift_1' else 14} of 24 kg" in found


def test_wheels_are_named():
    xml = robot(
        '<link name="base"/>', link("w", 2.0), link("l1", 4.0),
        joint("left_wheel_joint", "base", "w"), joint("j1", "base", "l1"),
    )  # fmt: skip
    assert ["wheel" in sentence for sentence in read_arm(xml).remarks] == [True]


def test_a_gripper_and_a_mimic_are_left_out_with_the_reason():
    xml = robot(
        '<link name="base"/>', link("l1", 5.0), link("l2", 3.0), link("f1", 0.05), link("f2", 0.05),
        joint("j1", "base", "l1"), joint("j2", "l1", "l2"),
        joint("finger_1", "l2", "f1", "prismatic"),
        joint("finger_2", "l2", "f2", "prismatic", more='<mimic joint="finger_1"/>'),
    )  # fmt: skip
    arm = read_arm(xml)
    assert [entry.name for entry in arm.joints] == ["j1", "j2"]
    assert dict(arm.left_out).keys() == {"finger_1", "finger_2"}
    wanted = read_arm(xml, joint_names=("finger_1", "j1"))
    assert [entry.name for entry in wanted.joints] == ["j1", "finger_1"]  # from the base


def test_both_arms_of_a_robot_are_modelled():
    xml = robot(
        '<link name="base"/>', link("a1", 5.0), link("b1", 5.0),
        joint("left", "base", "a1"), joint("right", "base", "b1"),
    )  # fmt: skip
    assert len(read_arm(xml).joints) == 2


def test_equal_effort_limits_far_beyond_need_are_placeholders():
    limit = 'effort="1000" velocity="2"'
    xml = robot(
        '<link name="base"/>', *(link(f"l{n}") for n in range(3)),
        joint("j0", "base", "l0", limit=limit), joint("j1", "l0", "l1", limit=limit),
        joint("j2", "l1", "l2", limit=limit),
    )  # fmt: skip
    arm = read_arm(xml)
    assert all(entry.effort < 100 for entry in arm.joints)
    assert len([text for text in arm.remarks if "placeholder" in text]) == 2  # masses too


def test_gear_ratios_of_transmissions_are_used_and_ones_are_not():
    transmission = (
        '<transmission name="t{0}"><joint name="j{0}"/><actuator name="m"><mechanicalReduction>'
        "{1}</mechanicalReduction></actuator></transmission>"
    )
    xml = robot(
        '<link name="base"/>', link("l1"), link("l2"),
        joint("j1", "base", "l1"), joint("j2", "l1", "l2"),
        transmission.format(1, -81.5), transmission.format(2, 1),
    )  # fmt: skip
    model = made(xml)
    assert [entry.gear_ratio.value for entry in model.joints] == [-81.5, 100.0]
    assert model.joints[0].friction.coulomb.value > 0


@given(
    effort=st.floats(1e-3, 1e6), velocity=st.floats(1e-3, 1e3), mass=st.floats(1e-3, 1e5),
    kind=st.sampled_from(["revolute", "prismatic"]), name=st.text(min_size=1, max_size=12),
    robot_class=st.sampled_from(["cobot", "industrial", None]),
)  # fmt: skip
@settings(deadline=None, max_examples=60)
def test_any_robot_that_can_be_read_gives_a_file_that_can_be_read(
    effort, velocity, mass, kind, name, robot_class
):
    from xml.sax.saxutils import quoteattr

    limit = f'effort="{effort!r}" velocity="{velocity!r}"'
    xml = robot('<link name="base"/>', link("l1", mass), joint("j1", "base", "l1", kind, limit))
    xml = xml.replace('name="j1"', f"name={quoteattr(name)}")
    try:
        arm = read_arm(xml, robot_class)
    except RobotDescriptionError:  # such a name is not accepted anywhere
        return
    text = starter_text(arm, RobotText(xml, "URDF"), ".")
    model = validate(parse_yaml(text, "starter"), "starter")
    assert model.urdf_xml.strip() == xml.strip()
    assert model.joint_names == (arm.joints[0].name,)


def test_a_urdf_without_masses_is_refused():
    bare = robot('<link name="base"/>', '<link name="l1"/>', joint("j1", "base", "l1"))
    with pytest.raises(RobotDescriptionError) as refused:
        read_arm(bare)
    assert refused.value.remedy


def test_an_unknown_joint_is_refused_with_those_there_are():
    with pytest.raises(UnknownJointError) as refused:
        read_arm(ONE, joint_names=("j7",))
    assert "j1" in refused.value.remedy


def test_an_existing_file_is_never_replaced(tmp_path):
    out = tmp_path / "first.yaml"
    source = str(MODELS / "kr16.urdf")
    assert main(["model", "init", source, "--out", str(out)]) == 0
    out.write_text(out.read_text() + "# edited by hand\n")
    assert main(["model", "init", source, "--out", str(out)]) == 2
    assert out.read_text().endswith("# edited by hand\n")


# Sources


XACRO = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="arm">
<xacro:arg name="effort" default="10"/><link name="base"/>
<link name="l1"><inertial><mass value="2"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="$(arg effort)" velocity="2"/></joint></robot>"""


def test_a_xacro_file_is_expanded_with_its_arguments(tmp_path):
    path = tmp_path / "arm.urdf.xacro"
    path.write_text(XACRO)
    text = read_description(path, ["effort:=35"])
    assert read_arm(text.xml).joints[0].effort == 35.0
    assert text.path is None  # the text is embedded
    with pytest.raises(RobotDescriptionError):
        read_description(path, ["effort=35"])
    path.write_text(XACRO.replace("$(arg effort)", "$(arg nobody)"))
    with pytest.raises(RobotDescriptionError):
        read_description(path)


def test_the_reason_of_xacro_reaches_the_user(tmp_path):
    path = tmp_path / "arm.urdf.xacro"
    path.write_text(XACRO.replace("$(arg effort)", "${nobody + 1}"))
    with pytest.raises(RobotDescriptionError) as refused:
        read_description(path)
    assert "name 'nobody' is not defined" in refused.value.found
    assert "\n" not in str(refused.value)


def test_xacro_is_found_next_to_the_interpreter(tmp_path, monkeypatch):
    """As in an environment whose commands are not on the path."""
    monkeypatch.setattr(description_module, "which", lambda name: None)
    path = tmp_path / "arm.urdf.xacro"
    path.write_text(XACRO)
    assert read_arm(read_description(path, ["effort:=35"]).xml).joints[0].effort == 35.0
    path.write_text(XACRO.replace("$(arg effort)", "${nobody + 1}"))
    with pytest.raises(RobotDescriptionError, match="nobody"):
        read_description(path)


def test_a_file_of_macros_alone_has_no_links(tmp_path):
    path = tmp_path / "macro.xacro"
    start, _, body = XACRO.partition('<xacro:arg name="effort" default="10"/>')
    path.write_text(
        f'{start}<xacro:macro name="m" params="effort">{body[:-8]}</xacro:macro></robot>'
    )
    with pytest.raises(RobotDescriptionError, match="no links: it only defines macros"):
        read_description(path)


def test_a_urdf_in_another_encoding_makes_a_model_that_is_read_again(tmp_path):
    urdf, out = tmp_path / "arm.urdf", tmp_path / "arm.yaml"
    text = '<?xml version="1.0" encoding="ISO-8859-1"?>' + ONE.replace('"l1"', '"förder"')
    urdf.write_bytes(text.encode("latin-1"))
    assert main(["model", "init", str(urdf), "--out", str(out)]) == 0
    assert "förder" in load(out).urdf_xml


def test_without_xacro_the_way_to_it_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(description_module, "which", lambda name: None)
    monkeypatch.setattr(description_module, "find_spec", lambda name: None)
    path = tmp_path / "arm.urdf"
    path.write_text(XACRO)
    with pytest.raises(RobotDescriptionError) as refused:
        read_description(path)
    assert "xacro" in refused.value.remedy


def recorded(path, xml, joint_names=("j1",)):
    """A bag with a robot description and joint states."""
    types = typestore()
    text = types.types["std_msgs/msg/String"]
    state, header = types.types["sensor_msgs/msg/JointState"], types.types["std_msgs/msg/Header"]
    stamp = types.types["builtin_interfaces/msg/Time"]
    zeros = np.zeros(len(joint_names))
    with BagWriter(path) as bag:
        if xml is not None:
            bag.add_topic("/cell/robot_description", "std_msgs/msg/String")
            message = types.serialize_cdr(text(xml), "std_msgs/msg/String")
            bag.write("/cell/robot_description", [1], [bytes(message)])
        bag.add_topic("/cell/joint_states", "sensor_msgs/msg/JointState")
        message = state(header(stamp(1, 0), ""), list(joint_names), zeros, zeros, zeros)
        data = bytes(types.serialize_cdr(message, "sensor_msgs/msg/JointState"))
        bag.write("/cell/joint_states", [2], [data])
    return path


def test_the_description_of_a_bag_is_used_with_the_joints_it_recorded(tmp_path):
    xml = robot(
        '<link name="base"/>', link("l1"), link("l2"), joint("j1", "base", "l1"),
        joint("j2", "l1", "l2"),
    )  # fmt: skip
    path, out = recorded(tmp_path / "bag", xml), tmp_path / "first.yaml"
    assert read_description(path).joint_names == ("j1",)
    assert main(["model", "init", str(path), "--out", str(out)]) == 0
    model = load(out)
    assert model.joint_names == ("j1",)
    assert model.urdf_xml.strip() == xml


def test_a_bag_without_description_is_refused(tmp_path):
    with pytest.raises(BagError):
        read_description(recorded(tmp_path / "bag", None))


def test_the_command_says_what_it_wrote(tmp_path):
    out = tmp_path / "first.yaml"
    done = subprocess.run(
        [sys.executable, "-m", "robot_energy", "model", "init", str(MODELS / "ur5e.urdf"),
         "--out", str(out)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert str(out) in done.stdout
    assert load(out).drive == "loss_model"
