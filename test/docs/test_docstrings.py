"""Docstrings: arguments, shapes, units, results, errors, sources.

Functions that users call describe every argument and every error they raise. Others say what a
name and a type do not, and always shape and unit.
"""

import ast
import pydoc
import re
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest

import robot_energy
from places import LIBRARY, ROOT

DOCUMENTS = ROOT / "src/doc"

PACKAGES = (*LIBRARY, ROOT / "ros2_energy_monitor/ros2_energy_monitor")

ARRAY = re.compile(r"\b(Float|Int|NDArray|ndarray)\b")
REAL = re.compile(r"\b(float|Float|np\.float64)\b")
SHAPE = re.compile(r"\b[Ss]hape\b|\(n|\(\.\.\.|\(N|\(\d+,|per (joint|sample)|one per|of each")
UNIT = re.compile(r"\[[^\]]+\]")
AS_IN = re.compile(r"\bas in `([\w.]+)`")  # the interface that describes arguments and result
SOURCE = re.compile(r"\bSource:|\beq\.|\[A|\[B|doi|DOI|paper [AB]")

Function = ast.FunctionDef | ast.AsyncFunctionDef


def section(docstring: str, *titles: str) -> str | None:
    """Text of a Google section, without its title."""
    found = re.search(
        rf"^(?:{'|'.join(titles)}): *\n((?: .*\n|\n)*)", docstring + "\n", flags=re.MULTILINE
    )
    return found.group(1) if found else None


def entries(text: str) -> dict[str, str]:
    """`name: description` of a section, with continued lines."""
    found: dict[str, str] = {}
    names: list[str] = []
    for line in text.splitlines():
        begin = re.match(r"^ {4,8}((?:\*{0,2}\w+(?:, )?)+)(?: \(.*?\))?: (.*)$", line)
        if begin and len(line) - len(line.lstrip()) <= 4:
            names = [name.strip("* ") for name in begin.group(1).split(",")]
            found |= dict.fromkeys(names, begin.group(2))
        else:
            for name in names:
                found[name] += " " + line.strip()
    return found


def swallows(handler: ast.ExceptHandler) -> bool:
    """Whether a handler ends our errors: it catches all of them and raises none."""
    caught = "" if handler.type is None else ast.unparse(handler.type)
    return "RobotEnergyError" in caught and not any(
        isinstance(node, ast.Raise) for node in ast.walk(handler)
    )


def raised_classes(function: Function, known: set[str]) -> set[str]:
    """Our error classes that a function raises itself, and lets out."""
    caught = {
        node
        for attempt in ast.walk(function)
        if isinstance(attempt, ast.Try) and any(map(swallows, attempt.handlers))
        for statement in attempt.body
        for node in ast.walk(statement)
    }
    names = set()
    for node in ast.walk(function):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and node not in caught:
            name = ast.unparse(node.exc.func).split(".")[-1]
            names |= {name} & known
    return names


def public_functions(tree: ast.Module) -> Iterator[tuple[str, Function, str]]:
    """Qualified name, function and docstring; that of `__init__` is the docstring of its class."""
    for node in tree.body:
        if isinstance(node, Function) and not node.name.startswith("_"):
            yield node.name, node, ast.get_docstring(node) or ""
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            for item in node.body:
                if not isinstance(item, Function):
                    continue
                if item.name == "__init__":
                    yield node.name, item, ast.get_docstring(node) or ""
                elif not item.name.startswith("_"):
                    yield f"{node.name}.{item.name}", item, ast.get_docstring(item) or ""


def names_for_users() -> set[str]:
    """Names that the documentation of the API or of kinds names, or that it says are public."""
    words = [
        word.rpartition(".")[2]
        for page in (*DOCUMENTS.glob("api/*.md"), DOCUMENTS / "kinds.md")
        for word in re.findall(r"(?:auto\w+:: |`)([A-Za-z_][\w.]*)", page.read_text())
    ]
    public = (original for _, original in robot_energy._EXPORTS.values())
    return {*words, *robot_energy.__all__, *public, *robot_energy.physics.__all__}


def names_elsewhere(path: Path) -> set[str]:
    """Names of the API that mean something else in a module: its `replay` is another function."""
    module = ".".join(path.with_suffix("").parts)
    public = robot_energy._EXPORTS.values()
    return {name for home, name in public if home and f".{home}" not in f".{module}"}


def gaps_of_function(
    name: str, function: Function, docstring: str, errors: set[str], users: set[str]
) -> Iterator[tuple[str, str]]:
    """Kind and place of all that one docstring lacks."""
    every = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
    every += [item for item in (function.args.vararg, function.args.kwarg) if item]
    given = [item for item in every if item.arg not in ("self", "cls")]
    if function.name == "_" or any("overload" in ast.unparse(d) for d in function.decorator_list):
        return
    if not docstring and name.partition(".")[0] in users:
        yield "docstring", name
    described = entries(section(docstring, "Args") or section(docstring, "Attributes") or "")
    elsewhere = AS_IN.search(docstring)
    if elsewhere:  # the interface describes them
        given = []
    for argument in given:
        text = described.get(argument.arg)
        kind = ast.unparse(argument.annotation) if argument.annotation else ""
        if text is None and (
            name.partition(".")[0] not in users and not ARRAY.search(kind) and not REAL.search(kind)
        ):
            continue
        if text is None:
            yield "argument", f"{name}({argument.arg})"
            continue
        if "Callable" in kind:
            continue
        if ARRAY.search(kind) and not SHAPE.search(text):
            yield "shape", f"{name}({argument.arg})"
        if REAL.search(kind) and not UNIT.search(text):
            yield "unit", f"{name}({argument.arg})"
    names = {item.arg for item in every}
    for argument in entries(section(docstring, "Args") or ""):
        if argument not in names:
            yield "unknown", f"{name}({argument})"
    gives = function.returns is not None and ast.unparse(function.returns) not in (
        "None", "NoReturn", "Never"
    )  # fmt: skip
    first = docstring.split("\n")[0]
    if (
        gives
        and docstring
        and function.name != "__init__"
        and not elsewhere
        and section(docstring, "Returns", "Yields") is None
        and not (len(given) == 0 or re.match(r"(Return|Yield|Whether|The )", first))
    ):
        yield "returns", name
    documented = section(docstring, "Raises") or ""
    for error in sorted(raised_classes(function, errors)):
        if error not in documented and name.partition(".")[0] in users:
            yield "raises", f"{name}: {error}"


