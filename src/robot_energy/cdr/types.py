"""Message definitions: ROS 2 Jazzy's own, those of ros2_energy_msgs and a few of control_msgs."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rosbags.interfaces.typing import Typesdict
    from rosbags.typesys.store import Typestore

ENERGY_PACKAGE = "ros2_energy_msgs"
_MSG_FOLDER = Path(__file__).parent / "msg"
# Of packages that need not be installed, as far as they are read here.
_OPTIONAL = {
    "control_msgs/msg/DynamicJointState": (
        "std_msgs/Header header\nstring[] joint_names\n"
        "control_msgs/InterfaceValue[] interface_values\n"
    ),
    "control_msgs/msg/InterfaceValue": "string[] interface_names\nfloat64[] values\n",
    "control_msgs/msg/Float64Values": "std_msgs/Header header\nfloat64[] values\n",
    "control_msgs/msg/Keys": "std_msgs/Header header\nstring[] keys\n",
}


@cache
def typestore() -> Typestore:
    """Return the message definitions of ROS 2 Jazzy, ros2_energy_msgs and control_msgs (a few).

    The store is made at the first call and shared: take a copy to add types to it.

    Returns:
        The rosbags type store.
    """
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    definitions: Typesdict = {}
    for path in sorted(_MSG_FOLDER.glob("*.msg")):
        name = f"{ENERGY_PACKAGE}/msg/{path.stem}"
        definitions.update(get_types_from_msg(path.read_text(encoding="utf-8"), name))
    for name, text in _OPTIONAL.items():
        if name not in store.fielddefs:
            definitions.update(get_types_from_msg(text, name))
    store.register(definitions)
    return store


def extended(base: Typestore, definitions: dict[str, tuple[str, str]]) -> Typestore:
    """Return a store that knows ``definitions`` as well, and prefers them where they differ.

    A bag carries the definitions its messages were written with. They decide how the bytes lie,
    so where one differs from the definition known here, the bag's is right for that bag.

    Args:
        base: Known definitions; unchanged.
        definitions: Per message type its schema encoding (``ros2msg`` or ``ros2idl``) and text.

    Returns:
        ``base`` itself when nothing differs, else a new store.

    Raises:
        MessageTypeError: If a definition cannot be parsed.
    """
    from rosbags.typesys import get_types_from_idl, get_types_from_msg
    from rosbags.typesys.store import Typestore

    from robot_energy.errors import MessageTypeError

    found: Typesdict = {}
    for msgtype, (encoding, text) in definitions.items():
        try:
            if encoding == "ros2msg":
                found.update(get_types_from_msg(text, msgtype))
            elif encoding in {"ros2idl", "omgidl"}:
                found.update(get_types_from_idl(text))
        except Exception as error:  # the parser raises many kinds on damaged text
            raise MessageTypeError(
                f"the definition of {msgtype} stored in the bag cannot be parsed ({error})",
                "a ROS 2 message definition",
                "check the bag with `ros2 bag info`, or leave that topic out",
            ) from error
    new: Typesdict = {
        name: definition
        for name, definition in found.items()
        if name not in base.fielddefs or base.fielddefs[name][1] != definition[1]
    }
    if not new:
        return base
    store = Typestore()
    store.fielddefs.update({k: v for k, v in base.fielddefs.items() if k not in new})
    store.types.update({k: v for k, v in base.types.items() if k not in new})
    store.register(new)
    return store
