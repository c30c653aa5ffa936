"""Parameters say what they mean, and refuse in one sentence what they cannot be."""

from __future__ import annotations

from dataclasses import MISSING, fields
from pathlib import Path
from typing import get_type_hints

import pytest
import yaml
from rclpy.node import Node
from rclpy.parameter import Parameter

from ros2_energy_monitor.node_parameters import (
    ConsoleParameters,
    EnergyParameters,
    FrictionParameters,
    ParameterError,
    PowerParameters,
    RobotParameters,
    TorqueParameters,
    declare,
)

CONFIG = Path(__file__).resolve().parent.parent / "config"
NODES = {
    "torque_monitor": TorqueParameters,
    "friction_monitor": FrictionParameters,
    "power_monitor": PowerParameters,
    "energy_monitor": EnergyParameters,
    "virtual_robot": RobotParameters,
    "console": ConsoleParameters,
}


class Any(Node):
    """A node with the parameters of the torque monitor."""

    def __init__(self, cls=TorqueParameters, **options):
        super().__init__("torque_monitor", **options)
        try:
            self.values = declare(self, cls)
        except ParameterError:
            self.destroy_node()
            raise


def test_every_node_has_a_configuration_and_no_other():
    assert {path.stem for path in CONFIG.glob("*.yaml")} == set(NODES)


@pytest.mark.parametrize("name", NODES)
def test_configuration_holds_every_parameter_with_its_default(name):
    document = yaml.safe_load((CONFIG / f"{name}.yaml").read_text())
    values = document["/**"]["ros__parameters"]
    defaults = {entry.name: entry.default for entry in fields(NODES[name])}
    assert list(values) == list(defaults)
    for key, default in defaults.items():
        if default is not MISSING:
            assert values[key] == (list(default) if isinstance(default, tuple) else default), key
            assert type(values[key]) in (type(default), list), key


@pytest.mark.parametrize("name", NODES)
def test_configuration_explains_every_parameter(name):
    lines = (CONFIG / f"{name}.yaml").read_text().splitlines()
    words = " ".join(" ".join(line.strip().removeprefix("#") for line in lines).split())
    for entry in fields(NODES[name]):
        assert entry.metadata["description"] in words, entry.name


@pytest.mark.parametrize("name", NODES)
def test_every_number_has_a_unit_and_a_range(name):
    hints = get_type_hints(NODES[name])
    for entry in fields(NODES[name]):
        if hints[entry.name] is float:
            assert "[" in entry.metadata["description"], entry.name
        if hints[entry.name] in (int, float):
            assert entry.metadata["low"] < entry.metadata["high"], entry.name


@pytest.mark.parametrize("name", NODES)
def test_configuration_file_is_accepted(bench, name):
    document = yaml.safe_load((CONFIG / f"{name}.yaml").read_text())
    node = bench.add(Any, NODES[name], **document["/**"]["ros__parameters"])
    assert node.values == NODES[name](
        **{
            key: tuple(value) if isinstance(value, list) else value
            for key, value in document["/**"]["ros__parameters"].items()
        }
    )


def test_descriptors_are_complete_and_read_only(bench):
    node = bench.add(Any, model="kr16")
    descriptor = node.describe_parameter("tick_rate")
    assert descriptor.read_only
    assert "[1/s]" in descriptor.description
    assert descriptor.floating_point_range[0].to_value == 1000.0
    assert not node.set_parameters([Parameter("tick_rate", value=20.0)])[0].successful
    assert node.describe_parameter("joint_state_depth").integer_range[0].from_value == 1


@pytest.mark.parametrize("given", [{}, {"model": ""}])
def test_missing_required_parameter(bench, given):
    with pytest.raises(ParameterError) as caught:
        bench.add(Any, **given)
    sentence = str(caught.value)
    assert sentence.startswith("torque_monitor was started without its parameter 'model'")
    assert "-p model:=" in sentence
    assert "\n" not in sentence


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"tick_rate": 0.0}, ("tick_rate", "0.0", "from 1.0 to 1000.0")),
        ({"tick_rate": "fast"}, ("tick_rate", "'fast'", "a number")),
        ({"tick_rate": float("nan")}, ("tick_rate", "nan", "a number")),
        ({"joint_state_depth": 0}, ("joint_state_depth", "0", "an integer from 1")),
        ({"joint_state_depth": 1.5}, ("joint_state_depth", "1.5", "an integer")),
        ({"model": 16}, ("model", "16", "a text")),
    ],
)
def test_wrong_values_are_refused_in_one_sentence(bench, given, words):
    with pytest.raises(ParameterError) as caught:
        bench.add(Any, **{"model": "kr16", **given})
    for word in words:
        assert word in str(caught.value)
    assert "\n" not in str(caught.value)


def test_wrong_choice_lists_the_right_ones(bench):
    with pytest.raises(ParameterError, match=r"one of ros2_energy_msgs/msg/MotorTemperatures"):
        bench.add(Any, FrictionParameters, model="kr16", temperature_type="Temperature")


def test_whole_numbers_and_empty_lists_are_understood(bench):
    node = bench.add(Any, FrictionParameters, model="kr16", tick_rate=20, temperature_topics=[])
    assert node.values.tick_rate == 20.0
    assert node.values.temperature_topics == ()


def test_unknown_parameter_is_named_with_its_neighbour(bench, capfd):
    bench.add(Any, model="kr16", tick_rat=20.0, use_sim_time=False)
    output = capfd.readouterr().err
    assert "has no parameter 'tick_rat'; did you mean 'tick_rate'?" in output
    assert "use_sim_time" not in output
