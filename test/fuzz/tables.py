"""Tables of logs in all forms: read, with every row accounted for, or refused with a sentence."""

from __future__ import annotations

import gzip
from datetime import UTC, date, datetime, time, timedelta
from pathlib import Path
from unittest import mock

import bags
import polars as pl
from target import done, in_file, scratch

from robot_energy_logs.log_import import import_log
from robot_energy_logs.mapping import LogMapping
from robot_energy_logs.recording import MIN_ROWS
from robot_energy_logs.table import PARQUET, LogTable

OPTIONS: tuple[dict[str, object], ...] = (
    {},
    {"decimal": ","},
    {"delimiter": ";"},
    {"encoding": "cp1252"},
    {"encoding": "utf-16"},
    {"comment": "%"},
    {"skip_rows": 1},
    {"column_names": ["t", "q1", "q2", "v1", "v2", "p"]},
)
TIMES: tuple[dict[str, object], ...] = (
    {"start": "2024-01-01T00:00:00"},
    {},
    {"zone": "Europe/Berlin"},
    {"unit": "excel_day", "zone": "Europe/Berlin"},
    {"unit": "ns"},
    {"format": "%d.%m.%Y %H:%M:%S.%f", "zone": "Europe/Berlin"},
    {"format": "%H:%M:%S.%f"},
    {"each_file_is_a_run": True, "start": "2024-01-01T00:00:00"},
    {"run": "v1", "start": "2024-01-01T00:00:00"},
)
COLUMNS = ("t", "q1", "q2", "v1", "v2", "p")
CELLS = ["1", "-1.5e3", "", "x", "nan", "1,5", "2026-10-25 02:30:00", "\0", "1e400", "-", "\ud7ff"]
KINDS = (  # of columns, from eight numbers
    lambda n: pl.Series(n, dtype=pl.Int64),
    lambda n: pl.Series([CELLS[k % len(CELLS)] for k in n]),
    lambda n: pl.Series([CELLS[k % len(CELLS)] for k in n]).cast(pl.Categorical),
    lambda n: pl.Series([CELLS[k % len(CELLS)] for k in n], dtype=pl.Enum(CELLS)),
    lambda n: pl.Series([float(k) if k % 7 else None for k in n], dtype=pl.Float64),
    lambda n: pl.Series([(0.1, float("nan"), float("inf"), -1e300)[k % 4] for k in n]),
    lambda n: pl.Series([2**64 - 1 - k for k in n], dtype=pl.UInt64),
    lambda n: pl.Series([(k - 128) * 2**110 for k in n], dtype=pl.Int128),
    lambda n: pl.Series(n).cast(pl.Decimal(38, 4)),
    lambda n: pl.Series([k % 2 == 0 for k in n]),
    lambda n: pl.Series([None] * len(n), dtype=pl.Null),
    lambda n: pl.Series([datetime(2026, 10, 25, k % 24, k % 60) for k in n]),
    lambda n: pl.Series([datetime(1 + 38 * k, 1, 1, tzinfo=UTC) for k in n]),
    lambda n: pl.Series(n).cast(pl.Int64).cast(pl.Datetime("ns", "Europe/Berlin")),
    lambda n: pl.Series([(k - 128) * 2**55 for k in n], dtype=pl.Int64).cast(pl.Duration("ms")),
    lambda n: pl.Series([timedelta(seconds=k) for k in n]),
    lambda n: pl.Series([date(2026, 1, 1 + k % 28) for k in n]),
    lambda n: pl.Series([time(k % 24) for k in n]),
    lambda n: pl.Series([bytes([k]) for k in n]),
    lambda n: pl.Series([[k] for k in n]),
    lambda n: pl.Series([{"a": k} for k in n]),
)
NO_NUMBERS = (pl.Boolean, pl.Datetime, pl.Duration, pl.Date, pl.Time, pl.Binary)
ROWS = 8


