"""The dataset of a fleet: Parquet files by robot and date, one row for each bag.

``DATASET/robot=R/date=YYYY-MM-DD/BAG-STATE-SETTINGS.parquet`` holds one row: all figures of one
bag, with jobs, clock hours, joints and errors against the meter as lists in it. So a bag is there
whole or not at all. The three parts of the name are hashes of the bag's address, of its size and
time of change, and of model, options and version: a bag that is there unchanged is found by the
name alone. Each robot of a bag has a row of its own. A row takes the place of older ones of the
same robot and address, and of those of the same robot and content that were run otherwise. At the
end of a run the rows of each robot and day are merged into one file, sorted by name: however the
rows came, the same bags give the same bytes.
"""

from __future__ import annotations

import fcntl
import hashlib
import io
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, NamedTuple, cast
from urllib.parse import quote

import polars as pl

from robot_energy.foundation.described import documented
from robot_energy.foundation.errors import DatasetError
from robot_energy.foundation.files.output_files import GENERATOR, PARQUET, write_file
from robot_energy.foundation.files.placement import PREFIX
from robot_energy.foundation.shown_text import shown
from robot_energy_fleet.tables import (
    REPORTED,
    SCHEMA,
    TABLES,
    FleetTables,
    history_tables,
    in_si,
    is_history,
)

PACKED = "rows-"  # begin of the names of files with many rows
LOCK = ".lock"
CONTENT = "content"  # column by which copies of a bag are found
MOST = 2**62  # of a whole number, so that some of them can be added
NEEDED = frozenset({"name", "key", "robot", "bag", "reason", "joint", "hour_ns"})
UNKNOWN_DATE = "unknown"  # of a bag that could not be read
UNREADABLE = (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError)

Bag = tuple[str, str]
"""Robot and address."""


@documented
class RowKey(NamedTuple):
    """What says of which bag a row is."""

    name: str
    key: Annotated[str, "Equal for the same content and settings."]
    robot: str
    bag: str
    bag_hash: Annotated[str | None, "Of its content; None if it could not be read."]
    reason: Annotated[str, "Why the bag could not be used; empty where it could."]

    @property
    def is_unread(self) -> bool:
        """Whether the bag could not be read at all."""
        return bool(self.reason) and self.bag_hash is None


def row_bytes(row: Mapping[str, Any]) -> bytes:
    """Return the Parquet file of one bag; equal rows give equal bytes.

    Args:
        row: Values by the columns of `SCHEMA`; what is left out is null.
    """
    whole = {name: [row.get(name)] for name in SCHEMA}
    return _parquet(pl.DataFrame(whole, schema=SCHEMA, strict=True))


def _parquet(rows: pl.DataFrame) -> bytes:
    target = io.BytesIO()
    rows.write_parquet(target, statistics=False, metadata={"generator": GENERATOR})
    return target.getvalue()


