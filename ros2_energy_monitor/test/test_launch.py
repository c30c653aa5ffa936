"""Launch files name only what exists. `launch` is not on PyPI: small stand-ins record calls."""

from __future__ import annotations

import ast
import runpy
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

PACKAGE = Path(__file__).resolve().parent.parent
FILES = sorted((PACKAGE / "launch").glob("*.launch.py"))
NAMES = {
    "launch": ["LaunchDescription"],
    "launch.actions": ["DeclareLaunchArgument", "IncludeLaunchDescription"],
    "launch.conditions": ["IfCondition", "UnlessCondition"],
    "launch.launch_description_sources": ["PythonLaunchDescriptionSource"],
    "launch.substitutions": ["LaunchConfiguration", "PathJoinSubstitution"],
    "launch_ros": [],
    "launch_ros.actions": ["Node"],
    "launch_ros.substitutions": ["FindPackageShare"],
}


class Recorded:
    """Stands for an object of the launch system: remembers how it was made."""

    def __init__(self, kind: str, args: tuple[Any, ...], options: dict[str, Any]) -> None:
        self.kind, self.args, self.options = kind, args, options


@pytest.fixture
def describe(monkeypatch: pytest.MonkeyPatch):
    made: list[Recorded] = []

    def maker(kind: str):
        def make(*args: Any, **options: Any) -> Recorded:
            made.append(Recorded(kind, args, options))
            return made[-1]

        return make

    for module_name, names in NAMES.items():
        module = ModuleType(module_name)
        for name in names:
            setattr(module, name, maker(name))
        monkeypatch.setitem(sys.modules, module_name, module)

    def run(path: Path) -> list[Recorded]:
        made.clear()
        runpy.run_path(str(path))["generate_launch_description"]()
        return list(made)

    return run


def executables() -> list[str]:
    tree = ast.parse((PACKAGE / "setup.py").read_text())
    for node in tree.body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "EXECUTABLES":
            return ast.literal_eval(node.value)
    raise AssertionError("setup.py has no EXECUTABLES")


def test_the_launch_files_are_found():
    assert [path.name.split(".")[0] for path in FILES] == ["energy_monitor", "virtual_robot"]


def test_the_monitor_runs_in_one_process_or_in_three(describe):
    nodes = [one for one in describe(FILES[0]) if one.kind == "Node"]
    kinds = {one.options["executable"]: one.options["condition"].kind for one in nodes}
    assert kinds == {
        "energy_monitor": "UnlessCondition",
        "torque_monitor": "IfCondition",
        "friction_monitor": "IfCondition",
        "power_monitor": "IfCondition",
    }


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_launch_file_names_only_what_exists(describe, path):
    made = describe(path)
    nodes = [one for one in made if one.kind == "Node"]
    assert nodes
    for node in nodes:
        assert node.options["package"] == "ros2_energy_monitor"
        assert node.options["executable"] in executables()
        config = node.options["parameters"][0]
        assert config.kind == "PathJoinSubstitution"
        assert (PACKAGE / Path(*config.args[0][1:])).is_file()
    declared = {one.args[0] for one in made if one.kind == "DeclareLaunchArgument"}
    used = {one.args[0] for one in made if one.kind == "LaunchConfiguration"}
    assert used == declared
    for source in (one for one in made if one.kind == "PythonLaunchDescriptionSource"):
        assert (PACKAGE / Path(*source.args[0][0].args[0][1:])).is_file()


def test_every_executable_has_a_main():
    for name in executables():
        source = ast.parse((PACKAGE / "ros2_energy_monitor" / f"{name}.py").read_text())
        assert "main" in {node.name for node in source.body if isinstance(node, ast.FunctionDef)}
