"""Stamps of a wrong clock in the bundled bags: one message, many messages, the log times.

A refused message costs what it alone knew: of a temperature next to nothing, of a joint
state one interval, of a meter reading the interval that it covers.
"""

import tempfile
from collections.abc import Callable
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stray_stamps

from places import ROOT
from robot_energy.bag import BagReader, BagWriter
from robot_energy.inputs.sources import JointStateSource
from robot_energy.model import load
from robot_energy.replay.bag_replay import Replay, replay
from robot_energy.replay.setup import ReplaySetup
from robot_energy.results.replay import replay_report
from robot_energy.timeline.blocks import Quality
from robot_energy.timeline.stamps import MAX_STAMP_NS

BAG = ROOT / "bags" / "kr16_warm"
JOINTS, TEMPERATURES, METER = "/joint_states", "/motor_temperatures", "/power_meter"
S = 10**9
MODEL = load("kr16")


@pytest.fixture(scope="module")
def recorded() -> tuple[list[tuple[int, str, bytes]], dict[str, str]]:
    reader = BagReader(BAG)
    types = {topic: info.msgtype for topic, info in reader.topics.items()}
    rows = [
        (int(batch.log_time_ns[row]), topic, bytes(batch.row(row)))
        for part in reader.parts(list(types))
        for topic, batch in part.items()
        for row in range(len(batch))
    ]
    return sorted(rows, key=lambda row: row[0]), types


@pytest.fixture(scope="module")
def reference() -> Replay:
    return replay(BAG, MODEL)


def moved(data: bytes, seconds: float) -> bytes:
    """The message with another stamp, which is what comes first in it."""
    changed = bytearray(data)
    sec, nanosec = np.frombuffer(data[4:12], dtype="<u4").astype(np.int64).tolist()
    instant = sec * S + nanosec + round(seconds * S)
    changed[4:12] = np.array(divmod(instant, S), dtype="<u4").tobytes()
    return bytes(changed)


@pytest.fixture
def faulty(recorded, tmp_path) -> Callable[..., Replay]:
    """Replays the bag with some stamps moved: ``{topic: {number of the message: seconds}}``."""
    rows, types = recorded

    def run(shifts: Any, log_shift: int = 0, **options: Any) -> Replay:
        folder = Path(tempfile.mkdtemp(dir=tmp_path)) / "bag"
        count = dict.fromkeys(types, 0)
        with BagWriter(folder) as bag:
            for topic, msgtype in types.items():
                bag.add_topic(topic, msgtype)
            for topic, run in groupby(rows, key=lambda row: row[1]):
                times, messages = [], []
                for time, _, data in run:
                    by = shifts.get(topic, {}).get(count[topic], 0.0)
                    late = log_shift and topic == JOINTS and count[topic] % 2
                    times.append(time + (log_shift if late else 0))
                    messages.append(moved(data, by) if by else data)
                    count[topic] += 1
                bag.write(topic, np.array(times), messages)
        result = replay(folder, MODEL, ReplaySetup(**options))
        for each in (result.joint_states, result.temperatures, result.meter):
            assert each.rejections.balanced
            assert not each.rejections.waiting
        return result

    return run


def energy(result: Replay) -> float:
    return result.account.registers.cabinet("grid_import")


def change(result: Replay, reference: Replay) -> float:
    return abs(energy(result) / energy(reference) - 1)


@pytest.mark.parametrize(
    ("number", "by"),
    [(0, -10), (0, 7200), (18, -86_400), (18, -1), (18, 10), (35, -10), (35, 1), (35, 7200)],
)
def test_one_temperature_of_another_time_changes_nothing(faulty, reference, number, by):
    """Energy within 0.1 %, and a note unless the stamp may well be right.

    The first stamped one second later is the same as a thermometer that begins then.
    """
    result = faulty({TEMPERATURES: {number: by}})
    assert change(result, reference) < 1e-3
    assert result.account.counts.quality[Quality.TEMPERATURE_MISSING] == 0
    if abs(by) > 5:
        assert any(TEMPERATURES in note for note in result.notes) or (number, by) == (0, -10)
    if abs(by) > 5 and number:
        assert result.temperatures.rejections.rejected == {"stray_stamp": 1}


@pytest.mark.parametrize(
    ("number", "by"),
    [
        *((0, -86_400), (0, -10), (0, -1), (0, 1), (0, 7200), (1, -1), (1, 10)),
        *((4500, -86_400), (4500, 1), (4500, 7200), (8999, -10), (8999, 1)),
    ],
)
def test_one_joint_state_of_another_time_changes_nothing(faulty, reference, number, by):
    result = faulty({JOINTS: {number: by}})
    assert change(result, reference) < 1e-3
    assert sum(result.joint_states.rejections.rejected.values()) == (
        number > 0 or by not in (-1, -10)
    )
    time = result.account.registers.time
    assert time.jumps == 0
    assert time.gap_ns <= (11 * S if not number else 0)


