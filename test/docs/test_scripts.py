"""Scripts of test/bench and test/soak: none is broken before somebody needs its figures."""

import json
import os
import re
import subprocess
import sys

import pytest

from places import ROOT

FOLDERS = (ROOT / "test/bench", ROOT / "test/soak")
FILES = sorted(path for folder in FOLDERS for path in folder.glob("*.py"))
SCRIPTS = [path for path in FILES if "ArgumentParser(" in path.read_text()]


# The scripts of a folder in one process, since most of them import the same.
ASKED = """
import io, json, runpy, sys, traceback
from contextlib import redirect_stdout
from pathlib import Path

sys.path.insert(0, str(Path(sys.argv[1]).parent))
answers = {}
for name in sys.argv[1:]:
    sys.argv, own, code = [name, "--help"], io.StringIO(), None
    try:
        with redirect_stdout(own):
            runpy.run_path(name, run_name="__main__")
    except SystemExit as end:
        code = end.code
    except BaseException:
        traceback.print_exc()
    answers[name] = code, own.getvalue()
print(json.dumps(answers))
"""


def run(*words: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *map(str, words)], env={**os.environ, "COLUMNS": "80"},
        capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_every_script_answers_help(folder):
    scripts = [path for path in SCRIPTS if path.parent == folder]
    done = run("-c", ASKED, *scripts)
    answers = json.loads(done.stdout.splitlines()[-1])
    assert len(answers) == len(scripts) >= 5
    for script in scripts:
        code, text = answers[str(script)]
        assert code == 0, done.stderr
        assert text.startswith(f"usage: {script.name}")


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


@pytest.mark.long
def test_mistakes_are_refused_and_sound_recordings_are_not():
    done = run(ROOT / "test/bench/identify_mistakes.py", "--quick")
    assert done.returncode == 0, done.stdout + done.stderr
    counts = re.findall(r"(\d+) of (\d+)", done.stdout)
    assert counts == [("0", "2"), ("1", "1"), ("1", "1"), ("1", "1")], done.stdout
