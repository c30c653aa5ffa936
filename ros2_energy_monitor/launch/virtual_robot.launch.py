# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Start the virtual robot alone: joint states, motor temperatures and a power meter.

ros2 launch ros2_energy_monitor virtual_robot.launch.py
"""

import sys

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription
from ros2_energy_monitor.launch_arguments import (
    BOOLEANS,
    LEVELS,
    check_arguments,
    is_true,
    parameter_files,
)

PACKAGE = "ros2_energy_monitor"
NAME = "virtual_robot"
TOPICS = ("joint_states", "motor_temperatures", "power_meter")
ARGUMENTS = {  # name: default, what it is, what it can be
    "namespace": ("", "Namespace of the node", None),
    "params_file": ("", "Parameter file that is read after that of this package", None),
    **{name: ("", f"Topic to publish as; empty for {name}", None) for name in TOPICS},
    "auxiliary": ("false", "Whether a pump and an extruder run next to the robot", BOOLEANS),
    "use_sim_time": ("false", "Whether the node takes the time from /clock", BOOLEANS),
    "log_level": ("info", "debug, info, warn, error or fatal", LEVELS),
}


def robots(context) -> list[Node]:
    """Return the node for the arguments that were given."""
    value = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    config = PathJoinSubstitution([FindPackageShare(PACKAGE), "config", f"{NAME}.yaml"])
    further = parameter_files(value["params_file"])
    node = Node(
        package=PACKAGE,
        executable=NAME,
        name=NAME,
        namespace=value["namespace"],
        parameters=[
            config,
            {"auxiliary": is_true(value["auxiliary"])},
            *further,
            {"use_sim_time": is_true(value["use_sim_time"])},
        ],
        remappings=[(name, value[name]) for name in TOPICS if value[name]],
        arguments=["--ros-args", "--log-level", value["log_level"]],
        output="screen",
    )
    return [node]


def generate_launch_description() -> LaunchDescription:
    """Return the virtual robot with its configuration file."""
    check_arguments(sys.argv, __file__, ARGUMENTS)
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(
                    name, description=text, default_value=default, choices=choices
                )
                for name, (default, text, choices) in ARGUMENTS.items()
            ),
            OpaqueFunction(function=robots),
        ]
    )
