"""Scripts of test/bench and test/soak: none is broken before somebody needs its figures."""

import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from places import ROOT

FOLDERS = (ROOT / "test/bench", ROOT / "test/soak")
FILES = sorted(path for folder in FOLDERS for path in folder.glob("*.py"))
SCRIPTS = [path for path in FILES if "ArgumentParser(" in path.read_text()]


def run(path: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(path), *words], env={**os.environ, "COLUMNS": "80"},
        capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip


@pytest.fixture(scope="module")
def helps():
    """What every script answers to `--help`; two at a time, since imports take their time."""
    with ThreadPoolExecutor(2) as pool:
        return dict(zip(SCRIPTS, pool.map(lambda path: run(path, "--help"), SCRIPTS), strict=True))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_a_script_answers_help(script, helps):
    done = helps[script]
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"usage: {script.name}")


@pytest.mark.parametrize(
    "part",
    [path for path in FILES if path not in SCRIPTS],
    ids=lambda path: f"{path.parent.name}/{path.name}",
)
def test_every_other_file_is_used_by_a_script(part):
    """Imported or started by a file of its folder, so that its script notices if it breaks."""
    name = re.escape(part.stem)
    use = re.compile(rf"(import|from) {name}\b|[\"'/]{name}(\.py)?[\"']")
    others = (path for path in part.parent.glob("*.py") if path != part)
    assert any(use.search(path.read_text()) for path in others)


def test_mistakes_are_refused_and_sound_recordings_are_not():
    done = run(ROOT / "test/bench/identify_mistakes.py", "--quick")
    assert done.returncode == 0, done.stdout + done.stderr
    counts = re.findall(r"(\d+) of (\d+)", done.stdout)
    assert counts == [("0", "2"), ("1", "1"), ("1", "1"), ("1", "1")], done.stdout
