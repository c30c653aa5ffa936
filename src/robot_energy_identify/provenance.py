"""What a model file says of the recordings that its identified figures come from."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

from robot_energy import __version__
from robot_energy.foundation.errors import BagError
from robot_energy.foundation.files.regular_file import open_regular
from robot_energy.model.schema import Provenance

DIGITS = 12  # of a hash, enough to distinguish recordings
NOTHING = hashlib.sha256().hexdigest()[:DIGITS]  # the hash of an empty folder


def sha256_of(path: Path) -> str:
    """Return the first digits of the hash over the files with messages, in the order of names.

    A folder without any is a log's: all its files count.

    Raises:
        OSError: If a file cannot be read.
    """
    files = [path]
    if path.is_dir():
        kinds = (".mcap", ".db3", ".zstd")
        held = sorted(p for p in path.iterdir() if p.is_file())
        files = [p for p in held if p.suffix in kinds] or held
    digest = hashlib.sha256()
    for file in files:
        with open_regular(file) as stream:
            while part := stream.read(1 << 20):
                digest.update(part)
    return digest.hexdigest()[:DIGITS]


def hashed(path: Path) -> str:
    """Return how a model file names a recording: its name and its hash.

    Raises:
        OSError: If a file cannot be read.
    """
    return f"{path.name} sha256:{sha256_of(path)}"


def require_distinct(bags: Sequence[Path], tests: Sequence[Path] = ()) -> None:
    """Refuse a recording that counts twice in a fit, or in the fit and in its test.

    Copies are found whatever their names. What cannot be read is left to those who read it.
    """
    known: dict[str, Path] = {}
    paths = (*bags, *tests)
    for place, path in enumerate(paths if len(paths) > 1 else ()):  # one is not read for nothing
        try:
            sha256 = sha256_of(path)
        except OSError:
            continue
        if sha256 == NOTHING:
            continue
        if sha256 in known:
            first = known[sha256]
            copy = "" if path == first else f", the second time as {path}: their messages are equal"
            why = (
                "a test on a recording of the fit shows nothing"
                if place >= len(bags)
                else "a copy holds no new information"
            )
            raise BagError(
                f"the recording {first} is named twice{copy}",
                "every recording once",
                f"name it once: {why}",
            )
        known[sha256] = path


def require_some(recordings: Sequence[object]) -> None:
    """Refuse an identification from nothing."""
    if not recordings:
        raise BagError("no recording", "one or more", "name recordings of the robot")


def identified_from(
    before: Provenance, done: str, recordings: Sequence[str], data_date: str = ""
) -> Provenance:
    """Return the provenance of a model after an identification.

    Args:
        recordings: Those behind it, see `hashed`.
    """
    new = [name for name in recordings if name not in before.bags]
    return Provenance(
        tool_version=__version__,
        data_date=data_date or before.data_date,
        bags=(*before.bags, *new),
        notes=f"{done} Of the model before: {before.notes}" if before.notes else done,
    )
