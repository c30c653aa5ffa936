"""Each package folder stands alone: a release holds it without its neighbours."""

import ast
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import pytest

from places import LIBRARY, ROOT

FOLDERS = {
    "robot_energy": ROOT / "src",
    "ros2_energy_monitor": ROOT / "ros2_energy_monitor",
    "ros2_energy_msgs": ROOT / "ros2_energy_msgs",
}
# What Python sources of a package import when it runs, and when it is tested.
RUN = {
    "robot_energy": [path.name for path in LIBRARY],
    "ros2_energy_monitor": ["ros2_energy_monitor", "launch"],
}
TESTED = {"ros2_energy_monitor": ["test"]}
OWN = {"robot_energy": [path.name for path in LIBRARY]}
# Modules of another name than their distribution, and one of the type checker alone.
DISTRIBUTIONS = {"paho": "paho_mqtt", "pydantic_core": "pydantic"}
TYPES_ONLY = {"_typeshed"}


@pytest.mark.parametrize("package", FOLDERS)
def test_no_file_is_a_link_out_of_the_folder(package):
    folder = FOLDERS[package]
    done = subprocess.run(
        ["git", "ls-files", "-z", folder], cwd=ROOT, capture_output=True, text=True, check=True
    )
    tracked = [ROOT / name for name in done.stdout.split("\0") if name]
    assert tracked
    assert [path for path in tracked if not path.resolve().is_relative_to(folder)] == []


def test_the_library_ships_the_definitions_of_the_interface_package():
    shipped = FOLDERS["robot_energy"] / "robot_energy/bag/cdr/msg"
    defined = FOLDERS["ros2_energy_msgs"] / "msg"
    assert {path.name: path.read_text() for path in shipped.glob("*.msg")} == {
        path.name: path.read_text() for path in defined.glob("*.msg")
    }, f"after a change of a message: cp {defined}/*.msg {shipped}"


def test_a_copy_of_the_library_alone_knows_the_energy_messages(tmp_path):
    shutil.copytree(
        FOLDERS["robot_energy"] / "robot_energy", tmp_path / "robot_energy", symlinks=True
    )
    program = (
        "import robot_energy.bag.cdr.types as t; print(t.__file__);"
        "print(*t.typestore().fielddefs); print(t.definition('PowerState'))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path, capture_output=True, text=True, check=True, timeout=600,
    )  # fmt: skip
    place, types, text = done.stdout.split("\n", 2)
    assert Path(place).is_relative_to(tmp_path)
    assert "ros2_energy_msgs/msg/PowerState" in types.split()
    assert "grid" in text


@pytest.mark.parametrize("package", RUN)
def test_every_import_is_of_a_declared_dependency(package):
    run = depends(package, "depend", "exec_depend") | by_pip(package)
    assert not imported(package, RUN[package]) - run
    tested = run | depends(package, "test_depend")
    # What robot_energy needs is there whenever it is.
    if "robot_energy" in tested:
        tested |= depends("robot_energy", "depend", "exec_depend") | by_pip("robot_energy")
    # Modules of the tests: those next to them, and those that all tests of the project share.
    shared = [*(ROOT / "test").glob("*.py"), *(FOLDERS[package] / "test").rglob("*.py")]
    tested |= {path.stem for path in shared}
    assert not imported(package, TESTED.get(package, [])) - tested


@pytest.mark.parametrize("package", RUN)
def test_what_pip_brings_is_what_the_packaging_asks_for(package):
    """The line for pip in package.xml names no distribution that setup.py does not know."""
    text = (FOLDERS[package] / "setup.py").read_text()
    named = {module_name(name) for name in re.findall(r'"([A-Za-z][\w.-]*)(?:\[\w+\])?[<>=]', text)}
    # Both come with `distributed`.
    assert by_pip(package) - {"dask"} <= named


def depends(package: str, *kinds: str) -> set[str]:
    """Names of modules that the dependencies of these kinds bring."""
    root = ET.parse(FOLDERS[package] / "package.xml").getroot()
    keys = [entry.text or "" for kind in kinds for entry in root.iter(kind)]
    return {module_name(key.removeprefix("python3-")) for key in keys}


def by_pip(package: str) -> set[str]:
    """Names of modules of the lines for pip in package.xml."""
    text = (FOLDERS[package] / "package.xml").read_text()
    lines = re.findall(r"^ *python3 -m pip install (.+?)(?: -->)?$", text, flags=re.MULTILINE)
    words = " ".join(lines).replace('"', "").split()
    return {module_name(re.split("[<>=]", word)[0]) for word in words}


def module_name(distribution: str) -> str:
    return distribution.lower().replace("-", "_")


def imported(package: str, folders: list[str]) -> set[str]:
    """Distributions that the sources import, but those of Python and of the package."""
    own = {package, *OWN.get(package, [])}
    found = {}
    for path in (path for name in folders for path in (FOLDERS[package] / name).rglob("*.py")):
        for module in modules(ast.parse(path.read_text(encoding="utf-8"))):
            found[module.split(".")[0]] = path
    names = found.keys() - sys.stdlib_module_names - own - TYPES_ONLY
    companions = {path.name for path in LIBRARY} & names
    names = names - companions | ({"robot_energy"} if companions else set())
    return {DISTRIBUTIONS.get(name, name) for name in names}


def modules(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


@pytest.mark.parametrize("package", FOLDERS)
def test_the_licence_is_in_the_folder(package):
    assert (FOLDERS[package] / "LICENSE").read_bytes() == (ROOT / "LICENSE").read_bytes()
