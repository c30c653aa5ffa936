"""Message definitions: shared store, and those a bag brings along."""

from pathlib import Path

import pytest

import robot_energy.bag.cdr
from refusals import refused
from robot_energy.bag.cdr import Decoder, typestore
from robot_energy.bag.cdr.types import extended
from robot_energy.foundation.errors import MessageTypeError


def test_every_interface_file_is_known():
    folder = Path(robot_energy.bag.cdr.__file__).parent / "msg"
    names = {f"ros2_energy_msgs/msg/{path.stem}" for path in folder.glob("*.msg")}
    assert "ros2_energy_msgs/msg/JointTorque" in names
    assert names <= typestore().fielddefs.keys()


def test_the_hash_is_the_one_ros_computes():
    """Published with every ROS 2 Jazzy: type description hash of std_msgs/String."""
    assert typestore().hash_rihs01("std_msgs/msg/String") == (
        "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    )


def test_known_definitions_need_no_new_store():
    text = "std_msgs/Header header\nfloat64 temperature\nfloat64 variance\n"
    definitions = {"sensor_msgs/msg/Temperature": ("ros2msg", text)}
    assert extended(typestore(), definitions) is typestore()


def test_unknown_definitions_are_added_to_a_copy():
    definitions = {"my_msgs/msg/Volt": ("ros2msg", "std_msgs/Header header\nfloat32 volt\n")}
    store = extended(typestore(), definitions)
    Decoder("my_msgs/msg/Volt", ["volt", "header.stamp.sec"], store)
    assert "my_msgs/msg/Volt" not in typestore().fielddefs


def test_the_definition_a_bag_brings_is_preferred_where_it_differs():
    text = "std_msgs/Header header\nfloat32 temperature\n"
    store = extended(typestore(), {"sensor_msgs/msg/Temperature": ("ros2msg", text)})
    with pytest.raises(MessageTypeError):
        Decoder("sensor_msgs/msg/Temperature", ["variance"], store)
    Decoder("sensor_msgs/msg/Temperature", ["variance"])
    old = store.types["sensor_msgs/msg/Temperature"]
    header = store.types["std_msgs/msg/Header"](
        store.types["builtin_interfaces/msg/Time"](1, 2), ""
    )
    data = store.serialize_cdr(old(header, 2.5), "sensor_msgs/msg/Temperature")
    assert store.deserialize_cdr(data, "sensor_msgs/msg/Temperature").temperature == 2.5


LINE = "=" * 80
STATE_IDL = """
#include "std_msgs/msg/Header.idl"
module my_msgs { module msg {
  @verbatim (language="comment", text="A state" "\\n" "of a joint.")
  struct State { std_msgs::msg::Header header; sequence<double> position; };
}; };
"""
HEADER_IDL = """
#include "builtin_interfaces/msg/Time.idl"
module std_msgs { module msg {
  struct Header { builtin_interfaces::msg::Time stamp; string frame_id; };
}; };
"""


@pytest.mark.parametrize("first", ["", f"{LINE}\nIDL: my_msgs/msg/State\n"])
def test_a_definition_in_idl_has_its_parts_behind_lines(first):
    """As rosbag2 writes them: a line, then `IDL: package/msg/Name`, before each part."""
    text = f"{first}{STATE_IDL}\n{LINE}\nIDL: std_msgs/msg/Header\n{HEADER_IDL}"
    store = extended(typestore(), {"my_msgs/msg/State": ("ros2idl", text)})
    Decoder("my_msgs/msg/State", ["position", "header.stamp.sec"], store)


@pytest.mark.parametrize("encoding", ["ros2msg", "ros2idl"])
def test_a_definition_that_cannot_be_parsed_is_named(encoding):
    with refused(MessageTypeError, found="a/msg/B"):
        extended(typestore(), {"a/msg/B": (encoding, "float64 = = x\n!!")})


def test_wide_strings_are_refused():
    store = extended(typestore(), {"a/msg/W": ("ros2msg", "wstring text\n")})
    with refused(MessageTypeError, found="a/msg/wstring"):
        Decoder("a/msg/W", ["text"], store)
