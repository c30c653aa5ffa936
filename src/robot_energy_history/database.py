"""The file of a history and its tables: one writer, who holds a lock; any number of readers."""

from __future__ import annotations

import fcntl
import os
import sqlite3
import uuid
from collections.abc import Generator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

from robot_energy.foundation.errors import HistoryError
from robot_energy.foundation.units import MINUTE_NS
from robot_energy.store.slots import open_unlinked
from robot_energy_history.readings import COLUMNS, JOINT_COLUMNS

VERSION = 3
FILE = "history.sqlite"
KEY = (
    "start INTEGER NOT NULL, robot INTEGER NOT NULL, epoch INTEGER NOT NULL, stop INTEGER NOT NULL"
)
LEVELS = (60, 1440)
"""What quarter hours and jobs are rolled up to, in UTC. [min]"""
JOB_COLUMNS = (
    "id", "start", "stop", "name", "observed_ns", "gap_ns", "compared_ns",
    "predicted_import_microjoule", "predicted_return_microjoule", "measured_microjoule",
    "predicted_microjoule_at_meter", "peak_power",
)  # fmt: skip
JOB_SUMS = tuple(name for name in JOB_COLUMNS if name.endswith(("_ns", "_microjoule", "_meter")))
"""What jobs of a name are added up by. [ns], [uJ]"""
_SLOT = f"""({KEY}, flags INTEGER NOT NULL, peak_microjoule INTEGER NOT NULL,
    {", ".join(f"{name} INTEGER NOT NULL" for name in COLUMNS)}, PRIMARY KEY ({{key}}))
    STRICT, WITHOUT ROWID"""
_JOINT = f"""({KEY}, joint TEXT NOT NULL,
    {", ".join(f"{name} INTEGER NOT NULL" for name in JOINT_COLUMNS)},
    PRIMARY KEY (robot, start, epoch, stop, joint)) STRICT, WITHOUT ROWID"""
ROLLED = (
    "".join(
        f"""
CREATE TABLE slot{level} {_SLOT.format(key="robot, start, epoch, stop")};
CREATE TABLE joint{level} {_JOINT};"""
        for level in LEVELS
    )
    + """
CREATE TABLE curve (id INTEGER PRIMARY KEY, energy BLOB NOT NULL) STRICT;
CREATE INDEX ended ON job (robot, stop);
"""
)
ROLL_JOBS = {
    level: f"INSERT INTO job{level} (robot, start, name, jobs, {', '.join(JOB_SUMS)}) SELECT "
    f"j.robot, (j.stop - 1) / {level * MINUTE_NS} * {level * MINUTE_NS} AS begin, j.name, "
    f"count(*), {', '.join(f'sum(j.{name})' for name in JOB_SUMS)} FROM robot r CROSS JOIN job j "
    "ON j.robot = r.id AND j.stop > ? AND j.stop <= ? GROUP BY j.robot, begin, j.name"
    for level in LEVELS
}
"""How jobs that ended after one instant and up to another are rolled up. [ns]"""
JOBS = "".join(
    f"""
CREATE TABLE job{level} (robot INTEGER NOT NULL, start INTEGER NOT NULL, name TEXT NOT NULL,
    jobs INTEGER NOT NULL, {", ".join(f"{name} INTEGER NOT NULL" for name in JOB_SUMS)},
    PRIMARY KEY (robot, start, name)) STRICT, WITHOUT ROWID;"""
    for level in LEVELS
)
FRICTION = """
CREATE TABLE friction (robot INTEGER NOT NULL, day INTEGER NOT NULL, joint TEXT NOT NULL,
    stamp INTEGER NOT NULL, model_id TEXT NOT NULL, ratio REAL NOT NULL,
    PRIMARY KEY (robot, day, joint)) STRICT, WITHOUT ROWID;
"""
TABLES = f"""
CREATE TABLE meta (name TEXT PRIMARY KEY, value TEXT NOT NULL) STRICT;
CREATE TABLE robot (id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE) STRICT;
CREATE TABLE epoch (id INTEGER PRIMARY KEY, robot INTEGER NOT NULL, origin TEXT NOT NULL,
    energy_start INTEGER NOT NULL, first TEXT NOT NULL, last TEXT NOT NULL,
    known_until INTEGER NOT NULL, newest INTEGER NOT NULL) STRICT;
CREATE TABLE slot1 {_SLOT.format(key="start, robot, epoch, stop")};
CREATE TABLE slot15 {_SLOT.format(key="robot, start, epoch, stop")};
CREATE TABLE joint15 {_JOINT};
CREATE TABLE job (robot INTEGER NOT NULL, id INTEGER NOT NULL, start INTEGER NOT NULL,
    stop INTEGER NOT NULL, name TEXT NOT NULL, observed_ns INTEGER NOT NULL,
    gap_ns INTEGER NOT NULL, compared_ns INTEGER NOT NULL,
    predicted_import_microjoule INTEGER NOT NULL, predicted_return_microjoule INTEGER NOT NULL,
    measured_microjoule INTEGER NOT NULL, predicted_microjoule_at_meter INTEGER NOT NULL,
    peak_power REAL, PRIMARY KEY (robot, start, id)) STRICT, WITHOUT ROWID;
CREATE TABLE event (robot INTEGER NOT NULL, stamp INTEGER NOT NULL, kind TEXT NOT NULL,
    text TEXT NOT NULL, PRIMARY KEY (robot, stamp, kind)) STRICT, WITHOUT ROWID;
CREATE INDEX irregular ON slot15 (robot, start) WHERE flags & 1;
{ROLLED}{JOBS}{FRICTION}"""
DAMAGED = (sqlite3.Error, UnicodeError)
"""What SQLite raises of a damaged file, also where its own words are damaged."""
BUSY = 5.0  # how long a lock of the file is waited for [s]


def version_of(connection: sqlite3.Connection) -> int:
    """Return the version of the tables; 0 where there are none."""
    return int(connection.execute("PRAGMA user_version").fetchone()[0])


def prepare(connection: sqlite3.Connection, path: Path) -> None:
    """Make the tables, in autocommit mode, if there are none; after an error all is as before."""
    if found := version_of(connection):
        require_version(found, path)
        return
    connection.execute("BEGIN IMMEDIATE")
    try:
        for statement in TABLES.split(";"):
            connection.execute(statement)
        connection.execute("INSERT INTO meta VALUES ('dataset', ?)", (uuid.uuid4().hex,))
        connection.execute(f"PRAGMA user_version = {VERSION}")
        connection.execute("COMMIT")
    except BaseException:
        with suppress(sqlite3.Error):  # a full disk has ended the transaction
            connection.execute("ROLLBACK")
        raise


def require_version(version: int, path: Path) -> None:
    """Refuse tables of another version with a `HistoryError`."""
    if version != VERSION:
        raise HistoryError(
            f"{path} has tables of version {version}", f"version {VERSION}",
            "use the release that wrote it, or another folder",
        )  # fmt: skip


def default_folder() -> Path:
    """Return where the recorder writes unless it is given another folder."""
    return Path(os.environ.get("ROS_HOME") or "~/.ros").expanduser() / "robot_energy" / "history"


def take_lock(folder: Path) -> int:
    """Return the lock of a folder, which is made for its owner alone if there is none.

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
    """Yield a connection that reads one state of a history, whatever is written meanwhile."""
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