def gaps_of_module(path: Path, errors: set[str], users: set[str]) -> list[tuple[str, str]]:
    """Every gap of one module."""
    tree, users = ast.parse(path.read_text()), users - names_elsewhere(path)
    found = [
        gap
        for name, function, docstring in public_functions(tree)
        for gap in gaps_of_function(name, function, docstring, errors, users)
    ]
    physics = "robot_energy/physics/" in path.as_posix() and "urdf" not in path.as_posix()
    if physics and path.name != "__init__.py" and not SOURCE.search(path.read_text()):
        found.append(("source", "module"))
    return found


def test_no_docstring_lacks_anything():
    text = (ROOT / "src/robot_energy/foundation/errors.py").read_text()
    errors = {node.name for node in ast.parse(text).body if isinstance(node, ast.ClassDef)}
    users = names_for_users()
    gaps = {
        path.relative_to(ROOT).as_posix(): found
        for package in PACKAGES
        for path in sorted(package.rglob("*.py"))
        if (found := gaps_of_module(path, errors, users))
    }
    assert not gaps, f"document these: {gaps}"


def test_interfaces_that_docstrings_refer_to_exist():
    """What is described elsewhere is a method in the same module, or one found by its full name."""
    without_ros = find_spec("rclpy") is None
    wrong = []
    for package in PACKAGES:
        for path in sorted(package.rglob("*.py")):
            functions = list(public_functions(ast.parse(path.read_text())))
            described = {name for name, _, docstring in functions if not AS_IN.search(docstring)}
            for name, _, docstring in functions:
                found = AS_IN.search(docstring)
                if found and not (
                    found[1] in described
                    or (found[1].startswith("rclpy.") and without_ros)
                    or ("." in found[1] and pydoc.locate(found[1]) is not None)
                ):
                    wrong.append(f"{path.relative_to(ROOT)}: {name} refers to {found[1]}")
    assert not wrong


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("def f() -> int:\n    return 1", ["docstring"]),
        ('def f(a: int) -> None:\n    """Do."""', ["argument"]),
        ('def f(a: int) -> None:\n    """Do.\n\n    Args:\n        a: Number.\n    """', []),
        ('def f(a: float) -> None:\n    """Do.\n\n    Args:\n        a: Speed.\n    """', ["unit"]),
        (
            'def f(a: float, b: int) -> None:\n    """Do.\n\n    Args:\n        a: Speed,\n'
            '            of it. [rad/s]\n        b: Number.\n    """',
            [],
        ),
        (
            'def f(a: Float) -> None:\n    """Do.\n\n    Args:\n        a: Speed. [m/s]\n    """',
            ["shape"],
        ),
        (
            'def f(a: int) -> int:\n    """Do.\n\n    Args:\n        a: Number.\n    """',
            ["returns"],
        ),
        (
            'def f(a: Float) -> Float:\n    """Do.\n\n    Args:\n        a: Speed. [m/s]\n\n'
            '    Returns:\n        Same shape.\n    """',
            ["shape"],
        ),
        ('def f(*a: int) -> None:\n    """Do."""', ["argument"]),
        ('def f() -> None:\n    """Do.\n\n    Args:\n        a: Number.\n    """', ["unknown"]),
        ('def f(a: int) -> int:\n    """Do; arguments and result as in `A.f`."""', []),
        ('def f() -> None:\n    """Do."""\n    raise BagError("x")', ["raises"]),
        (
            'def f() -> None:\n    """Do.\n\n    Raises:\n        BagError: Always.\n    """\n'
            '    raise BagError("x")',
            [],
        ),
        (
            'def f() -> None:\n    """Do."""\n    try:\n        raise BagError("x")\n'
            "    except RobotEnergyError:\n        pass",
            [],
        ),
        (
            'def f() -> None:\n    """Do."""\n    try:\n        raise BagError("x")\n'
            "    except RobotEnergyError:\n        raise",
            ["raises"],
        ),
    ],
)
def test_each_kind_of_gap_is_found(source, expected, tmp_path):
    path = tmp_path / "module.py"
    path.write_text(source)
    assert [kind for kind, _ in gaps_of_module(path, {"BagError"}, {"f"})] == expected


def test_other_functions_describe_what_their_names_and_types_do_not_say(tmp_path):
    path = tmp_path / "module.py"
    path.write_text('def f(a: int, b: Float) -> None:\n    """Do."""\n    raise BagError("x")')
    assert gaps_of_module(path, {"BagError"}, set()) == [("argument", "f(b)")]
