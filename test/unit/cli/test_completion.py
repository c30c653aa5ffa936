"""The completion script of bash completes what the parser knows."""

import contextlib
import io
import subprocess

import pytest

from robot_energy_cli.main import main

ASK = """
source /dev/stdin
COMP_WORDS=({words})
COMP_CWORD={last}
_shtab_robot_energy 2>/dev/null
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


def completed(script, *words):
    ask = ASK.format(words=" ".join(words), last=len(words) - 1)
    done = subprocess.run(
        ["bash", "-c", ask], input=script, capture_output=True, text=True, check=True
    )
    return done.stdout.split()


@pytest.fixture(scope="module")
def script():
    text = io.StringIO()
    with contextlib.redirect_stdout(text):
        assert main(["completion", "bash"]) == 0
    return text.getvalue()


def test_commands_are_completed(script):
    assert completed(script, "robot-energy", "repl") == ["replay"]


def test_options_are_completed(script):
    assert "--json" in completed(script, "robot-energy", "replay", "--js")
