"""The file of a history: one writer, who holds a lock; any number of readers next to it."""

from __future__ import annotations

import fcntl
import os
import sqlite3
from collections.abc import Generator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

from robot_energy.foundation.errors import HistoryError
from robot_energy.store.slots import open_unlinked
from robot_energy_history.schema import FILE, require_version, version_of

DAMAGED = (sqlite3.Error, UnicodeError)
"""What SQLite raises of a damaged file, also where its own words are damaged."""
BUSY = 5.0  # how long a lock of the file is waited for [s]


def default_folder() -> Path:
    """Return where the recorder writes unless it is given another folder."""
    return Path(os.environ.get("ROS_HOME") or "~/.ros").expanduser() / "robot_energy" / "history"


def take_lock(folder: Path) -> int:
    """Return the lock of a folder, which is made if there is none.

    Args:
        folder: Only its owner may look into a new one.

    Raises:
        OSError: If the folder cannot be used.
    """
    if not folder.is_dir():
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    lock = open_unlinked(folder / "history.lock", os.O_RDWR | os.O_CREAT, 0o600)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        owner = os.pread(lock, 20, 0).decode(errors="replace").strip()
        os.close(lock)
        raise HistoryError(
            f"another process ({owner or 'unknown'}) writes the history in {folder}",
            "one writer",
            "stop it, or use another folder",
        ) from None
    except OSError:
        os.close(lock)
        raise
    with suppress(OSError):  # only a hint for people
        os.ftruncate(lock, 0)
        os.pwrite(lock, f"{os.getpid()}\n".encode(), 0)
    return lock


def open_writer(folder: Path) -> sqlite3.Connection:
    """Return a connection that writes, each transaction synced; the lock must be held.

    Raises:
        sqlite3.Error, OSError: If it cannot be opened.
    """
    path = folder / FILE
    os.close(os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600))
    connection = sqlite3.connect(path, timeout=BUSY, isolation_level=None, check_same_thread=False)
    try:
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = FULL")
    except BaseException:
        connection.close()
        raise
    return connection


def unusable(folder: Path, error: Exception) -> HistoryError:
    """Return why a history cannot be written."""
    damaged = isinstance(error, DAMAGED) and not isinstance(error, sqlite3.OperationalError)
    return HistoryError(
        f"the history in {folder} cannot be written ({error})",
        "a folder that can be written, on a disk with space",
        f"stop the recorder and run: robot-energy history repair {folder}"
        if damaged
        else "counting goes on; this energy is recorded as one span once writing is possible",
    )


def open_reader(folder: str | Path) -> sqlite3.Connection:
    """Return a connection that only reads, also while another process writes."""
    path = Path(folder).expanduser() / FILE
    if not path.is_file():
        raise HistoryError(
            f"there is no history in {path.parent}", FILE,
            "start energy_recorder, or name the folder of one",
        )  # fmt: skip
    uri = f"{path.resolve().as_uri()}?mode=ro"
    try:
        connection = sqlite3.connect(uri, uri=True, timeout=BUSY, isolation_level=None)
        try:
            version = version_of(connection)
        except sqlite3.OperationalError:  # a folder that cannot be written, and no writer
            connection.close()
            connection = sqlite3.connect(f"{uri}&immutable=1", uri=True, isolation_level=None)
            version = version_of(connection)
    except DAMAGED as error:
        raise _unreadable(path, error) from error
    connection.execute("PRAGMA temp_store = MEMORY")
    try:
        require_version(version, path)
    except HistoryError:
        connection.close()
        raise
    return connection


@contextmanager
def reader(folder: str | Path) -> Generator[sqlite3.Connection]:
    """Give a connection that reads one state of a history, whatever is written meanwhile.

    Yields:
        The connection.
    """
    with closing(open_reader(folder)) as connection:
        try:
            connection.execute("BEGIN")
            yield connection
        except DAMAGED as error:
            raise _unreadable(Path(folder) / FILE, error) from error


def _unreadable(path: Path, error: Exception) -> HistoryError:
    return HistoryError(
        f"{path} cannot be read ({error})", "a history",
        f"robot-energy history check {path.parent}",
    )  # fmt: skip
