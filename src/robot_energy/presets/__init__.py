"""Table of the robots whose driver is known: the model that fits, and the inputs.

The inputs are a parameter file of ROS, one for each driver, so that the nodes and a replay read
the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, cast

from robot_energy.foundation.config_file import parse_yaml
from robot_energy.foundation.errors import ModelFileError
from robot_energy.foundation.kinds import Kind, Kinds

INIT = "robot-energy model init"


@dataclass(frozen=True, kw_only=True)
class RobotPreset(Kind):
    """A robot with its driver."""

    file: str
    model: Annotated[str, "Name of the shipped model; empty where none is shipped."] = ""

    @property
    def inputs(self) -> Path:
        return Path(str(resources.files("robot_energy") / "presets" / f"{self.file}.yaml"))

    @property
    def parameters(self) -> dict[str, Any]:
        document = parse_yaml(self.inputs.read_text(encoding="utf-8"), str(self.inputs))
        return cast("dict[str, Any]", document)["/**"]["ros__parameters"]

    def model_or(self, given: str | None) -> str:
        """Return the model to use: the given one, or the shipped one."""
        if given or self.model:
            return given or self.model
        raise ModelFileError(
            f"no model is shipped for the robot '{self.name}'",
            "a model file",
            f"make one with `{INIT} ROBOT.urdf --out my_robot.yaml` and give that as the model",
        )


ROBOTS = Kinds(
    "robot",
    RobotPreset(name="ur3e", label="UR3e", line="ur_robot_driver", file="ur", model="ur3e"),
    RobotPreset(name="ur5e", label="UR5e", line="ur_robot_driver", file="ur", model="ur5e"),
    RobotPreset(name="ur10e", label="UR10e", line="ur_robot_driver", file="ur", model="ur10e"),
    RobotPreset(name="ur", label="other Universal Robots", line="ur_robot_driver", file="ur"),
    RobotPreset(name="fr3", label="Franka Research 3", line="franka_ros2", file="franka"),
    RobotPreset(name="fer", label="Franka Emika Robot", line="franka_ros2", file="franka"),
    RobotPreset(name="lbr", label="KUKA LBR", line="lbr_fri_ros2_stack", file="lbr"),
    RobotPreset(name="kr16", label="KUKA KR 16", line="kuka_rsi_driver", file="kr16", model="kr16"),
    RobotPreset(name="kuka_kr", label="other KUKA KR", line="kuka_rsi_driver", file="kuka_kr"),
    RobotPreset(name="xarm", label="xArm 5, 6, 7", line="xarm_ros2", file="xarm"),
    RobotPreset(name="lite6", label="Lite 6, UFACTORY 850", line="xarm_ros2", file="ufactory"),
    RobotPreset(name="doosan", label="Doosan A, H, M", line="doosan-robot2", file="doosan"),
    RobotPreset(name="gen3", label="Kinova Gen3", line="ros2_kortex", file="kinova"),
    RobotPreset(
        name="ros2_control",
        label="any other",
        line="ros2_control with joint_state_broadcaster",
        file="ros2_control",
    ),
)
