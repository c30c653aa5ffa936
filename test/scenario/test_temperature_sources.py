"""One recorded run, its motor temperatures said in every way that a robot may say them.

The reference is the bundled bag: the same readings in another dress give the same
registers, to the last bit.
"""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import temperature_messages as says
from places import ROOT
from robot_energy.bag import BagReader, BagWriter
from robot_energy.bag.cdr.decode import Decoder, stamp_ns
from robot_energy.foundation.errors import MissingTopicError
from robot_energy.inputs.inputs_file import read_inputs
from robot_energy.inputs.sources import Inputs, TemperatureSource
from robot_energy.inputs.temperatures.kinds import (
    DIAGNOSTICS,
    DYNAMIC_JOINT_STATE,
    FLOAT_ARRAY,
    INTERFACE_NAMES,
    INTERFACE_VALUES,
    MOTOR_TEMPERATURES,
    TEMPERATURE,
)
from robot_energy.model import load
from robot_energy.replay.bag_replay import Replay, replay
from robot_energy.replay.setup import ReplaySetup, Topics
from robot_energy.results.replay import replay_report
from robot_energy.timeline.blocks import Quality

BAG = ROOT / "bags" / "kr16_cold"
TEMPERATURES = "/motor_temperatures"
MODEL = load("kr16")
JOINTS = MODEL.joint_names
FRAMES = tuple(f"motor_{axis}" for axis in range(1, 7))
KELVIN = 273.15

Row = tuple[str, str, bytes]  # topic, type, message
Dress = Callable[[int, np.ndarray], list[Row]]


def readings() -> Iterator[tuple[int, int, np.ndarray]]:
    """Log time, stamp and values of every message of motor temperatures."""
    decoder = Decoder(
        MOTOR_TEMPERATURES, ("header.stamp.sec", "header.stamp.nanosec", "temperature_degc")
    )
    for part in BagReader(BAG).parts([TEMPERATURES]):
        batch = part[TEMPERATURES]
        for run in decoder.decode(batch).runs:
            yield from zip(
                batch.log_time_ns[run.rows].tolist(),
                stamp_ns(run).tolist(),
                run.array("temperature_degc"),
                strict=True,
            )


@pytest.fixture(scope="module")
def reference() -> Replay:
    return replay(BAG, MODEL)


@pytest.fixture
def dressed(tmp_path) -> Callable[..., Path]:
    """Writes the bag with its temperatures said in another way."""

    def write(dress: Dress, before: tuple[Row, ...] = ()) -> Path:
        reader = BagReader(BAG)
        path = tmp_path / dress.__name__
        with BagWriter(path) as bag:
            kept = {t: i.msgtype for t, i in reader.topics.items() if t != TEMPERATURES}
            for topic, msgtype in kept.items():
                bag.add_topic(topic, msgtype)
            rows = [(log, row) for log, stamp, values in readings() for row in dress(stamp, values)]
            first = rows[0][0]
            rows = [(first, row) for row in before] + rows
            for topic, msgtype in {row[0]: row[1] for _, row in rows}.items():
                bag.add_topic(topic, msgtype)
            pending = list(rows)
            for part in reader.parts(list(kept)):
                end = max(int(batch.log_time_ns[-1]) for batch in part.values())
                while pending and pending[0][0] <= end:
                    log, (topic, _, data) = pending.pop(0)
                    bag.write(topic, np.array([log]), [data])
                for topic, batch in part.items():
                    bag.write(topic, batch.log_time_ns, [batch.row(i) for i in range(len(batch))])
            for log, (topic, _, data) in pending:
                bag.write(topic, np.array([log]), [data])
        return path

    return write


def as_temperatures(stamp, values) -> list[Row]:
    return [
        ("/temperatures", TEMPERATURE, says.temperature(stamp, value, joint))
        for joint, value in zip(JOINTS, values, strict=True)
    ]


def as_topics(stamp, values) -> list[Row]:
    return [
        (f"/{joint}/temperature", TEMPERATURE, says.temperature(stamp, value, "flange"))
        for joint, value in zip(JOINTS, values, strict=True)
    ]


