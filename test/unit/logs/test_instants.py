"""Dates of a zone, dates in other forms, and days of Excel."""

import re
from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

import polars as pl
import pytest

from robot_energy_logs.instants import Instants, time_remedy
from robot_energy_logs.mapping import Time, since_1970

BERLIN = "Europe/Berlin"
MINUTE = 60 * 10**9


def instants(texts, begin=0, reader=None, **keys):
    reader = reader or Instants(Time.model_validate({"column": "t", **keys}))
    lines = range(begin + 2, begin + 2 + len(texts))
    return reader(pl.Series(texts), list(lines), "log.csv"), reader


def local(start, count, minutes, zone=BERLIN):
    """Local times, as a logger writes them, of instants that advance evenly."""
    found = [start + timedelta(minutes=minutes * k) for k in range(count)]
    texts = [each.astimezone(ZoneInfo(zone)).replace(tzinfo=None).isoformat(" ") for each in found]
    return texts, [since_1970(each) for each in found]


@pytest.mark.parametrize("block", [1, 5, 100])
@pytest.mark.parametrize(
    ("start", "zone"),
    [
        (datetime(2026, 10, 24, 23, 40, tzinfo=UTC), BERLIN),
        (datetime(2026, 10, 25, 0, 30, tzinfo=UTC), BERLIN),  # within the first such hour
        (datetime(2026, 11, 1, 5, 10, tzinfo=UTC), "America/New_York"),
        (datetime(2026, 4, 4, 14, 0, tzinfo=UTC), "Australia/Lord_Howe"),  # half an hour
    ],
)
def test_no_hour_is_lost_at_the_end_of_summer_time(start, zone, block):
    texts, expected = local(start, 18, 10, zone)
    found, reader = [], None
    for begin in range(0, len(texts), block):
        part, reader = instants(texts[begin : begin + block], begin, reader, zone=zone)
        found += part
    assert found == expected
    again = 2 + next(k for k in range(1, 18) if texts[k] < texts[k - 1])
    assert f"occurs twice in {zone}" in reader.notes[0]
    assert f"from line {again} of log.csv on" in reader.notes[1]


def test_without_a_zone_utc_is_assumed_and_the_doubled_hour_is_named():
    texts, _ = local(datetime(2026, 10, 24, 23, 40, tzinfo=UTC), 18, 10)
    found, reader = instants(texts)
    assert found[0] == since_1970(datetime(2026, 10, 25, 1, 40, tzinfo=UTC))
    assumed, doubled = reader.notes
    assert "taken as UTC" in assumed
    assert "from 2026-10-25 02:50:00 to 2026-10-25 02:00:00 at line 10 of log.csv" in doubled
    _, reader = instants([f"{text}Z" for text in texts])
    assert reader.notes == []


def test_an_hour_that_the_zone_leaves_out_is_no_time():
    found, _ = instants(["2026-03-29 01:59", "2026-03-29 02:30", "2026-03-29 03:00"], zone=BERLIN)
    assert found[1] is None
    assert found[2] - found[0] == MINUTE


def test_a_row_out_of_order_does_not_begin_the_second_hour():
    texts = [f"2026-10-25 02:{text}" for text in ("00:10", "00:05", "00:11", "59:59")]
    found, reader = instants(texts, zone=BERLIN)
    assert found[2] - found[0] == 10**9
    assert len(reader.notes) == 1


def test_dates_of_parquet_without_zone_are_local():
    naive = pl.Series([datetime(2026, 7, 1, 12), datetime(2026, 12, 1, 12)])
    summer, winter = Instants(Time(column="t", zone=BERLIN))(naive)
    assert summer == since_1970(datetime(2026, 7, 1, 10, tzinfo=UTC))
    assert winter == since_1970(datetime(2026, 12, 1, 11, tzinfo=UTC))


@pytest.mark.parametrize(
    ("cell", "keys"),
    [
        ("01.07.2026 12:00:00.25", {"format": "%d.%m.%Y %H:%M:%S.%f"}),
        ("07/01/2026 12:00:00.25", {"format": "%m/%d/%Y %H:%M:%S.%f"}),
        ("01.07.2026 12:00:00.25+0200", {"format": "%d.%m.%Y %H:%M:%S.%f%z"}),
        ("2026-07-01 12:00:00,25", {}),
        ("2026-07-01T12:00:00.250000000", {}),
        ("46204.50000289352", {"unit": "excel_day"}),
    ],
)
def test_every_form_gives_the_same_instant(cell, keys):
    expected = since_1970(datetime(2026, 7, 1, 10, 0, 0, 250_000, tzinfo=UTC))
    assert abs(instants([cell], zone=BERLIN, **keys)[0][0] - expected) < 1000
    assert instants(["2026-07-01T10:00:00.123456789Z"])[0][0] % 10**9 == 123_456_789


