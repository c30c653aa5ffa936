"""Online energy monitoring of robots: the power chain from joint states to the outlet."""

__version__ = "0.1.0"
