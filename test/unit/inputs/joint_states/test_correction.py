"""Sign, scale and zero of joint states, with numbers worked out by hand."""

import numpy as np
import pytest
import yaml

from joint_messages import NAMES, limits, message, take
from robot_energy.foundation.errors import ParameterError
from robot_energy.inputs.inputs_file import read_inputs
from robot_energy.inputs.joint_states.correction import JointCorrection
from robot_energy.inputs.joint_states.joint_states import JointStateIngest
from robot_energy.inputs.sources import JointStateSource


def ingest(**corrections):
    made = {name: JointCorrection(**entries) for name, entries in corrections.items()}
    return JointStateIngest(NAMES, source=JointStateSource(**made), effort=True)


def test_each_quantity_of_each_joint_is_corrected_and_the_zero_comes_last():
    block = take(
        ingest(
            position={"sign": (1.0, -1.0), "scale": (2.0, 0.5), "zero": (0.25, 0.125)},
            velocity={"sign": (-1.0,)},
            effort={"scale": (10.0,), "zero": (0.0, -4.0)},
        ),
        [message(1.0, ("b", "a"), (2.0, 1.0), (4.0, 3.0), (6.0, 5.0))],  # another order
    )
    np.testing.assert_array_equal(block.joint_position, [[2.25, -0.875]])
    np.testing.assert_array_equal(block.joint_velocity, [[-3.0, -4.0]])
    np.testing.assert_array_equal(block.joint_effort, [[50.0, 56.0]])


def test_what_a_message_lacks_stays_unknown():
    made = ingest(velocity={"zero": (1.0,)}, effort={"zero": (1.0,)})
    block = take(made, [message(1.0, velocity=(), effort=())])
    assert np.isnan(block.joint_velocity).all()
    assert np.isnan(block.joint_effort).all()


def test_degrees_are_mended_before_limits_are_looked_at():
    source = JointStateSource(
        position=JointCorrection(scale=(0.017453292519943295,)),
        velocity=JointCorrection(scale=(0.017453292519943295,)),
    )
    states = [
        message(1.0 + 0.01 * k, position=(90.0, 10.0), velocity=(57.3, 0.0)) for k in range(9)
    ]
    plain, mended = (
        JointStateIngest(NAMES, limits=limits(), source=each) for each in (None, source)
    )
    take(plain, states)
    block = take(mended, states)
    assert plain.findings()
    assert not mended.findings()
    np.testing.assert_allclose(block.joint_position[0], [np.pi / 2, np.pi / 18])


def test_a_second_correction_after_a_first_is_one_correction():
    first = JointCorrection(sign=(1.0, -1.0), scale=(2.0,), zero=(0.5, 0.25))
    second = JointCorrection(sign=(-1.0,), scale=(3.0, 4.0), zero=(1.0,))
    values = np.array([[1.0, 2.0], [-3.0, 0.0]])
    both = first.followed_by(second)
    np.testing.assert_allclose(both.apply(values), second.apply(first.apply(values)))
    assert (both.sign, both.scale, both.zero) == ((-1.0, 1.0), (6.0, 8.0), (-0.5, 0.0))


def test_the_line_of_yaml_says_the_same_and_nothing_more(tmp_path):
    correction = JointCorrection(sign=(1.0, -1.0), scale=(1e-9,), zero=(0.1, 2.0))
    line = correction.line("effort")
    assert line == "effort: {sign: [1, -1], scale: [1.0e-09], zero: [0.1, 2.0]}"
    path = tmp_path / "inputs.yaml"
    path.write_text(f"/**:\n  ros__parameters:\n    joint_states:\n      {line}\n")
    assert read_inputs(path)[0].joint_states == JointStateSource(effort=correction)
    assert yaml.safe_load(line)["effort"]["sign"] == [1, -1]
    assert JointCorrection(sign=(-1.0, -1.0)).line("velocity") == "velocity: {sign: [-1, -1]}"
    assert JointCorrection().line("position") == ""


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ({"sign": (0.5,)}, "sign has the entry 0.5; expected 1 or -1"),
        (
            {"zero": (0.0, 0.0, 0.0)},
            r"joint_states.effort.zero has 3 entries; expected 1 for all joints, or 2, one for "
            "each of a, b",
        ),
    ],
)
def test_wrong_entries_are_named(entries, words):
    with pytest.raises(ParameterError, match=words):
        ingest(effort=entries)


@pytest.mark.parametrize(
    "text", ["scale: [0.0]", "scale: [-2.0]", "zero: [.nan]", "sign: []", "zero: 1.0"]
)
def test_a_file_with_an_impossible_entry_is_refused(tmp_path, text):
    path = tmp_path / "inputs.yaml"
    path.write_text(f"/**:\n  ros__parameters:\n    joint_states:\n      effort: {{{text}}}\n")
    with pytest.raises(ParameterError, match=r"joint_states.effort.*a list of numbers from"):
        read_inputs(path)
