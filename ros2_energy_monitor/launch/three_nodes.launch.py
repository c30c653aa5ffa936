"""Start the torque, friction and power monitor; with `virtual:=true` also a virtual robot.

ros2 launch ros2_energy_monitor three_nodes.launch.py model:=/path/to/robot.yaml
"""

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

PACKAGE = "ros2_energy_monitor"
NODES = ("torque_monitor", "friction_monitor", "power_monitor")


def share(*parts: str) -> PathJoinSubstitution:
    """Return the path of an installed file of this package."""
    return PathJoinSubstitution([FindPackageShare(PACKAGE), *parts])


def generate_launch_description() -> LaunchDescription:
    """Return the monitors with their configuration files."""
    model = LaunchConfiguration("model")
    nodes = [
        Node(
            package=PACKAGE,
            executable=name,
            name=name,
            namespace=LaunchConfiguration("namespace"),
            parameters=[share("config", f"{name}.yaml"), {"model": model}],
            output="screen",
        )
        for name in NODES
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
                "virtual", default_value="false", description="Whether to start a virtual robot"
            ),
            *nodes,
            robot,
        ]
    )
