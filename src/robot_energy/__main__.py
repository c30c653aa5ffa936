"""The command `robot-energy`, also as ``python -m robot_energy``."""

from __future__ import annotations

import gc
import sys
from importlib import import_module

from robot_energy.foundation.stopping import end_at_once


def main() -> int:
    """Return the exit code of the command; a signal ends it from here on, also during imports."""
    end_at_once("robot-energy")
    gc.disable()  # modules stay: to look for garbage among them takes a tenth of the start
    # By name: the core imports no companion.
    command = import_module("robot_energy_cli.main")
    gc.enable()
    return command.main()


if __name__ == "__main__":
    sys.exit(main())
