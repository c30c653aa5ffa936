"""Packages that only some meters and exporters need."""

from __future__ import annotations

import importlib
from typing import Any

from robot_energy.errors import RobotEnergyError


def require(package: str, distribution: str, user: str, error: type[RobotEnergyError]) -> Any:
    """Import a package, or say how to install it.

    Args:
        package: Name of the module.
        distribution: Its name for pip.
        user: What needs it, for the message.
        error: Class of the error.

    Returns:
        The module.

    Raises:
        RobotEnergyError: Of that class, if it is not installed.
    """
    try:
        return importlib.import_module(package)
    except ModuleNotFoundError as missing:
        raise error(
            f"{user} needs the package {distribution}, which is not installed",
            f"the package {distribution}",
            f"install it: pip install {distribution}",
        ) from missing
