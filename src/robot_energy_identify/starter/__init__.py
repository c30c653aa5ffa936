"""A first model file of a robot from its URDF: what that does not state is assumed, and says so."""

from robot_energy_identify.starter.arm import Arm, read_arm
from robot_energy_identify.starter.description import RobotText, read_description
from robot_energy_identify.starter.model_text import starter_text

__all__ = ["Arm", "RobotText", "read_arm", "read_description", "starter_text"]
