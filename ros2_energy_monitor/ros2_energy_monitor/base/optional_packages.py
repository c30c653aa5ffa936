# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Packages that only some meters and exporters need."""

from __future__ import annotations

import importlib
from typing import Any

from robot_energy.foundation.errors import RobotEnergyError


def require(package: str, distribution: str, user: str, error: type[RobotEnergyError]) -> Any:
    """Return a package, or say how to install it."""
    try:
        return importlib.import_module(package)
    except ModuleNotFoundError as missing:
        raise error(
            f"{user} needs the package {distribution}, which is not installed",
            f"the package {distribution}",
            f"install it: pip install {distribution}",
        ) from missing
