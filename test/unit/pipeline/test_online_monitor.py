"""One's own loop gives the figures of a replay, however the samples are cut."""

import pickle
from contextlib import closing
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import robot_energy as re
from robot_energy.bag import BagReader
from robot_energy.bag.cdr.decode import Decoder, RawBatch, stamp_ns
from robot_energy.foundation.units import MINUTE_NS
from robot_energy_fleet.bag_row import reading_of
from robot_energy_history.check import check
from robot_energy_history.database import open_reader
from robot_energy_history.readings import COLUMNS, JOINT_COLUMNS
from robot_energy_history.store import HistoryStore

BAG = Path(__file__).resolve().parents[3] / "bags/kr16_warm"
STAMP = ("header.stamp.sec", "header.stamp.nanosec")
START = 1_700_000_000_000_000_000


def column(bag, topic, *fields):
    """Stamps and columns of a topic."""
    decoder = Decoder(bag.topics[topic].msgtype, (*STAMP, *fields), bag.typestore)
    runs = []
    for part in bag.parts([topic]):
        batch = part[topic]
        assert isinstance(batch, RawBatch)
        runs += decoder.decode(batch).runs
    return [
        np.concatenate([stamp_ns(run) for run in runs]),
        *(np.concatenate([run.array(field) for run in runs]) for field in fields),
    ]


@pytest.fixture(scope="module")
def recorded():
    bag = BagReader(BAG)
    return (
        column(bag, "/joint_states", "position", "velocity", "effort"),
        column(bag, "/motor_temperatures", "temperature_degc"),
        column(bag, "/power_meter", "power", "interval"),
    )


def run(recorded, sizes, read=None):
    """Push all that was recorded up to each moment, in pieces of the sizes given."""
    joints, temperatures, meter = recorded
    monitor = re.OnlineMonitor("kr16", effort="motor_torque")
    if read is not None:
        monitor.account.on_reading = partial(read, monitor.account)
    tables, start, turn, done = [], 0, 0, [0, 0]
    while start < len(joints[0]):
        end = min(start + sizes[turn % len(sizes)], len(joints[0]))
        now = joints[0][end - 1]
        for index, (stamp, push) in enumerate(
            ((temperatures[0], monitor.push_temperatures), (meter[0], monitor.push_meter))
        ):
            last = int(np.searchsorted(stamp, now, side="right"))
            rows = slice(done[index], last)
            if last > done[index] and index == 0:
                push(stamp[rows], temperatures[1][rows])
            elif last > done[index]:
                push(stamp[rows], meter[1][rows], interval=meter[2][rows])
            done[index] = last
        rows = slice(start, end)
        tables.append(
            monitor.push(joints[0][rows], joints[1][rows], joints[2][rows], joints[3][rows])
        )
        start, turn = end, turn + 1
    monitor.push_meter(meter[0][done[1] :], meter[1][done[1] :], interval=meter[2][done[1] :])
    tables.append(monitor.flush())
    return monitor, tables


@pytest.mark.parametrize("sizes", [(1000,), (1, 7, 40, 3, 250), (100_000,)])
def test_the_loop_gives_the_registers_of_the_replay_to_the_bit(recorded, sizes):
    monitor, tables = run(recorded, sizes)
    expected = re.replay(BAG, "kr16", effort="motor_torque")
    found, registers = monitor.account.registers, expected.replay.account.registers
    assert np.array_equal(found.microjoule, registers.microjoule)
    assert np.array_equal(found.remainder, registers.remainder)
    comparison = monitor.account.comparison
    assert comparison.measured_energy == expected.replay.account.comparison.measured_energy
    assert comparison.predicted_energy == expected.replay.account.comparison.predicted_energy
    assert monitor.energy == expected.energy
    for name in (*tables[-1].columns, *tables[-1].joint_columns):
        together = np.concatenate([table[name] for table in tables])
        assert np.array_equal(together, expected.power[name], equal_nan=True), name


def rows_of(folder):
    """All slots of a history, whoever recorded them."""
    found = []
    with closing(open_reader(folder)) as connection:
        for table, names in (("slot1", COLUMNS), ("slot15", COLUMNS), ("joint15", JOINT_COLUMNS)):
            key = "start, stop, joint" if table == "joint15" else "start, stop, flags"
            query = f"SELECT {key}, {', '.join(names)} FROM {table} ORDER BY 1, 2, 3"
            found += connection.execute(query).fetchall()
    return found


