"""Definitions and messages that grow beyond all bounds are refused before they are expanded."""

import time

import numpy as np
import pytest

from robot_energy.bag.cdr import Decoder, RawBatch, typestore
from robot_energy.bag.cdr import decode as layout
from robot_energy.bag.cdr.schema import MAX_DEPTH, MAX_FIELDS
from robot_energy.bag.cdr.types import MAX_DEFINITION, extended
from robot_energy.bag.cdr.walk import MAX_PARTS
from robot_energy.foundation.errors import MessageTypeError

RULE = "=" * 80
TYPE = "a/msg/T0"


def nested(levels, twice, leaf="float64 x\n"):
    """Text of a type that holds another, and so on; doubled at each level if ``twice``."""
    fields = ["a/T{0} l\na/T{0} r\n" if twice else "a/T{0} l\n"] * levels
    parts = [text.format(level + 1) for level, text in enumerate(fields)] + [leaf]
    heads = ["", *(f"{RULE}\nMSG: a/T{level}\n" for level in range(1, levels + 1))]
    return "".join(head + part for head, part in zip(heads, parts, strict=True))


@pytest.mark.parametrize(("levels", "twice"), [(40, True), (20, True), (900, False)])
@pytest.mark.parametrize("leaf", ["float64 x\n", ""])
def test_a_definition_that_nests_without_end_is_refused_at_once(levels, twice, leaf):
    text = nested(levels, twice, leaf)
    begin = time.process_time()
    with pytest.raises(MessageTypeError, match=r"deep|fields"):
        extended(typestore(), {TYPE: ("ros2msg", text)})
    assert time.process_time() - begin < 20


def test_three_thousand_levels_are_refused_as_text_or_as_depth():
    with pytest.raises(MessageTypeError):
        extended(typestore(), {TYPE: ("ros2msg", nested(3000, False))})


def test_what_cannot_be_used_is_left_out_and_the_rest_is_known():
    said = []
    store = extended(
        typestore(),
        {
            TYPE: ("ros2msg", nested(20, True)),
            "b/msg/Good": ("ros2msg", "float64 x\n"),
            "c/msg/Bad": ("ros2msg", "float64 = = x\n!!"),
            "d/msg/Long": ("ros2msg", "#" * (MAX_DEFINITION + 1)),
            "e/msg/Twice": ("ros2msg", "float64 x\nfloat64 x\n"),
        },
        said.append,
    )
    Decoder("b/msg/Good", ["x"], store)
    assert TYPE not in store.fielddefs
    assert len([text for text in said if "c/msg/Bad" in text]) == 1
    assert len([text for text in said if "d/msg/Long" in text]) == 1
    assert len([text for text in said if "e/msg/Twice" in text]) == 1
    assert any("has over" in text for text in said)


def test_a_known_type_that_cannot_be_used_is_an_error():
    """To read it by the definition known here would be a guess."""
    with pytest.raises(MessageTypeError):
        extended(typestore(), {"sensor_msgs/msg/JointState": ("ros2msg", "float64 = = x")}, print)


def test_the_definition_under_another_topic_does_not_replace_a_type_s_own():
    """A camera's definition could otherwise exchange the fields of joint states."""
    own, _ = typestore().generate_msgdef("sensor_msgs/msg/JointState", ros_version=2)
    other = f"sensor_msgs/JointState s\n{RULE}\nMSG: sensor_msgs/JointState\nfloat64[] velocity\n"
    for order in (1, -1):
        said = []
        definitions = {
            "sensor_msgs/msg/JointState": ("ros2msg", own),
            "a/msg/Camera": ("ros2msg", other),
        }
        store = extended(typestore(), dict(list(definitions.items())[::order]), said.append)
        Decoder("sensor_msgs/msg/JointState", ["position"], store)
        assert len(said) == 1
        assert "two ways" in said[0]


def test_a_type_of_very_many_fields_is_refused():
    text = "".join(f"float64 x{index}\n" for index in range(MAX_FIELDS + 1))
    with pytest.raises(MessageTypeError, match="fields"):
        extended(typestore(), {TYPE: ("ros2msg", text)})
    assert MAX_DEPTH < 100


def batch(kind, messages):
    return RawBatch.from_messages("/t", kind, np.arange(len(messages)), messages)


def names_message(names):
    """A JointState without numbers."""
    data = bytearray(b"\x00\x01\x00\x00" + bytes(8) + b"\x01\x00\x00\x00\x00")

    def number(value):
        data.extend(bytes(-(len(data) - 4) % 4) + value.to_bytes(4, "little"))

    number(len(names))
    for name in names:
        number(len(name) + 1)
        data.extend(name.encode() + b"\x00")
    for _ in range(3):
        number(0)
    return bytes(data)


def test_a_message_of_very_many_parts_is_malformed():
    decoder = Decoder("sensor_msgs/msg/JointState", ["name"])
    for count, good in ((MAX_PARTS, True), (MAX_PARTS + 1, False)):
        decoded = decoder.decode(batch("sensor_msgs/msg/JointState", [names_message("a" * count)]))
        assert bool(len(decoded.runs)) is good


def test_a_sequence_of_empty_messages_cannot_be_longer_than_its_bytes():
    store = extended(
        typestore(),
        {
            TYPE: ("ros2msg", f"a/E[] e\n{RULE}\nMSG: a/E\nuint8 X=1\n"),
        },
    )
    decoder = Decoder(TYPE, ["e.structure_needs_at_least_one_member"], store)
    data = b"\x00\x01\x00\x00" + b"\xff\xff\xff\xff"
    assert len(decoder.decode(batch(TYPE, [data])).malformed) == 1


def test_the_layouts_that_are_kept_are_bounded_in_memory(monkeypatch):
    monkeypatch.setattr(layout, "MAX_LAYOUT_BYTES", 10_000)
    decoder = Decoder("sensor_msgs/msg/JointState", ["name"])
    for index in range(30):
        message = names_message([f"j{index}_{joint}" for joint in range(index)])
        assert len(decoder.decode(batch("sensor_msgs/msg/JointState", [message])).runs) == 1
        assert decoder._kept_bytes <= 10_000
    assert decoder._kept_bytes == sum(one.memory for one in decoder._layouts.values())


def test_a_batch_falls_into_pieces_of_bounded_size():
    whole = batch("a", [bytes(size) for size in (10, 10, 50, 1, 1, 30, 30)])
    pieces = list(whole.pieces(40))
    assert [first for first, _ in pieces] == [0, 2, 3, 6]
    rows = [piece.row(i) for _, piece in pieces for i in range(len(piece))]
    assert rows == [whole.row(i) for i in range(7)]
    assert [first for first, _ in whole.pieces(1000)] == [0]
