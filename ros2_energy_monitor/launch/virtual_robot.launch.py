"""Start the virtual robot alone: joint states, motor temperatures and a power meter.

ros2 launch ros2_energy_monitor virtual_robot.launch.py
"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

PACKAGE = "ros2_energy_monitor"
NODES = ("virtual_robot",)


def share(*parts: str) -> PathJoinSubstitution:
    """Return the path of an installed file of this package."""
    return PathJoinSubstitution([FindPackageShare(PACKAGE), *parts])


def generate_launch_description() -> LaunchDescription:
    """Return the virtual robot with its configuration file."""
    nodes = [
        Node(
            package=PACKAGE,
            executable=name,
            name=name,
            namespace=LaunchConfiguration("namespace"),
            parameters=[share("config", f"{name}.yaml")],
            output="screen",
        )
        for name in NODES
    ]
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "namespace", default_value="", description="Namespace of the node"
            ),
            *nodes,
        ]
    )
