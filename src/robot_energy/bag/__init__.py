"""Recorded bags: read and write MCAP and rosbag2 without ROS, bounded and checked."""

from robot_energy.bag.metadata import DEFAULT_QOS, LATCHED_QOS, SENSOR_QOS
from robot_energy.bag.reader import BagReader
from robot_energy.bag.writer import BagWriter

__all__ = ["DEFAULT_QOS", "LATCHED_QOS", "SENSOR_QOS", "BagReader", "BagWriter"]
