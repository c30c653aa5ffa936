"""A bag gives the same energy to the bit, in whatever order its topics were written."""

from itertools import permutations

import numpy as np
import pytest

from places import ROOT
from robot_energy.bag import BagReader, BagWriter
from robot_energy.model import load
from robot_energy.replay.bag_replay import replay

BAG = ROOT / "bags/kr16_cold"


@pytest.fixture(scope="module")
def reference():
    return replay(BAG, load("kr16"))


@pytest.mark.parametrize("order", [*permutations(BagReader(BAG).topics)])
def test_topics_one_behind_the_other_give_the_same_registers(order, reference, tmp_path):
    source = BagReader(BAG)
    with BagWriter(tmp_path / "bag") as writer:
        for topic in order:
            writer.add_topic(topic, source.topics[topic].msgtype)
        for topic in order:
            for part in source.parts([topic]):
                batch = part[topic]
                rows = [batch.row(row) for row in range(len(batch))]
                writer.write(topic, batch.log_time_ns, rows)
    result = replay(tmp_path / "bag", load("kr16"))
    np.testing.assert_array_equal(
        result.account.registers.microjoule, reference.account.registers.microjoule
    )
    assert result.account.counts.quality == reference.account.counts.quality
    assert result.notes == reference.notes
