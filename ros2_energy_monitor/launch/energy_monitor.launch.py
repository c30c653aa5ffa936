# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Start the energy monitor: one process, or with `separate:=true` the three nodes.

The nodes configure and activate themselves, so plain node actions are enough; with
`autostart:=false` they wait for a life cycle manager. With `respawn:=true` a node that ends is
started again, also one that refuses its parameters.

`joint_states`, `motor_temperatures` and `power_meter` name the topics to read, in place of those of
the parameter files, and `robot_description` is remapped. Every other topic can be remapped by an
including launch file with `SetRemap`.

With `virtual:=true` a virtual robot is started as well; its model is kr16, and its energy is
kept in a folder of its own, apart from that of a real robot.

With `robot:=ur5e` the nodes read what the driver of that robot publishes, and use the shipped
model if there is one (`robot-energy kinds` lists the robots); `model` and `params_file` override
it.

ros2 launch ros2_energy_monitor energy_monitor.launch.py model:=/path/to/robot.yaml
ros2 launch ros2_energy_monitor energy_monitor.launch.py robot:=ur5e
"""

import sys

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription
from robot_energy.presets import ROBOTS
from robot_energy.timeline.blocks import EffortMeaning, Learning
from ros2_energy_monitor.launch_arguments import (
    BOOLEANS,
    LEVELS,
    check_arguments,
    is_true,
    parameter_files,
)

PACKAGE = "ros2_energy_monitor"
RESPAWN_DELAY = 2.0  # [s]
TOGETHER = ("energy_monitor",)
SEPARATE = ("torque_monitor", "friction_monitor", "power_monitor")
READERS = ("energy_monitor", "torque_monitor")  # the nodes with joint states
WARM = ("energy_monitor", "friction_monitor")  # the nodes with motor temperatures
KEEPERS = ("energy_monitor", "power_monitor")  # the nodes with a state_folder and a meter
AS_CONFIGURED = "as_configured"
DEFAULT_SOURCE = "motors"  # of motor temperatures, in the parameter files of this package
VIRTUAL_FOLDER = "$ROS_HOME/robot_energy/virtual_robot"
ARGUMENTS = {  # name: default, what it is
    "model": ("", "Model file of the robot, or name of a shipped model; needed without robot"),
    "robot": ("", "Robot whose driver is known; empty for the topics of the parameter files"),
    "effort": (
        AS_CONFIGURED,
        "What the effort of the joint states is: joint_states.effort_meaning",
    ),
    "namespace": ("", "Namespace of the nodes"),
    "separate": ("false", "Whether to start three processes"),
    "respawn": ("false", "Whether to restart what ends"),
    "virtual": ("false", "Whether to start a virtual robot"),
    "auxiliary": ("false", "Whether a pump and an extruder run next to the virtual robot"),
    "dashboard": ("false", "Whether to serve the energy page of all robots"),
    "history": (
        "true",
        "Whether to record what all robots use, in the folder history of state_folder",
    ),
    "autostart": (AS_CONFIGURED, "Whether the nodes configure and activate themselves"),
    "params_file": ("", "Parameter file that is read after those of this package"),
    "state_folder": (AS_CONFIGURED, "Folder that keeps the registers; none keeps nothing"),
    "learning": (AS_CONFIGURED, "What is done with learned friction and losses: learning"),
    "joint_states": ("", "Topic of the joint states; empty for those of the parameter files"),
    "motor_temperatures": ("", "Topic of the motor temperatures; empty as joint_states"),
    "power_meter": ("", "Topic of the power meter; empty as joint_states"),
    "robot_description": ("", "Topic of the robot description; empty for robot_description"),
    "use_sim_time": ("false", "Whether the nodes take the time from /clock"),
    "log_level": ("info", "debug, info, warn, error or fatal"),
}
CHOICES = {  # of those that take no free text
    **dict.fromkeys(
        ("separate", "respawn", "virtual", "auxiliary", "dashboard", "history", "use_sim_time"),
        BOOLEANS,
    ),
    "autostart": [AS_CONFIGURED, *BOOLEANS],
    "effort": [AS_CONFIGURED, *(str(meaning) for meaning in EffortMeaning)],
    "learning": [AS_CONFIGURED, *map(str, Learning)],
    "log_level": LEVELS,
}
OF_THE_ROBOT = (
    *("namespace", "joint_states", "motor_temperatures", "power_meter", "auxiliary", "log_level"),
)


def share(*parts: str) -> PathJoinSubstitution:
    """Return the path of an installed file of this package."""
    return PathJoinSubstitution([FindPackageShare(PACKAGE), *parts])


def model_of(robot: str, model: str, *, required: bool) -> str:
    """Return the model to use: the given one, or the shipped one of a robot; empty for none."""
    if robot:
        return ROBOTS[robot].model_or(model)
    if required and not model:
        raise RuntimeError("neither model nor robot is given; expected model:=... or robot:=...")
    return model


def robot_inputs(robot: str, node: str) -> dict:
    """Return the parameters of a node that fit the driver of a robot."""
    values = ROBOTS[robot].parameters if robot else {}
    read = {
        "torque_monitor": ["joint_states"],
        "friction_monitor": ["temperature_sources", *values.get("temperature_sources", [])],
        "power_monitor": ["meter"],
    }
    return {name: value for name, value in values.items() if name in read.get(node, values)}


def topics(robot: str, node: str, joint_states: str, temperatures: str, meter: str) -> dict:
    """Return the parameters of a node that name the topics it reads, where they are given."""
    preset = ROBOTS[robot].parameters if robot else {}
    (source, *others) = preset.get("temperature_sources", [DEFAULT_SOURCE])
    if temperatures and others:
        raise RuntimeError(
            f"{robot} has several sources of motor temperatures; name their topics in params_file"
        )
    found = {}
    if joint_states and node in READERS:
        found["joint_states"] = {"topics": [joint_states]}
    if temperatures and node in WARM:
        found[source] = {"topic": temperatures}
    if meter and node in KEEPERS:
        found["meter"] = {"topic": meter}
    return found


def monitors(context) -> list[Node]:
    """Return the nodes for the arguments that were given."""
    value = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    folder = value["state_folder"]
    if folder == AS_CONFIGURED and is_true(value["virtual"]):
        folder = VIRTUAL_FOLDER
    further = parameter_files(value["params_file"])
    robot = value["robot"]
    managed = value["autostart"] != AS_CONFIGURED and not is_true(value["autostart"])
    model = model_of(robot, value["model"], required=not managed)
    read = [value[name] for name in ("joint_states", "motor_temperatures", "power_meter")]
    described = value["robot_description"]
    nodes = []
    for name in SEPARATE if is_true(value["separate"]) else TOGETHER:
        given = {"use_sim_time": is_true(value["use_sim_time"])}
        if model:
            given["model"] = model
        given |= topics(robot, name, *read)
        preset = [robot_inputs(robot, name)] if robot_inputs(robot, name) else []
        if name in READERS and value["effort"] != AS_CONFIGURED:
            given.setdefault("joint_states", {})["effort_meaning"] = value["effort"]
        if name in KEEPERS and folder != AS_CONFIGURED:
            given["state_folder"] = folder
        if name in KEEPERS and value["learning"] != AS_CONFIGURED:
            given["learning"] = value["learning"]
        if value["autostart"] != AS_CONFIGURED:
            given["autostart"] = is_true(value["autostart"])
        nodes.append(
            Node(
                package=PACKAGE,
                executable=name,
                name=name,
                namespace=value["namespace"],
                parameters=[share("config", f"{name}.yaml"), *preset, *further, given],
                remappings=[("robot_description", described)] if described else [],
                arguments=["--ros-args", "--log-level", value["log_level"]],
                output="screen",
                respawn=is_true(value["respawn"]),
                respawn_delay=RESPAWN_DELAY,
            )
        )
    keeps = folder not in ("", "none")
    history = "" if folder == AS_CONFIGURED else f"{folder}/history" if keeps else "none"
    if is_true(value["dashboard"]):
        name = "energy_dashboard"
        shown = {"history_folder": history} if history else {}
        nodes.append(
            Node(
                package=PACKAGE,
                executable=name,
                name=name,
                parameters=[share("config", f"{name}.yaml"), *further, shown],
                output="screen",
            )
        )
    if is_true(value["history"]) and keeps:
        name = "energy_recorder"
        kept = {"folder": history} if history else {}
        nodes.append(
            Node(
                package=PACKAGE,
                executable=name,
                name=name,
                parameters=[share("config", f"{name}.yaml"), *further, kept],
                output="screen",
            )
        )
    return nodes


def generate_launch_description() -> LaunchDescription:
    """Return the monitor, in one process or in three, with its configuration files."""
    check_arguments(sys.argv, __file__, ARGUMENTS)
    robot = IncludeLaunchDescription(
        PythonLaunchDescriptionSource([share("launch", "virtual_robot.launch.py")]),
        launch_arguments={name: LaunchConfiguration(name) for name in OF_THE_ROBOT}.items(),
        condition=IfCondition(LaunchConfiguration("virtual")),
    )
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(
                    name, description=text, default_value=default, choices=CHOICES.get(name)
                )
                for name, (default, text) in ARGUMENTS.items()
            ),
            OpaqueFunction(function=monitors),
            robot,
        ]
    )
