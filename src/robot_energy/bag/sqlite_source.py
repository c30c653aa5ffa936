"""Messages of one rosbag2 sqlite3 file, read without trusting what the file says of itself."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing
from functools import partial
from pathlib import Path
from urllib.parse import quote

from robot_energy.bag.cdr.decode import RawBatch
from robot_energy.bag.mcap_records import LogTimes
from robot_energy.bag.sources import (
    BATCH_BYTES,
    BATCH_MESSAGES,
    MANY_STEPS_BACK,
    BagContents,
    Report,
    TopicInfo,
    broken_times,
)
from robot_energy.foundation.errors import BagError
from robot_energy.foundation.files.first_bytes import SQLITE
from robot_energy.foundation.files.regular_file import open_regular
from robot_energy.foundation.units import SECOND_NS

MAX_VALUE_BYTES = 64 * 2**20  # longest row that is looked at, whosever it is [bytes]
MAX_MESSAGE_BYTES = 16 * 2**20  # longest message that is read [bytes]
MAX_TOPICS = 10_000
_LIMITS = {
    sqlite3.SQLITE_LIMIT_LENGTH: MAX_VALUE_BYTES,
    sqlite3.SQLITE_LIMIT_ATTACHED: 0,
    sqlite3.SQLITE_LIMIT_COLUMN: 100,
    sqlite3.SQLITE_LIMIT_EXPR_DEPTH: 50,
    sqlite3.SQLITE_LIMIT_TRIGGER_DEPTH: 1,
}
# Text of the file can stand in sqlite's own messages; a size it makes up can be refused.
_UNREADABLE = (sqlite3.Error, OverflowError, UnicodeDecodeError, MemoryError)
_COLUMNS = {
    "topics": {"id", "name", "type", "serialization_format"},
    "messages": {"topic_id", "timestamp", "data"},
    "message_definitions": {"topic_type", "encoding", "encoded_message_definition"},
}


class SqliteSource:
    """Messages of one sqlite3 file.

    The file is opened read-only and as one that nobody writes, so that no journal next to it is
    taken up. Only plain tables are read: a view or a computed column would run what the file
    says. sqlite keeps no checksum of messages, so none of them is verified.
    """

    def __init__(self, path: Path, report: Report) -> None:
        self._path = path
        self._report_to = report
        self._ids: dict[int, tuple[str, str]] = {}  # topic and type of each id
        self.unverified_count = 0

    def contents(self) -> BagContents:
        result = BagContents()
        try:
            with closing(self._open()) as base:
                self._check(base)
                self._read_topics(base, result)
                if self._table(base, "message_definitions"):
                    query = "SELECT topic_type, encoding, encoded_message_definition"
                    for msgtype, encoding, text in base.execute(
                        f"{query} FROM message_definitions LIMIT {MAX_TOPICS}"
                    ):
                        result.definitions.setdefault(str(msgtype), (str(encoding), str(text)))
        except _UNREADABLE as error:
            raise self._unreadable(str(error)) from error
        return result

    def parts(
        self, topics: dict[str, str], spans: Mapping[str, LogTimes] | None = None
    ) -> Iterator[dict[str, RawBatch]]:
        """Yield some thousand messages at a time, in order of their times, a batch a topic."""
        wanted = [key for key, (name, kind) in self._ids.items() if topics.get(name) == kind]
        within = ""
        if spans and spans.keys() >= topics.keys():
            first = min(spans[name][0] for name in topics)
            last = max(spans[name][1] for name in topics)
            within = f"AND timestamp BETWEEN {first:d} AND {last:d} "
        marks = ",".join("?" * len(wanted))
        held: dict[str, tuple[list[int], list[bytes]]] = {}
        size = number = count = odd = 0
        try:
            with closing(self._open()) as base:
                order = "rowid" if self._times_are_broken(base, wanted) else "timestamp, rowid"
                for key, time, data in base.execute(
                    "SELECT topic_id, timestamp, "
                    f"CASE WHEN length(data) <= {MAX_MESSAGE_BYTES} THEN data END "
                    f"FROM messages WHERE topic_id IN ({marks}) {within}ORDER BY {order}",
                    wanted,
                ):
                    if not isinstance(time, int) or not isinstance(data, bytes) or time < 0:
                        odd += 1
                        continue
                    times, rows = held.setdefault(self._ids[key][0], ([], []))
                    times.append(time)
                    rows.append(data)
                    size, number = size + len(data), number + 1
                    if number == BATCH_MESSAGES or size >= BATCH_BYTES:
                        count += number
                        yield self._flush(held, topics)
                        held, size, number = {}, 0, 0
        except _UNREADABLE as error:
            self._report(
                f"reading stopped ({error}); {count + number} messages before it were read"
            )
        if odd:
            self._report(f"{odd} rows that hold no message, or a huge one, were left out")
        if number:
            yield self._flush(held, topics)

    def _times_are_broken(self, base: sqlite3.Connection, wanted: list[int]) -> bool:
        """Whether the log times of a topic jump back and forth, and say so.

        They are then no order of the messages: the rows are, as they were written.
        """
        found = base.execute(
            "SELECT topic_id FROM (SELECT topic_id, timestamp - lag(timestamp) OVER "
            "(PARTITION BY topic_id ORDER BY rowid) AS step FROM messages "
            f"WHERE topic_id IN ({','.join('?' * len(wanted))})) WHERE step < {-SECOND_NS} "
            f"GROUP BY topic_id HAVING count(*) >= {MANY_STEPS_BACK}",
            wanted,
        ).fetchall()
        for (key,) in found:
            self._report(broken_times(self._ids[key][0]))
        return bool(found)

    def _flush(
        self, held: dict[str, tuple[list[int], list[bytes]]], topics: dict[str, str]
    ) -> dict[str, RawBatch]:
        part = {
            topic: RawBatch.from_messages(topic, topics[topic], times, rows)
            for topic, (times, rows) in held.items()
        }
        self.unverified_count += sum(len(batch) for batch in part.values())
        return part

    def _open(self) -> sqlite3.Connection:
        """Open the file so that nothing in it can run, write or grow."""
        try:
            with open_regular(self._path) as file:
                if file.read(len(SQLITE)) != SQLITE:
                    raise self._unreadable("it is not a sqlite3 file")
        except OSError as error:
            raise self._unreadable(str(error.strerror)) from error
        place = quote(str(self._path.absolute()))
        base = sqlite3.connect(f"file:{place}?mode=ro&immutable=1", uri=True, isolation_level=None)
        base.text_factory = partial(str, encoding="utf-8", errors="replace")
        for kind, limit in _LIMITS.items():
            base.setlimit(kind, limit)
        for pragma in ("trusted_schema = OFF", "cell_size_check = ON", "mmap_size = 0"):
            base.execute(f"PRAGMA {pragma}")
        return base

    def _check(self, base: sqlite3.Connection) -> None:
        for name in ("topics", "messages"):
            if not self._table(base, name):
                raise self._unreadable(f"it has no table of {name}")
        for suffix in ("-wal", "-journal"):
            journal = self._path.with_name(self._path.name + suffix)
            if journal.is_file() and journal.stat().st_size:
                self._report(f"{journal.name} was not read: the recording was not closed")
        (verdict,) = base.execute("PRAGMA quick_check(1)").fetchone()
        if verdict != "ok":
            line = " ".join(str(verdict).split())[:120]
            self._report(f"the file is damaged ({line}); what can be read was read")

    def _table(self, base: sqlite3.Connection, name: str) -> bool:
        """Whether there is a plain table with the columns of a bag."""
        found = base.execute("SELECT type, sql FROM sqlite_master WHERE name = ?", (name,))
        row = found.fetchone()
        if row is None:
            return False
        columns = base.execute(f"PRAGMA table_xinfo({name})").fetchall()
        computed = [column[1] for column in columns if column[6]]
        plain = row[0] == "table" and str(row[1]).upper().startswith("CREATE TABLE")
        if not plain or computed:
            raise self._unreadable(f"its {name} is not a plain table")
        lacks = _COLUMNS[name] - {column[1] for column in columns}
        if lacks:
            raise self._unreadable(f"its table of {name} has no {', '.join(sorted(lacks))}")
        return True

    def _read_topics(self, base: sqlite3.Connection, result: BagContents) -> None:
        counts = dict(base.execute("SELECT topic_id, count(*) FROM messages GROUP BY topic_id"))
        query = f"SELECT id, name, type, serialization_format FROM topics LIMIT {MAX_TOPICS + 1}"
        topics = base.execute(query).fetchall()
        if len(topics) > MAX_TOPICS:
            self._report(f"only the first {MAX_TOPICS} topics were read")
        for key, name, msgtype, encoding in topics[:MAX_TOPICS]:
            self._ids[key] = (str(name), str(msgtype))
            info = TopicInfo(str(msgtype), counts.pop(key, 0), str(encoding))
            result.add_topic(str(name), info, self._report)
            result.message_count = (result.message_count or 0) + (info.message_count or 0)
        if counts:
            self._report(f"{sum(counts.values())} messages of unknown topics were left out")
        first, last = base.execute("SELECT min(timestamp), max(timestamp) FROM messages").fetchone()
        if isinstance(first, int) and isinstance(last, int):
            result.span = first, last

    def _unreadable(self, why: str) -> BagError:
        return BagError(
            f"{self._path} cannot be read ({why})",
            "a whole rosbag2 bag",
            "rebuild it with `ros2 bag reindex`, or record again",
        )

    def _report(self, sentence: str) -> None:
        self._report_to(f"{self._path.name}: {sentence}")
