"""Small bags, written where a test runs."""

import contextlib
from types import SimpleNamespace

import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType, Writer

from robot_energy.bag import BagReader, BagWriter
from robot_energy.bag.cdr import Decoder, Encoder, stamp_columns

JOINT_STATE = "sensor_msgs/msg/JointState"
TEMPERATURE = "sensor_msgs/msg/Temperature"


def joint_rows(stamps, seed=0):
    """Serialized joint states of these stamps, shape (n, size)."""
    random = np.random.default_rng(seed)
    encoder = Encoder(
        JOINT_STATE, {"name": ("a", "bb", "ccc")}, {"position": 3, "velocity": 3, "effort": 3}
    )
    n = len(stamps)
    arrays = {key: random.normal(size=(n, 3)) for key in ("position", "velocity", "effort")}
    return encoder.encode({**stamp_columns(stamps), **arrays}, n)


def temperature_rows(stamps):
    """Serialized temperatures of these stamps, shape (n, size)."""
    columns = stamp_columns(stamps) | {"temperature": stamps / 1e9, "variance": 0}
    return Encoder(TEMPERATURE).encode(columns, len(stamps))


def write_bag(path, n=3000, compression="none", block=100):
    """Write n joint states at 1 kHz on /joints and one temperature per block on /heat."""
    with BagWriter(path, compression) as bag:
        bag.add_topic("/joints", JOINT_STATE)
        bag.add_topic("/heat", TEMPERATURE)
        for start in range(0, n, block):
            stamps = np.arange(start, min(n, start + block)) * 10**6 + 10**15
            bag.write("/joints", stamps, joint_rows(stamps, start))
            bag.write("/heat", stamps[:1], temperature_rows(stamps[:1]))
    return path / f"{path.name}_0.mcap"


@contextlib.contextmanager
def foreign_mcap(path, **options):
    """Open another writer's MCAP file with the topics /joints and /heat."""
    with path.open("wb") as file:
        options = {"compression": CompressionType.NONE, "chunk_size": 20_000} | options
        writer = Writer(file, **options)
        writer.start("ros2", "test")
        schema = {t: writer.register_schema(t, "ros2msg", b"") for t in (JOINT_STATE, TEMPERATURE)}
        writer.joints = writer.register_channel("/joints", "cdr", schema[JOINT_STATE])
        writer.heat = writer.register_channel("/heat", "cdr", schema[TEMPERATURE])
        yield writer
        writer.finish()


def read_all(path, topics=("/joints", "/heat")):
    """Read a bag: messages as (topic, log time, bytes) in the order delivered, and the reader."""
    reader = BagReader(path)
    found = []
    for part in reader.parts([t for t in topics if t in reader.topics]):
        assert part
        for topic, batch in part.items():
            assert topic == batch.topic
            assert len(batch)
            assert (np.diff(batch.log_time_ns) >= 0).all()
            found += [(topic, int(batch.log_time_ns[i]), batch.row(i)) for i in range(len(batch))]
    return found, reader


@pytest.fixture(scope="session")
def bags():
    return SimpleNamespace(
        JOINT_STATE=JOINT_STATE,
        TEMPERATURE=TEMPERATURE,
        CompressionType=CompressionType,
        Decoder=Decoder,
        IndexType=IndexType,
        foreign_mcap=foreign_mcap,
        joint_rows=joint_rows,
        read_all=read_all,
        temperature_rows=temperature_rows,
        write_bag=write_bag,
    )
