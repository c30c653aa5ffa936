# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Parameters say what they mean, and refuse in one sentence what they cannot be."""

from __future__ import annotations

from dataclasses import MISSING, fields
from pathlib import Path

import pytest
import yaml
from rclpy.node import Node
from rclpy.parameter import Parameter

from robot_energy.foundation.errors import ParameterError
from robot_energy.inputs.inputs_file import read_inputs
from robot_energy.inputs.joint_states.correction import JointCorrection
from robot_energy.inputs.parameters import assemble
from robot_energy.inputs.sources import JointStateSource, TemperatureSource
from robot_energy.inputs.temperatures.kinds import FLOAT_ARRAY, TEMPERATURE
from robot_energy.presets import ROBOTS
from ros2_energy_monitor.base.node_parameters import (
    ConsoleParameters,
    DashboardParameters,
    EnergyParameters,
    FrictionParameters,
    PowerParameters,
    RobotParameters,
    TorqueParameters,
)
from ros2_energy_monitor.base.parameter_files import files_without_section, sections
from ros2_energy_monitor.base.parameters import declare
from ros2_energy_monitor.exporters.kinds import exporter_parameters
from ros2_energy_monitor.meters.kinds import MeterDriverParameters
from ros2_energy_monitor.nodes.energy_recorder import RecorderParameters

CONFIG = Path(__file__).resolve().parent.parent / "config"
NODES = {
    "torque_monitor": TorqueParameters,
    "friction_monitor": FrictionParameters,
    "power_monitor": PowerParameters,
    "energy_monitor": EnergyParameters,
    "virtual_robot": RobotParameters,
    "console": ConsoleParameters,
    "energy_dashboard": DashboardParameters,
    "meter_driver": MeterDriverParameters,
    "energy_recorder": RecorderParameters,
    "energy_exporter": exporter_parameters(),
}


def entries(cls):
    """Every parameter of a node, those of its groups included."""
    found = []

    def value_of(entry):
        found.append(entry)
        return "kr16" if entry.default is MISSING else entry.default

    assemble(cls, value_of, "test")
    return found


def flat(values, prefix=""):
    """Parameters of a file by full name."""
    found = {}
    for name, value in values.items():
        is_group = isinstance(value, dict)
        found |= flat(value, f"{prefix}{name}.") if is_group else {prefix + name: value}
    return found


def configured(name):
    document = yaml.safe_load((CONFIG / f"{name}.yaml").read_text())
    return flat(document["/**"]["ros__parameters"])


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
    values = configured(name)
    defaults = {entry.name: entry.default for entry in entries(NODES[name])}
    assert list(values) == list(defaults)
    for key, default in defaults.items():
        if default is not MISSING:
            assert values[key] == (list(default) if isinstance(default, tuple) else default), key
            assert type(values[key]) in (type(default), list), key


@pytest.mark.parametrize("name", NODES)
def test_configuration_explains_every_parameter(name):
    lines = (CONFIG / f"{name}.yaml").read_text().splitlines()
    words = " ".join(" ".join(line.strip().removeprefix("#") for line in lines).split())
    for entry in entries(NODES[name]):
        assert entry.description in words, entry.name


@pytest.mark.parametrize("name", NODES)
def test_every_number_has_a_unit_and_a_range(name):
    for entry in entries(NODES[name]):
        if entry.kind is float:
            assert "[" in entry.description, entry.name
        if entry.kind in (int, float):
            assert entry.bounds[0] < entry.bounds[1], entry.name


@pytest.mark.parametrize("name", NODES)
def test_configuration_file_is_accepted(bench, name):
    values = configured(name)
    node = bench.add(Any, NODES[name], **values)
    expected = assemble(
        NODES[name], lambda entry: entry.check(values[entry.name], "the file"), "the file"
    )
    assert node.values == expected


@pytest.mark.parametrize("name", ["torque_monitor", "power_monitor", "energy_monitor"])
@pytest.mark.parametrize("value", [-1.0, 0.0005, 61.0])
def test_a_longest_gap_that_makes_no_sense_stops_the_node(bench, name, value):
    with pytest.raises(ParameterError, match="max_gap"):
        bench.add(Any, NODES[name], model="kr16", max_gap=value)


@pytest.mark.parametrize("robot", ROBOTS)
def test_presets_of_robots_are_accepted_and_mean_the_same_as_in_a_replay(bench, robot):
    node = bench.add(Any, EnergyParameters, **flat(ROBOTS[robot].parameters), model="kr16")
    inputs, _ = read_inputs(robot)
    assert node.values.joint_states == inputs.joint_states
    assert node.values.temperature_sources == inputs.temperature_sources
    assert node.values.meter == inputs.meter


def test_descriptors_are_complete_and_read_only(bench):
    node = bench.add(Any, model="kr16")
    descriptor = node.describe_parameter("tick_rate")
    assert descriptor.read_only  # as for nodes without a life cycle
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
    assert sentence.endswith("start with --ros-args -p model:=VALUE.")
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
        bench.add(Any, FrictionParameters, model="kr16", **{"motors.type": "Temperature"})


def test_whole_numbers_and_empty_lists_are_understood(bench):
    node = bench.add(Any, FrictionParameters, model="kr16", tick_rate=20, temperature_sources=[])
    assert node.values.tick_rate == 20.0
    assert node.values.temperature_sources == {}


