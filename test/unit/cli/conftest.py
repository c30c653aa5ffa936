"""Inputs of the commands that write."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from logbook import WHEEL_MAPPING, wheel_bag, wheel_model
from places import ROOT


@pytest.fixture(scope="session")
def given(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The inputs of all commands."""
    folder = tmp_path_factory.mktemp("given")
    wheel_bag(folder, seconds=1.0)
    wheel_model(folder)
    (folder / "map.yaml").write_text(json.dumps(WHEEL_MAPPING))
    joints = ",".join(f"actual_q_{index}" for index in range(6))
    rows = [f"{10 + index / 100:.3f},0.1,0,0,0,0,0" for index in range(20)]
    (folder / "ur.csv").write_text("\n".join([f"timestamp,{joints}", *rows, ""]))
    examples = ROOT / "src" / "examples" / "programs"
    shutil.copy(examples / "kr16_pick_and_place.yaml", folder / "moves.yaml")
    return folder


@pytest.fixture
def place(given: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of them to run in."""
    folder = tmp_path / "place"
    shutil.copytree(given, folder)
    monkeypatch.chdir(folder)
    return folder
