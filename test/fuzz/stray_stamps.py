"""Any set of stamps of other times in clean streams: bounded, balanced, and cut anyhow."""

import functools

import numpy as np
from target import JOINTS

import robots
from robot_energy.bag.cdr.decode import Encoder, RawBatch, stamp_columns
from robot_energy.inputs.joint_states.joint_states import JOINT_STATE, JointStateIngest
from robot_energy.inputs.meter.meter import MeterIngest
from robot_energy.inputs.meter.source import POWER_READING
from robot_energy.inputs.temperatures.temperatures import TemperatureIngest
from robot_energy.pipeline import EnergyPipeline, Output

MOTOR_TEMPERATURES = "ros2_energy_msgs/msg/MotorTemperatures"
S = 10**9
START = 1_000_000 * S
SECONDS = 12
STREAMS = {  # topic, type and rate [Hz]
    "/joint_states": (JOINT_STATE, 50),
    "/motor_temperatures": (MOTOR_TEMPERATURES, 2),
    "/power_meter": (POWER_READING, 10),
}
TOPICS = tuple(STREAMS)
AWAY = (-86_400, -7200, -3600, -60, -10, -3, -1, 1, 3, 10, 60, 3600, 7200, 86_400)  # s
ALONE = (-86_400, -7200, -3600, -60, 60, 3600, 7200, 86_400)  # out of reach of every stream