def test_sources_are_groups_of_parameters(bench):
    node = bench.add(
        Any,
        FrictionParameters,
        model="kr16",
        temperature_sources=["wrist", "arm"],
        **{
            "wrist.topic": "wrist/temperature",
            "wrist.type": TEMPERATURE,
            "wrist.joints": ["joint_a4"],
            "arm.topic": "arm",
            "arm.type": FLOAT_ARRAY,
            "arm.unit": "kelvin",
            "arm.joints": ["joint_a1", "-"],
        },
    )
    assert node.values.temperature_sources == {
        "wrist": TemperatureSource(
            topic="wrist/temperature", type=TEMPERATURE, joints=("joint_a4",)
        ),
        "arm": TemperatureSource(
            topic="arm", type=FLOAT_ARRAY, unit="kelvin", joints=("joint_a1", "-")
        ),
    }
    descriptor = node.describe_parameter("arm.unit")
    assert descriptor.read_only
    assert descriptor.additional_constraints == "one of degc, kelvin, fahrenheit"
    assert not node.set_parameters([Parameter("arm.unit", value="degc")])[0].successful


def test_a_source_that_does_not_fit_is_refused_by_its_name(bench):
    with pytest.raises(ParameterError) as caught:
        bench.add(Any, FrictionParameters, model="kr16", **{"motors.type": FLOAT_ARRAY})
    assert "'motors' of torque_monitor: type is Float64MultiArray but joints is empty" in str(
        caught.value
    )


def test_unknown_parameter_of_a_group_is_named_with_its_neighbour(bench, capfd):
    bench.add(Any, FrictionParameters, model="kr16", **{"motors.topik": "x"})
    output = capfd.readouterr().err
    assert "has no parameter 'motors.topik'; did you mean 'motors.topic'?" in output


@pytest.mark.parametrize(
    ("section", "fits"),
    [
        ("/**", True),
        ("/*", True),
        ("torque_monitor", True),
        ("/torque_monitor", True),
        ("/**/torque_monitor", True),
        ("/*/torque_monitor", False),
        ("torque_moniter", False),
        ("torque", False),
        ("/cell/torque_monitor", False),
    ],
)
def test_a_file_for_other_nodes_is_named(bench, capfd, monkeypatch, tmp_path, section, fits):
    path = tmp_path / "given.yaml"
    path.write_text(yaml.safe_dump({section: {"ros__parameters": {"model": "kr16"}}}))
    monkeypatch.setattr("sys.argv", ["node", "--ros-args", "--params-file", str(path)])
    bench.add(Any, model="kr16")
    sentence = f"the parameter file {path} holds nothing for /torque_monitor, only for"
    assert (sentence in capfd.readouterr().err) is not fits
    if not fits:
        with pytest.raises(ParameterError, match="holds nothing for /torque_monitor"):
            bench.add(Any, model="kr16", strict_parameters=True)


def test_sections_of_a_namespace_and_of_several_nodes(tmp_path):
    path = tmp_path / "given.yaml"
    path.write_text(
        "cell:\n  torque_monitor:\n    ros__parameters: {model: kr16}\n"
        "/other/*:\n  ros__parameters: {model: ur3e}\n"
    )
    assert list(sections(str(path))) == ["/cell/torque_monitor", "/other/*"]
    arguments = ["--params-file", str(path)]
    assert not files_without_section(arguments, "/cell/torque_monitor")
    assert not files_without_section(arguments, "/other/torque_monitor")
    assert (
        "only for /cell/torque_monitor, /other/*"
        in files_without_section(arguments, "/torque_monitor")[0]
    )
    path.write_text("{")
    assert not files_without_section(arguments, "/torque_monitor")


def test_strict_parameters_refuse_what_is_unknown(bench):
    with pytest.raises(ParameterError, match="has no parameter 'tick_rat'; did you mean"):
        bench.add(Any, model="kr16", tick_rat=20.0, strict_parameters=True)


@pytest.mark.parametrize(
    "name",
    [
        *(entry.name for entry in fields(TorqueParameters) if entry.name != "joint_states"),
        *(
            f"joint_states.{entry.name}"
            for entry in fields(JointStateSource)
            if "group" not in entry.metadata
        ),
        *(f"joint_states.effort.{entry.name}" for entry in fields(JointCorrection)),
    ],
)
def test_one_wrong_letter_in_any_name_is_noticed(bench, capfd, name):
    wrong = name[:-1] + ("x" if name[-1] != "x" else "y")
    bench.add(Any, **{"model": "kr16", wrong: 1})
    assert f"no parameter '{wrong}'; did you mean '{name}'?" in capfd.readouterr().err


def test_corrections_of_joint_states_are_lists_of_numbers_with_or_without_a_point(bench):
    given = {"joint_states.effort.sign": [1, -1], "joint_states.effort.zero": [0.5, 0.0]}
    node = bench.add(Any, model="kr16", **given)
    expected = JointCorrection(sign=(1.0, -1.0), zero=(0.5, 0.0))
    assert node.values.joint_states == JointStateSource(effort=expected)


def test_a_correction_that_is_no_list_of_numbers_stops_the_node(bench):
    with pytest.raises(ParameterError, match=r"joint_states.effort.sign.*a list of numbers"):
        bench.add(Any, model="kr16", **{"joint_states.effort.sign": ["a"]})


def test_unknown_parameter_is_named_with_its_neighbour(bench, capfd):
    bench.add(Any, model="kr16", tick_rat=20.0, use_sim_time=False)
    output = capfd.readouterr().err
    assert "has no parameter 'tick_rat'; did you mean 'tick_rate'?" in output
    assert "use_sim_time" not in output
