"""Start the energy monitor: one process, or with `separate:=true` the three nodes.

The nodes configure and activate themselves, so plain node actions are enough. For a life
cycle manager set `autostart: false` in their configuration. With `respawn:=true` a node that
ends is started again, also one that refuses its parameters.

With `virtual:=true` a virtual robot is started as well; its model is kr16, and its energy is
kept in a folder of its own, apart from that of a real robot.

With `robot:=ur5e` the nodes read what the driver of that robot publishes, and use the shipped
model if there is one (`robot-energy kinds` lists the robots); `model` and `params_file` go before.

ros2 launch ros2_energy_monitor energy_monitor.launch.py model:=/path/to/robot.yaml
ros2 launch ros2_energy_monitor energy_monitor.launch.py robot:=ur5e
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
from robot_energy.presets import ROBOTS

PACKAGE = "ros2_energy_monitor"
RESPAWN_DELAY = 2.0  # [s]
TOGETHER = ("energy_monitor",)
SEPARATE = ("torque_monitor", "friction_monitor", "power_monitor")
READERS = ("energy_monitor", "torque_monitor")  # the nodes with joint states
KEEPERS = ("energy_monitor", "power_monitor")  # the nodes with a state_folder
AS_CONFIGURED = "as_configured"
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


def model_of(robot: str, model: str) -> str:
    """Return the model to use: the given one, or the shipped one of a robot."""
    if robot:
        return ROBOTS[robot].model_or(model)
    if not model:
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
    robot = value("robot")
    model = model_of(robot, value("model"))
    nodes = []
    for name in SEPARATE if true("separate") else TOGETHER:
        given = {"model": model, "use_sim_time": true("use_sim_time")}
        preset = [robot_inputs(robot, name)] if robot_inputs(robot, name) else []
        if name in READERS and value("effort") != AS_CONFIGURED:
            given["joint_states"] = {"effort_meaning": value("effort")}
        if name in KEEPERS and folder != AS_CONFIGURED:
            given["state_folder"] = folder
        nodes.append(
            Node(
                package=PACKAGE,
                executable=name,
                name=name,
                namespace=value("namespace"),
                parameters=[share("config", f"{name}.yaml"), *preset, *further, given],
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
                DeclareLaunchArgument(name, description=text, default_value=default)
                for name, (default, text) in ARGUMENTS.items()
            ),
            OpaqueFunction(function=monitors),
            robot,
        ]
    )
