"""Folders for the user: whole or not at all, and never over what is not ours."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import BinaryIO

from robot_energy.foundation.errors import ReportError, RobotEnergyError
from robot_energy.foundation.files.output_files import (
    GENERATOR,
    ErrorType,
    Names,
    checked_path,
    refuse_inputs,
)
from robot_energy.foundation.files.placement import OutputPlacement, all_or_none, remove_remains
from robot_energy.foundation.shown_text import shown


class OutputFolder:
    """A folder that appears whole, with all its files, or not at all.

    Arguments as in `check_folder`.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        foreign: Callable[[Path], list[str]],
        overwrite: bool = False,
        inputs: Names = (),
        error: ErrorType = ReportError,
    ) -> None:
        self._error = error
        self.path = folder_path(path, error)
        given = {"overwrite": overwrite, "inputs": tuple(inputs), "error": error}
        check = partial(check_folder, foreign=foreign, **given)
        remove_remains(self.path)
        check(path)
        self._placement = OutputPlacement(self.path, check, self.failure)
        try:
            self._placement.make_folder()
        except BaseException:
            self.discard()
            raise

    @property
    def draft(self) -> Path:
        """Where its files are written until it is placed."""
        return self._placement.draft

    def open(self, name: str, buffering: int = 2**20) -> BinaryIO:
        try:
            return (self.draft / name).open("xb", buffering)
        except OSError as trouble:
            raise self.failure(trouble) from trouble

    def make(self, name: str) -> None:
        try:
            os.mkdir(self.draft / name)
        except OSError as trouble:
            raise self.failure(trouble) from trouble

    def place(self) -> None:
        """Put it into place, now or at the end of the block `all_or_none` around this."""
        try:
            with all_or_none() as waiting:
                waiting.append(self._placement)
        except BaseException:
            self.discard()
            raise

    def discard(self) -> None:
        """Leave everything as it was."""
        self._placement.undo()

    def failure(self, trouble: OSError) -> RobotEnergyError:
        return self._error(
            f"{shown(str(self.path))} cannot be written ({trouble.strerror or trouble})",
            "a folder that can be written to, with room",
        )


def folder_path(path: str | os.PathLike[str], error: ErrorType = ReportError) -> Path:
    target = checked_path(path, "the folder", error)
    if target.name in ("", ".."):
        target = target.resolve()
    if not target.name:
        raise error(f"'{shown(str(path))}' is the root of the file system", "a folder of its own")
    return target


def check_folder(
    path: str | os.PathLike[str],
    foreign: Callable[[Path], list[str]],
    overwrite: bool = False,
    inputs: Names = (),
    error: ErrorType = ReportError,
) -> None:
    """Refuse an output folder, before the work that it is for.

    Args:
        foreign: Names what in a folder is not ours.
        overwrite: Whether it may be replaced if all in it is ours.
        inputs: Files and folders that the command reads; missing ones are ignored.
    """
    target = folder_path(path, error)
    name = shown(str(target))
    try:
        refuse_inputs(target, inputs, f"{name} cannot be written", error)
        try:
            found = os.lstat(target)
        except FileNotFoundError:
            return
        if stat.S_ISLNK(found.st_mode):
            raise error(f"{name} is a link", "a new folder", "name the folder that it leads to")
        if not stat.S_ISDIR(found.st_mode):
            raise error(f"{name} exists and is not a folder", "a new folder", "choose another name")
        if not any(target.iterdir()):
            return
        strange = foreign(target)
    except OSError as trouble:
        raise error(
            f"{name} cannot be made ({trouble.strerror})", "a folder that can be written to"
        ) from trouble
    if strange:
        more = f" and {len(strange) - 3} more" if len(strange) > 3 else ""
        raise error(
            f"{name} exists and holds {[shown(entry) for entry in strange[:3]]}{more}",
            f"a new folder, or one with nothing but what {GENERATOR} wrote",
            "choose another name",
        )
    if not overwrite:
        raise error(f"{name} exists", "a new folder", "choose another name, or give --overwrite")
