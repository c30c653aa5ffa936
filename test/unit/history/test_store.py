"""What the history holds is what the registers counted, whatever happens."""

import random
import shutil
import sqlite3
from contextlib import closing, suppress
from dataclasses import replace
from threading import Thread

import numpy as np
import pytest

import accounts
import histories
import page_messages
from histories import DAY, HOUR, MINUTE, SECOND, START, Robot
from page_messages import JOINTS, encoder_of, zeros
from refusals import refused
from robot_energy.accounting.account import EnergyAccount
from robot_energy.bag.cdr import stamp_columns
from robot_energy.bag.cdr.decode import RawBatch
from robot_energy.foundation.errors import HistoryError
from robot_energy.messages.fields import ENERGY_REGISTERS
from robot_energy.messages.registers import RegistersWriter
from robot_energy_history import database, readings
from robot_energy_history.api import history, history_events, history_friction, history_jobs
from robot_energy_history.check import check, repair
from robot_energy_history.database import open_reader
from robot_energy_history.differences import CLOCK, EARLIER
from robot_energy_history.readings import COLUMNS, LearnedFriction, ReadingDecoder
from robot_energy_history.store import MAX_ROBOTS, HistoryStore

IMPORT = "predicted_import_microjoule"


@pytest.fixture
def store(tmp_path):
    store = HistoryStore(tmp_path / "history")
    store.open()
    yield store
    store.close()


def total(folder, name=IMPORT):
    """All that the history holds, resolved or not."""
    with closing(open_reader(folder)) as connection:
        return connection.execute(f"SELECT sum({name}) FROM slot15").fetchone()[0]


def events(folder):
    with closing(open_reader(folder)) as connection:
        return [row[0] for row in connection.execute("SELECT kind FROM event ORDER BY stamp")]


def write(store, robot, readings, name="a"):
    store.add(name, readings)
    assert store.write(robot.now), store.trouble


def test_each_minute_has_what_was_used_in_it(store):
    robot = Robot()
    write(store, robot, [robot.minute(watt) for watt in (60, 120, 180)])
    found = history(store.folder, START, START + 3 * MINUTE, "minute")
    assert found[IMPORT].tolist() == [60 * w * 10**6 for w in (60, 120, 180)]
    assert (found["observed_ns"] == MINUTE).all()
    quarter = history(store.folder, START, START + 3 * MINUTE, "quarter")
    assert quarter[IMPORT].tolist() == [60 * 360 * 10**6]
    assert quarter["peak_minute_microjoule"].tolist() == [60 * 180 * 10**6]
    joints = history(store.folder, START, START + 3 * MINUTE, "day", by_joint=True)
    assert joints["joint"].tolist() == ["elbow", "shoulder"]
    assert joints["friction_microjoule"].sum() == robot.values["friction_microjoule"]


def test_readings_between_minutes_cost_nothing_and_are_not_rows(store):
    robot = Robot()
    readings = []
    for _ in range(180):
        robot.advance(SECOND)
        readings.append(robot.read(robot.now if robot.now % MINUTE == 0 else 0))
    robot.advance(3 * SECOND)
    readings.append(robot.read())
    write(store, robot, readings)
    assert total(store.folder) == readings[-2].values[COLUMNS.index(IMPORT)]
    store.write(robot.now, newest=True)
    assert total(store.folder) == robot.values[IMPORT]
    with closing(open_reader(store.folder)) as connection:
        assert connection.execute("SELECT count(*) FROM slot1").fetchone() == (4,)


def test_late_and_doubled_readings_add_nothing(store):
    robot = Robot()
    readings = [robot.minute() for _ in range(5)]
    for batch in (readings, readings, readings[2:4], [readings[0]]):
        write(store, robot, batch)
    assert total(store.folder) == robot.values[IMPORT]
    assert check(store.folder) == []


