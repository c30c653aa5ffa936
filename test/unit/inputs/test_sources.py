import pytest
import yaml

from robot_energy.foundation.errors import ParameterError
from robot_energy.inputs.parameters import assemble
from robot_energy.inputs.sources import Inputs, TemperatureSource, names_remedy
from robot_energy.inputs.temperatures.kinds import (
    DIAGNOSTICS,
    DYNAMIC_JOINT_STATE,
    FLOAT_ARRAY,
    INTERFACE_NAMES,
    INTERFACE_VALUES,
    TEMPERATURE,
)


def inputs(**given):
    return assemble(
        Inputs,
        lambda entry: entry.check(given.get(entry.name, entry.default), "node"),
        "node",
    )


def test_motor_temperatures_need_no_setting():
    assert inputs().temperature_sources == {"motors": TemperatureSource()}
    assert TemperatureSource().topics == {
        "motor_temperatures": "ros2_energy_msgs/msg/MotorTemperatures"
    }


@pytest.mark.parametrize(
    ("topic", "names_topic", "expected"),
    [
        ("values", "", "names"),
        ("/arm/broadcaster/values", "", "/arm/broadcaster/names"),
        ("arm/values", "keys", "keys"),
    ],
)
def test_keys_come_on_a_topic_next_to_the_values(topic, names_topic, expected):
    source = TemperatureSource(topic=topic, names_topic=names_topic, type=INTERFACE_VALUES)
    assert source.topics == {expected: INTERFACE_NAMES, topic: INTERFACE_VALUES}
    assert list(source.topics) == [expected, topic]  # keys are drained first
    resolved = source.resolved(lambda name: f"/ns/{name.lstrip('/')}")
    assert resolved.topics == {
        f"/ns/{expected.lstrip('/')}": INTERFACE_NAMES,
        f"/ns/{topic.lstrip('/')}": INTERFACE_VALUES,
    }


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"topic": ""}, "topic is empty"),
        ({"joints": ("a", "a"), "type": FLOAT_ARRAY}, "joints has a twice"),
        ({"type": FLOAT_ARRAY}, "type is Float64MultiArray but joints is empty"),
        ({"type": DIAGNOSTICS}, "type is DiagnosticArray but joints is empty"),
        ({"names": ("f",)}, "names is given but joints is empty"),
        ({"type": FLOAT_ARRAY, "joints": ("a",), "names": ("x",)}, "names is given for Float64"),
        ({"type": TEMPERATURE, "joints": ("a", "b")}, "type is Temperature and joints names 2"),
        (
            {"type": TEMPERATURE, "joints": ("a", "b"), "names": ("f",)},
            "names has 1 entries; expected 2",
        ),
        (
            {"type": DYNAMIC_JOINT_STATE, "joints": ("a", "b"), "names": ("f", "f")},
            "names has a name twice",
        ),
        ({"type": DIAGNOSTICS, "joints": ("a",), "keys": ("k", "l")}, "keys has 2 entries"),
    ],
)
def test_settings_that_do_not_fit_are_refused(settings, words):
    with pytest.raises(ParameterError, match=words):
        TemperatureSource(**settings)


def test_places_that_are_no_joint_may_repeat():
    source = TemperatureSource(type=FLOAT_ARRAY, joints=("-", "a", "-"))
    assert source.joints == ("-", "a", "-")


def test_sources_must_differ_and_agree_on_the_type_of_a_topic():
    with pytest.raises(ParameterError, match="sources one, two are the same"):
        inputs(temperature_sources=["one", "two"])
    with pytest.raises(ParameterError, match=r"'two' reads motor_temperatures as .*Temperature"):
        inputs(temperature_sources=["one", "two"], **{"two.type": TEMPERATURE})


def test_the_line_of_joint_names_is_yaml():
    met = ["r: a1", "left/a2", "gripper"]
    remedy = names_remedy(("a1", "a2"), met)
    assert yaml.safe_load(remedy.partition(" to ")[2]) == ["r: a1", "left/a2"]
    assert remedy.endswith(" to ['r: a1', left/a2]")
    assert names_remedy(("a1", "a3"), met).endswith("set joint_states.joint_names")
