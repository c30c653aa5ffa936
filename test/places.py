"""Where the checkout is, for tests that read its files."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# The import packages of the library: the core and its companions.
LIBRARY = tuple(path.parent for path in sorted((ROOT / "src").glob("robot_energy*/__init__.py")))
GRAFANA = ROOT / "src/robot_energy_report/page/grafana"  # files that `monitoring` writes