def test_a_week_without_recorder_is_one_span_that_no_day_holds(store):
    robot = Robot()
    write(store, robot, [robot.minute()])
    before = robot.values[IMPORT]
    for _ in range(7 * 24):
        robot.advance(HOUR, 1000)
    write(store, robot, [robot.minute(1000)])
    days = history(store.folder, START, START + 8 * DAY, "day")
    assert days[IMPORT].tolist() == [before]
    (span,) = days.not_resolved.to_polars().iter_rows(named=True)
    assert span[IMPORT] == robot.values[IMPORT] - before
    assert days.not_resolved.stamp_ns[0] == START + MINUTE
    assert span["stop_ns"] == START + 2 * MINUTE + 7 * DAY
    month = history(store.folder, START, START + 8 * DAY, "month")
    assert month[IMPORT].tolist() == [robot.values[IMPORT]]  # within it, the span is resolved
    assert len(month.not_resolved) == 0


def test_a_gap_carries_no_energy_and_none_is_spread_over_it(store):
    robot = Robot()
    robot.advance(30 * SECOND, 100)
    readings = [robot.read(START + 3 * HOUR)]
    robot.rest(3 * HOUR - 20 * SECOND)
    readings.append(robot.minute(100))
    write(store, robot, readings)
    found = history(store.folder, START, START + 4 * HOUR, "minute")
    assert found.stamp_ns.tolist() == [START, START + 3 * HOUR]
    assert found[IMPORT].tolist() == [30 * 100 * 10**6, 50 * 100 * 10**6]
    assert len(history(store.folder, START, START + 4 * HOUR, "quarter").not_resolved) == 0


def test_a_reset_a_model_and_a_meter_begin_again_and_lose_nothing(store):
    robot, used = Robot(), 0
    readings = [robot.minute()]
    for change in ("reset", "model", "meter", "reset"):
        robot.advance(20 * SECOND)
        readings.append(robot.read())
        if change == "reset":
            used += robot.values[IMPORT]
            robot.reset()
        elif change == "model":
            robot.model = "m2"
        else:
            robot.meter = 2
        readings.append(robot.minute())
    write(store, robot, readings)
    assert total(store.folder) == used + robot.values[IMPORT]
    assert check(store.folder) == []
    assert [kind for kind in events(store.folder) if kind != "first"] == [
        *("reset", "model", "meter", "reset"),
    ]
    days = history(store.folder, START, START + DAY)
    assert days[IMPORT].tolist() == [used + robot.values[IMPORT]]


@pytest.mark.parametrize("by", [-2 * HOUR, 3 * HOUR])
def test_a_clock_that_is_set_merges_into_the_slots_and_is_an_event(store, by):
    robot = Robot()
    readings = [robot.minute(100) for _ in range(200)]
    robot.step_clock(by)
    readings += [robot.minute(100) for _ in range(10)]
    write(store, robot, readings)
    assert total(store.folder) == 210 * 60 * 100 * 10**6 == robot.values[IMPORT]
    assert "clock" in events(store.folder)
    day = history(store.folder, START, START + DAY, "day")
    assert day["flags"][0] & CLOCK
    assert day[IMPORT].tolist() == [robot.values[IMPORT]]
    assert check(store.folder) == []


def test_registers_that_go_back_are_not_counted_twice(store):
    robot = Robot()
    write(store, robot, [robot.minute() for _ in range(10)])
    kept = robot.values.copy(), {name: [*own] for name, own in robot.joints.items()}
    write(store, robot, [robot.minute() for _ in range(10)])
    held = robot.values[IMPORT]
    robot.values, robot.joints = kept  # an older state file
    write(store, robot, [robot.minute() for _ in range(2)])
    again = robot.values[IMPORT]  # the first that is believed, after the second of two
    write(store, robot, [robot.minute() for _ in range(30)])
    assert total(store.folder) == held + robot.values[IMPORT] - again
    assert "went_back" in events(store.folder)
    assert check(store.folder) == []


def test_a_single_late_reading_with_a_new_stamp_does_not_begin_again(store):
    robot = Robot()
    first = robot.minute()
    write(store, robot, [first, *(robot.minute() for _ in range(9))])
    write(store, robot, [replace(first, stamp_ns=robot.now + HOUR), robot.minute(), robot.minute()])
    assert total(store.folder) == robot.values[IMPORT]
    assert "went_back" not in events(store.folder)


