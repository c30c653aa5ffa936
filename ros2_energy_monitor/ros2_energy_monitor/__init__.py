"""Nodes of the robot energy monitor: the live shell around the library `robot_energy`."""
