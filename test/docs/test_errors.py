"""Every error of the library says what was found, and what was expected or what to do."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from places import LIBRARY, ROOT

ERRORS = ROOT / "src/robot_energy/foundation/errors.py"
PACKAGES = (*LIBRARY, ROOT / "ros2_energy_monitor/ros2_energy_monitor")

# Raised with one part only, because that part says it all: module and number of such places.
# A number may only fall.
ONE_PART = {
    "ros2_energy_monitor/ros2_energy_monitor/base/monitor_node.py": 1,
    "ros2_energy_monitor/ros2_energy_monitor/base/parameters.py": 1,
    "ros2_energy_monitor/ros2_energy_monitor/nodes/player.py": 1,
}


@cache
def error_classes() -> set[str]:
    """Names of our error classes that take found, expected and remedy."""
    return {
        node.name
        for node in ast.parse(ERRORS.read_text()).body
        if isinstance(node, ast.ClassDef)
        and not any(
            isinstance(item, ast.FunctionDef) and item.name == "__init__" for item in node.body
        )
    }


def raised(path: Path) -> Iterator[ast.Call]:
    """Calls of our error classes in a module: raised at once, returned or kept."""
    known = error_classes()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in known:
            yield node


def parts(call: ast.Call) -> set[str]:
    """Which of found, expected and remedy a call gives, and not as an empty text."""
    given = dict(zip(("found", "expected", "remedy"), call.args, strict=False))
    given |= {word.arg: word.value for word in call.keywords if word.arg}
    if any(isinstance(value, ast.Starred) for value in call.args):
        return {"found", "expected"}  # another call made them
    return {
        name for name, value in given.items()
        if not (isinstance(value, ast.Constant) and not value.value)
    }  # fmt: skip


def test_every_error_says_found_and_expected_or_remedy():
    without_found, one_part = [], {}
    for package in PACKAGES:
        for path in sorted(package.rglob("*.py")):
            if path == ERRORS:
                continue
            for call in raised(path):
                has = parts(call)
                place = f"{path.relative_to(ROOT)}:{call.lineno}"
                if "found" not in has:
                    without_found.append(place)
                elif not has & {"expected", "remedy"}:
                    one_part.setdefault(path.relative_to(ROOT).as_posix(), []).append(call.lineno)
    assert not without_found
    found = {name: len(lines) for name, lines in one_part.items()}
    grown = {name: one_part[name] for name in found if found[name] > ONE_PART.get(name, 0)}
    assert not grown, f"say what was expected or what to do: {grown}"
    fallen = {name: found.get(name, 0) for name, n in ONE_PART.items() if found.get(name, 0) < n}
    assert not fallen, f"lower the numbers of ONE_PART to {fallen}"


def test_parts_of_an_error_are_recognised():
    def has(text: str) -> set[str]:
        call = ast.parse(text, mode="eval").body
        assert isinstance(call, ast.Call)
        return parts(call)

    assert has('BagError("x")') == {"found"}
    assert has('BagError("x", "")') == {"found"}
    assert has('BagError("x", remedy="do")') == {"found", "remedy"}
    assert has('BagError(f"{x}", "a file")') == {"found", "expected"}