def test_what_was_counted_before_the_first_reading_is_said(store):
    robot = Robot()
    for _ in range(48):
        robot.advance(HOUR)
    robot.minute()
    write(store, robot, [robot.read(robot.now)])
    found = history(store.folder, START, robot.now, "all")
    assert found["flags"][0] & EARLIER
    assert found[IMPORT].tolist() == [robot.values[IMPORT]]
    days = history(store.folder, START, robot.now, "day")
    assert len(days) == 0
    assert days.not_resolved["flags"][0] & EARLIER


def test_a_second_recorder_is_refused_and_readers_are_not(store):
    robot = Robot()
    write(store, robot, [robot.minute()])
    other = HistoryStore(store.folder)
    with refused(HistoryError, found="writes the history", expected="one writer"):
        other.open()
    assert total(store.folder) == robot.values[IMPORT]


def test_a_recorder_that_is_killed_goes_on_from_what_is_on_disk(tmp_path):
    robot = Robot()
    for _ in range(20):
        store = HistoryStore(tmp_path)
        store.open()
        readings = [robot.minute() for _ in range(3)]
        write(store, robot, readings[:2])
        store.add("a", readings[2:])  # not written any more
        store.close()  # as the kernel would: nothing is written
    assert check(tmp_path) == []
    store = HistoryStore(tmp_path)
    store.open()
    store.add("a", [robot.read()])
    assert store.write(robot.now, newest=True)
    store.close()
    assert total(tmp_path) == robot.values[IMPORT]


def test_a_full_disk_leaves_all_waiting_and_bounded(store, monkeypatch):
    robot = Robot()
    write(store, robot, [robot.minute()])
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("", (), {"free": -1})())
    for _ in range(500):
        store.add("a", [robot.minute()])
    assert not store.write(robot.now)
    assert "free space" in store.trouble
    assert store.waiting <= 120
    assert store.dropped > 0
    monkeypatch.undo()
    assert store.write(robot.now)
    assert not store.trouble
    assert total(store.folder) == robot.values[IMPORT]


def test_what_ends_the_making_of_the_tables_is_said(tmp_path, monkeypatch):
    """A full disk ends the transaction by itself: a failed rollback is not the cause."""
    monkeypatch.setattr(database, "TABLES", "COMMIT;SELECT full")
    store = HistoryStore(tmp_path / "h")
    assert not store.write(0)
    assert "no such column: full" in store.trouble


def test_readings_that_come_while_the_disk_is_at_work_are_written_after_it(store, monkeypatch):
    """They come in the middle of the first transaction, from another thread."""
    robot = Robot()
    first, during = [robot.minute() for _ in range(3)], [robot.minute() for _ in range(3)]
    real, calls = shutil.disk_usage, []

    def disk_usage(path):
        if not calls:
            thread = Thread(target=store.add, args=("a", during))
            thread.start()
            thread.join()
        calls.append(store.waiting)
        return real(path)

    monkeypatch.setattr(shutil, "disk_usage", disk_usage)
    write(store, robot, first)
    assert total(store.folder) == first[-1].values[COLUMNS.index(IMPORT)]
    assert store.waiting == 3
    write(store, robot, [])
    assert total(store.folder) == robot.values[IMPORT]
    assert calls == [6, 3]
    with closing(open_reader(store.folder)) as connection:
        assert connection.execute("SELECT count(*) FROM slot1").fetchone() == (6,)


def test_an_error_of_the_disk_in_a_transaction_takes_all_of_it_back(store):
    robot = Robot()
    write(store, robot, [robot.minute()])
    held = robot.values[IMPORT]
    store._connection.execute("PRAGMA max_page_count = 1")
    readings = [robot.minute() for _ in range(3000)]
    for place in range(0, len(readings), 100):
        store.add("a", readings[place : place + 100])
        if not store.write(robot.now):
            break
    assert "full" in store.trouble
    assert held <= total(store.folder) < robot.values[IMPORT]
    assert check(store.folder) == []
    store.add("a", readings)
    assert store.write(robot.now)  # opened again, without the limit
    assert total(store.folder) == robot.values[IMPORT]