def test_a_time_of_the_day_counts_from_midnight():
    found, _ = instants(["00:01:00.5", "24:00:00"], format="%H:%M:%S.%f", zone=BERLIN)
    assert found == [MINUTE + 500_000_000, None]


def test_a_start_is_of_the_zone():
    times = {"column": "t", "start": "2026-07-01T12:00:00"}
    assert Time(**times).start_ns - Time(**times, zone=BERLIN).start_ns == 120 * MINUTE


@pytest.mark.parametrize(
    ("cell", "instant"),
    [
        ("1782900000", "2026-07-01T10:00:00"),
        ("1782900000000", "2026-07-01T10:00:00"),
        ("1782900000000.5", "2026-07-01T10:00:00"),
        ("1782900000000000", "2026-07-01T10:00:00"),
        ("1782900000000000000", "2026-07-01T10:00:00"),
        ("46204.5", "2026-07-01T12:00:00"),
        ("01.07.2026 12:00:00", "2026-07-01T12:00:00"),
        ("01.07.2026 12:00", "2026-07-01T12:00:00"),
        ("07/31/2026 12:00:00.5", "2026-07-31T12:00:00"),
        ("31/07/2026 12:00:00", "2026-07-31T12:00:00"),
        ("07/31/2026 01:00:00 PM", "2026-07-31T13:00:00"),
        ("2026-7-1 9:05:06", "2026-07-01T09:05:06"),
        ("2026:07:01:12:00:00.5", "2026-07-01T12:00:00"),
        ("09:05:06", "1970-01-01T09:05:06"),
    ],
)
def test_the_remedy_for_a_time_reads_it(cell, instant):
    key, value = re.match(r"set time\.(\w+): '?(.*?)'?(?: in| or|,)", time_remedy(cell)).groups()
    found, _ = instants([cell], **{key: value})
    assert found[0] // 10**9 == since_1970(datetime.fromisoformat(instant)) // 10**9


@pytest.mark.parametrize("cell", ["", "soon", "-1", "nan", "1e9999", "9" * 400, "0", "12:", "\0"])
def test_nothing_is_advised_where_nothing_helps(cell):
    assert time_remedy(cell) == ""
    assert instants([cell])[0][0] in (None, 0, -(10**9))


@pytest.mark.parametrize("name", ["Europe/Belin", "Europe", "../etc/passwd", "/etc/passwd", "\0"])
def test_a_zone_that_does_not_exist_is_refused_with_one_that_does(name):
    with pytest.raises(ValueError, match=r"a time zone such as [A-Z]\w+"):
        Time(column="t", zone=name)
    with pytest.raises(ValueError, match="Europe/Berlin"):
        Time(column="t", zone="Europe/Belin")


def test_a_system_without_time_zones_says_what_to_install(monkeypatch):
    import robot_energy.foundation.time_zone as module

    monkeypatch.setattr(module, "available_timezones", set)
    with pytest.raises(ValueError, match="pip install tzdata"):
        Time(column="t", zone="Europe/Belin")


@pytest.mark.parametrize("form", ["%Q", "no percent", "%", "%Y %Y", "\0\0"])
def test_a_format_that_reads_nothing_is_refused(form):
    with pytest.raises(ValueError, match="format"):
        Time(column="t", format=form)


@pytest.mark.parametrize("unit", ["s", "ms", "ns"])
@pytest.mark.parametrize(
    "cell",
    ["12", "0.000000001", "012.50", "1790000000.123456789", "9" * 18, "9" * 30, "0.0000000001",
     "", None, ".", ".5", "5.", "-5.5", "-0.5", "+5.5", "5.-3", "5.+3", "1e3", "1.5e3", " 5", "5 ",
     "5. 5", "1.2.3", "1_0", "nan", "inf", "0x1f", "\u0665.5", "5.\u0665", "2026-01-01T00:00"],
)  # fmt: skip
def test_plain_numbers_read_at_once_are_those_read_one_by_one(cell, unit):
    reader = Instants(Time.model_validate({"column": "t", "unit": unit}))
    column = pl.Series(["7.25" if unit == "s" else "7", cell, "8"], dtype=pl.String)
    at_once = reader.exact(column)
    assert at_once is None or at_once.tolist() == reader(column)
    plain = unit == "s" and cell in ("12", "0.000000001", "012.50", "1790000000.123456789")
    assert (at_once is not None) or not plain
