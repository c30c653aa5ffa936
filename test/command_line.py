"""Commands that must be refused."""

from __future__ import annotations

import pytest

from robot_energy_cli import main


def refused(capsys: pytest.CaptureFixture[str], *args: object, code: int = 2) -> str:
    """Run a command that must be refused in one sentence and return that."""
    assert main([str(arg) for arg in args]) == code
    out, err = capsys.readouterr()
    assert err.startswith("robot-energy: ")
    assert err.count("\n") == 1
    assert "Traceback" not in out + err
    return err
