"""Laws of motor temperatures: cut anywhere, interleaved anyhow, nothing lost in the books."""

from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

import robots
import temperature_messages as says
from robot_energy.inputs.sources import TemperatureSource
from robot_energy.inputs.temperatures.kinds import (
    DIAGNOSTICS,
    DYNAMIC_JOINT_STATE,
    FLOAT_ARRAY,
    INTERFACE_VALUES,
    TEMPERATURE,
)
from robot_energy.inputs.temperatures.stuck import StuckTemperatureDetector
from robot_energy.inputs.temperatures.temperatures import TemperatureIngest
from robot_energy.pipeline import FrictionStage
from robot_energy.timeline.blocks import TemperatureBlock

S = 10**9
JOINTS = ("shoulder", "elbow")
SOURCES = {
    "own": TemperatureSource(topic="/own"),
    "one": TemperatureSource(topic="/one", type=TEMPERATURE, joints=("elbow",)),
    "row": TemperatureSource(topic="/row", type=FLOAT_ARRAY, joints=("elbow", "-")),
    "all": TemperatureSource(topic="/all", type=DYNAMIC_JOINT_STATE, unit="kelvin"),
    "pair": TemperatureSource(topic="/b/values", type=INTERFACE_VALUES),
    "text": TemperatureSource(topic="/text", type=DIAGNOSTICS, joints=JOINTS, names=("drives",)),
}
Arrival = tuple[int, str, str, bytes]  # log time, topic, type, message


def message(rng: np.random.Generator, source: TemperatureSource, stamp: int) -> tuple[str, bytes]:
    """A message of a source, often wrong in some way."""
    values = rng.choice([20.0, 25.0, 70.0, 300.0, np.nan], 2, p=[0.4, 0.3, 0.1, 0.1, 0.1])
    names = JOINTS if rng.random() < 0.8 else ("shoulder", "flange")
    keys = [f"{name}/temperature" for name in names]
    match source.type:
        case "ros2_energy_msgs/msg/MotorTemperatures":
            return source.topic, says.motor_temperatures(stamp, values, names)
        case "sensor_msgs/msg/Temperature":
            return source.topic, says.temperature(stamp, values[0], "frame")
        case "std_msgs/msg/Float64MultiArray":
            return source.topic, says.float_array(values[: rng.integers(1, 3)])
        case "control_msgs/msg/DynamicJointState":
            entries: list[dict[str, float]] = [{"temperature": value} for value in values]
            return source.topic, says.dynamic_joint_state(stamp, names, entries)
        case "control_msgs/msg/Float64Values":
            if rng.random() < 0.3:
                return source.keys_topic, says.interface_names(stamp, keys[: rng.integers(1, 3)])
            return source.topic, says.interface_values(stamp, values)
        case _:
            texts = {"temperature": rng.choice(["20", "25.5 C", "n/a"])}
            return source.topic, says.diagnostics(stamp, {rng.choice(["drives", "fan"]): texts})


