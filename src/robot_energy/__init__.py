"""Online energy monitoring of robots: the power chain from joint states to the outlet."""
