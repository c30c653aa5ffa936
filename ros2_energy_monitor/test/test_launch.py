# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Launch files name only what exists. `launch` is not on PyPI: small stand-ins record calls."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from robot_energy.foundation.errors import KindError, ModelFileError
from robot_energy.presets import ROBOTS
from ros2_energy_monitor.executables import EXECUTABLES

PACKAGE = Path(__file__).resolve().parent.parent
FILES = sorted((PACKAGE / "launch").glob("*.launch.py"))
NAMES = {
    "launch": ["LaunchDescription"],
    "launch.actions": ["DeclareLaunchArgument", "IncludeLaunchDescription", "OpaqueFunction"],
    "launch.conditions": ["IfCondition", "UnlessCondition"],
    "launch.launch_description_sources": ["PythonLaunchDescriptionSource"],
    "launch.substitutions": ["LaunchConfiguration", "PathJoinSubstitution"],
    "launch_ros": [],
    "launch_ros.actions": ["Node"],
    "launch_ros.substitutions": ["FindPackageShare"],
}


class Recorded:
    """Stands for an object of the launch system: remembers how it was made."""

    def __init__(self, kind: str, args: tuple[Any, ...], options: dict[str, Any]) -> None:
        self.kind, self.args, self.options = kind, args, options

    def perform(self, given: dict[str, str]) -> str:
        return given[self.args[0]]


@pytest.fixture
def file(tmp_path: Path) -> str:
    """A parameter file; one that is not there is refused."""
    path = tmp_path / "my.yaml"
    path.write_text("")
    return str(path)


@pytest.fixture
def describe(monkeypatch: pytest.MonkeyPatch):
    made: list[Recorded] = []

    def maker(kind: str):
        def make(*args: Any, **options: Any) -> Recorded:
            made.append(Recorded(kind, args, options))
            return made[-1]

        return make

    for module_name, names in NAMES.items():
        module = ModuleType(module_name)
        for name in names:
            setattr(module, name, maker(name))
        monkeypatch.setitem(sys.modules, module_name, module)

    def run(path: Path, **given: str) -> list[Recorded]:
        """What the file makes, for arguments or their defaults."""
        made.clear()
        runpy.run_path(str(path))["generate_launch_description"]()
        defaults = {
            one.args[0]: one.options["default_value"]
            for one in made
            if one.kind == "DeclareLaunchArgument"
        }
        for one in [one for one in made if one.kind == "OpaqueFunction"]:
            model = "" if "robot" in given else "kr16"
            off = {} if path != FILES[0] else {"history": "false"}  # most tests look at monitors
            values = {**defaults, "model": model, **off, **given}
            for name, choices in choices_of(made).items():
                assert values[name] in choices
            one.options["function"](values)
        return list(made)

    return run


def choices_of(made: list[Recorded]) -> dict[str, list[str]]:
    """What arguments can be, where they take no free text."""
    declared = [one for one in made if one.kind == "DeclareLaunchArgument"]
    return {one.args[0]: one.options["choices"] for one in declared if one.options["choices"]}


def test_the_launch_files_are_found():
    assert [path.name.split(".")[0] for path in FILES] == ["energy_monitor", "virtual_robot"]


def test_the_monitor_runs_in_one_process_or_in_three(describe):
    assert list(nodes_of(describe(FILES[0]))) == ["energy_monitor"]
    assert list(nodes_of(describe(FILES[0], separate="true"))) == [
        "torque_monitor",
        "friction_monitor",
        "power_monitor",
    ]


def test_the_dashboard_is_started_where_it_is_asked_for(describe, file):
    made = nodes_of(describe(FILES[0], dashboard="true", namespace="left", params_file=file))
    assert list(made) == ["energy_monitor", "energy_dashboard"]
    assert made["energy_dashboard"].options["parameters"][1:] == [file, {}]
    assert "namespace" not in made["energy_dashboard"].options  # one page for all robots


@pytest.mark.parametrize(("kept", "shown"), [("/kept", "/kept/history"), ("none", "none")])
def test_the_dashboard_shows_the_history_that_is_recorded(describe, kept, shown):
    made = nodes_of(describe(FILES[0], dashboard="true", state_folder=kept))
    assert made["energy_dashboard"].options["parameters"][1:] == [{"history_folder": shown}]