def test_live_and_fleet_run_give_equal_slots_and_live_goes_before(recorded, tmp_path, monkeypatch):
    """What a monitor records live, and a replay of the bag of the same work, a minute later."""
    later = int(recorded[0][0][-1]) + MINUTE_NS
    monkeypatch.setattr("robot_energy_fleet.fleet_run.time.time_ns", lambda: later)  # keeps minutes
    model, readings = re.load_model("kr16"), []

    def read(account, minute_ns):
        readings.append(reading_of(account, model, minute_ns))

    monitor, _ = run(recorded, (1, 7, 40, 3, 250), read)
    read(monitor.account, 0)
    store = HistoryStore(tmp_path / "live")
    store.open()
    store.add("bags", readings)
    assert store.write(readings[-1].stamp_ns, newest=True)
    store.close()
    fleet = {"workers": 0, "effort": "motor_torque", "name": "bags"}
    re.fleet_run(BAG, tmp_path / "d", "kr16", history=tmp_path / "bag", **fleet)
    live = [(row[0], row[1], *row[3:]) for row in rows_of(tmp_path / "live")]
    bag = [(row[0], row[1], *row[3:]) for row in rows_of(tmp_path / "bag")]
    assert len(live) >= 8
    assert bag == live  # but for the flag that says: counted before the recorder ran
    assert check(tmp_path / "bag") == check(tmp_path / "live") == []
    # The bag of the same time adds nothing, also where the dataset has it already.
    again = re.fleet_run(BAG, tmp_path / "d", "kr16", history=tmp_path / "live", **fleet)
    assert again.replayed == 1
    assert [(row[0], row[1], *row[3:]) for row in rows_of(tmp_path / "live")] == live
    events = re.history_events(tmp_path / "live", 0, 2**62)
    assert "recorded by others" in events["text"].tolist()[-1]
    done = re.fleet_run(BAG, tmp_path / "d", "kr16", history=tmp_path / "live", **fleet)
    assert done.replayed == 0


def test_single_samples_and_arrays_are_the_same():
    stamp = START + np.arange(60) * 4_000_000
    position = np.sin(np.linspace(0.0, 0.5, 60))[:, None] * np.ones(6)
    degc, power = np.full((60, 6), 30.0), np.full(60, 500.0)
    one, many = re.OnlineMonitor("kr16"), re.OnlineMonitor("kr16")
    for row in range(60):
        one.push(
            int(stamp[row]), position[row], motor_temperature_degc=degc[row],
            measured_power=power[row],
        )  # fmt: skip
    many.push(stamp, position, motor_temperature_degc=degc, measured_power=power)
    one.flush(), many.flush()
    assert one.energy == many.energy
    assert one.account.comparison.measured_energy > 0
    assert one.account.comparison.measured_energy == many.account.comparison.measured_energy


def test_what_cannot_be_right_is_counted_and_not_raised():
    monitor = re.OnlineMonitor("kr16")
    position = np.zeros((3, 6))
    position[1, 2] = np.nan
    monitor.push([START, START + 4_000_000, 0], position)
    assert monitor.rejected["joint_states"] == {"not_finite": 1, "zero_stamp": 1}


def test_what_the_stages_refuse_is_counted_too():
    monitor = re.OnlineMonitor("kr16")
    for step in range(100):
        monitor.push(START + step * 10_000_000, np.full(6, 0.1), np.zeros(6))
    monitor.push_temperatures(START + 1_000_000_000, np.full(6, 30.0))
    monitor.push_temperatures(START + 1_100_000_000, np.full(6, 318.0))  # kelvin
    monitor.push_meter(START + 500_000_000, 1e9)
    assert monitor.rejected["temperatures"] == {"temperature_implausible": 6}
    assert monitor.rejected["meter"] == {"meter_implausible": 1}


def test_columns_have_one_type_with_rows_and_without():
    monitor = re.OnlineMonitor("kr16")
    stamps = START + np.arange(100) * 10_000_000
    full = monitor.push(stamps, np.full((100, 6), 0.1), np.zeros((100, 6)))
    empty = re.OnlineMonitor("kr16").flush()
    assert len(full) > len(empty) == 0
    for name in empty.columns:
        assert empty[name].dtype == full[name].dtype, name


def test_the_power_of_one_push_is_empty_until_it_is_complete():
    monitor = re.OnlineMonitor("kr16")
    table = monitor.push(START, np.zeros(6))
    assert len(table) == 0
    assert table["motor_velocity"].shape == (0, 6)
    assert set(table.columns) | set(table.joint_columns) == set(table.units)


@pytest.mark.parametrize(
    ("stamp", "position"),
    [(1.5, np.zeros(6)), (START, np.zeros(5)), ([START, START], np.zeros(6)), (2**62, np.zeros(6))],
)
def test_arrays_that_do_not_fit_are_refused(stamp, position):
    with pytest.raises(re.ShapeError):
        re.OnlineMonitor("kr16").push(stamp, position)


def test_unknown_meanings_are_refused():
    with pytest.raises(re.ParameterError):
        re.OnlineMonitor("kr16", effort="torque")
    with pytest.raises(re.ParameterError):
        re.OnlineMonitor("kr16", meter_location="roof")
    with pytest.raises(re.ShapeError):
        re.OnlineMonitor("kr16").push_meter(START)


@pytest.mark.parametrize("model", ["kr16", "irb4600"])
def test_a_monitor_can_be_pickled_in_the_middle(recorded, model):
    joints = recorded[0]
    monitor = re.OnlineMonitor(model)
    monitor.push_temperatures(recorded[1][0][:1], recorded[1][1][:1])
    monitor.push(joints[0][:1000], joints[1][:1000], joints[2][:1000])
    copy = pickle.loads(pickle.dumps(monitor))
    tables = [
        one.push(joints[0][1000:2000], joints[1][1000:2000], joints[2][1000:2000])
        for one in (monitor, copy)
    ]
    for name, column in tables[0].columns.items():
        np.testing.assert_array_equal(tables[1][name], column)
    assert copy.energy == monitor.energy
