"""What a fuzz target is: a function of bytes that fails only on a fault.

It returns for any bytes whatever, and says whether something of them was taken; files are
refused with a `RobotEnergyError`.
"""

import functools
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from robot_energy.foundation.errors import RobotEnergyError

JOINTS = ("shoulder", "elbow")  # of the robot that everything is about


class Target(NamedTuple):
    """What is tried, and valid samples to begin with."""

    run: Callable[[bytes], bool]  # whether something of it was taken
    seeds: Callable[[], list[bytes]]


@functools.cache
def scratch() -> Path:
    """A folder of this process."""
    return Path(tempfile.mkdtemp(prefix="fuzz_"))


def discard_scratch() -> None:
    """Remove the folder of this process."""
    shutil.rmtree(scratch(), ignore_errors=True)
    scratch.cache_clear()


def done(action: Callable[[], Any]) -> bool:
    """Run and say whether it was not refused; a refusal must be text that can be printed."""
    try:
        action()
    except RobotEnergyError as error:
        if not str(error):
            raise AssertionError("a refusal says why") from error
        return False
    return True


def in_file(name: str, data: bytes) -> Path:
    """Write bytes where a target can read them."""
    path = scratch() / name
    path.write_bytes(data)
    return path