def test_what_all_robots_use_is_recorded_in_one_folder_unless_it_is_turned_off(describe, file):
    declared = [one for one in describe(FILES[0]) if one.kind == "DeclareLaunchArgument"]
    defaults = {one.args[0]: one.options["default_value"] for one in declared}
    on = {"history": defaults["history"]}
    made = nodes_of(describe(FILES[0], namespace="left", params_file=file, **on))
    recorder = made["energy_recorder"]
    assert recorder.options["parameters"][1:] == [file, {}]
    assert "namespace" not in recorder.options  # one recorder for all robots
    for given, folder in (
        ({"state_folder": "/kept"}, "/kept/history"),
        ({"virtual": "true"}, "$ROS_HOME/robot_energy/virtual_robot/history"),
    ):
        found = nodes_of(describe(FILES[0], **on, **given))["energy_recorder"]
        assert found.options["parameters"][1:] == [{"folder": folder}]
    for off in ({"history": "false"}, {**on, "state_folder": "none"}):
        assert "energy_recorder" not in nodes_of(describe(FILES[0], **off))


def nodes_of(made: list[Recorded]) -> dict[str, Recorded]:
    return {one.options["executable"]: one for one in made if one.kind == "Node"}


def test_arguments_reach_the_nodes(describe, file):
    """The parameter file comes after that of the package; only keepers have a folder."""
    given = {"params_file": file, "state_folder": "/kept", "use_sim_time": "true"}
    for separate in ("true", "false"):
        nodes = nodes_of(describe(FILES[0], separate=separate, log_level="debug", **given))
        for name, node in nodes.items():
            _, last, values = node.options["parameters"]
            assert last == file
            assert values["use_sim_time"] is True
            assert node.options["arguments"][-1] == "debug"
            keeper = name in ("energy_monitor", "power_monitor")
            assert values.get("state_folder") == ("/kept" if keeper else None)


def test_a_robot_brings_its_model_and_the_topics_of_its_driver(describe, file):
    """Before the parameter file of the user, to each node what it has parameters for."""
    nodes = nodes_of(describe(FILES[0], robot="ur5e", params_file=file))
    _, preset, last, values = nodes["energy_monitor"].options["parameters"]
    assert preset == ROBOTS["ur5e"].parameters
    assert set(preset) == {"joint_states", "temperature_sources", "rtde", "meter"}
    assert last == file
    assert values["model"] == "ur5e"
    assert "joint_states" not in values
    nodes = nodes_of(describe(FILES[0], robot="fr3", model="my_fr3.yaml", separate="true"))
    assert [len(node.options["parameters"]) for node in nodes.values()] == [3, 2, 2]
    assert {node.options["parameters"][-1]["model"] for node in nodes.values()} == {"my_fr3.yaml"}
    nodes = nodes_of(describe(FILES[0], robot="ur5e", separate="true"))
    found = {name: set(node.options["parameters"][1]) for name, node in nodes.items()}
    assert found == {
        "torque_monitor": {"joint_states"},
        "friction_monitor": {"temperature_sources", "rtde"},
        "power_monitor": {"meter"},
    }


def test_the_meaning_of_the_effort_reaches_the_nodes_with_joint_states(describe):
    for separate in ("true", "false"):
        nodes = nodes_of(describe(FILES[0], robot="ur5e", effort="joint_torque", separate=separate))
        for name, node in nodes.items():
            given = node.options["parameters"][-1].get("joint_states")
            reads = name in ("energy_monitor", "torque_monitor")
            assert given == ({"effort_meaning": "joint_torque"} if reads else None)


def test_a_monitor_without_model_or_known_robot_is_refused(describe):
    with pytest.raises(RuntimeError, match="neither model nor robot"):
        describe(FILES[0], model="")
    # A manager can set it before it configures the node, and a parameter file can hold it.
    node = nodes_of(describe(FILES[0], model="", autostart="false"))["energy_monitor"]
    assert "model" not in node.options["parameters"][-1]
    with pytest.raises(ModelFileError, match="robot-energy model init"):
        describe(FILES[0], robot="fr3")
    with pytest.raises(KindError, match="ur5x"):
        describe(FILES[0], robot="ur5x")


def test_autostart_is_that_of_the_parameter_files_unless_given(describe):
    for given, expected in (
        ({}, None),
        ({"autostart": "false"}, False),
        ({"autostart": "1"}, True),
    ):
        for separate in ("true", "false"):
            nodes = nodes_of(describe(FILES[0], separate=separate, **given))
            for node in nodes.values():
                assert node.options["parameters"][-1].get("autostart") is expected


TOPICS = {"joint_states": "/arm/state", "motor_temperatures": "degc", "power_meter": "/grid"}


