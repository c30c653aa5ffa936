"""State files of an earlier release, named by robot alone: one node takes them, once.

A claim with the name of the node appears by one rename, under the lock of the earlier release, and
stays: only that node may rename the slots, as often as it is interrupted.
"""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from robot_energy.foundation.files.placement import sync_folder
from robot_energy.store.state_files import open_regular, read_regular

BEGUN, COMPLETE = "begun", "complete"
MAX_CLAIM = 4096  # bytes


class Adoption:
    """Takes the files of an earlier release over.

    Args:
        name: How the names of the own files begin, whose lock is held.
    """

    def __init__(self, folder: Path, earlier: str, name: str, owner: str) -> None:
        self._claim = folder / f"{earlier}.adopted"
        self._draft = folder / f"{earlier}.adopted.part"
        self._lock = folder / f"{earlier}.lock"
        self._moves = [
            (folder / f"{earlier}.{s}.state", folder / f"{name}.{s}.state") for s in "ab"
        ]
        self._owner = owner

    def take(self) -> bool:
        """Take them over, or finish that, if they are there and nobody else has.

        Returns:
            Whether files became our own just now. False as well while a monitor of the
            earlier release writes them.

        Raises:
            OSError: If the folder cannot be written.
        """
        if not any(os.path.lexists(old) for old, _ in self._moves):
            return False
        lock = open_regular(self._lock, os.O_RDWR | os.O_CREAT)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return self._take()
        except BlockingIOError:
            return False
        finally:
            os.close(lock)

    def _take(self) -> bool:
        claim = read_regular(self._claim, MAX_CLAIM)
        if claim is None:
            if any(os.path.lexists(new) for _, new in self._moves):
                return False  # these registers count on their own already
            self._write(BEGUN)
        elif claim.decode(errors="replace") != f"{BEGUN} {self._owner}\n":
            return False
        moved = False
        for old, new in self._moves:
            if os.path.lexists(old) and not os.path.lexists(new):
                old.rename(new)
                moved = True
        sync_folder(self._claim.parent)
        self._write(COMPLETE)
        return moved

    def _write(self, progress: str) -> None:
        """Replace the claim; it is there whole, or as it was."""
        self._draft.unlink(missing_ok=True)
        file = open_regular(self._draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL)
        with os.fdopen(file, "wb") as opened:
            opened.write(f"{progress} {self._owner}\n".encode())
            opened.flush()
            os.fsync(file)
        self._draft.rename(self._claim)
        sync_folder(self._claim.parent)