class Dataset:
    """The files of a dataset."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        # Rows, and their files; None until they are asked for: a report needs none.
        self._known: dict[str, tuple[RowKey, set[Path]]] | None = None
        self._same: dict[Bag, set[str]] = {}  # names of rows, by robot and address or content
        self._unfinished: set[Path] | None = None  # folders in which killed runs left drafts
        if not self.folder.exists():
            return
        if not self.folder.is_dir():
            raise DatasetError(f"{folder} is not a folder", "the folder of a dataset, or a new one")
        known = ("robot=", ".")
        foreign = [e.name for e in self.folder.iterdir() if not e.name.startswith(known)]
        if foreign:
            raise DatasetError(
                f"{folder} holds '{min(foreign)}'", "a dataset of this tool, or an empty folder"
            )

    @contextmanager
    def locked(self) -> Generator[None]:
        """Keep other commands from writing to it."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with (self.folder / LOCK).open("w") as lock:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                yield
        except BlockingIOError as error:
            raise DatasetError(
                f"another command writes to {self.folder}", "one at a time", "wait, or stop it"
            ) from error

    def files(self) -> list[Path]:
        """Return all files, in order of their names."""
        found = sorted(self.folder.glob("robot=*/date=*/*.parquet"))
        for path in found:
            if not path.is_file():
                raise DatasetError(f"{path} is not a file", "rows of bags", "move it away")
        return found

    def has(self, name: str) -> bool:
        """Return whether a bag is there unchanged; older rows of it are removed."""
        if name in self._rows():
            self._keep(name)
        return name in self._rows()

    def add(self, key: RowKey, date: str, data: bytes) -> Path:
        """Return the file of a bag's row, whole or not at all in place; older rows of it go.

        A bag that cannot be read takes no row away: where it was read before, that row stays.
        """
        robot = f"robot={quote(key.robot, safe=' ')}"
        path = self.folder / robot / f"date={date}" / f"{key.name}.parquet"
        self._rows()  # before there is one more
        self._write(path, data)
        self._note(key, path)
        self._keep(key.name)
        return path

    def remove(self, bags: Iterable[Bag], unread: bool = False) -> None:
        """Remove the rows of bags."""
        rows = self._rows()
        for bag in bags:
            for name in sorted(self._same.get(bag, ())):
                if rows[name][0].is_unread or not unread:
                    self._drop(name)

    def pack(self, least: int = 2) -> None:
        """Merge the files of each robot and day, which are quicker to read as one."""
        parts: dict[Path, list[Path]] = {}
        for path in self.files():
            parts.setdefault(path.parent, []).append(path)
        for paths in parts.values():
            single = [path for path in paths if not path.stem.startswith(PACKED)]
            if len(single) >= least or (single and len(paths) > len(single)):
                self._merge(paths)

    def _rows(self) -> dict[str, tuple[RowKey, set[Path]]]:
        if self._known is None:
            self._known = {}
            self._found(self.files())
        return self._known

    def _found(self, files: list[Path]) -> None:
        if not files:
            return
        columns = collected(_scan(files, "file").select(*RowKey._fields, "file"), self.folder)
        for *values, file in columns.iter_rows():
            self._note(RowKey(*values), Path(file))

    def _note(self, key: RowKey, file: Path) -> None:
        self._rows().setdefault(key.name, (key, set()))[1].add(file)
        for same in (key.bag, key.bag_hash):
            if same is not None:
                self._same.setdefault((key.robot, same), set()).add(key.name)

    def _keep(self, name: str) -> None:
        """Remove the rows for which this one stands; it itself, if it says less than they do."""
        rows = self._rows()
        row = rows[name][0]
        older = self._same[row.robot, row.bag] - {name}
        if row.is_unread and not all(rows[other][0].reason for other in older):
            older = {name}
        elif row.bag_hash is not None:
            copies = self._same[row.robot, row.bag_hash]
            older |= {other for other in copies if rows[other][0].key != row.key}
        for other in sorted(older):
            self._drop(other)

    def _drop(self, name: str) -> None:
        row, files = self._rows().pop(name)
        for same in (row.bag, row.bag_hash):
            if same is not None:
                self._same[row.robot, same].discard(name)
        for path in files:
            if path.stem.startswith(PACKED):
                self._merge([path], name)
            else:
                path.unlink(missing_ok=True)

    def _merge(self, paths: list[Path], without: str = "") -> None:
        rows = _scan(paths).filter(pl.col("name") != without).unique("name").sort("name")
        rows = collected(rows, self.folder)
        names = cast("list[str]", rows["name"].to_list())
        ending = hashlib.sha256("".join(names).encode()).hexdigest()[:16]
        stem = names[0] if len(names) == 1 else f"{PACKED}{ending}"
        target = paths[0].parent / f"{stem}.parquet"
        if names:
            self._write(target, _parquet(rows))
        for path in paths:
            if path != target or not names:
                path.unlink(missing_ok=True)
        for name in names if self._known is not None else ():
            files = self._rows()[name][1]
            files.difference_update(paths)
            files.add(target)

    def _write(self, path: Path, data: bytes) -> None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DatasetError(
                f"{path.parent} cannot be made ({error.strerror})", "a folder that can be written"
            ) from error
        if self._unfinished is None:
            drafts = self.folder.glob(f"robot=*/date=*/{PREFIX}*")
            self._unfinished = {draft.parent for draft in drafts}
        left = path.parent in self._unfinished
        write_file(path, data, PARQUET, "rows of bags", DatasetError, remains=left)