def as_frames(stamp, values) -> list[Row]:
    return [
        ("/temperatures", TEMPERATURE, says.temperature(stamp, value, frame))
        for frame, value in zip(FRAMES, values, strict=True)
    ]


def as_array(stamp, values) -> list[Row]:
    return [("/motor_temps", FLOAT_ARRAY, says.float_array([0.0, *values[::-1]]))]


def as_stamped_late(stamp, values) -> list[Row]:
    return [
        (
            TEMPERATURES,
            MOTOR_TEMPERATURES,
            says.motor_temperatures(stamp + 5_000_000, values, JOINTS),
        )
    ]


def as_dynamic(stamp, values) -> list[Row]:
    states = [{"position": 0.0, "temperature": value} for value in values]
    states[2] = {"temperature": states[2]["temperature"], "velocity": 0.0, "effort": 0.0}
    message = says.dynamic_joint_state(
        stamp, (*JOINTS[::-1], "gripper"), [*states[::-1], {"temperature": 99.0}]
    )
    return [("/dynamic_joint_states", DYNAMIC_JOINT_STATE, message)]


KEYS = ("gripper/temperature", *(f"{joint}/temperature" for joint in JOINTS))


def as_values(stamp, values) -> list[Row]:
    return [("/b/values", INTERFACE_VALUES, says.interface_values(stamp, [99.0, *values]))]


def as_diagnostics(stamp, values) -> list[Row]:
    statuses = {
        f"driver: {frame}": {"current": "1.0", "temperature": f"{float(value)!r} C"}
        for frame, value in zip(FRAMES, values, strict=True)
    }
    fan = says.diagnostics(stamp, {"fan": {"temperature": "99"}})
    return [
        ("/diagnostics", DIAGNOSTICS, says.diagnostics(stamp, statuses)),
        ("/diagnostics", DIAGNOSTICS, fan),
    ]


def source(**settings) -> Inputs:
    return Inputs(temperature_sources={"motors": TemperatureSource(**settings)})


ONE_EACH = Inputs(
    temperature_sources={
        joint: TemperatureSource(topic=f"{joint}/temperature", type=TEMPERATURE, joints=(joint,))
        for joint in JOINTS
    }
)
NAMES = ("/b/names", INTERFACE_NAMES, says.interface_names(1, KEYS))
WAYS = {
    "frame ids that are joints": (as_temperatures, source(topic="temperatures", type=TEMPERATURE)),
    "a topic for each joint": (as_topics, ONE_EACH),
    "frame ids of their own": (
        as_frames,
        source(topic="temperatures", type=TEMPERATURE, joints=JOINTS, names=FRAMES),
    ),
    "dynamic joint states": (
        as_dynamic,
        source(topic="dynamic_joint_states", type=DYNAMIC_JOINT_STATE),
    ),
    "values next to their names": (as_values, source(topic="b/values", type=INTERFACE_VALUES)),
    "texts of diagnostics": (
        as_diagnostics,
        source(
            topic="/diagnostics",
            type=DIAGNOSTICS,
            joints=JOINTS,
            names=tuple(f"driver: {frame}" for frame in FRAMES),
        ),
    ),
}


def same_registers(result: Replay, reference: Replay) -> None:
    np.testing.assert_array_equal(
        result.account.registers.microjoule, reference.account.registers.microjoule
    )
    assert result.temperatures.rejections.balanced
    assert result.account.counts.quality == reference.account.counts.quality


@pytest.mark.parametrize("way", WAYS)
def test_the_same_readings_in_another_dress_give_the_same_registers(way, dressed, reference):
    """Each message type, read as its source says: equal to the last bit."""
    dress, inputs = WAYS[way]
    result = replay(
        dressed(dress, (NAMES,) if dress is as_values else ()), MODEL, ReplaySetup(inputs=inputs)
    )
    same_registers(result, reference)
    assert result.notes == []


def test_kelvin_gives_the_same_registers(dressed, reference):
    """The same readings in kelvin, said to be: equal to the last bit of the registers."""
    inputs = source(topic="dynamic_joint_states", type=DYNAMIC_JOINT_STATE, unit="kelvin")
    path = dressed(lambda stamp, values: as_dynamic(stamp, values + KELVIN))
    same_registers(replay(path, MODEL, ReplaySetup(inputs=inputs)), reference)