@pytest.mark.parametrize("stamp_ns", [1, MAX_STAMP_NS])
def test_a_first_joint_state_of_another_age_is_no_epoch(stamp_ns):
    """Live as in a replay, however it is cut."""
    stamps = {topic: stray_stamps.stamps_of(topic) for topic in stray_stamps.TOPICS}
    stamps[JOINTS][0] = stamp_ns
    streams = {topic: stray_stamps.messages(topic, stamp) for topic, stamp in stamps.items()}
    run, found = stray_stamps.whole(streams, 1)
    assert run.joints.rejections.rejected == {"stray_stamp": 1}
    time = run.pipeline.account.registers.time
    assert (time.jumps, time.gap_ns) == (0, 0)
    assert stray_stamps.live(streams, 0.1) == stray_stamps.whole(streams, 37)[1] == found


@pytest.mark.parametrize(
    ("number", "by"),
    [(0, -1), (0, 10), (0, 7200), (180, -10), (180, 1), (358, -86_400), (358, -1), (358, 10)],
)
def test_one_meter_reading_of_another_time_costs_what_it_covers(faulty, reference, number, by):
    """Two readings' intervals at most, on both sides: the error of the prediction stays."""
    result = faulty({METER: {number: by}})
    assert energy(result) == energy(reference)
    found, whole = result.account.comparison, reference.account.comparison
    assert 1 - found.compared_ns / whole.compared_ns < 2.1 / 359
    assert 0 <= 1 - found.measured_energy / whole.measured_energy < 2.1 / 359
    ratio = found.predicted_energy / found.measured_energy
    assert ratio == pytest.approx(whole.predicted_energy / whole.measured_energy, abs=1e-3)


@pytest.mark.parametrize("offset", [3.0, 7200.0, -1e9])
def test_thermometers_of_two_clocks_that_take_turns(faulty, reference, offset):
    """One clock is believed; the other one is said with its offset."""
    result = faulty({TEMPERATURES: {number: offset for number in range(1, 36, 2)}})
    assert change(result, reference) < 5e-3
    (note,) = [note for note in result.notes if TEMPERATURES in note]
    assert "two clocks?" in note
    if abs(offset) > 5:
        assert result.temperatures.rejections.rejected["stray_stamp"] >= 16


@pytest.mark.parametrize("offset", [-7200.0, 7200.0])
def test_a_thermometer_of_another_clock_is_never_used_in_silence(faulty, offset):
    """The notes say how many samples had to do without, and how far the clock is off."""
    result = faulty({TEMPERATURES: dict.fromkeys(range(36), offset)})
    used = result.pipeline.power.fallback_use
    assert used.missing + used.stale > 7000
    ahead_ns = result.temperatures.ahead_ns(result.joint_states)
    assert ahead_ns == pytest.approx(offset * S, abs=2 * S)
    (note,) = [note for note in replay_report(result).notes if "fallback temperature" in note]
    way = "ahead of" if offset > 0 else "behind"
    assert f"; its stamps are {abs(ahead_ns) / S:.1f} s {way} those of the joint states" in note
    assert "synchronise the clocks" in note


def test_a_thermometer_that_stops_is_no_clock(recorded, tmp_path):
    """Its last reading is used for 5 s; then the notes say how long it has been silent."""
    rows, types = recorded
    begin = rows[0][0]
    with BagWriter(tmp_path / "bag") as bag:
        for topic, msgtype in types.items():
            bag.add_topic(topic, msgtype)
        for time, topic, data in rows:
            if topic != TEMPERATURES or time < begin + 10 * S:
                bag.write(topic, np.array([time]), [data])
    short = MODEL.temperature.model_copy(update={"stale_after": 5.0})
    result = replay(tmp_path / "bag", MODEL.changed(temperature=short))
    notes = replay_report(result).notes
    (note,) = [note for note in notes if "fallback temperature" in note]
    silence = float(note.split("no new one for up to ")[1].split()[0])
    assert silence == pytest.approx(26.0, abs=1.5)
    assert note.endswith("s: check its driver or topic")
    assert not any("clock" in note for note in notes)


def test_a_thermometer_a_little_off_is_used_and_said(faulty, reference):
    result = faulty({TEMPERATURES: dict.fromkeys(range(36), -20.0)})
    assert change(result, reference) < 1e-2
    (note,) = [note for note in result.notes if "newest temperature" in note]
    assert float(note.split("stamped ")[1].split()[0]) == pytest.approx(20.0, abs=2.0)
    assert "before the joint states that arrived with it: synchronise the clocks" in note


@pytest.mark.parametrize("stamp_source", ["header", "receive"])
def test_broken_log_times_never_give_the_energy_twice(faulty, reference, stamp_source):
    """Every second message was logged half a minute later: a problem, which is exit code 3."""
    states = JointStateSource(stamp_source=stamp_source)
    result = faulty({}, log_shift=36 * S, states=states)
    assert any("log times" in problem for problem in result.problems)
    assert change(result, reference) < 2e-2
    assert result.account.registers.time.span_ns < 40 * S
