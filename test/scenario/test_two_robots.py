"""Two robots of one type in one bag, each in its namespace: what is found by type is its own."""

from collections.abc import Mapping

import pytest

from places import ROOT
from robot_energy.bag import BagReader, BagWriter
from robot_energy.model import load
from robot_energy.replay.bag_replay import replay
from robot_energy.replay.setup import ReplaySetup, Topics
from robot_energy.results.replay import replay_report

RIGHT, LEFT = ROOT / "bags/kr16_cold", ROOT / "bags/kr16_warm"
TEMPERATURES, METER = "/motor_temperatures", "/power_meter"
STATES = Topics(joint_states=("/right/joint_states",))


def both(path, without: Mapping[str, tuple[str, ...]]):
    """A bag with the topics of both recordings, some left out."""
    with BagWriter(path) as writer:
        for space, source in (("/right", RIGHT), ("/left", LEFT)):
            bag = BagReader(source)
            kept = {
                topic: info.msgtype
                for topic, info in bag.topics.items()
                if topic not in without.get(space, ())
            }
            for topic, kind in kept.items():
                writer.add_topic(space + topic, kind)
            for part in bag.parts(kept):
                for topic, batch in part.items():
                    rows = [batch.row(row) for row in range(len(batch))]
                    writer.write(space + topic, batch.log_time_ns, rows)
    return path


def test_temperatures_and_meter_of_the_other_robot_are_left_alone(tmp_path):
    result = replay(both(tmp_path / "bag", {}), load("kr16"), ReplaySetup(topics=STATES))
    alone = replay(RIGHT, load("kr16"))
    assert result.topics.temperatures == ("/right" + TEMPERATURES,)
    assert result.topics.meter == "/right" + METER
    assert replay_report(result).energy == replay_report(alone).energy
    assert result.notes == alone.notes


@pytest.mark.parametrize(
    ("topic", "option"), [(TEMPERATURES, "--temperatures"), (METER, "--meter")]
)
def test_what_only_the_other_robot_has_is_not_used_and_said(tmp_path, topic, option):
    result = replay(
        both(tmp_path / "bag", {"/right": (topic,)}), load("kr16"), ReplaySetup(topics=STATES)
    )
    assert ("/left" + topic) not in (*(result.topics.temperatures or ()), result.topics.meter)
    assert [note for note in result.notes if "/left" + topic in note and option in note]


def test_topics_that_bring_the_same_joint_are_named(tmp_path):
    given = Topics(STATES.joint_states, ("/right" + TEMPERATURES, "/left" + TEMPERATURES))
    result = replay(both(tmp_path / "bag", {}), load("kr16"), ReplaySetup(topics=given))
    assert [note for note in result.notes if "all bring temperatures of joint_a1, joint_a2" in note]