def test_minutes_are_dropped_in_time_and_quarters_stay(tmp_path):
    store, robot = HistoryStore(tmp_path, keep_days=1.0), Robot()
    store.open()
    write(store, robot, [robot.minute() for _ in range(30)])
    store.write(robot.now + 2 * DAY)
    store.close()
    with closing(open_reader(tmp_path)) as connection:
        assert connection.execute("SELECT count(*) FROM slot1").fetchone() == (0,)
    assert total(tmp_path) == robot.values[IMPORT]


def test_robots_are_bounded(store):
    robot = Robot()
    reading = robot.minute()
    for number in range(MAX_ROBOTS):
        store.add(f"r{number}", [reading])
    with refused(HistoryError, expected=str(MAX_ROBOTS)):
        store.add("one more", [reading])
    store.add("r0", [reading])


def test_a_damaged_sum_is_found_and_repaired(store):
    robot = Robot()
    write(store, robot, [robot.minute() for _ in range(40)])
    folder = store.folder
    store._connection.execute("UPDATE slot15 SET brake_microjoule = 7 WHERE start = ?", (START,))
    store._connection.execute("DELETE FROM joint15 WHERE joint = 'elbow' AND start = ?", (START,))
    store.close()
    (said,) = check(folder)
    assert "brake_microjoule -7" in said
    assert "elbow" in said
    assert len(repair(folder, robot.now)) == 1
    assert check(folder) == []
    assert "repair" in events(folder)
    assert repair(folder, robot.now) == []


def test_a_damaged_file_keeps_what_can_be_read(store):
    robot = Robot()
    for _ in range(40):
        write(store, robot, [robot.minute() for _ in range(60)])
    folder, path = store.folder, store.folder / database.FILE
    store.close()
    content = bytearray(path.read_bytes())
    middle = len(content) // 2 // 4096 * 4096
    content[middle : middle + 4096] = b"\xff" * 4096
    path.write_bytes(content)
    assert check(folder)
    said = repair(folder, robot.now)
    assert "damaged" in said[0]
    assert check(folder) == []
    assert total(folder) == robot.values[IMPORT]
    assert path.with_name(f"{path.name}.bad-1").read_bytes() == content


def test_damaged_pages_cost_their_rows_alone_and_no_hour(tmp_path):
    robots, store = {f"r{number}": Robot(number) for number in range(8)}, HistoryStore(tmp_path)
    store.open()
    for quarter in range(20 * 96):
        for name, robot in robots.items():
            robot.advance(15 * MINUTE)
            store.add(name, [robot.read(robot.now)])
        if quarter % 8 == 7:  # so that robots lie next to each other in the file
            assert store.write(robot.now), store.trouble
    store.close()
    path = tmp_path / database.FILE
    count = "SELECT count(*) FROM slot15"
    with closing(sqlite3.connect(path)) as connection:
        (before,) = connection.execute(count).fetchone()
    content = bytearray(path.read_bytes())
    middle = len(content) // 2 // 4096 * 4096
    content[middle : middle + 3 * 4096] = b"\xff" * 3 * 4096
    path.write_bytes(content)
    assert "damaged" in repair(tmp_path, robot.now)[0]
    assert check(tmp_path) == []
    with closing(sqlite3.connect(path)) as connection:
        (kept,) = connection.execute(count).fetchone()
    assert 0.98 * before < kept < before
    days = history(tmp_path, START, START + 19 * DAY)
    assert len(days) == 19 * len(robots)
    assert not len(days.not_resolved)
    assert total(tmp_path) == sum(robot.values[IMPORT] for robot in robots.values())


