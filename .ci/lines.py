"""Lines of Python in the core, its companions and the nodes; how many the monitor nodes load.

Below stand the modules of the core that neither a monitor node nor a replay loads.
Run it in the environment of the set-up: ``python .ci/lines.py``.
"""

from __future__ import annotations

import importlib
import sys
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

from ownership import header

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = {
    **{
        path.parent.name: path.parent for path in sorted(ROOT.glob("src/robot_energy*/__init__.py"))
    },
    "ros2_energy_monitor": ROOT / "ros2_energy_monitor/ros2_energy_monitor",
}
GROUPS = {"robot_energy": "core", "ros2_energy_monitor": "nodes"}  # all others are companions
BAG = ROOT / "bags/kr16_cold"
NODES = ("torque_monitor", "friction_monitor", "power_monitor", "energy_monitor")


def lines(path: Path) -> int:
    """Return the number of lines of a file, without the header of its licence."""
    text = path.read_text(encoding="utf-8").removeprefix(header(path.suffix))
    return len(text.lstrip("\n").splitlines())


def main() -> None:
    """Print the table."""
    sys.path[:0] = [str(folder.parent) for folder in PACKAGES.values()]
    for node in NODES:
        importlib.import_module(f"ros2_energy_monitor.nodes.{node}")
    loaded = files_loaded()
    row = "{:<24} {:>7} {:>21}".format
    print(row("package", "lines", "of the monitor nodes"))
    groups = {"core": (0, 0), "companions": (0, 0), "nodes": (0, 0), "all": (0, 0)}
    for name, folder in PACKAGES.items():
        files = list(folder.rglob("*.py"))
        counts = sum(map(lines, files)), sum(lines(one) for one in files if one in loaded)
        print(row(name, *counts))
        for group in (GROUPS.get(name, "companions"), "all"):
            groups[group] = tuple(map(sum, zip(groups[group], counts, strict=True)))
    print()
    for group, counts in groups.items():
        print(row(group, *counts))
    command = importlib.import_module("robot_energy_cli")
    with redirect_stdout(StringIO()):
        command.main(["replay", str(BAG), "--model", "kr16"])
    print()
    print(row("core, not loaded", "lines", ""))
    core = PACKAGES["robot_energy"]
    for path in sorted({*core.rglob("*.py")} - files_loaded()):
        print(row(str(path.relative_to(core)), lines(path), "").rstrip())


def files_loaded() -> set[Path]:
    """Return the files of all modules that are loaded."""
    files = (getattr(module, "__file__", None) for module in list(sys.modules.values()))
    return {Path(file).resolve() for file in files if file}


if __name__ == "__main__":
    main()
