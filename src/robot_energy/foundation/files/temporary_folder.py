"""Temporary folders that do not outlive their process, however it ends."""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
import weakref
from contextlib import AbstractContextManager, suppress
from pathlib import Path

from robot_energy.foundation.files.placement import is_locked, is_running

PREFIX = "robot_energy_work_"


class TemporaryFolder(AbstractContextManager["TemporaryFolder"]):
    """A folder that goes with this object, its process, or, after a kill, the next one made.

    A process keeps its folders locked, so that others know which are in use.
    """

    def __init__(self) -> None:
        remove_abandoned(Path(tempfile.gettempdir()))
        self.path = Path(tempfile.mkdtemp(prefix=f"{PREFIX}{os.getpid()}_"))
        lock = os.open(self.path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        self.remove = weakref.finalize(self, _remove, self.path, lock, os.getpid())
        with suppress(OSError):  # not every file system has locks
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)

    def __exit__(self, *error: object) -> None:
        self.remove()


def remove_abandoned(parent: Path) -> None:
    with suppress(OSError), os.scandir(parent) as entries:
        for entry in entries:
            if not entry.name.startswith(PREFIX):
                continue
            pid = entry.name.removeprefix(PREFIX).partition("_")[0]
            with suppress(OSError):
                mine = entry.stat(follow_symlinks=False).st_uid == os.getuid()
                folder = entry.is_dir(follow_symlinks=False)
                running = pid.isdecimal() and is_running(int(pid))
                if mine and folder and not running and not is_locked(Path(entry.path)):
                    shutil.rmtree(entry.path)


def _remove(path: Path, lock: int, pid: int) -> None:
    """Remove it; a forked child leaves it alone."""
    if os.getpid() != pid:
        return
    shutil.rmtree(path, ignore_errors=True)
    with suppress(OSError):
        os.close(lock)
