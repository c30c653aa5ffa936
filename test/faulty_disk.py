"""A disk that fails, and inventories of folders before and after a command."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

import pytest

from robot_energy.foundation.files import output_files, output_folder, placement

CALLS = ("open", "write", "fsync", "mkdir", "link", "rename", "replace", "unlink", "rmdir")


class FaultyDisk:
    """Stands for the module `os` in the writer and fails at one of its file operations.

    Args:
        monkeypatch: Of the test.
        error: What is raised.
        at: Number of the operation, from 1; 0 for none.
        done: Whether the operation is done before the error is raised.
        calls: The operations that count.
    """

    def __init__(
        self,
        monkeypatch: pytest.MonkeyPatch,
        error: BaseException,
        at: int,
        done: bool = False,
        calls: tuple[str, ...] = CALLS,
    ) -> None:
        self.error, self.at, self.done, self.calls = error, at, done, calls
        self.count = 0
        for module in (placement, output_files, output_folder):
            monkeypatch.setattr(module, "os", self)

    @property
    def met(self) -> bool:
        """Whether the operation that fails was met."""
        return 0 < self.at <= self.count

    def __getattr__(self, name: str) -> Any:
        real = getattr(os, name)
        if name not in self.calls:
            return real

        def call(*args: Any, **options: Any) -> Any:
            self.count += 1
            if self.count != self.at:
                return real(*args, **options)
            if self.done:
                real(*args, **options)
            raise self.error

        return call


def inventory(folder: Path) -> dict[str, str]:
    """What lies in a folder and below: kind and content of everything, by name."""
    return {str(path.relative_to(folder)): _content(path) for path in sorted(folder.rglob("*"))}


def _content(path: Path) -> str:
    if path.is_symlink():
        return f"link to {os.readlink(path)}"
    if path.is_dir():
        return "folder"
    if path.is_file():
        return hashlib.sha256(path.read_bytes()).hexdigest()
    return "special"
