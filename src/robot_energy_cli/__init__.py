"""The command `robot-energy`."""

from robot_energy.cli.main import main

__all__ = ["main"]
