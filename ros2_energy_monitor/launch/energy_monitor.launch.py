"""Start the energy monitor: one process, or with `separate:=true` the three nodes.

The nodes configure and activate themselves, so plain node actions are enough. For a life
cycle manager set `autostart: false` in their configuration. With `respawn:=true` a node that
ends is started again, also one that refuses its parameters.

With `virtual:=true` a virtual robot is started as well; its model is kr16, and its energy is
kept in a folder of its own, apart from that of a real robot.

ros2 launch ros2_energy_monitor energy_monitor.launch.py model:=/path/to/robot.yaml
"""

import sys
from pathlib import Path

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

PACKAGE = "ros2_energy_monitor"
RESPAWN_DELAY = 2.0  # [s]
TOGETHER = ("energy_monitor",)
SEPARATE = ("torque_monitor", "friction_monitor", "power_monitor")
KEEPERS = ("energy_monitor", "power_monitor")  # the nodes with a state_folder
AS_CONFIGURED = "as_configured"
VIRTUAL_FOLDER = "$ROS_HOME/robot_energy/virtual_robot"
ARGUMENTS = {  # name: default, what it is; None = required
    "model": (None, "Model file of the robot, or name of a shipped model"),
    "namespace": ("", "Namespace of the nodes"),
    "separate": ("false", "Whether to start three processes"),
    "respawn": ("false", "Whether to restart what ends"),
    "virtual": ("false", "Whether to start a virtual robot"),
    "params_file": ("", "Parameter file that is read after those of this package"),
    "state_folder": (AS_CONFIGURED, "Folder that keeps the registers; empty keeps nothing"),
    "use_sim_time": ("false", "Whether the nodes take the time from /clock"),
    "log_level": ("info", "debug, info, warn, error or fatal"),
}


def share(*parts: str) -> PathJoinSubstitution:
    """Return the path of an installed file of this package."""
    return PathJoinSubstitution([FindPackageShare(PACKAGE), *parts])


def check_arguments(command_line: list[str]) -> None:
    """Refuse arguments of the command line that this file does not have.

    Only where the file itself was launched: one that includes it has arguments of its own.
    """
    if not any(Path(word).name == Path(__file__).name for word in command_line):
        return
    given = [word.split(":=")[0] for word in command_line if ":=" in word]
    unknown = [name for name in given if name not in ARGUMENTS]
    if unknown:
        raise RuntimeError(
            f"unknown launch argument '{unknown[0]}'; expected one of {', '.join(ARGUMENTS)}"
        )


def monitors(context) -> list[Node]:
    """Return the nodes for the arguments that were given."""

    def value(name: str) -> str:
        return LaunchConfiguration(name).perform(context)

    def true(name: str) -> bool:
        return value(name).lower() in ("true", "1")

    folder = value("state_folder")
    if folder == AS_CONFIGURED and true("virtual"):
        folder = VIRTUAL_FOLDER
    further = [value("params_file")] if value("params_file") else []
    nodes = []
    for name in SEPARATE if true("separate") else TOGETHER:
        given = {"model": value("model"), "use_sim_time": true("use_sim_time")}
        if name in KEEPERS and folder != AS_CONFIGURED:
            given["state_folder"] = folder
        nodes.append(
            Node(
                package=PACKAGE,
                executable=name,
                name=name,
                namespace=value("namespace"),
                parameters=[share("config", f"{name}.yaml"), *further, given],
                arguments=["--ros-args", "--log-level", value("log_level")],
                output="screen",
                respawn=true("respawn"),
                respawn_delay=RESPAWN_DELAY,
            )
        )
    return nodes


def generate_launch_description() -> LaunchDescription:
    """Return the monitor, in one process or in three, with its configuration files."""
    check_arguments(sys.argv)
    robot = IncludeLaunchDescription(
        PythonLaunchDescriptionSource([share("launch", "virtual_robot.launch.py")]),
        launch_arguments={"namespace": LaunchConfiguration("namespace")}.items(),
        condition=IfCondition(LaunchConfiguration("virtual")),
    )
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(
                    name,
                    description=text,
                    **({} if default is None else {"default_value": default}),
                )
                for name, (default, text) in ARGUMENTS.items()
            ),
            OpaqueFunction(function=monitors),
            robot,
        ]
    )
