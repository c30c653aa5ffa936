"""Every table of kinds is complete, whatever was imported before."""

import json
import subprocess
import sys
from dataclasses import fields
from pkgutil import resolve_name

import pytest

from robot_energy.foundation.kinds import Part
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.model.friction_laws import FRICTION_LAWS

TABLES = (DRIVE_MODELS, FRICTION_LAWS)
SCRIPT = """
import json, sys
from importlib import import_module
import_module(sys.argv[1])
from dataclasses import fields
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.model.friction_laws import FRICTION_LAWS
print(json.dumps([
    [kind.name, *(one.name for one in fields(kind) if getattr(kind, one.name))]
    for table in (DRIVE_MODELS, FRICTION_LAWS) for kind in table.values()
]))
"""


def found():
    return [
        [kind.name, *(one.name for one in fields(kind) if getattr(kind, one.name))]
        for table in TABLES
        for kind in table.values()
    ]


@pytest.mark.parametrize(
    "module",
    [
        "robot_energy.model.friction_laws",
        "robot_energy.physics.drives_and_cabinet",
        "robot_energy_cli.kinds",
    ],
)
def test_a_module_alone_finds_the_parts_of_all_kinds(module):
    run = subprocess.run(
        [sys.executable, "-c", SCRIPT, module], capture_output=True, text=True, check=True
    )
    assert json.loads(run.stdout) == found()


def test_the_shipped_kinds_have_the_parts_that_they_need():
    assert all(law.curve and law.fit and law.merged_fit for law in FRICTION_LAWS.values())
    assert all(drive.physics for drive in DRIVE_MODELS.values())
    assert [drive.name for drive in DRIVE_MODELS.values() if drive.fitted] == [
        "efficiency_map",
        "loss_model",
        "loss_map",
    ]


def test_every_part_is_a_function_of_its_module():
    parts = [
        part
        for table in TABLES
        for kind in table.values()
        for one in fields(kind)
        if isinstance(part := getattr(kind, one.name), Part)
    ]
    assert len(parts) > 10
    for part in parts:
        assert callable(resolve_name(part.name))
