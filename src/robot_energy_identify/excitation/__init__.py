"""Motions that excite what is to be identified, within the robot's limits."""
