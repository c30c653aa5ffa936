"""What is written for other databases is the history, and counts once however often it comes."""

import csv
import io
import json
import re
import shutil
import subprocess
from contextlib import closing
from datetime import date

import polars
import pytest
from prometheus_client.openmetrics.parser import text_string_to_metric_families

import databases
from histories import DAY, HOUR, MINUTE, START, Robot
from places import GRAFANA
from refusals import refused
from robot_energy.foundation.errors import HistoryError
from robot_energy_cli import main
from robot_energy_history.database import open_reader
from robot_energy_history.outputs import (
    COUNTERS,
    Wanted,
    csv_bytes,
    line_bytes,
    metrics_bytes,
    parquet_bytes,
    rows,
    sql_bytes,
)
from robot_energy_history.store import HistoryStore
from robot_energy_history.tariffs import Tariff, add_tariffs

IMPORT = "predicted_import_microjoule"
NAMES = ("a", "cell 1/b,c=d", "o'brien; DROP TABLE robot_energy; --", '\u00fc\U0001f916"\\x')
PROMTOOL = shutil.which("promtool")
needs_postgres = pytest.mark.skipif(
    databases.POSTGRES is None, reason="no PostgreSQL: apt-get install postgresql"
)
needs_influx = pytest.mark.skipif(
    databases.INFLUXD is None, reason="no InfluxDB: apt-get install influxdb"
)
needs_victoria = pytest.mark.skipif(
    databases.VICTORIA is None, reason="no VictoriaMetrics: apt-get install victoria-metrics"
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Names that each format must escape; the recorder was off for hours, and for minutes."""
    folder = tmp_path_factory.mktemp("outputs") / "history"
    store = HistoryStore(folder)
    store.open()
    for number, name in enumerate(NAMES):
        robot = Robot(number)
        store.add(name, [robot.minute() for _ in range(100)])
        assert store.write(robot.now), store.trouble
        robot.advance(2 * HOUR + 7)
        store.add(name, [robot.minute() for _ in range(100)])
        robot.advance(2 * MINUTE)  # within a quarter hour
        store.add(name, [robot.minute()])
        assert store.write(robot.now, newest=True), store.trouble
    store.close()
    add_tariffs(folder, [Tariff(begin=date(2026, 1, 1), price_per_kwh=0.3)], START)
    return folder


@pytest.fixture
def wanted(folder):
    return Wanted(folder, START, START + DAY)


def recorded(folder, column=IMPORT):
    """All that each robot used, from the table itself."""
    with closing(open_reader(folder)) as connection:
        return dict(connection.execute(
            f"SELECT r.name, sum({column}) FROM slot15 s JOIN robot r ON r.id = s.robot GROUP BY 1"
        ))  # fmt: skip


@pytest.mark.parametrize(("resolution", "count"), [("minute", 2), ("quarter", 1), ("hour", 1)])
def test_rows_are_all_of_the_history_and_have_keys_of_their_own(folder, resolution, count):
    found = rows(Wanted(folder, START, START + DAY, resolution))
    keys = {(row["robot"], row["start_ns"], row["stop_ns"]) for row in found}
    assert len(keys) == len(found)
    sums = dict.fromkeys(NAMES, 0)
    for row in found:
        sums[row["robot"]] += row[IMPORT]
    assert sums == recorded(folder)
    spans = [row for row in found if not row["resolved"]]
    assert len(spans) == count * len(NAMES)
    lengths = {round((row["stop_ns"] - row["start_ns"]) / MINUTE) for row in spans}
    assert lengths == ({121, 3} if count == 2 else {121})
    assert all(row.get("cost") is None for row in spans)  # nothing is known of its price


def test_what_is_not_known_is_left_out(tmp_path):
    store, robot = HistoryStore(tmp_path), Robot()
    store.open()
    reading = robot.minute(100)
    robot.values["compared_ns"] = 0
    store.add("a", [robot.read(reading.minute_ns)])
    assert store.write(robot.now), store.trouble
    store.close()
    (row,) = csv.DictReader(io.StringIO(csv_bytes(Wanted(tmp_path, START, START + DAY)).decode()))
    assert row["measured_microjoule"] == ""
    assert row["predicted_return_microjoule"] == "0"
    assert "cost" not in row
    line = line_bytes(Wanted(tmp_path, START, START + DAY)).decode()
    assert "measured" not in line
    assert "None" not in line


def test_what_is_not_over_is_left_out(folder, tmp_path, monkeypatch):
    until = START + 67 * 60 * 10**9
    found = rows(Wanted(folder, START, until))
    assert {row["stop_ns"] for row in found} == {START + n * HOUR // 4 for n in range(1, 5)}
    monkeypatch.setattr("time.time_ns", lambda: until)
    path = tmp_path / "rows.csv"
    words = ["history", "export", str(folder), "--out", str(path), "--start", "2026-01-01"]
    assert main([*words, "--stop", "2026-01-02"]) == 0
    table = list(csv.DictReader(io.StringIO(path.read_text())))
    assert [int(row["stop_ns"]) for row in table] == [row["stop_ns"] for row in found]


def test_csv_and_parquet_hold_the_same(wanted, folder):
    table = list(csv.DictReader(io.StringIO(csv_bytes(wanted).decode())))
    frame = polars.read_parquet(io.BytesIO(parquet_bytes(wanted)))
    assert [int(row[IMPORT]) for row in table] == frame[IMPORT].to_list()
    sums = dict(frame.group_by("robot").agg(polars.col(IMPORT).sum()).iter_rows())
    assert sums == recorded(folder)
    assert frame["cost"].null_count() == len(NAMES)


def test_counters_count_from_the_begin_of_the_history(folder):
    whole = metrics_bytes(Wanted(folder, START, START + DAY, robots=NAMES[:3])).decode()
    later = metrics_bytes(Wanted(folder, START + HOUR, START + DAY, robots=NAMES[:3])).decode()
    assert set(later.splitlines()) <= set(whole.splitlines())
    (family,) = text_string_to_metric_families(whole)
    last = {}
    for sample in family.samples:
        key = sample.labels["robot"], sample.labels["part"]
        assert sample.value >= last.get(key, 0.0)
        last[key] = sample.value
    assert {part for _, part in last} == set(COUNTERS)
    for name, energy in recorded(folder).items():
        if name in NAMES[:3]:
            assert last[name, "predicted_import"] == pytest.approx(energy / 1e6, abs=1e-6)


@pytest.mark.parametrize("name", ["ends in \\", "two\nlines", "n\0l"])
def test_a_name_that_a_format_has_not_is_refused(tmp_path, name):
    store, robot = HistoryStore(tmp_path), Robot()
    store.open()
    store.add(name, [robot.minute()])
    assert store.write(robot.now), store.trouble
    store.close()
    wanted = Wanted(tmp_path, START, START + DAY)
    with refused(HistoryError, "line protocol"):
        line_bytes(wanted)
    if "\0" in name:
        with refused(HistoryError, "zero"):
            sql_bytes(wanted)


@needs_postgres
def test_a_real_postgresql_holds_the_history_once(wanted, folder):
    with databases.postgres() as server:
        server.run(sql_bytes(wanted).rpartition(b"COMMIT;")[0])  # a transfer that breaks off
        assert server.run(b"SELECT to_regclass('robot_energy') IS NULL;") == "t"
        early = Wanted(folder, START, START + HOUR)
        for part in (early, wanted, wanted):
            server.run(sql_bytes(part))
        said = server.run(
            f"SELECT json_object_agg(robot, total) FROM (SELECT robot, sum({IMPORT}) AS total FROM "
            "robot_energy GROUP BY robot) AS sums;".encode()
        )
        assert json.loads(said) == recorded(folder)
        count = server.run(b"SELECT count(*), count(cost), min(begin) FROM robot_energy;")
        found = rows(wanted)
        priced = sum(row.get("cost") is not None for row in found)
        assert count == f"{len(found)}|{priced}|2026-01-01 00:00:00+00"
        days = Wanted(folder, START, START + DAY, "day")
        server.run(sql_bytes(days))  # another resolution is other rows
        sums = server.run(
            f"SELECT sum({IMPORT}) FROM robot_energy GROUP BY resolution;".encode()
        ).split()
        assert sums == [str(sum(recorded(folder).values()))] * 2


@needs_postgres
def test_each_query_of_the_dashboard_is_answered(wanted, folder):
    board = json.loads((GRAFANA / "grafana_history.json").read_text())
    with databases.postgres() as server:
        server.run(sql_bytes(wanted))
        asked = [panel["targets"][0]["rawSql"] for panel in board["panels"]]
        answers = [
            server.run(
                query.replace("$__timeFilter(begin)", "begin >= '2026-01-01'")
                .replace("${robot:sqlstring}", "'a'")
                .encode()
            )
            for query in asked
        ]
        used = recorded(folder)["a"] / 3.6e12
        assert float(answers[0].partition("|")[2]) == pytest.approx(used)
        assert float(answers[3].rpartition("|")[2]) == pytest.approx(used)
        assert all(one.startswith(("a|", "2026-01-01")) for one in answers)
        names = server.run(board["templating"]["list"][1]["query"].encode())
        assert set(names.splitlines()) == set(NAMES)


@needs_postgres
def test_a_changed_price_replaces_the_cost(tmp_path):
    store, robot = HistoryStore(tmp_path), Robot()
    store.open()
    store.add("a", [robot.minute(6000) for _ in range(15)])
    assert store.write(robot.now), store.trouble
    store.close()
    with databases.postgres() as server:
        for price in (None, 0.3, 0.2):
            if price is not None:
                add_tariffs(tmp_path, [Tariff(begin=date(2026, 1, 1), price_per_kwh=price)], START)
            server.run(sql_bytes(Wanted(tmp_path, START, START + DAY)))
        count, cost = server.run(b"SELECT count(*), sum(cost) FROM robot_energy;").split("|")
        assert (count, float(cost)) == ("1", pytest.approx(1.5 * 0.2))


@needs_influx
def test_a_real_influxdb_holds_the_history_once(wanted, folder):
    wanted = Wanted(folder, wanted.start_ns, wanted.stop_ns)
    with databases.influxdb() as server:
        server("query", b"", q="CREATE DATABASE plant")
        lines = line_bytes(wanted).splitlines(keepends=True)
        server("write", b"".join(lines[: len(lines) // 2]), db="plant")  # one that breaks off
        for _ in range(2):
            server("write", line_bytes(wanted), db="plant")
        asked = f"SELECT sum({IMPORT}) FROM robot_energy GROUP BY robot"
        (found,) = json.loads(server("query", db="plant", q=asked))["results"]
        sums = {one["tags"]["robot"]: one["values"][0][1] for one in found["series"]}
        assert sums == recorded(folder)


@needs_victoria
def test_a_real_victoriametrics_holds_the_history_once(wanted, folder):
    with databases.victoria_metrics("-dedup.minScrapeInterval=1ms") as server:
        for _ in range(3):
            server("write", line_bytes(wanted))
            server("internal/force_flush")
        asked = f"sum_over_time(robot_energy_{IMPORT}[2d])"
        when = str((START + DAY) // 10**9)
        found = json.loads(server("api/v1/query", query=f"sum by (robot) ({asked})", time=when))
        sums = {one["metric"]["robot"]: float(one["value"][1]) for one in found["data"]["result"]}
        assert sums == pytest.approx(recorded(folder))


@needs_victoria
def test_counters_in_a_real_victoriametrics_count_once_as_it_is_installed(wanted, folder):
    with databases.victoria_metrics() as server:
        for _ in range(3):
            server("api/v1/import/prometheus", metrics_bytes(wanted))
            server("internal/force_flush")
        for part, column in COUNTERS.items():
            asked = f'increase_pure(robot_energy_history_joules_total{{part="{part}"}}[2d])'
            when = str((START + DAY) // 10**9)
            found = json.loads(server("api/v1/query", query=asked, time=when))["data"]["result"]
            sums = {one["metric"]["robot"]: float(one["value"][1]) for one in found}
            true = {name: energy / 1e6 for name, energy in recorded(folder, column).items()}
            assert sums == pytest.approx(true, abs=1e-6)


@pytest.mark.skipif(PROMTOOL is None, reason="no promtool: apt-get install prometheus")
def test_a_real_prometheus_takes_the_past_twice(wanted, folder, tmp_path):
    path, data = tmp_path / "past.om", tmp_path / "data"
    path.write_bytes(metrics_bytes(wanted))
    for _ in range(2):
        made = subprocess.run(
            [PROMTOOL, "tsdb", "create-blocks-from", "openmetrics", str(path), str(data)],
            capture_output=True, check=False,
        )  # fmt: skip
        assert made.returncode == 0, made.stdout + made.stderr
    (data / "wal").mkdir()  # the tool looks for it
    dumped = subprocess.run(
        [PROMTOOL, "tsdb", "dump", "--match", '{robot="a",part="predicted_import"}', str(data)],
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    values = {tuple(re.findall(r"[\d.e+]+", line)[-2:]) for line in dumped.splitlines()}
    stamps = {stamp for _, stamp in values}
    assert len(stamps) == len(values) > 5  # the same values at the same instants
    assert max(float(value) for value, _ in values) == pytest.approx(recorded(folder)["a"] / 1e6)


def test_the_command_writes_each_kind_and_replaces_only_its_own(folder, tmp_path, capsys):
    days = ["--start", "2026-01-01", "--stop", "2026-01-02"]
    for end in ("csv", "parquet", "lp", "sql", "om"):
        path = tmp_path / f"rows.{end}"
        words = ["history", "export", str(folder), "--out", str(path), *days]
        words += ["--robots", "a"] if end == "lp" else []
        for _ in range(2):
            assert main(words) == 0
        assert path.stat().st_size > 1000
        path.write_bytes(b"notes of someone")
        assert main(words) == 2
        assert path.read_bytes() == b"notes of someone"
    assert "was not written by robot-energy" in capsys.readouterr().err
    for bad in (["--out", "rows.xlsx"], ["--out", "-"], ["--out", "-", "--format", "parquet"],
                ["--out", "r.csv", "--timezone", "Mars/Base"], ["--out", "r.csv", "--start", "May"],
                ["--out", str(tmp_path / "no" / "r.csv")], ["--out", str(folder / "r.csv")],
                ["--out", str(folder / "history.sqlite"), "--format", "csv"]):  # fmt: skip
        assert main(["history", "export", str(folder), *bad]) == 2, bad
    capsys.readouterr()
    assert main(["history", "export", str(folder), "--out", "-", "--format", "csv", *days]) == 0
    assert capsys.readouterr().out == csv_bytes(Wanted(folder, START, START + DAY)).decode()
