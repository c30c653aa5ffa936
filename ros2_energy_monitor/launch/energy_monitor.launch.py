"""Start the energy monitor: one process, or with `separate:=true` the three nodes.

The nodes configure and activate themselves, so plain node actions are enough. For a life
cycle manager set `autostart: false` in their configuration. With `respawn:=true` a node that
ends is started again, also one that refuses its parameters.

With `virtual:=true` a virtual robot is started as well; its model is kr16.

ros2 launch ros2_energy_monitor energy_monitor.launch.py model:=/path/to/robot.yaml
"""

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.conditions import IfCondition, UnlessCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

PACKAGE = "ros2_energy_monitor"
RESPAWN_DELAY = 2.0  # [s]
TOGETHER = ("energy_monitor",)
SEPARATE = ("torque_monitor", "friction_monitor", "power_monitor")


def share(*parts: str) -> PathJoinSubstitution:
    """Return the path of an installed file of this package."""
    return PathJoinSubstitution([FindPackageShare(PACKAGE), *parts])


def generate_launch_description() -> LaunchDescription:
    """Return the monitor, in one process or in three, with its configuration files."""
    model, separate = LaunchConfiguration("model"), LaunchConfiguration("separate")
    nodes = [
        Node(
            package=PACKAGE,
            executable=name,
            name=name,
            namespace=LaunchConfiguration("namespace"),
            parameters=[share("config", f"{name}.yaml"), {"model": model}],
            output="screen",
            respawn=LaunchConfiguration("respawn"),
            respawn_delay=RESPAWN_DELAY,
            condition=condition(separate),
        )
        for names, condition in ((TOGETHER, UnlessCondition), (SEPARATE, IfCondition))
        for name in names
    ]
    robot = IncludeLaunchDescription(
        PythonLaunchDescriptionSource([share("launch", "virtual_robot.launch.py")]),
        launch_arguments={"namespace": LaunchConfiguration("namespace")}.items(),
        condition=IfCondition(LaunchConfiguration("virtual")),
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "model", description="Model file of the robot, or name of a shipped model"
            ),
            DeclareLaunchArgument(
                "namespace", default_value="", description="Namespace of the nodes"
            ),
            DeclareLaunchArgument(
                "separate", default_value="false", description="Whether to start three processes"
            ),
            DeclareLaunchArgument(
                "respawn", default_value="false", description="Whether to restart what ends"
            ),
            DeclareLaunchArgument(
                "virtual", default_value="false", description="Whether to start a virtual robot"
            ),
            *nodes,
            robot,
        ]
    )
