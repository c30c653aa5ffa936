"""A part of a bag: the same as a recording of that part alone."""

from __future__ import annotations

import sqlite3

import numpy as np
import pytest

from places import ROOT
from robot_energy.bag import BagReader
from robot_energy.bag.mcap_file import McapFile
from robot_energy.bag.reader import TimeRange
from robot_energy.foundation.errors import BagError
from robot_energy.model import load
from robot_energy.replay.bag_replay import replay
from robot_energy.replay.setup import ReplaySetup

COLD = ROOT / "bags" / "kr16_cold"
STATES = "/joint_states"


def times(reader, spans):
    parts = [part[STATES].log_time_ns for part in reader.parts([STATES], spans)]
    return np.concatenate(parts) if parts else np.zeros(0, dtype=np.int64)


def test_messages_are_those_of_the_stretch_with_both_ends():
    reader = BagReader(COLD)
    whole = times(reader, None)
    first, last = int(whole[100]), int(whole[2000])
    assert np.array_equal(times(reader, {STATES: (first, last)}), whole[100:2001])
    assert reader.problems == []


def test_chunks_outside_are_passed_over():
    file = McapFile(next(COLD.glob("*.mcap")), pytest.fail)
    whole = list(file.blocks({STATES}))
    stamps = np.concatenate([part.log_time_ns for part in whole[-1].messages.values()])
    inside = (int(stamps.max()) - 10**8, int(stamps.max()))
    assert len(whole) == 3
    assert len(list(file.blocks({STATES}, {STATES: inside}))) == 1


def test_parts_of_a_bag_add_up_to_its_observed_time_and_energy():
    model = load("kr16")
    whole = replay(COLD, model).account
    parts = [
        replay(COLD, model, ReplaySetup(time_range=TimeRange(start, end))).account
        for start, end in ((None, 12.0), (12.0, -10.0), (-10.0, None))
    ]
    observed = sum(int(part.counts.phase_ns.sum()) for part in parts)
    assert observed == pytest.approx(int(whole.counts.phase_ns.sum()), abs=10**8)
    energy = sum(part.comparison.predicted_energy for part in parts)
    assert energy == pytest.approx(whole.comparison.predicted_energy, rel=0.02)


def test_temperatures_from_before_the_part_hold_in_it():
    result = replay(COLD, load("kr16"), ReplaySetup(time_range=TimeRange(20.3, 20.6)))
    assert result.temperatures.rejections.accepted >= 15  # one a second
    assert any("from 20.3 to 20.6 s of" in note for note in result.notes)


def test_a_sqlite_bag_is_cut_alike(tmp_path):
    path = tmp_path / "bag.db3"
    base = sqlite3.connect(path)
    base.execute(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, "
        "serialization_format TEXT, offered_qos_profiles TEXT)"
    )
    base.execute(
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, "
        "data BLOB)"
    )
    base.execute("INSERT INTO topics VALUES (1, '/x', 'std_msgs/msg/Empty', 'cdr', '')")
    base.executemany(
        "INSERT INTO messages VALUES (?, 1, ?, ?)",
        [(k, 10**18 + k * 10**9, b"\x00\x01\x00\x00") for k in range(10)],
    )
    base.commit()
    base.close()
    reader = BagReader(path)
    span = TimeRange(2.0, -3.0).span(reader)
    found = [part["/x"].log_time_ns for part in reader.parts(["/x"], {"/x": span})]
    assert ((np.concatenate(found) - 10**18) // 10**9).tolist() == [2, 3, 4, 5, 6]


@pytest.mark.parametrize(
    ("start", "end"), [(20.0, 10.0), (100.0, None), (None, -100.0), (5.0, 5.0)]
)
def test_a_part_without_anything_is_refused(start, end):
    with pytest.raises(BagError, match="nothing of"):
        replay(COLD, load("kr16"), ReplaySetup(time_range=TimeRange(start, end)))
