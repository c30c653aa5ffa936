"""`import robot_energy` is light, and its names are complete."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

import robot_energy as re
from robot_energy import _EXPORTS
from robot_energy.foundation.described import texts_of
from robot_energy_logs.mapping import LogRobot, ReferenceFriction
from robot_energy_report.page.settings import PageSettings

HEAVY = ("matplotlib", "scipy", "pinocchio", "numpy", "rich", "pydantic", "rosbags")


def test_the_import_is_light():
    code = "import json, sys, robot_energy; print(json.dumps(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not set(HEAVY) & set(json.loads(done.stdout))


def test_a_monitor_needs_neither_reports_nor_scipy():
    code = (
        "import sys, robot_energy as re; re.OnlineMonitor; re.physics; sys.exit("
        + " or ".join(f"'{name}' in sys.modules" for name in ("matplotlib", "scipy", "rich"))
        + ")"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("name", re.__all__)
def test_every_public_name_exists_and_is_documented(name):
    assert getattr(re, name).__doc__


@pytest.mark.parametrize(
    "kind",
    [*(one for name in re.__all__ if isinstance(one := getattr(re, name), type)),
     PageSettings, LogRobot, ReferenceFriction],
)  # fmt: skip
def test_help_has_the_text_and_unit_of_every_field(kind):
    lacking = [key for key, text in texts_of(kind).items() if f"{key}: {text}" not in kind.__doc__]
    assert not lacking


def test_type_checkers_see_the_same_names_from_the_same_modules():
    assert set(re.__all__) <= set(dir(re))
    tree = ast.parse(Path(re.__file__).with_suffix(".pyi").read_text())
    typed = {
        name.asname or name.name: (node.module, name.name)
        for node in tree.body
        if isinstance(node, ast.ImportFrom)
        for name in node.names
    }
    assert typed == _EXPORTS | {"physics": ("robot_energy", "physics")}
    assert ast.literal_eval(tree.body[-1].value) == re.__all__


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError):
        re.no_such_name  # noqa: B018


def test_functions_are_not_hidden_by_modules():
    """The package `robot_energy.replay` is set in its parent when it is imported."""
    code = (
        "import robot_energy.replay.bag_replay, robot_energy as re; "
        "from robot_energy import replay; from robot_energy.replay import bag_replay; "
        "assert replay is re.replay; assert re.replay.__module__ == 'robot_energy.replay.api'; "
        "assert bag_replay.replay is not replay"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(
    ("name", "missing", "remedy"),
    [
        ("fleet_run", "fsspec", "pip install './src[fleet]'"),
        ("optimize", "robot_energy_plan", "pip install ./src"),
    ],
)
def test_a_name_of_a_companion_says_what_is_missing(name, missing, remedy):
    code = (
        f"import sys, robot_energy as re; sys.modules['{missing}'] = None\n"
        f"try:\n    re.{name}\n"
        "except ImportError as error:\n    print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert f"robot_energy.{name} needs {missing}" in done.stdout
    assert remedy in done.stdout
