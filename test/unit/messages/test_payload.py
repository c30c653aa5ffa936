"""The payload service and topic: what is asked, answered, written and read."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

import robots
from robot_energy.bag.cdr.decode import RawBatch
from robot_energy.bag.cdr.types import extended, typestore
from robot_energy.messages.payload import PayloadReader, PayloadWriter, answer_set_payload
from robot_energy.model.payload import payload
from robot_energy.pipeline import TorqueStage
from robot_energy.pipeline.torque_stage import PayloadChange

TYPE = "ros2_energy_msgs/msg/Payload"
BODY = payload("fore", 3.0, (0.25, 0.1, -0.2), (0.03, 0.04, 0.05, 1e-3, -2e-3, 3e-3))


@dataclass
class Time:
    sec: int = 0
    nanosec: int = 0


def request(link="fore", m=3.0, com=(0.25, 0.0, 0.0), stamp=None, **entries):
    """As rclpy has it."""
    inertia = SimpleNamespace(
        m=m,
        com=SimpleNamespace(**dict(zip("xyz", com, strict=True))),
        **{**dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), 0.0), **entries},
    )
    header = SimpleNamespace(stamp=stamp or Time(), frame_id=link)
    return SimpleNamespace(payload=SimpleNamespace(header=header, inertia=inertia))


def batch(*changes):
    writer = PayloadWriter("id")
    rows = [writer.encode(change)[0].tobytes() for change in changes]
    return RawBatch.from_messages("/energy/payload", TYPE, range(len(rows)), rows)


def test_message_says_what_was_set():
    row = PayloadWriter("id").encode(PayloadChange(12 * 10**9 + 34, BODY))
    found = typestore().deserialize_cdr(row.tobytes(), TYPE)
    assert (found.header.stamp.sec, found.header.stamp.nanosec) == (12, 34)
    assert (found.model_id, found.header.frame_id, found.inertia.m) == ("id", "fore", 3.0)
    com, body = found.inertia.com, found.inertia
    assert (com.x, com.y, com.z) == (0.25, 0.1, -0.2)
    tensor = [[body.ixx, body.ixy, body.ixz], [body.ixy, body.iyy, body.iyz]]
    assert tensor == BODY.tensor[:2].tolist()
    assert body.izz == 0.05


OLD = """std_msgs/Header header
string model_id
string link
float64 mass
float64[3] centre_of_mass
float64[6] inertia
"""


def test_messages_of_release_0_1_are_read_by_the_definition_of_their_bag():
    """Its inertia began with the diagonal: Ixx, Iyy, Izz, Ixy, Ixz, Iyz."""
    store = extended(typestore(), {TYPE: ("ros2msg", OLD)})
    kinds = store.types
    header = kinds["std_msgs/msg/Header"](kinds["builtin_interfaces/msg/Time"](0, 5), "fore")
    numbers = np.array([0.03, 0.04, 0.05, 1e-3, -2e-3, 3e-3])
    centre = np.array([0.25, 0.1, -0.2])
    message = kinds[TYPE](header, "id", "fore", 3.0, centre, numbers)
    row = bytes(store.serialize_cdr(message, TYPE))
    reader = PayloadReader(TorqueStage(robots.two_link()).set_payload, store)
    reader.step(RawBatch.from_messages("/energy/payload", TYPE, [0], [row]))
    assert reader.changes == [PayloadChange(5, BODY)]


def test_what_is_read_is_what_was_written_in_order_of_arrival():
    sent = [PayloadChange(5, BODY), PayloadChange(3, payload("upper", 1.0)), PayloadChange(9, BODY)]
    stage = TorqueStage(robots.two_link())
    reader = PayloadReader(stage.set_payload)
    reader.step(batch(*sent))
    assert reader.changes == sent
    assert [change.from_ns for change in stage.coming_payloads] == [3, 5, 9]
    assert (reader.rejections.received, reader.rejections.accepted) == (3, 3)


def test_impossible_payload_in_a_bag_is_counted_and_changes_nothing():
    bad = BODY.model_copy(update={"mass": -1.0})
    elsewhere = payload("hand", 1.0)
    stage = TorqueStage(robots.two_link())
    reader = PayloadReader(stage.set_payload)
    reader.step(batch(PayloadChange(1, bad), PayloadChange(2, elsewhere), PayloadChange(3, BODY)))
    assert reader.rejections.rejected == {"impossible_payload": 2}
    assert reader.rejections.balanced
    assert [change.payload for change in stage.coming_payloads] == [BODY]
    assert "hand" in reader.refused


def test_request_is_answered_with_what_holds_from_when():
    stage = TorqueStage(robots.two_link())
    answer = answer_set_payload(stage.set_payload, request(stamp=Time(2, 5)))
    assert answer.success
    assert answer.from_ns == 2 * 10**9 + 5
    assert "2.000 s" in answer.message
    assert [change.from_ns for change in stage.coming_payloads] == [answer.from_ns]
    taken_off = answer_set_payload(stage.set_payload, request(m=0.0))
    assert taken_off.message == "the robot carries nothing on 'fore' from the start"


def test_bodies_on_other_links_are_said_with_the_sum():
    model = robots.two_link(payload=[{"link": "upper", "mass": 3.0, "tag": "assumed"}])
    stage = TorqueStage(model)
    answer = answer_set_payload(stage.set_payload, request(m=2.0))
    assert answer.message.endswith("; 3 kg on 'upper' and 2 kg on 'fore', 5 kg in all")


def test_request_without_a_stamp_counts_from_the_next_joint_state():
    stage = TorqueStage(robots.two_link())
    stamp, zero = 7.0 + np.arange(10) / 100, np.zeros((10, 2))
    stage.step(robots.joint_block(stamp, zero, zero))
    for nothing in (Time(), Time(sec=-5)):
        answer = answer_set_payload(stage.set_payload, request(stamp=nothing))
        assert answer.from_ns == 7_090_000_001


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"m": -1.0}, "'mass' is -1.0"),
        ({"m": float("nan")}, "'mass' is nan"),
        ({"link": "hand"}, "link 'hand'"),
        ({"link": ""}, "link ''"),
        ({"ixx": 1.0, "iyy": 1.0, "izz": 3.0}, "sum of the other two"),
        ({"com": (np.inf, 0, 0)}, "'centre_of_mass.0' is inf"),
    ],
)
def test_bad_request_is_refused_with_a_sentence_and_the_old_payload_stays(change, words):
    stage = TorqueStage(robots.two_link())
    answer_set_payload(stage.set_payload, request())
    answer = answer_set_payload(stage.set_payload, request(**change))
    assert not answer.success
    assert words in answer.message
    assert answer.change is None
    assert answer.from_ns == 0
    assert len(stage.coming_payloads) == 1


@pytest.mark.parametrize(
    "change",
    [
        {"m": 1e308},
        {"m": 10_001.0},
        {"com": (0.0, 1e308, 0.0)},
        {"ixx": 1e308, "iyy": 1e308, "izz": 1e308},
        {"link": "fore\n[INFO] all is well"},
        {"link": "fore\x1b[31m"},
        {"link": "f" * 1_000_000},
        {"link": "\ud800"},
        {"stamp": Time(2**31 - 1, 0)},
        {"stamp": Time(2**31 - 1, 2**32 - 1)},
        {"stamp": Time(5, 10**9)},
    ],
    ids=repr,
)
def test_what_no_robot_carries_is_refused_in_one_short_line(change):
    stage = TorqueStage(robots.two_link())
    answer = answer_set_payload(stage.set_payload, request(**change))
    assert (answer.success, answer.from_ns) == (False, 0)
    assert answer.message.isprintable()
    assert len(answer.message) < 1000
    assert stage.coming_payloads == ()


def test_payload_with_a_bad_stamp_in_a_bag_is_counted():
    stage = TorqueStage(robots.two_link())
    reader = PayloadReader(stage.set_payload)
    message = bytearray(PayloadWriter("id").encode(PayloadChange(5, BODY))[0].tobytes())
    message[4:12] = np.array([2**31 - 1, 2**32 - 1], dtype="<u4").tobytes()
    reader.step(RawBatch.from_messages("/energy/payload", TYPE, [0], [bytes(message)]))
    assert reader.rejections.rejected == {"bad_stamp": 1}
    assert reader.rejections.balanced


def test_the_next_joint_state_sees_what_was_set_before_it():
    """Also before a torque has come; a change for later does not count yet."""
    stage = TorqueStage(robots.two_link())
    assert stage.next_payload == ()
    stage.set_payload(BODY)
    stage.set_payload(payload("fore", 99.0), 2 * 10**9)
    assert stage.next_payload == (BODY,)
    stage.set_payload(payload("fore", 0.0))
    assert stage.next_payload == ()