@pytest.mark.parametrize(
    "changed",
    [{IMPORT: 2**63 - 1}, {IMPORT: -(2**63)}, {"observed_ns": 2**63 - 1, "gap_ns": 2**63 - 1},
     {"friction_microjoule": 2**70}, {"standby_microjoule": 2**60}],
)  # fmt: skip
def test_nonsense_of_one_robot_is_refused_and_stops_no_other(store, changed):
    robots = {"a": Robot(1), "b": Robot(2)}
    for minute in range(4):
        for name, robot in robots.items():
            reading = robot.minute()
            if name == "a" and minute in (1, 2):
                values = dict(zip(COLUMNS, reading.values, strict=True)) | changed
                reading = replace(reading, values=tuple(values.values()))
            store.add(name, [reading])
        assert store.write(robot.now), store.trouble
    assert store.refused == 2
    assert not store.waiting
    assert check(store.folder) == []
    assert total(store.folder) == sum(robot.values[IMPORT] for robot in robots.values())


def test_jobs_that_no_table_holds_are_refused_and_stop_no_other(store):
    robot = Robot()
    job = dict.fromkeys(database.JOB_COLUMNS, 1) | {
        "name": "weld",
        "start": START,
        "stop": START + 1,
    }
    for number, wrong in enumerate(
        ({}, {"observed_ns": 2**80}, {"name": "\ud800"}, {"id": -(2**64)})
    ):
        store.add_jobs("a", [job | {"id": number} | wrong])
    write(store, robot, [robot.minute()], "b")
    assert store.refused == 3
    assert len(history_jobs(store.folder, START, START + DAY)) == 1
    assert total(store.folder) == robot.values[IMPORT]


def test_a_fault_of_the_program_costs_no_reading(store, monkeypatch):
    robot = Robot()
    with monkeypatch.context() as patch:
        patch.setattr(HistoryStore, "_record", lambda *_: {}["no such key"])
        store.add("a", [robot.minute()])
        with pytest.raises(KeyError):
            store.write(robot.now)
        assert store.waiting == 1
    assert store.write(robot.now), store.trouble
    assert total(store.folder) == robot.values[IMPORT]


def test_messages_without_a_stamp_or_with_a_negative_count_are_malformed():
    given = drawn_messages(0, 4)
    encoder = encoder_of(ENERGY_REGISTERS, JOINTS)
    good = {"band": np.uint8(0), "meter_location": np.uint8(0), "gap_count": np.uint64(0),
            "persisted": True, **stamp_columns(np.full(6, START)),
            **stamp_columns(np.full(6, START), "energy_start"),
            **stamp_columns(np.zeros(6, np.int64), "minute"),
            "observed_ns": np.array([1, -1, 2**62, 1, 1, 1])}  # fmt: skip
    columns = zeros(encoder, 6) | good
    columns["header.stamp.sec"] = np.array([1, 1, 1, -5, 0, 1], dtype=np.int32)
    columns["energy_start.nanosec"] = np.array([0, 0, 0, 0, 0, 2**31], dtype=np.uint32)
    decoder = ReadingDecoder()
    found = decoder.decode(page_messages.batch(ENERGY_REGISTERS, encoder.encode(columns, 6)))
    assert [one.stamp_ns for one in found] == [SECOND]
    assert decoder.malformed == 5
    assert decoder.decode(given)


def test_whatever_is_damaged_is_an_error_in_one_sentence(store, tmp_path):
    robot = Robot()
    for _ in range(20):
        write(store, robot, [robot.minute() for _ in range(60)])
    store.close()
    content = (store.folder / database.FILE).read_bytes()
    at = content.index(b"CREATE TABLE slot1 ")
    draw, refused_once = random.Random(5), 0
    for number in range(12):
        damaged = bytearray(content)
        for _ in range(60):
            damaged[draw.randrange(4096, len(content))] = draw.randrange(256)
        if number == 0:
            damaged[at + 30] = 0xA1
        folder = tmp_path / f"damaged{number}"
        folder.mkdir()
        (folder / database.FILE).write_bytes(damaged)
        for ask in (history, history_jobs, history_friction, history_events):
            try:
                ask(folder, START, START + DAY, timezone="Asia/Kathmandu")
            except HistoryError:
                refused_once += 1
        with suppress(HistoryError):
            check(folder)
        assert isinstance(repair(folder, robot.now), list)
    assert refused_once > 4


