"""Log times that are not stamps: the order of the file counts, and nothing raises."""

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

from logbook import wheel_bag, wheel_model
from robot_energy.bag import BagReader
from robot_energy.inputs.joint_states.joint_states import JOINT_STATE
from robot_energy.inputs.sources import JointStateSource
from robot_energy.model import load
from robot_energy.replay.bag_replay import replay
from robot_energy.replay.setup import ReplaySetup

TOPIC = "/joint_states"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The joint states of a small bag, and the model of its robot."""
    folder = tmp_path_factory.mktemp("wheel")
    messages = []
    for part in BagReader(wheel_bag(folder, None)).parts([TOPIC]):
        batch = part[TOPIC]
        messages += [(int(batch.log_time_ns[i]), batch.row(i)) for i in range(len(batch))]
    return messages, load(wheel_model(folder))


def written(path, messages):
    """An MCAP file, as any recorder may write it."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=20_000, compression=CompressionType.NONE)
        writer.start("ros2", "test")
        schema = writer.register_schema(JOINT_STATE, "ros2msg", b"")
        channel = writer.register_channel(TOPIC, "cdr", schema)
        for log_ns, row in messages:
            writer.add_message(channel, log_ns, row, log_ns)
        writer.finish()
    return path


@pytest.mark.parametrize("row", [0, 500, -1])
@pytest.mark.parametrize("log_ns", [2**63 - 1, 2**63, 2**64 - 1, 2**61])
def test_a_log_time_beyond_all_stamps_costs_its_own_message_at_most(wheel, tmp_path, row, log_ns):
    messages, model = wheel
    clean = replay(written(tmp_path / "clean.mcap", messages), model)
    odd = list(messages)
    odd[row] = (log_ns, odd[row][1])
    path = written(tmp_path / "odd.mcap", odd)
    by_header = replay(path, model)
    assert by_header.joint_states.rejections == clean.joint_states.rejections
    np.testing.assert_array_equal(
        by_header.account.registers.microjoule, clean.account.registers.microjoule
    )
    received = replay(path, model, ReplaySetup(states=JointStateSource(stamp_source="receive")))
    assert received.joint_states.rejections.rejected == {"bad_stamp": 1}
    del odd[row]
    rest = replay(
        written(tmp_path / "rest.mcap", odd),
        model,
        ReplaySetup(states=JointStateSource(stamp_source="receive")),
    )
    np.testing.assert_array_equal(
        received.account.registers.microjoule, rest.account.registers.microjoule
    )
