"""Nobody compares the name of a kind: the tables are asked instead."""

import ast
import importlib

from places import LIBRARY, ROOT
from robot_energy.inputs.meter.kinds import METER_KINDS
from robot_energy.inputs.temperatures.kinds import TEMPERATURE_KINDS
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.model.friction_laws import FRICTION_LAWS
from robot_energy_logs.log_formats import LOG_FORMATS
from robot_energy_plan.optimization.measures import MEASURES

TABLES = (DRIVE_MODELS, FRICTION_LAWS, METER_KINDS, TEMPERATURE_KINDS, LOG_FORMATS, MEASURES)
NAMES = {name for table in TABLES for name in table}
ENTRIES = {
    kind.entry.__name__ for kind in (*DRIVE_MODELS.values(), *FRICTION_LAWS.values()) if kind.entry
}
NODES = ROOT / "ros2_energy_monitor/ros2_energy_monitor"
# Words that are a kind's name and mean something else.
OTHER_WORDS = {
    ("robot_energy/bag/sqlite_source.py", "table"),  # type of an object of a database
    ("robot_energy_fleet/identify.py", "constant"),  # the law that every joint must have
    ("robot_energy_identify/drives/total_power.py", "constant"),  # a structure of losses
    ("robot_energy_identify/drives/total_covariance.py", "constant"),  # the name of a figure
    ("robot_energy/model/load.py", "efficiency_map"),  # key of an entry
    ("robot_energy/model/load.py", "loss_map"),
    ("robot_energy_papers/models.py", "table"),  # the law that paper A asks for
}
BY_CLASS = {
    # The free curve of identified friction is a table or a constant, by definition.
    "robot_energy_identify/friction/friction.py",
    # A temperature shape that is lent is that of an exponential law.
    "robot_energy_identify/friction/shared_shape.py",
    # A factor on the viscous friction of the arm of paper B, whose law is exponential.
    "robot_energy_papers/models.py",
}


def values(node, module):
    """Texts that an operand of a comparison may be."""
    if isinstance(node, ast.Constant):
        found = [node.value]
    elif isinstance(node, ast.Tuple | ast.List | ast.Set):
        return {text for item in node.elts for text in values(item, module)}
    elif isinstance(node, ast.Name):
        value = getattr(module, node.id, None)
        found = list(value) if isinstance(value, tuple | list | set | frozenset) else [value]
    else:
        found = []
    return {text for text in found if isinstance(text, str)}


def compared(tree, module):
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare):
            for side in (node.left, *node.comparators):
                yield from ((node.lineno, text) for text in values(side, module) & NAMES)
        elif isinstance(node, ast.MatchValue):
            yield from ((node.value.lineno, text) for text in values(node.value, module) & NAMES)


def classes(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "isinstance":
            yield from (
                (node.lineno, name.id)
                for name in ast.walk(node.args[1])
                if isinstance(name, ast.Name) and name.id in ENTRIES
            )
        elif isinstance(node, ast.MatchClass) and getattr(node.cls, "id", "") in ENTRIES:
            yield node.cls.lineno, node.cls.id


def modules():
    """Every file with its name and, where it needs no ROS, its module."""
    for package in LIBRARY:
        for path in sorted(package.rglob("*.py")):
            name = path.relative_to(ROOT / "src")
            if path.name != "__main__.py":
                dotted = ".".join(name.with_suffix("").parts).removesuffix(".__init__")
                yield path, str(name), importlib.import_module(dotted)
    for path in sorted(NODES.rglob("*.py")):
        yield path, str(path.relative_to(NODES)), None


def test_no_name_of_a_kind_is_compared():
    found = []
    for path, name, module in modules():
        tree = ast.parse(path.read_text())
        found += [
            f"{name}:{line} compares '{text}'"
            for line, text in compared(tree, module)
            if (name, text) not in OTHER_WORDS
        ]
        found += [
            f"{name}:{line} asks for {text}" for line, text in classes(tree) if name not in BY_CLASS
        ]
    assert found == []


def test_a_comparison_would_be_found():
    code = """
def f(a):
    return a == "ideal" or a in (LAW,) or isinstance(a, TableLaw)
"""
    module = type("Module", (), {"LAW": "table"})
    tree = ast.parse(code)
    assert {text for _, text in compared(tree, module)} == {"ideal", "table"}
    assert [text for _, text in classes(tree)] == ["TableLaw"]