def test_a_table_whose_columns_are_damaged_is_written_again(store):
    robot = Robot()
    write(store, robot, [robot.minute() for _ in range(60)])
    folder, path = store.folder, store.folder / database.FILE
    store.close()
    content = path.read_bytes()
    at = content.index(b"rigid_microjoule", content.index(b"CREATE TABLE joint15"))
    path.write_bytes(content[:at] + b"x" + content[at + 1 :])
    assert "damaged" in repair(folder, robot.now)[0]
    assert check(folder) == []
    assert total(folder) == robot.values[IMPORT]


@pytest.mark.parametrize("version", [2, 4])
def test_a_history_of_another_version_is_refused_and_left_as_it_is(store, version):
    robot = Robot()
    write(store, robot, [robot.minute()])
    path = store.folder / database.FILE
    store._connection.execute(f"PRAGMA user_version = {version}")
    store.close()
    content = path.read_bytes()
    for use in (lambda: repair(store.folder, robot.now), lambda: open_reader(store.folder),
                lambda: HistoryStore(store.folder).open()):  # fmt: skip
        with refused(HistoryError, found=f"version {version}", expected="version 3"):
            use()
    assert path.read_bytes() == content


def test_jobs_are_the_same_however_often_they_come(store):
    robot = Robot()
    job = {"id": 3, "start": START, "stop": START + MINUTE, "name": "weld", "observed_ns": MINUTE,
           "gap_ns": 0, "compared_ns": 0, "predicted_return_microjoule": 0,
           "measured_microjoule": 0, "predicted_microjoule_at_meter": 0, "peak_power": None,
           IMPORT: 5}  # fmt: skip
    for _ in range(3):
        store.add_jobs("a", [job])
        write(store, robot, [])
    with closing(open_reader(store.folder)) as connection:
        rows = connection.execute(f"SELECT id, name, {IMPORT} FROM job").fetchall()
    assert rows == [(3, "weld", 5)]


def test_learned_friction_is_kept_by_day_and_model(store):
    def learned(stamp, ratio, model="m1"):
        return LearnedFriction(stamp, model, {"elbow": ratio, "wrist": 1.0})

    store.add_friction("a", [learned(START + hour * HOUR, 1 + hour / 100) for hour in range(48)])
    store.add_friction("a", [learned(START + 2 * DAY, 2.0, "m2"), learned(START + 40 * DAY, 1.9)])
    write(store, Robot(), [])
    store.add_friction("a", [learned(START + HOUR, 9.0)])  # late: the newest of a day stays
    write(store, Robot(), [])
    found = history_friction(store.folder, START, START + 59 * DAY)
    own = found["joint"] == "elbow"
    assert found["model_id"][own].tolist() == ["m1", "m2", "m1"]
    assert found["days"][own].tolist() == [2, 1, 1]
    assert found["ratio"][own] == pytest.approx([(1.23 + 1.47) / 2, 2.0, 1.9])
    assert found["greatest"][own] == pytest.approx([1.47, 2.0, 1.9])
    days = history_friction(store.folder, START, START + 2 * DAY, "day", timezone="Europe/Berlin")
    assert days["ratio"][days["joint"] == "elbow"] == pytest.approx([1.23, 1.47, 2.0])
    with refused(HistoryError, found="no robot 'b'"):
        history_friction(store.folder, START, START + DAY, robots=["b"])


def test_messages_of_an_account_are_its_history_to_the_microjoule(store):
    account, writer = EnergyAccount(2), RegistersWriter(accounts.NAMES, "m1")
    rows = []
    account.on_reading = lambda minute: rows.append(writer.encode(account, True, minute)[0])
    for start in range(30, 400, 5):
        stamp = np.rint(np.arange(start, start + 5, 0.01) * 1e9).astype(np.int64)
        account.step(accounts.power_block(stamp, 300.0 + 400 * np.sin(stamp / 3e9)))
        rows.append(writer.encode(account)[0])
    messages = [row.tobytes() for row in rows]
    batch = RawBatch.from_messages(
        "energy/registers", "ros2_energy_msgs/msg/EnergyRegisters", [0] * len(rows), messages
    )
    store.add("a", ReadingDecoder().decode(batch))
    assert store.write(500 * SECOND, newest=True)
    totals = account.totals()
    assert total(store.folder) == totals.cabinet_energy_microjoule["grid_import"]
    assert total(store.folder, "brake_microjoule") == totals.cabinet_energy_microjoule["brake"]
    assert total(store.folder, "observed_ns") == totals.observed_ns
    assert check(store.folder) == []
    minutes = history(store.folder, 0, 400 * SECOND, "minute")
    assert minutes.stamp_ns.tolist() == [MINUTE * n for n in range(7)]
    assert (minutes["observed_ns"][1:6] == MINUTE).all()


