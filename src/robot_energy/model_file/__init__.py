"""One robot's model file: schema-versioned YAML, every figure tagged."""

from robot_energy.model_file.schema import RobotModel
from robot_energy.model_file.store import load, parse_yaml, save, shipped_models, validate

__all__ = ["RobotModel", "load", "parse_yaml", "save", "shipped_models", "validate"]
