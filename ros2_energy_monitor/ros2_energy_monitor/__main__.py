"""``python -m ros2_energy_monitor NAME ...`` is ``ros2 run ros2_energy_monitor NAME ...``."""

from __future__ import annotations

import sys
from importlib import import_module

from ros2_energy_monitor.executables import EXECUTABLES


def main() -> int:
    """Run the executable that the first argument names."""
    name = sys.argv[1] if len(sys.argv) > 1 else ""
    if name not in EXECUTABLES:
        found = f"there is no executable '{name}'" if name else "no executable is named"
        expected = f"expected one of: {', '.join(EXECUTABLES)}"
        print(f"ros2_energy_monitor: {found}; {expected}.", file=sys.stderr)
        return 2
    sys.argv[:2] = [name]
    return int(import_module(EXECUTABLES[name]).main() or 0)


if __name__ == "__main__":
    raise SystemExit(main())
