"""Message definitions: ROS 2 Jazzy's own, those of ros2_energy_msgs, a few of other packages."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from robot_energy.bag.cdr.schema import check_size
from robot_energy.foundation.errors import MessageTypeError
from robot_energy.foundation.shown_text import shown

if TYPE_CHECKING:
    from rosbags.interfaces.typing import Typesdict
    from rosbags.typesys.store import Typestore

ENERGY_PACKAGE = "ros2_energy_msgs"
_IDL_HEAD = re.compile(r"^={80}\r?\n(?:IDL: .*\n)?", re.MULTILINE)
_IDL_INCLUDE = re.compile(r"^[ \t]*#include.*$", re.MULTILINE)
"""Between the parts of a definition in IDL, and what names the parts, which the parser refuses."""
MAX_DEFINITION = 256 * 1024
"""Longest definition of a message with all that it is made of; those of ROS reach 60,000."""
MAX_DEFINITIONS = 4 * 2**20
"""All definitions of a bag that are parsed. [characters]"""
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
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
    "example_interfaces/msg/Float64": "float64 data\n",
    "example_interfaces/msg/Float64MultiArray": (
        "example_interfaces/MultiArrayLayout layout\nfloat64[] data\n"
    ),
    "example_interfaces/msg/MultiArrayLayout": (
        "example_interfaces/MultiArrayDimension[] dim\nuint32 data_offset\n"
    ),
    "example_interfaces/msg/MultiArrayDimension": "string label\nuint32 size\nuint32 stride\n",
}


@cache
def typestore() -> Typestore:
    """Return the message definitions of ROS 2 Jazzy, ros2_energy_msgs, and a few more.

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


def definition(name: str) -> str:
    """Return the text of a message of ours, with its comments.

    Args:
        name: Without the package, such as ``PowerState``.

    Raises:
        MessageTypeError: If there is none of this name.
    """
    path = _MSG_FOLDER / f"{name}.msg"
    if not path.is_file():
        known = ", ".join(sorted(each.stem for each in _MSG_FOLDER.glob("*.msg")))
        raise MessageTypeError(f"{ENERGY_PACKAGE} has no message {name}", f"one of {known}")
    return path.read_text(encoding="utf-8")


def extended(
    base: Typestore,
    definitions: Mapping[str, tuple[str, str]],
    report: Callable[[str], None] | None = None,
) -> Typestore:
    """Return a store that has ``definitions`` as well, and prefers them where they differ.

    A bag carries the definitions its messages were written with. They decide how the bytes lie,
    so where one differs from the definition known here, the bag's is right for that bag.

    Args:
        base: Known definitions; unchanged.
        definitions: Per message type its schema encoding (``ros2msg`` or ``ros2idl``) and text.
        report: Takes one sentence for each definition of a type unknown here that cannot be
            used, and for types that the definitions contradict each other about; None: the
            first one is an error.

    Returns:
        ``base`` itself when nothing differs, else a new store.

    Raises:
        MessageTypeError: If a definition cannot be parsed or is too large.
    """
    from rosbags.typesys.store import Typestore

    own: Typesdict = {}
    nested: Typesdict = {}
    room = MAX_DEFINITIONS
    # Known types first: what else a bag defines must not take their room.
    for msgtype in sorted(definitions, key=lambda name: name not in base.fielddefs):
        encoding, text = definitions[msgtype]
        try:
            room -= len(text)
            if len(text) > MAX_DEFINITION or room < 0:
                raise _unusable(msgtype, f"{len(text)} characters")
            for name, definition in _parsed(msgtype, encoding, text).items():
                (own if name == msgtype else nested).setdefault(name, definition)
        except MessageTypeError as error:
            if report is None or msgtype in base.fielddefs:
                raise
            report(str(error))
    found: Typesdict = {**nested, **own}
    if report is not None:
        for name in own.keys() & nested.keys():
            if own[name][1] != nested[name][1]:
                report(f"the bag defines {name} in two ways; its own definition was used")
    new: Typesdict = {
        name: definition
        for name, definition in found.items()
        if name not in base.fielddefs or base.fielddefs[name][1] != definition[1]
    }
    every, known = {**base.fielddefs, **new}, dict[str, int]()
    for name in list(new):
        try:
            check_size(name, every, known=known)
        except MessageTypeError as error:
            if report is None or name in base.fielddefs:
                raise
            report(str(error))
            del new[name]
    if not new:
        return base
    store = Typestore()
    store.fielddefs.update({k: v for k, v in base.fielddefs.items() if k not in new})
    store.types.update({k: v for k, v in base.types.items() if k not in new})
    for name, definition in new.items():
        try:
            store.register({name: definition})
        except Exception as error:  # it makes Python classes of what the bag says
            if report is None or name in base.fielddefs:
                raise _unusable(name, str(error)) from error
            report(str(_unusable(name, str(error))))
    return store


@lru_cache(maxsize=64)  # the bags of a fleet carry the same ones
def _parsed(msgtype: str, encoding: str, text: str) -> Typesdict:
    """Parse one definition; only names that can be names of messages and fields pass."""
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    try:
        if encoding == "ros2msg":
            found = get_types_from_msg(text, msgtype)
        elif encoding in {"ros2idl", "omgidl"}:
            found: Typesdict = {}
            for part in _IDL_HEAD.split(_IDL_INCLUDE.sub("", text)):  # the type, then its members
                found |= get_types_from_idl(part) if part.strip() else {}
        else:
            return {}
    except Exception as error:  # the parser raises many kinds on damaged text
        raise _unusable(msgtype, str(error)[:80]) from error
    for name, (constants, fields) in found.items():
        parts = [*name.split("/"), *(field[0] for field in (*constants, *fields))]
        if not all(_NAME.fullmatch(part) for part in parts):
            raise _unusable(msgtype, "a name that is none")
    return found


def _unusable(msgtype: str, why: str) -> MessageTypeError:
    return MessageTypeError(
        f"the definition of {shown(msgtype)} stored in the bag cannot be parsed ({shown(why)})",
        "a ROS 2 message definition",
        "check the bag with `ros2 bag info`, or leave that topic out",
    )
