"""Rows of the tables: what one span adds to them, and readings as text."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

from robot_energy.foundation.units import MINUTE_NS
from robot_energy.history.differences import SLOT_NS, CountedSpan, Event
from robot_energy.history.readings import COLUMNS, JOINT_COLUMNS, Reading

JOB_COLUMNS = (
    "id", "start", "stop", "name", "observed_ns", "gap_ns", "compared_ns",
    "predicted_import_microjoule", "predicted_return_microjoule", "measured_microjoule",
    "predicted_microjoule_at_meter", "peak_power",
)  # fmt: skip


def _upsert(table: str, key: str, columns: Sequence[str], further: str = "") -> str:
    names = [*key.split(), *columns]
    added = [f"{name} = {name} + excluded.{name}" for name in columns if name not in further]
    if further:
        added += ["flags = flags | excluded.flags",
                  "peak_microjoule = max(peak_microjoule, excluded.peak_microjoule)"]  # fmt: skip
    return (
        f"INSERT INTO {table} ({', '.join(names)}) VALUES ({', '.join('?' * len(names))}) "
        f"ON CONFLICT DO UPDATE SET {', '.join(added)}"
    )


_KEY = "start robot epoch stop"
_FURTHER = ("flags", "peak_microjoule")
SLOT1 = (
    _upsert("slot1", _KEY, (*_FURTHER, *COLUMNS), "flags peak_microjoule")
    + " RETURNING predicted_import_microjoule"
)
SLOT15 = _upsert("slot15", _KEY, (*_FURTHER, *COLUMNS), "flags peak_microjoule")
JOINT15 = _upsert("joint15", f"{_KEY} joint", JOINT_COLUMNS)


def put_span(connection: sqlite3.Connection, robot: int, epoch: int, span: CountedSpan) -> None:
    """Add a span to the minutes, the quarter hours, and the joints of these."""
    start, stop, flags = span.slot(MINUTE_NS)
    row = (start, robot, epoch, stop, flags, 0, *span.values)
    ((minute,),) = connection.execute(SLOT1, row).fetchall()
    peak = minute if stop - start == MINUTE_NS else 0
    start, stop, flags = span.slot(SLOT_NS)
    connection.execute(SLOT15, (start, robot, epoch, stop, flags, peak, *span.values))
    connection.executemany(
        JOINT15,
        ((start, robot, epoch, stop, name, *own) for name, own in span.joints.items() if any(own)),
    )


def put_events(connection: sqlite3.Connection, robot: int, events: Iterable[Event]) -> None:
    """Note events; one that is there already stays."""
    connection.executemany(
        "INSERT OR IGNORE INTO event VALUES (?, ?, ?, ?)",
        ((robot, one.stamp_ns, one.kind, one.text) for one in events),
    )


def reading_from(text: str) -> Reading:
    """Return a reading as it was stored."""
    plain: dict[str, Any] = json.loads(text)
    values, joints = tuple(plain.pop("values")), plain.pop("joints")
    return Reading(**plain, values=values, joints={k: tuple(v) for k, v in joints.items()})


def text_of(reading: Reading) -> str:
    """Return a reading as it is stored."""
    return json.dumps(asdict(reading))
