"""One robot's model file: schema-versioned YAML, every figure tagged."""

from robot_energy.model.load import follow_tables, load, parse_yaml, save, shipped_models, validate
from robot_energy.model.schema import RobotModel

__all__ = ["RobotModel", "load", "parse_yaml", "save", "shipped_models", "validate"]

follow_tables()  # from now on model files may hold every kind that the tables have
