"""Ready inputs for the drivers of real robots: topics, types, units and meanings."""

from robot_energy.presets.robots import ROBOTS, RobotPreset

__all__ = ["ROBOTS", "RobotPreset"]
