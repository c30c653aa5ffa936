"""The history for other databases: CSV, Parquet, line protocol, SQL, OpenMetrics.

Each row has a key that is the same in every run: resolution, time zone, robot, begin and end. To
write the same time again replaces rows, so a retry counts nothing twice. What is not known is
left out or NULL, never 0.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator, Sequence
from decimal import Decimal
from operator import itemgetter
from pathlib import Path
from typing import Annotated, Any

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import HistoryError
from robot_energy.foundation.extras import require
from robot_energy.foundation.files.output_files import GENERATOR
from robot_energy.timeline.time_series import TimeSeries, library
from robot_energy_history.api import PRICED as EVERY_PRICED
from robot_energy_history.api import History, history
from robot_energy_history.queries import Resolution, edges, rows_of, zone_of
from robot_energy_history.tariffs import stored_tariffs

TABLE = "robot_energy"
KEY = ("resolution", "timezone", "robot", "start_ns", "stop_ns")
TEXTS = KEY[:3]
MARK = f"Written by {GENERATOR}."
MAX_ROWS = 1_000_000
ROWS_AT_ONCE = 500  # of one INSERT
PRICED = ("cost", "co2_kg", "standby_night_cost", "standby_weekend_cost")
AT_METER = ("measured_microjoule", "predicted_microjoule_at_meter")
COUNTERS = {
    "predicted_import": "predicted_import_microjoule",
    "predicted_return": "predicted_return_microjoule",
    "brake_resistor": "brake_microjoule",
    "cabinet_dc": "loss_dc_microjoule",
    "cabinet_grid": "loss_grid_microjoule",
    "standby": "standby_microjoule",
}
"""Energies that only grow, by the names that ``/metrics`` has."""


class Wanted(Described):
    """What is written out."""

    folder: Annotated[Path, "Of the history."]
    start_ns: Annotated[int, "Begin of the time. [ns]"]
    stop_ns: Annotated[int, "End of the time. [ns]"]
    resolution: Annotated[Resolution, "Of the rows."] = "quarter"
    robots: Annotated[tuple[str, ...], "Names; empty for all."] = ()
    timezone: Annotated[str, "Where days begin."] = "UTC"

    def read(self, start_ns: int, stop_ns: int, resolution: Resolution) -> History:
        """Return what was used in a time."""
        return history(self.folder, start_ns, stop_ns, resolution, self.robots, self.timezone)


Row = dict[str, Any]
"""One row: `KEY`, ``resolved``, and figures by the columns of the history; None if unknown."""


def rows(wanted: Wanted) -> list[Row]:
    """Return the rows that end in a time by their begin, spans that no part holds among them."""
    table = wanted.read(wanted.start_ns, wanted.stop_ns, wanted.resolution)
    emits = any(one.co2_kg_per_kwh is not None for one in stored_tariffs(wanted.folder))
    unknown = () if emits else ("co2_kg",)
    found = [*_rows(wanted, table, 1, unknown), *_rows(wanted, table.not_resolved, 0, unknown)]
    if len(found) > MAX_ROWS:
        raise HistoryError(
            f"{len(found)} rows", f"at most {MAX_ROWS}",
            "a shorter time, or a coarser resolution",
        )  # fmt: skip
    by_key: dict[tuple[int, str, int], Row] = {}
    for row in found:
        if row["stop_ns"] > wanted.stop_ns:  # it may not be over
            continue
        key = row["start_ns"], row["robot"], row["stop_ns"]
        by_key[key] = _added(by_key[key], row) if key in by_key else row
    return [by_key[key] for key in sorted(by_key)]


def csv_bytes(wanted: Wanted) -> bytes:
    """Return the rows as CSV; unknown is an empty cell."""
    found, text = rows(wanted), io.StringIO()
    writer = csv.DictWriter(text, _names(found), lineterminator="\n")
    writer.writeheader()
    writer.writerows(found)
    return text.getvalue().encode()


def parquet_bytes(wanted: Wanted) -> bytes:
    """Return the rows as a Parquet file; unknown is null."""
    require("polars", "a Parquet file")
    polars = library("polars")
    found = rows(wanted)
    columns: dict[str, Any] = {}
    for name in _names(found):
        kind = polars.String if name in TEXTS else _plain(name, polars.Float64, polars.Int64)
        columns[name] = polars.Series(name, [row.get(name) for row in found], kind)
    target = io.BytesIO()
    polars.DataFrame(columns).write_parquet(target, metadata={"generator": GENERATOR})
    return target.getvalue()


def line_bytes(wanted: Wanted) -> bytes:
    """Return the rows as line protocol of InfluxDB, which others read too.

    The stamp is the begin of a row; it and the tags are its key. Whole numbers stay whole.
    """
    lines = [f"# {MARK}"]
    for row in rows(wanted):
        tags = [f"{name}={_tag(row[name])}" for name in TEXTS]
        if not row["resolved"]:
            tags.append(f"span_stop={row['stop_ns']}")
        fields = [
            f"{name}={value}{'' if isinstance(value, float) else 'i'}"
            for name, value in row.items()
            if name not in (*TEXTS, "start_ns") and value is not None
        ]
        lines.append(f"{TABLE},{','.join(tags)} {','.join(fields)} {row['start_ns']}")
    return ("\n".join(lines) + "\n").encode()


def sql_bytes(wanted: Wanted) -> bytes:
    """Return statements for PostgreSQL that make the table, if there is none, and put rows in.

    All is one transaction; a row that is there already is replaced.
    """
    found = rows(wanted)
    names = list(dict.fromkeys((*_names(found), *EVERY_PRICED)))
    others = [name for name in names if name not in KEY]
    types = {name: _plain(name, "double precision", "bigint") for name in others}
    key = ", ".join(f"{one} {'text' if one in TEXTS else 'bigint'} NOT NULL" for one in KEY)
    lines = [
        f"-- {MARK}\nSET client_encoding = 'UTF8';",
        "SET standard_conforming_strings = on;",
        "SET client_min_messages = warning;",
        "BEGIN;",
        f"CREATE TABLE IF NOT EXISTS {TABLE} ({key}, begin timestamptz NOT NULL,",
        f"  PRIMARY KEY ({', '.join(KEY)}));",
        *(f"ALTER TABLE {TABLE} ADD COLUMN IF NOT EXISTS {n} {t};" for n, t in types.items()),
    ]
    put = ", ".join(f"{name} = EXCLUDED.{name}" for name in others)
    for first in range(0, len(found), ROWS_AT_ONCE):
        values = ",\n".join(
            f"({', '.join(_sql(row.get(name)) for name in names)}, "
            f"to_timestamp({row['start_ns'] // 1000}::numeric / 1000000))"
            for row in found[first : first + ROWS_AT_ONCE]
        )
        lines.append(
            f"INSERT INTO {TABLE} ({', '.join(names)}, begin) VALUES\n{values}\n"
            f"ON CONFLICT ({', '.join(KEY)}) DO UPDATE SET {put};"
        )
    return ("\n".join([*lines, "COMMIT;"]) + "\n").encode()


def metrics_bytes(wanted: Wanted) -> bytes:
    """Return counters since the begin of the history in the OpenMetrics format, to fill in a past.

    A counter stands at the end of each row. It counts from the begin of the history, not of the
    time, so that each run gives the same values.
    """
    found = rows(wanted)
    first = edges(wanted.start_ns, wanted.stop_ns, wanted.resolution, zone_of(wanted.timezone))[0]
    base = wanted.read(0, max(1, first), "all")
    before = dict(zip(base["robot"].tolist(), range(len(base)), strict=True))
    lines = [
        "# HELP robot_energy_history_joules Energy since the history began, predicted.",
        "# TYPE robot_energy_history_joules counter",
        "# UNIT robot_energy_history_joules joules",
    ]
    for robot in sorted({*before, *(row["robot"] for row in found)}):
        steps = sorted(
            (row for row in found if row["robot"] == robot),
            key=itemgetter("stop_ns"),
        )
        for part, column in COUNTERS.items():
            total = int(base[column][before[robot]]) if robot in before else 0
            at: dict[int, int] = {}
            for row in steps:
                total += row[column]
                at[row["stop_ns"]] = total
            labels = f'{{robot="{_label(robot)}",part="{part}"}}'
            lines += [
                f"{TABLE}_history_joules_total{labels} {Decimal(value).scaleb(-6):f} "
                f"{Decimal(stop).scaleb(-9):f}"
                for stop, value in at.items()
            ]
    return ("\n".join([*lines, "# EOF"]) + "\n").encode()


WRITERS: dict[str, Callable[[Wanted], bytes]] = {
    "csv": csv_bytes, "parquet": parquet_bytes, "line": line_bytes, "sql": sql_bytes,
    "openmetrics": metrics_bytes,
}  # fmt: skip


def _rows(
    wanted: Wanted, table: TimeSeries, resolved: int, unknown: Sequence[str]
) -> Iterator[Row]:
    for figures in rows_of(table):
        start, robot, stop = (figures.pop(name) for name in ("stamp_ns", "robot", "stop_ns"))
        if figures.get("priced_microjoule") == 0:
            figures |= dict.fromkeys((name for name in PRICED if name in figures), None)
        if not figures["compared_ns"]:
            figures |= dict.fromkeys(AT_METER, None)
        figures["peak_minute_microjoule"] = figures["peak_minute_microjoule"] or None
        for name in unknown:
            figures.pop(name, None)
        yield {
            "resolution": wanted.resolution, "timezone": wanted.timezone, "robot": robot,
            "start_ns": start, "stop_ns": stop, "resolved": resolved, **figures,
        }  # fmt: skip


def _added(one: Row, other: Row) -> Row:
    """Two spans of one robot and time, as of two models, as one row."""
    figures = {
        name: one[name] + value for name, value in other.items()
        if name not in (*KEY, "resolved", "flags") and None not in (value, one.get(name))
    }  # fmt: skip
    return {**one, **figures, "flags": one["flags"] | other["flags"]}


def _names(found: Sequence[Row]) -> list[str]:
    """Columns of all rows, in order: spans have no costs."""
    return list(dict.fromkeys(name for row in found for name in row)) or list(KEY)


def _plain(name: str, real: Any, whole: Any) -> Any:
    return real if name.endswith("cost") or name == "co2_kg" else whole


def _tag(text: str) -> str:
    if text.endswith("\\") or not text.isprintable():
        raise HistoryError(
            f"the name {text!r} in line protocol",
            "printable characters, and no backslash at the end",
            "use another format, or other robots",
        )
    return "".join(f"\\{one}" if one in ", =" else one for one in text)


def _label(text: str) -> str:
    return text.replace("\\", "\\\\").replace("\n", "\\n").replace('"', '\\"')


def _sql(value: Any) -> str:
    if value is None:
        return "NULL"
    if isinstance(value, str):
        if "\0" in value:
            raise HistoryError("a name with a zero character", "one that PostgreSQL keeps")
        return "'" + value.replace("'", "''") + "'"
    return repr(value)