def test_topics_reach_the_nodes_that_read_them_and_the_virtual_robot(describe):
    """After every parameter file, a robot's own included; relative ones are in the namespace."""
    expected = {
        "torque_monitor": {"joint_states": {"topics": ["/arm/state"]}},
        "friction_monitor": {"motors": {"topic": "degc"}},
        "power_monitor": {"meter": {"topic": "/grid"}},
    }
    expected["energy_monitor"] = {k: v for one in expected.values() for k, v in one.items()}
    for separate in ("true", "false"):
        nodes = nodes_of(describe(FILES[0], separate=separate, robot_description="/rd", **TOPICS))
        for name, node in nodes.items():
            given = node.options["parameters"][-1]
            assert {k: v for k, v in given.items() if isinstance(v, dict)} == expected[name]
            assert node.options["remappings"] == [("robot_description", "/rd")]
    values = describe(FILES[0], robot="ur5e", effort="joint_torque", **TOPICS)
    given = nodes_of(values)["energy_monitor"].options["parameters"][-1]
    assert given["joint_states"] == {"topics": ["/arm/state"], "effort_meaning": "joint_torque"}
    assert given["rtde"] == {"topic": "degc"}
    robot = nodes_of(describe(FILES[1], **TOPICS))["virtual_robot"]
    assert robot.options["remappings"] == list(TOPICS.items())
    assert nodes_of(describe(FILES[1]))["virtual_robot"].options["remappings"] == []


def test_arguments_without_free_text_have_choices(describe):
    choices = choices_of(describe(FILES[0]))
    assert set(choices) == {
        "separate", "respawn", "virtual", "dashboard", "history", "use_sim_time", "autostart",
        "effort", "auxiliary", "learning", "log_level",
    }  # fmt: skip
    assert "joint_torque" in choices["effort"]
    assert "yes" not in choices["use_sim_time"]


def test_the_virtual_robot_counts_apart_from_a_real_one(describe):
    def folder(**given: str) -> str | None:
        node = nodes_of(describe(FILES[0], **given))["energy_monitor"]
        return node.options["parameters"][-1].get("state_folder")

    assert folder() is None  # as the parameter files say
    assert folder(virtual="true") == "$ROS_HOME/robot_energy/virtual_robot"
    assert folder(virtual="true", state_folder="/mine") == "/mine"
    assert folder(state_folder="none") == "none"  # an empty argument is malformed


def test_a_parameter_file_that_is_not_there_is_refused(describe, tmp_path, monkeypatch):
    for path in FILES:
        with pytest.raises(
            RuntimeError, match=r"params_file is 'my\.yaml', and /.*/my\.yaml is no"
        ):
            describe(path, params_file="my.yaml")
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "my.yaml").write_text("")
    nodes = nodes_of(describe(FILES[0], params_file="~/my.yaml"))
    assert str(tmp_path / "my.yaml") in nodes["energy_monitor"].options["parameters"]


def test_an_unknown_argument_is_refused(describe, monkeypatch):
    words = ["ros2", "launch", "ros2_energy_monitor", "energy_monitor.launch.py", "model:=kr16"]
    monkeypatch.setattr(sys, "argv", [*words, "param_file:=a.yaml"])
    with pytest.raises(RuntimeError, match="'param_file'; did you mean 'params_file'"):
        describe(FILES[0])
    monkeypatch.setattr(sys, "argv", ["ros2", "launch", "virtual_robot.launch.py", "rate:=100"])
    with pytest.raises(RuntimeError, match="unknown launch argument 'rate'; expected one of"):
        describe(FILES[1])
    monkeypatch.setattr(sys, "argv", [*words, "params_file:=a.yaml"])
    describe(FILES[0])
    monkeypatch.setattr(sys, "argv", ["ros2", "launch", "cell.launch.py", "colour:=red"])
    describe(FILES[0])


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_launch_file_names_only_what_exists(describe, path):
    made = describe(path)
    nodes = [one for one in made if one.kind == "Node"]
    assert nodes
    for node in nodes:
        assert node.options["package"] == "ros2_energy_monitor"
        assert node.options["executable"] in EXECUTABLES
        config = node.options["parameters"][0]
        assert config.kind == "PathJoinSubstitution"
        assert (PACKAGE / Path(*config.args[0][1:])).is_file()
    declared = {one.args[0] for one in made if one.kind == "DeclareLaunchArgument"}
    used = {one.args[0] for one in made if one.kind == "LaunchConfiguration"}
    assert used == declared
    for source in (one for one in made if one.kind == "PythonLaunchDescriptionSource"):
        assert (PACKAGE / Path(*source.args[0][0].args[0][1:])).is_file()
