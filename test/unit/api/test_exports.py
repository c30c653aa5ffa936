"""`import robot_energy` is light, and its names are complete."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

import robot_energy as re
from robot_energy import _EXPORTS

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


def test_the_lists_of_names_agree():
    assert sorted(_EXPORTS) == sorted(re.__all__)
    assert set(re.__all__) <= set(dir(re))
    tree = ast.parse(Path(re.__file__).read_text())
    block = next(n for n in tree.body if isinstance(n, ast.If))
    typed = {
        a.asname or a.name for n in block.body if isinstance(n, ast.ImportFrom) for a in n.names
    }
    assert typed == set(re.__all__)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError):
        re.no_such_name  # noqa: B018


def test_functions_are_not_hidden_by_modules():
    import robot_energy.replay.api  # noqa: F401
    import robot_energy_plan.api.predict

    assert callable(re.replay)
    assert callable(re.predict)
