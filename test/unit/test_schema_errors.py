"""What is wrong in a file is said in plain words, at its place, all of it at once."""

import copy
import resource

import pytest
import yaml

import robots
from robot_energy.foundation.errors import ModelFileError, MotionError
from robot_energy.model import parse_yaml, validate
from robot_energy_plan.motion.ptp_file import read_program
from robots import figure

PYDANTIC = (
    "Input",
    "input",
    "valid dictionary",
    "instance of",
    "Keys should",
    "tag '",
    "validation",
)


def refused(change):
    """The error of the two-link model after a change of its plain values."""
    data = copy.deepcopy(robots.two_link_data())
    change(data)
    with pytest.raises(ModelFileError) as caught:
        validate(data, "robot.yaml")
    text = str(caught.value)
    assert "\n" not in text
    assert not any(words in text for words in PYDANTIC), text
    return caught.value


def shoulder(**changes):
    def change(data):
        data["joints"][0].update(changes)

    return change


def misspelt(data):
    joint = data["joints"][0]
    joint["gear_ration"] = joint.pop("gear_ratio")


def test_a_misspelt_key_is_said_once_with_the_joint_and_the_right_spelling():
    error = refused(misspelt)
    assert error.found == "robot.yaml: key 'joints.shoulder.gear_ration' is unknown"
    assert error.expected == "'gear_ratio'"


@pytest.mark.parametrize(
    ("change", "found", "expected"),
    [
        (shoulder(gear_ratio=100.0), "is 100.0", "a mapping with value and tag"),
        (shoulder(gear_ratio=[1]), "is a list", "a mapping with value and tag"),
        (shoulder(gear_ratio=None), "is empty", "a mapping with value and tag"),
        (shoulder(name=5), "'joints.0.name' is 5", "text"),
        (shoulder(name=""), "'joints.0.name' is ''", "text with a length of at least 1"),
        (
            shoulder(friction={"coulomb": figure(1.0), "viscous": {"law": "konstant"}}),
            "'joints.shoulder.friction.viscous.law' is 'konstant'",
            "one of 'constant', 'exponential', 'table'",
        ),
        (
            shoulder(friction={"coulomb": figure(1.0), "viscous": {"a": 1}}),
            "key 'joints.shoulder.friction.viscous.law' is missing",
            "",
        ),
        (
            shoulder(rotor_inertia={"value": 0, 2: None, "tag": "assumed"}),
            "'joints.shoulder.rotor_inertia' has 2 as a key",
            "a name",
        ),
        (lambda data: data.update(gravity=[0, 0]), "'gravity' is a list", "3 entries"),
        (lambda data: data.update(joints={}), "'joints' is a mapping", "a list"),
        (lambda data: data.update(colour=1), "key 'colour' is unknown", "one of schema_version, "),
    ],
)
def test_a_wrong_entry_is_said_in_plain_words(change, found, expected):
    error = refused(change)
    assert found in error.found
    assert error.expected.startswith(expected)


def test_all_problems_are_said_at_once_up_to_a_bound():
    def change(data):
        misspelt(data)
        del data["cabinet"]
        data["joints"][1]["rotor_inertia"] = "small"

    text = refused(change).found
    assert "3 problems" in text
    for words in ("gear_ration' is unknown, expected 'gear_ratio'", "'cabinet' is missing"):
        assert words in text
    assert "'joints.elbow.rotor_inertia' is 'small', expected a mapping" in text

    def many(data):
        data["massless_links"] = [*range(100)]

    text = refused(many).found
    assert "100 problems" in text
    assert text.endswith("(8) 'massless_links.7' is 7, expected text; and 92 more")


def test_a_file_full_of_problems_needs_little_memory():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    data = robots.two_link_data() | {"massless_links": [1] * 50_000}
    text = yaml.dump(data, Dumper=getattr(yaml, "CSafeDumper", yaml.SafeDumper))
    with pytest.raises(ModelFileError, match="50000 problems"):
        validate(parse_yaml(text, "robot.yaml"), "robot.yaml")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 110 * 1024  # KiB


def test_a_key_of_any_length_and_content_is_cut_and_escaped():
    error = refused(lambda data: data.update({"\x1b[2J" + "k" * 100_000: 1}))
    assert "\\x1b[2J" in error.found
    assert len(str(error)) < 1000


def test_kinds_that_a_key_may_have_are_joined(tmp_path):
    program = {"schema_version": 1, "motion": "point_to_point", "angle_unit": "rad"}
    program |= {"via": [{"a": 0.0}], "dwell": "long"}
    (tmp_path / "program.yaml").write_text(yaml.safe_dump(program))
    with pytest.raises(MotionError) as caught:
        read_program(tmp_path / "program.yaml")
    assert caught.value.found.endswith("'dwell' is 'long'")
    assert caught.value.expected == "a number or a list"
    program["dwell"] = [0.1, "long"]
    (tmp_path / "program.yaml").write_text(yaml.safe_dump(program))
    with pytest.raises(MotionError) as caught:
        read_program(tmp_path / "program.yaml")
    assert caught.value.found.endswith("'dwell.1' is 'long'")
    assert caught.value.expected == "a number"