def stamps_of(topic: str) -> np.ndarray:
    """Right stamps of a stream."""
    rate = STREAMS[topic][1]
    return START + np.arange(SECONDS * rate, dtype=np.int64) * (S // rate)


@functools.cache
def encoders() -> dict[str, Encoder]:
    """What writes the messages."""
    return {
        "/joint_states": Encoder(
            JOINT_STATE, {"name": JOINTS}, {"position": 2, "velocity": 2, "effort": 0}
        ),
        "/motor_temperatures": Encoder(
            MOTOR_TEMPERATURES, {"joint_names": JOINTS}, {"temperature_degc": 2}
        ),
        "/power_meter": Encoder(POWER_READING, {"meaning": 1, "location": 1}, {}),
    }


def messages(topic: str, stamp: np.ndarray) -> list[bytes]:
    """Messages with these stamps that say what is so at the right ones."""
    time = (stamps_of(topic) - START) / S
    two = np.ones((1, 2))
    columns = {
        "/joint_states": lambda: {
            "position": np.sin(2 * time)[:, None] * two,
            "velocity": 2 * np.cos(2 * time)[:, None] * two,
            "effort": np.empty((len(time), 0)),
        },
        "/motor_temperatures": lambda: {"temperature_degc": (50 + 0.05 * time)[:, None] * two},
        "/power_meter": lambda: {
            "power": 300.0 + time,
            "energy": np.full(len(time), np.nan),
            "interval": np.full(len(time), np.nan),
        },
    }[topic]()
    rows = encoders()[topic].encode({**stamp_columns(stamp), **columns}, len(stamp))
    return [row.tobytes() for row in rows]


class Run:
    """One run of all streams through ingest and pipeline."""

    def __init__(self) -> None:
        self.joints = JointStateIngest(JOINTS)
        model = robots.two_link()
        self.temperatures = TemperatureIngest(JOINTS, stale_after=model.temperature.stale_after)
        self.meter = MeterIngest()
        self.pipeline = EnergyPipeline(model)

    def step(self, part: dict[str, list[bytes]]) -> Output:
        """Take some messages of each stream."""
        batches = {
            topic: RawBatch.from_messages(
                topic, STREAMS[topic][0], np.arange(len(rows), dtype=np.int64), rows
            )
            for topic, rows in part.items()
            if rows
        }
        joints, temperatures, meter = (
            [batches[topic]] if topic in batches else [] for topic in TOPICS
        )
        return self.pipeline.step(
            self.joints.step(joints) if joints else None,
            self.temperatures.step(temperatures) if temperatures else None,
            self.meter.step(meter) if meter else None,
        )

    def end(self) -> tuple[object, ...]:
        """Return all that was counted."""
        self.pipeline.step(None, self.temperatures.flush(), self.meter.flush())
        self.pipeline.step(self.joints.flush())
        self.pipeline.flush()
        for ingest in (self.joints, self.temperatures, self.meter):
            assert ingest.rejections.balanced
            assert not ingest.rejections.waiting
        account = self.pipeline.account
        return (
            account.registers.microjoule.tolist(),
            account.registers.time.observed_ns,
            account.registers.time.gap_ns,
            dict(account.counts.quality),
            account.comparison.microjoule.tolist(),
            account.comparison.compared_ns,
            *(
                dict(each.rejections.rejected)
                for each in (self.joints, self.temperatures, self.meter)
            ),
        )


def whole(streams: dict[str, list[bytes]], cuts: int) -> tuple[Run, tuple[object, ...]]:
    """All temperatures and readings, then the joint states, each in so many pieces."""
    run = Run()
    for topic in reversed(TOPICS):
        rows = streams[topic]
        size = max(1, len(rows) // cuts)
        for first in range(0, len(rows), size):
            run.step({topic: rows[first : first + size]})
    return run, run.end()


def live(streams: dict[str, list[bytes]], step: float) -> tuple[object, ...]:
    """Everything as it arrives, some time at once."""
    run = Run()
    for number in range(round(SECONDS / step)):
        part = {}
        for topic, rows in streams.items():
            rate = STREAMS[topic][1]
            first, last = (int(np.ceil(n * step * rate)) for n in (number, number + 1))
            part[topic] = rows[first:last]
        run.step(part)
    return run.end()


@functools.cache
def clean() -> tuple[Run, tuple[object, ...]]:
    """The streams without an outlier."""
    return whole({topic: messages(topic, stamps_of(topic)) for topic in TOPICS}, 1)


def outlier_stamps(data: bytes) -> bool:
    """Outliers are refused or bounded, and no cutting changes anything.

    The first byte says whether they stand alone, one in four at most and none among the
    first three. Then the energy differs by no more than the share of the joint states that
    were refused, and 0.1 %; the compared time by the intervals of the readings refused.
    """
    alone = bool(data[:1]) and data[0] % 2 == 1
    stamps = {topic: stamps_of(topic) for topic in TOPICS}
    moved = {topic: np.zeros(len(stamp), dtype=np.bool_) for topic, stamp in stamps.items()}
    for which, place, by in zip(*(data[number + 1 :: 3] for number in range(3)), strict=False):
        topic = TOPICS[which % len(TOPICS)]
        stamp, away = stamps[topic], moved[topic]
        row = (place + 256 * (which // len(TOPICS))) % len(stamp)
        near = away[max(0, row - 3) : row + 4].any() or row < 3
        if away[row] or (alone and near):
            continue
        stamp[row] += (ALONE[by % len(ALONE)] if alone else AWAY[by % len(AWAY)]) * S
        away[row] = True
    streams = {topic: messages(topic, stamp) for topic, stamp in stamps.items()}
    run, found = whole(streams, 1)
    assert whole(streams, 1 + (data[0] if data else 0) % 37)[1] == found
    assert run.pipeline.power.timeline.rows <= 3 * SECONDS * 2 + 3
    if not alone:
        return True
    assert live(streams, 0.3) == found
    base, counted = clean()
    for topic, ingest in zip(TOPICS, (run.joints, run.temperatures, run.meter), strict=True):
        assert ingest.rejections.rejected["stray_stamp"] == moved[topic].sum(), topic
    energy = [each.pipeline.account.registers.cabinet("grid_import") for each in (run, base)]
    share = moved["/joint_states"].mean()
    assert abs(energy[0] / energy[1] - 1) <= share + 1e-3
    lost = counted[5] - run.pipeline.account.comparison.compared_ns  # type: ignore[operator]
    refused = int(moved["/power_meter"].sum()) + int(moved["/joint_states"].sum())
    assert lost <= refused * S // 5
    return True


def outlier_seeds() -> list[bytes]:
    """None, one in each stream, many, two clocks."""
    one = [bytes([1, stream, 50, by]) for stream in range(3) for by in (0, 7)]
    rng = np.random.default_rng(0)
    many = [bytes([start, *rng.integers(0, 256, 240).tolist()]) for start in (0, 1)]
    turns = [bytes([0, *(n for row in range(0, 120, 2) for n in (2, row, by))]) for by in (8, 12)]
    return [b"", *one, *many, *turns]