def arrivals(seed: int, size: int) -> list[Arrival]:
    """Messages of all sources, interleaved; stamps lie before the arrival, or jump back."""
    rng = np.random.default_rng(seed)
    log = 1000 * S + np.cumsum(rng.integers(1, S, size))
    offset = 0
    found: list[Arrival] = []
    for at in log.tolist():
        source = SOURCES[rng.choice(list(SOURCES))]
        offset -= 50 * S * (rng.random() < 0.03)
        stamp = 0 if rng.random() < 0.05 else at + offset - int(rng.integers(0, S // 4))
        topic, data = message(rng, source, stamp)
        found.append((at, topic, source.topics[topic], data[: rng.integers(4, 9)] if
                      rng.random() < 0.05 else data))  # fmt: skip
    return found


def batches(part: Iterable[Arrival]) -> list[Any]:
    by_topic: dict[str, list[Arrival]] = {}
    for arrival in part:
        by_topic.setdefault(arrival[1], []).append(arrival)
    return [
        says.batch(topic, rows[0][2], [row[3] for row in rows], [row[0] for row in rows])
        for topic, rows in by_topic.items()
    ]


def pieces(seed: int, size: int) -> list[slice]:
    cuts = np.flatnonzero(np.random.default_rng(seed).random(size) < 0.2)
    bounds = [0, *cuts.tolist(), size]
    return [slice(a, b) for a, b in pairwise(bounds) if b > a]


def run(messages: list[Arrival], cuts: list[slice]) -> tuple[TemperatureBlock | None, Any, Any]:
    """Blocks, accounts and friction of messages that arrive in pieces."""
    ingest = TemperatureIngest(JOINTS, SOURCES)
    stage = FrictionStage(robots.two_link())
    blocks, frictions = [], []
    for cut in cuts:
        block = ingest.step(batches(messages[cut]))
        if block is not None:
            blocks.append(block)
            friction = stage.step(block)
            frictions += [] if friction is None else [friction]
    accounts = [
        (each.rejections.received, each.rejections.accepted, dict(each.rejections.rejected),
         each.missing_readings, each.ignored_joints, each.keys_account.received)
        for each in ingest.readers
    ]  # fmt: skip
    assert all(reader.rejections.balanced for reader in ingest.readers)
    assert all(reader.keys_account.balanced for reader in ingest.readers)
    assert sum(each[0] + each[-1] for each in accounts) == len(messages)
    assert stage.rejections.received == stage.rejections.accepted + sum(
        stage.rejections.rejected.values()
    )
    whole = TemperatureBlock.concatenate(blocks) if blocks else None
    last = type(frictions[0]).concatenate(frictions) if frictions else None
    return whole, accounts, (last, dict(stage.rejections.rejected), stage.rejections.accepted)


def same(a: Any, b: Any) -> None:
    assert (a is None) == (b is None)
    if a is not None:
        for name, value in a.__dict__.items():
            np.testing.assert_array_equal(value, b.__dict__[name])


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 10**6), size=st.integers(1, 80), cuts=st.integers(0, 10**6))
def test_any_cutting_of_interleaved_sources_gives_the_same(seed: int, size: int, cuts: int):
    messages = arrivals(seed, size)
    block, accounts, friction = run(messages, [slice(0, size)])
    other, other_accounts, other_friction = run(messages, pieces(cuts, size))
    same(block, other)
    assert accounts == other_accounts
    same(friction[0], other_friction[0])
    assert friction[1:] == other_friction[1:]


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 10**6), cuts=st.integers(0, 10**6), clean=st.booleans())
def test_readings_are_judged_the_same_in_any_cut(seed: int, cuts: int, clean: bool):
    """Readings that are all in order take a short cut; it must not show."""
    rng = np.random.default_rng(seed)
    stamp = 100 * S + np.cumsum(rng.integers(0 if clean else -S // 10, S, 60))
    values = 20 + np.cumsum(rng.normal(0, 0.3, (60, 2)), axis=0)
    wild = rng.random((60, 2)) < (0.01 if clean else 0.2)
    values[wild] = rng.choice([999.0, 60.0, 61.0, np.nan], int(wild.sum()))
    block = TemperatureBlock(stamp, values)
    results = []
    for parts in ([slice(0, 60)], pieces(cuts, 60), [slice(n, n + 1) for n in range(60)]):
        stage = FrictionStage(robots.two_link())
        rows = [found for part in parts if (found := stage.step(block[part])) is not None]
        results.append(
            (
                type(rows[0]).concatenate(rows),
                stage.rejections.accepted,
                dict(stage.rejections.rejected),
            )
        )
    for other in results[1:]:
        same(results[0][0], other[0])
        assert results[0][1:] == other[1:]


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 10**6), cuts=st.integers(0, 10**6))
@example(seed=368, cuts=368)  # a jump back into the window that a part began in
def test_a_stuck_reading_is_found_at_the_same_sample_in_any_cut(seed: int, cuts: int):
    rng = np.random.default_rng(seed)
    size = 400
    stamp = 100 * S + np.cumsum(rng.integers(1, 20 * S, size))
    segment = np.cumsum(rng.random(size) < 0.01)
    loss = rng.uniform(0, 3000, (size, 2))
    loss[rng.random((size, 2)) < 0.02] = np.nan
    degc = np.full((size, 2), 20.0)
    degc[:, 1] = np.round(20 + stamp / 1e12 * rng.uniform(0, 3), 0)
    degc[rng.random((size, 2)) < 0.002] = np.nan
    stamp[size // 2 :] -= int(rng.choice([0, 200 * S]))

    def marks(parts: list[slice]) -> Any:
        watch = StuckTemperatureDetector(robots.two_link())
        rows = []
        for part in parts:
            found = watch.step(stamp[part], segment[part], loss[part], degc[part])
            rows.append(np.zeros(part.stop - part.start, bool) if found is None else found)
        return np.concatenate(rows), watch.rise

    whole, other = marks([slice(0, size)]), marks(pieces(cuts, size))
    np.testing.assert_array_equal(whole[0], other[0])
    np.testing.assert_array_equal(whole[1], other[1])
