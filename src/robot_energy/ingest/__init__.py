"""Serialised messages -> blocks: names, order, units, quality, and what was refused."""

from robot_energy.ingest.accounting import Accounting
from robot_energy.ingest.joint_states import JointStateIngest
from robot_energy.ingest.meter import MeterIngest
from robot_energy.ingest.temperatures import TemperatureIngest

__all__ = ["Accounting", "JointStateIngest", "MeterIngest", "TemperatureIngest"]
