"""What is stated in more than one place is stated alike: versions, names, files, dependencies."""

import ast
import re
import runpy
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from functools import cache
from pathlib import Path

import pytest

from places import LIBRARY, ROOT

PACKAGES = ("src", "ros2_energy_monitor", "ros2_energy_msgs")
SOURCE = ROOT / "src"
NODES = ROOT / "ros2_energy_monitor/ros2_energy_monitor"
VERSION = re.search(
    r'__version__ = "(.+)"', (SOURCE / "robot_energy/__init__.py").read_text()
).group(1)  # fmt: skip


def tracked(*patterns: str) -> list[Path]:
    """Files of the project that match, or all files below a folder without git."""
    done = subprocess.run(
        ["git", "ls-files", *patterns], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if done.returncode:
        return [path for pattern in patterns for path in sorted(ROOT.rglob(pattern))]
    return [ROOT / name for name in done.stdout.splitlines() if (ROOT / name).is_file()]


SOURCES = tracked(
    "src/robot_energy*.py",
    "ros2_energy_monitor/ros2_energy_monitor/*.py",
)
CODE = [*SOURCES, *tracked("test/*.py", ".ci/*.py", "ros2_energy_monitor/test/*.py")]
# Records of decisions name files as they were then.
DOCUMENTS = [path for path in tracked("*.md", "*.rst") if "decisions" not in path.parts
             and not path.name.startswith("CHANGELOG")]  # fmt: skip


# Versions and the workflow


@pytest.mark.parametrize("package", PACKAGES)
def test_package_xml_states_the_version_of_the_library(package):
    assert ET.parse(ROOT / package / "package.xml").findtext("version") == VERSION


def test_setup_of_the_nodes_states_no_other_version():
    done = subprocess.run(
        [sys.executable, "setup.py", "--version"],
        cwd=NODES.parent, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.split()[-1] == VERSION


def test_the_workflow_is_clean():
    zizmor = shutil.which("zizmor")
    if zizmor is None:
        pytest.skip("zizmor, which checks workflows, is not installed")
    done = subprocess.run(
        [zizmor, "--offline", "--no-progress", str(ROOT / ".github/workflows/ci.yml")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr


# Names and files that texts refer to

DOTTED = re.compile(r"\b(robot_energy(?:_[a-z]+)?|ros2_energy_monitor)((?:\.\w+)+)")
# Files named in a text: a folder, a slash, and a Python file.
FILE = re.compile(r"(?<![\w./~{*-])((?:[\w.-]+/)+[\w-]+\.(?:py|md|yaml|gcode))\b")
NOT_NAMES = ("commands", "kinds")  # groups of entry points


@cache
def comments_and_strings(path: Path) -> str:
    """Docstrings and comments of a module; of a document, all of it."""
    text = path.read_text()
    if path.suffix != ".py":
        return text
    nodes = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    found = [ast.get_docstring(node) or "" for node in ast.walk(ast.parse(text))
             if isinstance(node, nodes)]  # fmt: skip
    found += re.findall(r"(?:^|\s)# (.*)$", text, flags=re.MULTILINE)
    return "\n".join(found)


def exists(package: str, tail: str) -> bool:
    """Whether a dotted name is a module, or an attribute of one."""
    top = NODES if package == "ros2_energy_monitor" else SOURCE / package
    parts = tail.strip(".").split(".")
    place = top
    while parts and (place / parts[0]).is_dir():
        place = place / parts.pop(0)
    if not parts:
        return True
    file = place / f"{parts[0]}.py"
    if file.exists():
        parts.pop(0)
    else:
        file = place / "__init__.py"
    if not parts:
        return True
    words = set(re.findall(r"\w+", file.read_text())) if file.exists() else set()
    return all(part in words for part in parts)


def test_every_dotted_name_exists():
    missing = {
        f"{path.relative_to(ROOT)}: {package}{tail}"
        for path in [*CODE, *DOCUMENTS]
        for package, tail in DOTTED.findall(comments_and_strings(path))
        if tail.strip(".").split(".")[0] not in NOT_NAMES and not exists(package, tail)
    }
    assert not missing


def test_a_wrong_dotted_name_is_found():
    assert exists("robot_energy", ".physics.friction.FrictionModel")
    assert exists("robot_energy", ".model.load")
    assert not exists("robot_energy", ".ingest.source_file.read_inputs")
    assert not exists("robot_energy", ".physics.friction.NoSuchThing")


MADE = ("build/", "my_", "install/", ".venv/", "state/")


def named_file_exists(path: Path, name: str) -> bool:
    """Whether a text's file exists: from the root, next to the text, or in a package."""
    if name.startswith(MADE):
        return True
    tops = (ROOT, path.parent, SOURCE, SOURCE / "robot_energy", SOURCE / "doc", ROOT / "test",
            NODES, NODES.parent)  # fmt: skip
    return any((top / name).exists() for top in tops)


def test_every_file_that_is_named_exists():
    missing = {
        f"{path.relative_to(ROOT)}: {name}"
        for path in [*CODE, *DOCUMENTS]
        for name in FILE.findall(comments_and_strings(path))
        if not named_file_exists(path, name)
    }
    assert not missing


# Architecture

ARCHITECTURE = (SOURCE / "doc/architecture.md").read_text()


def defines(path: Path, name: str) -> bool:
    """Whether a file defines a function, or a class with this method."""
    body = ast.parse(path.read_text()).body
    for part in name.split("."):
        found = [node for node in body if getattr(node, "name", "") == part]
        if not found:
            return False
        body = getattr(found[0], "body", [])
    return True


def test_the_ways_through_the_code_name_what_is_there():
    named = re.findall(r"`([\w.]+)`\s+\(`([\w/]+\.py)`\)", ARCHITECTURE)
    tops = (NODES, SOURCE / "robot_energy", SOURCE)
    files = [(name, top / path) for name, path in named for top in tops if (top / path).exists()]
    assert len(files) == len(named) > 50
    assert not [(name, str(path)) for name, path in files if not defines(path, name)]


@pytest.fixture(scope="module")
def drawing():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / ".ci")
        return runpy.run_path(str(ROOT / ".ci/architecture.py"))


def test_the_table_of_packages_is_in_the_order_of_imports(drawing):
    named = re.findall(r"^\| `(\w+)` \|", ARCHITECTURE, flags=re.MULTILINE)
    assert set(named) == set(drawing["PACKAGES"])
    between, _ = drawing["imports"]()
    assert not [pair for pair in between if named.index(pair[0]) < named.index(pair[1])]


def test_the_picture_of_the_packages_shows_their_imports(drawing):
    assert drawing["PICTURE"].read_text() == drawing["picture"](), "run: python .ci/architecture.py"


# Dependencies

TABLE = (ROOT / "src/doc/dependencies.md").read_text()
# Import name -> name in the table, where they differ.
CALLED = {
    "yaml": "pyyaml",
    "pinocchio": "pin",
    "pydantic_core": "pydantic",
    "prometheus_client": "prometheus-client",
}
# Modules of ROS messages and of rclpy come with one row.
ROS = re.compile(
    r"^(rclpy|\w+_msgs|\w+_srvs|\w+_interfaces|ament_index_python|rosidl_\w+|launch(_ros)?)$"
)


@cache
def imports(path: Path) -> frozenset[str]:
    """Top-level names that a file imports, wherever in it."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module.split(".")[0])
    return frozenset(found)


def third_party(paths: list[Path]) -> set[str]:
    """Third-party names of several files, as the table calls them."""
    own = {*(path.name for path in LIBRARY), "ros2_energy_monitor", "_typeshed"}
    names = set().union(*map(imports, paths)) - own - set(sys.stdlib_module_names)
    return {CALLED.get(name, name) for name in names if not ROS.match(name)}


def rows() -> dict[str, str]:
    """Package -> the rest of its row."""
    found = {}
    for line in TABLE.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("|") and len(cells) > 1:
            found |= dict.fromkeys(re.findall(r"`([\w.*-]+)`", cells[0]), " | ".join(cells[1:]))
    return found


def test_every_third_party_import_has_its_row():
    assert third_party(SOURCES) <= set(rows()) | {"setuptools"}


def test_every_direct_dependency_of_the_wheel_has_its_row():
    text = (SOURCE / "setup.py").read_text()
    names = {name.lower() for name in re.findall(r'"([A-Za-z0-9_-]+)>=', text)}
    assert names <= set(rows())


def test_claims_that_only_one_part_imports_a_package_hold():
    claims = {
        package: re.findall(r"`([\w./]+)`", claim.group(1))
        for package, text in rows().items()
        if (claim := re.search(r"only ((?:`[\w./]+`(?:, | and )?)+) imports?", text))
    }
    assert len(claims) >= 3
    for package, places in claims.items():
        users = {path.relative_to(ROOT).as_posix() for path in SOURCES
                 if package in third_party([path])}  # fmt: skip
        assert users, f"{package} is imported nowhere"
        strangers = {user for user in users if not any(f"/{place}" in user for place in places)}
        assert not strangers, f"{package} is imported by {strangers} too"


def test_every_tool_with_a_row_is_pinned():
    pins = " ".join(path.read_text() for path in sorted((ROOT / ".ci").glob("requirements*.txt")))
    pinned = {
        name.lower() for name in re.findall(r"^([\w.-]+)(?:\[.*\])?==", pins, flags=re.MULTILINE)
    }
    # Of the platform, of benchmarks, or optional.
    others = {"figaroh", "gcode-lib", "Printrun", "pre-commit", "setuptools", "wheel"}
    others |= {"ros-jazzy-common-interfaces"}
    assert not {name for name in rows() if "*" not in name} - pinned - others
