"""The direction of dependencies, as the blueprint draws it."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import robot_energy

ROOT = Path(robot_energy.__file__).parent
PHYSICS = {
    "robot",
    "drivetrain",
    "effort",
    "derivative",
    "torque",
    "friction",
    "drive",
    "cabinet",
    "registers",
    "comparison",
    "shaft_comparison",
}
BOOKS = {"registers", "shaft_comparison"}
ALLOWED = {
    "errors": set(),
    "blocks": {"errors"},
    "yaml_text": {"errors"},
    "model_file": {"errors", "yaml_text"},
    "urdf_text": {"errors"},
    "urdf": {"errors", "blocks", "urdf_text"},
    "urdf_agreement": {"model_file", "urdf"},
    "wire": {"errors"},
    **{name: {"errors", "blocks", "model_file", "robot", "drivetrain", "urdf"} for name in PHYSICS},
    "torque": {"errors", "blocks", "model_file", "robot", "drivetrain", "effort"},
    "shaft_comparison": {"errors", "blocks", "registers"},
    "comparison": {"errors", "blocks", "registers", "units"},
    "pipeline": {"errors", "blocks", "model_file", "urdf", *PHYSICS},
    "ingest": {"errors", "blocks", "units", "urdf", "wire"},
    "bag": {"errors", "wire", "yaml_text"},
    "state_file": {"errors", "model_file", "pipeline", "registers"},
    "messages": {"errors", "blocks", "model_file", "wire", "ingest", "pipeline", *BOOKS},
}
FOREIGN = {
    "rclpy",
    "std_msgs",
    "sensor_msgs",
    "ros2_energy_msgs",
    "ros2_energy_monitor",
    "diagnostic_msgs",
    "builtin_interfaces",
    "ament_index_python",
}


def imports(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def modules():
    for path in sorted(ROOT.rglob("*.py")):
        yield path.relative_to(ROOT).with_suffix("").parts[0], path


def test_modules_import_only_what_stands_before_them_in_the_chain():
    for name, path in modules():
        if name not in ALLOWED:
            continue
        used = {part.split(".")[1] for part in imports(path) if part.startswith("robot_energy.")}
        assert used <= ALLOWED[name] | {name}, f"{path} imports {used - ALLOWED[name]}"


def test_nothing_but_the_command_imports_reproduce():
    """The studies stand on everything else, and only the command stands on them."""
    for name, path in modules():
        used = {part.split(".")[1] for part in imports(path) if part.startswith("robot_energy.")}
        assert "reproduce" not in used or name in ("reproduce", "cli"), path
        assert name != "reproduce" or "cli" not in used, path


def test_the_library_imports_no_ros():
    for _, path in modules():
        used = {part.split(".")[0] for part in imports(path)}
        assert not used & FOREIGN, f"{path} imports {used & FOREIGN}"


def test_only_robot_imports_pinocchio():
    found = {
        path.relative_to(ROOT).as_posix()
        for _, path in modules()
        if "pinocchio" in {part.split(".")[0] for part in imports(path)}
    }
    assert found == {"robot.py"}


@pytest.mark.parametrize(
    "heavy",
    ["matplotlib", "scipy", "rich", "clarabel", "robot_energy.identify", "robot_energy.report"],
)
def test_nothing_online_imports_what_only_reports_need(heavy):
    code = (
        "import sys, robot_energy.pipeline, robot_energy.ingest, robot_energy.messages;"
        f"sys.exit('{heavy}' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
