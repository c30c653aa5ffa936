# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Start of every executable: ``ros2 run ros2_energy_monitor NAME`` and ``python -m``."""

from __future__ import annotations

import gc
import os
import sys
from importlib import import_module
from pathlib import Path

from robot_energy.foundation.stopping import end_at_once
from ros2_energy_monitor.executables import EXECUTABLES


def main() -> int:
    """Run the executable whose name the script has, else that of the first argument."""
    # Before numpy is imported: matrices are small, and more threads only wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    script = Path(sys.argv[0]).name
    name = script if script in EXECUTABLES else "".join(sys.argv[1:2])
    if name in ("-h", "--help"):
        names = "\n  ".join(EXECUTABLES)
        print("usage: python -m ros2_energy_monitor NAME [ARGUMENTS]")
        print(f"\nNAME is one of:\n  {names}")
        return 0
    if name not in EXECUTABLES:
        found = f"there is no executable '{name}'" if name else "no executable is named"
        expected = f"expected one of: {', '.join(EXECUTABLES)}"
        print(f"ros2_energy_monitor: {found}; {expected}.", file=sys.stderr)
        return 2
    if name != script:
        sys.argv[:2] = [name]
    end_at_once(name)  # until the node has its own handlers, which stop it cleanly
    gc.disable()  # modules stay: to look for garbage among them takes a fifth of the start
    module = import_module(EXECUTABLES[name])
    gc.enable()
    return int(module.main() or 0)


if __name__ == "__main__":
    raise SystemExit(main())