def test_files_are_readable_by_nobody_else(tmp_path):
    store = HistoryStore(tmp_path / "new")
    store.open()
    store.write(START)
    assert (tmp_path / "new").stat().st_mode & 0o077 == 0
    for path in (tmp_path / "new").glob("history.*"):  # who can read the lock can hold it
        assert path.stat().st_mode & 0o077 == 0, path
    store.close()


def test_histories_have_the_columns_of_the_readings():
    assert len(Robot().read().values) == len(COLUMNS)
    assert histories.JOINTS == accounts.NAMES


def drawn_messages(seed, count=400):
    """A course of seconds with resets, clocks that are set, late and doubled messages; a batch."""
    draw, robot, rows = random.Random(seed), Robot(seed), []
    for _ in range(count):
        match draw.random():
            case x if x < 0.01:
                robot.reset()
            case x if x < 0.02:
                robot.step_clock(draw.choice((-1, 1)) * draw.randint(1, 3 * MINUTE))
            case x if x < 0.03:
                robot.meter = draw.choice((0, 1, 2))
            case x if x < 0.05:
                robot.rest(SECOND)
        robot.advance(SECOND)
        rows.append(robot.read(robot.now if robot.now % MINUTE == 0 else 0))
        if draw.random() < 0.02:
            rows += rows[-draw.randint(1, 5) :]
    encoder = encoder_of(ENERGY_REGISTERS, JOINTS)
    columns = zeros(encoder, len(rows)) | {
        name: np.array([row.values[COLUMNS.index(name)] for row in rows])
        for name in ("observed_ns", "gap_ns", IMPORT)
    }
    for prefix, field in (("header.stamp", "stamp_ns"), ("energy_start", "energy_start_ns"),
                          ("minute", "minute_ns")):  # fmt: skip
        columns |= stamp_columns(np.array([getattr(row, field) for row in rows]), prefix)
    meters = np.array([row.meter_location for row in rows], dtype=np.uint8)
    columns |= {"meter_location": meters, "band": np.uint8(0), "gap_count": np.uint64(0)}
    columns["persisted"] = True
    return page_messages.batch(ENERGY_REGISTERS, encoder.encode(columns, len(rows)))


def test_readings_in_between_are_left_out_where_the_next_takes_their_place(tmp_path, monkeypatch):
    for seed in range(8):
        given, held = drawn_messages(seed), []
        for name in ("thinned", "whole"):
            with monkeypatch.context() as patch:
                if name == "whole":
                    patch.setattr(readings, "_kept", lambda run, *_: np.full(len(run.rows), True))
                found = ReadingDecoder().decode(given)
            assert len(found) < 0.2 * len(given) if name == "thinned" else len(found) == len(given)
            store = HistoryStore(tmp_path / f"{name}{seed}")
            store.open()
            for one in found:  # one by one, as they arrive
                store.add("a", [one])
            assert store.write(START + DAY, newest=True)
            store.close()
            with closing(open_reader(store.folder)) as connection:
                held.append(
                    [
                        connection.execute(f"SELECT {what} ORDER BY 1, 2").fetchall()
                        for what in (
                            f"start, stop, flags, {IMPORT}, gap_ns FROM slot1",
                            f"start, stop, flags, {IMPORT}, gap_ns FROM slot15",
                            "stamp, kind, text FROM event",
                        )
                    ]
                )
        assert held[0] == held[1], seed
