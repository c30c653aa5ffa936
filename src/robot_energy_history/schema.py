"""Tables of the history."""

from __future__ import annotations

import sqlite3
import uuid
from pathlib import Path

from robot_energy.foundation.errors import HistoryError
from robot_energy.foundation.units import MINUTE_NS
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


def version_of(connection: sqlite3.Connection) -> int:
    """Return the version of the tables; 0 where there are none."""
    return int(connection.execute("PRAGMA user_version").fetchone()[0])


def prepare(connection: sqlite3.Connection, path: Path) -> None:
    """Make the tables, if there are none.

    Args:
        connection: In autocommit mode.

    Raises:
        sqlite3.Error: If it cannot be done; all is as before then.
    """
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
        connection.execute("ROLLBACK")
        raise


def require_version(version: int, path: Path) -> None:
    """Refuse tables of another version with a `HistoryError`."""
    if version != VERSION:
        raise HistoryError(
            f"{path} has tables of version {version}", f"version {VERSION}",
            "use the release that wrote it, or another folder",
        )  # fmt: skip
