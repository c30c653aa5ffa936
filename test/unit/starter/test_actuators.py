"""What a URDF states of drives: the side of each figure, and what is named as not used."""

import pytest

from robot_energy.physics.urdf.checks import parse
from robot_energy_identify.starter.arm import read_actuators, without_defaults


def robot(*more, dynamics=("", "", "")):
    """Three joints in a row, with what stands next to them."""
    joints = "".join(
        f'<link name="l{row}"/><joint name="j{row}" type="revolute"><parent link="l{row - 1}"/>'
        f'<child link="l{row}"/><axis xyz="0 0 1"/>{text}</joint>'
        for row, text in enumerate(dynamics, 1)
    )
    return parse(f'<robot name="r"><link name="l0"/>{joints}{"".join(more)}</robot>')


def transmission(joint, actuator, more=""):
    return (
        f'<transmission name="t"><type>transmission_interface/SimpleTransmission</type>'
        f'<joint name="{joint}"/>{more}<actuator name="m">{actuator}</actuator></transmission>'
    )


REDUCTION = "<mechanicalReduction>{}</mechanicalReduction>"
DRAKE = '<drake:gear_ratio value="{}"/><drake:rotor_inertia value="{}"/>'
NAMES = ("j1", "j2", "j3")


@pytest.mark.parametrize(
    ("entry", "ratio", "inertia"),
    [
        (REDUCTION.format("113.90625"), 113.90625, None),
        (REDUCTION.format(" -79.2380952381\n"), -79.2380952381, None),
        (REDUCTION.format("50") + "<motorInertia>2.5e-5</motorInertia>", 50.0, 2.5e-5),
        (DRAKE.format("18.0", "0.00012"), 18.0, 0.00012),
        (REDUCTION.format("1"), None, None),
        (REDUCTION.format(""), None, None),
    ],
)
def test_figures_of_a_transmission_are_those_of_the_motor_side(entry, ratio, inertia):
    found, ignored = read_actuators(robot(transmission("j1", entry)), NAMES)
    assert (found["j1"].gear_ratio, found["j1"].rotor_inertia) == (ratio, inertia)
    assert found["j2"].gear_ratio is None
    assert ignored == []


def test_a_transmission_of_ros2_control_is_read():
    entry = transmission("j1", "<mechanical_reduction>72</mechanical_reduction>")
    found, _ = read_actuators(robot(f'<ros2_control name="c">{entry}</ros2_control>'), NAMES)
    assert found["j1"].gear_ratio == 72.0


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ([transmission("j1", REDUCTION.format("0.02"))], "is it 50?"),
        ([transmission("j1", REDUCTION.format("ratio"))], "'ratio' of the URDF is not a number"),
        ([transmission("j1", DRAKE.format("1", "0.1"))], "gives no gear ratio"),
        ([transmission("j1", DRAKE.format("10", "-0.1"))], "below 0"),
        ([transmission("j1", REDUCTION.format("50"), '<joint name="j2"/>')], "several joints"),
        (
            [transmission("j1", REDUCTION.format("50")), transmission("j1", DRAKE.format(60, 1))],
            "gives another",
        ),
    ],
)
def test_what_is_not_used_is_named(entries, words):
    _, ignored = read_actuators(robot(*entries), NAMES)
    assert any(words in text and text.startswith("j1") for text in ignored)


def test_friction_is_that_of_the_joint_side_and_zeros_say_nothing():
    root = robot(
        dynamics=(
            '<dynamics damping="8" friction="6"/>',
            '<dynamics damping="0.0" friction="0"/>',
            '<dynamics damping="nan" friction="-1"/>',
        )
    )
    found, ignored = read_actuators(root, NAMES)
    assert (found["j1"].damping, found["j1"].friction) == (8.0, 6.0)
    assert (found["j2"].damping, found["j2"].friction) == (None, None)
    assert (found["j3"].damping, found["j3"].friction) == (None, None)
    assert [text[:2] for text in ignored] == ["j3", "j3"]


@pytest.mark.parametrize(
    ("dynamics", "effort", "kept", "words"),
    [
        (["8"] * 3, [100.0, 50.0, 20.0], 0, "default of a simulation"),
        (["8"] * 3, [100.0] * 3, 3, ""),  # the same drive three times
        (["8", "4", "2"], [100.0, 50.0, 20.0], 3, ""),
        (["8", "4", "9"], [100.0, 50.0, 18.0], 2, "all of the effort limit"),  # 9 * 2 rad/s
    ],
)
def test_friction_that_the_joint_cannot_have_is_left_out(dynamics, effort, kept, words):
    root = robot(dynamics=[f'<dynamics damping="{text}"/>' for text in dynamics])
    found, said = without_defaults(read_actuators(root, NAMES)[0], effort, [2.0] * 3)
    assert sum(actuator.damping is not None for actuator in found.values()) == kept
    assert [words in text for text in said] == ([True] if words else [])
