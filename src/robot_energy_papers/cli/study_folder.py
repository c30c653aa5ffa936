"""The folder that a study writes: whole, or not at all."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from robot_energy.files.output_files import HTML, JSON, PICTURE, TEXT, is_own_file
from robot_energy.files.output_folder import OutputFolder

REPORT, FIGURES, FRONT, MODEL = "report.html", "figures.json", "front.svg", "identified.yaml"
BAGS = "bags"
_FILES = {REPORT: HTML, FIGURES: JSON, FRONT: PICTURE, MODEL: TEXT}


@contextmanager
def study_folder(name: str, overwrite: bool) -> Generator[Path]:
    """Yield a draft of the folder, with a place for bags, which is put into place at the end.

    Args:
        name: Name of the folder.
        overwrite: Whether an earlier study may be replaced.

    Raises:
        ReportError: If the folder exists and is not such a study, or cannot be written.
    """
    folder = OutputFolder(name, _foreign, overwrite)
    try:
        folder.make(BAGS)
        yield folder.draft
        folder.place()
    except BaseException:
        folder.discard()
        raise


def _foreign(folder: Path) -> list[str]:
    """What in a folder no study wrote."""
    found: list[str] = []
    for path in sorted(folder.iterdir()):
        if path.name == BAGS and path.is_dir() and not path.is_symlink():
            found += [f"{BAGS}/{bag.name}" for bag in sorted(path.iterdir()) if not _is_bag(bag)]
        elif not is_own_file(path, _FILES.get(path.name, ())):
            found.append(path.name)
    return found


def _is_bag(path: Path) -> bool:
    from robot_energy.bag.ownership import foreign_entries  # imports much, at every command

    return path.is_dir() and not path.is_symlink() and not foreign_entries(path)