def _scan(files: list[Path], file_column: str | None = None) -> pl.LazyFrame:
    return pl.scan_parquet(
        files, hive_partitioning=False, glob=False, schema=SCHEMA, include_file_paths=file_column
    )


def scan(folder: str | Path) -> pl.LazyFrame:
    """Return all rows of a dataset, one of each bag and robot: copies of a bag count once."""
    files = Dataset(folder).files()
    if not files:
        raise DatasetError(
            f"{folder} {'holds no row' if Path(folder).exists() else 'does not exist'}",
            "a dataset of `robot-energy fleet run`",
            "run it first",
        )
    content = pl.coalesce("bag_hash", "key").alias(CONTENT)
    return (
        _scan(files)
        .with_columns(content)
        .unique(["robot", CONTENT], keep="first", maintain_order=True)
        .drop(CONTENT)
    )


def collected(rows: pl.LazyFrame, folder: str | Path) -> pl.DataFrame:
    """Return rows of a dataset."""
    try:
        return _read(rows)
    except UNREADABLE as error:
        for file in Dataset(folder).files():
            try:
                _read(_scan([file]))
            except UNREADABLE as own:
                if _is_of_another_version(file):
                    raise DatasetError(
                        f"{folder} has rows of another version ({file})",
                        "rows with the columns of this version",
                        "run the bags again into a new --out, or move this folder away first",
                    ) from own
                reason = shown(str(own).partition("\n")[0])
                remedy = "move it away; the next run replays those of its bags that are still there"
                if isinstance(own, OSError):
                    remedy = "check the permissions of the file, and the disk"
                raise DatasetError(
                    f"{file} cannot be read ({reason})", "rows of bags", remedy
                ) from own
        raise DatasetError(
            f"{folder} changed meanwhile", "one that nothing writes to", "run the command again"
        ) from error


def _is_of_another_version(file: Path) -> bool:
    try:
        columns = dict(pl.read_parquet_schema(file))
    except UNREADABLE:
        return False
    return "bag" in columns and columns != dict(SCHEMA)


def _read(rows: pl.LazyFrame) -> pl.DataFrame:
    found = rows.collect()
    if "key" in found.columns and found["key"].null_count():
        raise pl.exceptions.SchemaError("no table of bags")
    if wrong := _why_wrong(found):
        raise pl.exceptions.SchemaError(wrong)
    return found


def _why_wrong(rows: pl.DataFrame) -> str:
    """What no run writes: a row without its names, or a number that is none; empty for nothing."""
    for column in rows.iter_columns():
        if column.name in NEEDED and column.null_count():
            return f"a row without '{column.name}'"
        if column.dtype.is_float() and not column.drop_nulls().is_finite().all():
            return f"'{column.name}' is not a finite number"
        if column.dtype.is_integer() and not column.drop_nulls().is_between(-MOST, MOST).all():
            return f"'{column.name}' is beyond 2^62"
        if column.name in TABLES:
            own = column.explode().drop_nulls()
            if len(own) and (wrong := _why_wrong(own.struct.unnest())):
                return f"in '{column.name}', {wrong}"
    return ""


def read_tables(folder: str | Path) -> FleetTables:
    """Return the rows of a dataset, or of a history, as the tables that reports are made from."""
    if is_history(folder):
        return history_tables(folder)
    named = [name for name in TABLES if name != "meter_errors"]
    rows = collected(scan(folder).select(*REPORTED, *named), folder)
    rows = rows.with_columns(pl.col("model_id").fill_null(""))

    def table(name: str) -> pl.DataFrame:
        own = rows.select("key", "robot", pl.col(name)).filter(pl.col(name).list.len() > 0)
        return in_si(own.explode(name).unnest(name))

    return FleetTables(in_si(rows.drop(named)), *map(table, named))