def _read(path: Path, mapping: LogMapping) -> None:
    report = import_log(path, mapping, scratch() / "out", overwrite=True)
    assert all(account.balanced for account in report.files)
    assert report.joint_states >= MIN_ROWS
    assert report.start_ns is not None
    assert report.end_ns is not None
    assert report.end_ns > report.start_ns


def _mapping(option: int, kind: int) -> LogMapping:
    data = {**bags.MAPPING, **OPTIONS[option % len(OPTIONS)]}
    return LogMapping.model_validate({**data, "time": {"column": "t", **TIMES[kind % len(TIMES)]}})


def table_text(data: bytes) -> bool:
    """A text by a mapping that the first two bytes choose."""
    option, kind = (*data[:2], 0, 0)[:2]
    log = in_file("log.csv", data[2:])
    return done(lambda: _read(log, _mapping(option, kind)))


def text_seeds() -> list[bytes]:
    """A log in each form that a mapping has words for."""
    rows = [f"{k},1,2,3,4,50" for k in range(3)]
    plain = "\n".join([",".join(COLUMNS), *rows, ""])
    quoted = '"t","q1",q2,v1,v2,p,"a ""b"""\r\n"0",1,2,3,4,50,"x\ny"\n1,1,2,3,4,50,\n2,1,2,3,4,50,z'
    dates = plain
    for k in range(3):
        dates = dates.replace(f"\n{k},", f"\n2026-10-25 02:0{k}:00,")
    german = plain.replace(",", ";").replace("50", "50,5")
    return [
        b"\0\0" + plain.encode(),
        b"\0\0" + gzip.compress(plain.encode(), mtime=0),
        b"\0\0" + f"# a\n{plain}# b\n{plain}".encode(),
        b"\0\0" + quoted.encode(),
        b"\1\0" + german.encode(),
        b"\2\0" + german.replace("50,5", "50").encode(),
        b"\3\0" + plain.replace("p\n", "p,\N{DEGREE SIGN}\n").replace("50", "50,").encode("cp1252"),
        b"\0\0" + plain.encode("utf-16"),
        b"\5\0" + f"% a\n{plain}".encode(),
        b"\6\0" + f"x\n{plain}".encode(),
        b"\7\7" + "\n".join(rows).encode(),
        b"\0\2" + dates.encode(),
        b"\0\3" + plain.replace("\n", "\n4620").encode(),
        b"\0\5" + dates.replace("2026-10-25", "25.10.2026").replace(":00,", ":00.5,").encode(),
    ]


def table_types(data: bytes) -> bool:
    """A table of typed columns, as Parquet has them; without the file, so that it takes 1 ms."""
    numbers = [*data, *range(3)] * (ROWS * len(COLUMNS))
    option, *kinds = numbers[: 1 + len(COLUMNS)]
    table = {}
    for place, (name, kind) in enumerate(zip(COLUMNS, kinds, strict=True)):
        begin = 1 + len(COLUMNS) + place * ROWS
        table[name] = KINDS[kind % len(KINDS)](numbers[begin : begin + ROWS])
    frame = pl.DataFrame(table)

    def unpacked(self: LogTable) -> pl.DataFrame:
        self._frame = frame
        return frame

    log = in_file("log.parquet", PARQUET)
    with mock.patch.object(LogTable, "_unpack", unpacked):
        taken = done(lambda: _read(log, _mapping(0, option)))
    types = [frame[name].dtype for name in COLUMNS[1:]]
    assert not (taken and any(kind in NO_NUMBERS or kind.is_nested() for kind in types)), types
    return taken


def types_seeds() -> list[bytes]:
    """Numbers with text, categories and decimals, at rising times."""
    rising = bytes(range(1, ROWS + 1))
    return [
        bytes([0, 0, kind, 0, 4, 8, 0]) + rising + bytes([1] * 2 * ROWS) + rising * 3
        for kind in (0, 4, 8)
    ] + [bytes([2, 11, 0, 0, 0, 0, 3]) + rising * 6]