def test_kelvin_that_is_not_said_is_refused_and_named(dressed):
    """Kelvin from a source in degC: no value is used, and a sentence says what to set."""
    path = dressed(lambda stamp, values: as_dynamic(stamp, values + KELVIN))
    inputs = source(topic="dynamic_joint_states", type=DYNAMIC_JOINT_STATE)
    result = replay(path, MODEL, ReplaySetup(inputs=inputs))
    assert (
        result.account.counts.quality[Quality.TEMPERATURE_MISSING] == result.account.counts.samples
    )
    assert result.pipeline.friction.rejections.accepted == 0
    (note,) = result.notes
    assert note.startswith("/dynamic_joint_states reads 29")
    assert note.endswith("for joint_a1: set unit: kelvin")


def test_temperatures_of_no_joint_are_listed_once(dressed, reference):
    """A gripper that reports its temperature too changes nothing and is named in the notes."""
    path = dressed(as_dynamic)
    result = replay(path, MODEL, ReplaySetup(inputs=WAYS["dynamic joint states"][1]))
    same_registers(result, reference)
    assert replay_report(result).notes == ("temperatures of unknown joints: gripper",)


def test_an_array_counts_from_its_receipt(dressed, reference):
    """Float64MultiArray has no stamp: a reading counts from its receipt, here 5 ms later.

    So the registers are equal to the last bit to those of MotorTemperatures stamped 5 ms
    later, and differ from the reference by friction that is 1 K behind for 5 ms a second.
    """
    assert {log - stamp for log, stamp, _ in readings()} == {5_000_000}
    inputs = source(topic="motor_temps", type=FLOAT_ARRAY, joints=("-", *JOINTS[::-1]))
    result = replay(dressed(as_array), MODEL, ReplaySetup(inputs=inputs))
    late = replay(dressed(as_stamped_late), MODEL)
    same_registers(result, late)
    drawn = [each.account.registers.cabinet("grid_import") for each in (result, reference)]
    assert drawn[0] != drawn[1]
    assert drawn[0] == pytest.approx(drawn[1], rel=1e-4)


def test_the_parameter_file_of_the_node_serves_the_replay(dressed, reference, tmp_path):
    """The file of a live monitor, other parameters included, reads the bag in the same way."""
    file = tmp_path / "robot.yaml"
    file.write_text(
        "energy_monitor:\n"
        "  ros__parameters:\n"
        "    model: kr16\n"
        "    temperature_sources: [drives]\n"
        "    drives:\n"
        "      topic: dynamic_joint_states\n"
        f"      type: {DYNAMIC_JOINT_STATE}\n"
    )
    inputs, notes = read_inputs(file)
    same_registers(replay(dressed(as_dynamic), MODEL, ReplaySetup(inputs=inputs)), reference)
    assert notes == []


def test_without_a_file_the_replay_says_what_may_hold_temperatures(dressed):
    """A topic that does not say all by itself is not guessed at, but named."""
    path = dressed(as_dynamic)
    result = replay(path, MODEL)
    assert (
        result.account.counts.quality[Quality.TEMPERATURE_MISSING] == result.account.counts.samples
    )
    assert any("/dynamic_joint_states" in note and "--inputs" in note for note in result.notes)
    with pytest.raises(MissingTopicError, match="--inputs"):
        replay(path, MODEL, ReplaySetup(topics=Topics(temperatures=("/dynamic_joint_states",))))


def test_a_source_that_the_bag_lacks_is_left_out_and_said(reference):
    """The file describes the robot; a bag may hold less of it."""
    sources = {
        "motors": TemperatureSource(),
        "wrist": TemperatureSource(topic="wrist/values", type=INTERFACE_VALUES),
    }
    result = replay(BAG, MODEL, ReplaySetup(inputs=Inputs(temperature_sources=sources)))
    same_registers(result, reference)
    (note,) = result.notes
    assert "no wrist/names and wrist/values: the temperature source 'wrist' is not used" in note


def test_a_source_of_another_type_is_refused():
    with pytest.raises(MissingTopicError, match="has /motor_temperatures as ros2_energy_msgs"):
        replay(BAG, MODEL, ReplaySetup(inputs=source(type=TEMPERATURE)))
