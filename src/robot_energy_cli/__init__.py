"""The command `robot-energy`."""

from robot_energy_cli.main import main

__all__ = ["main"]
