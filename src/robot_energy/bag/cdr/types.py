"""Message definitions: ROS 2 Jazzy's own, those of ros2_energy_msgs, a few of other packages."""

from __future__ import annotations

import re
from collections import ChainMap
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

    from robot_energy.bag.cdr.lazy_store import LazyStore

ENERGY_PACKAGE = "ros2_energy_msgs"
_IDL_HEAD = re.compile(r"^={80}\r?\n(?:IDL: .*\n)?", re.MULTILINE)
_IDL_INCLUDE = re.compile(r"^[ \t]*#include.*$", re.MULTILINE)
"""Between the parts of a definition in IDL, and what names the parts, which the parser refuses."""
MAX_DEFINITION = 256 * 1024
"""Longest definition of a message with all that it is made of; those of ROS reach 60,000."""
MAX_DEFINITIONS = 4 * 2**20  # all definitions of a bag that are parsed [characters]
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_MSG_FOLDER = Path(__file__).parent / "msg"
# Of packages that need not be installed, as far as they are read here, and the most frequent ones
# of ROS: to load all of Jazzy takes 0.2 s.
_TEXTS = {
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec\n",
    "builtin_interfaces/msg/Duration": "int32 sec\nuint32 nanosec\n",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "std_msgs/msg/String": "string data\n",
    "std_msgs/msg/Float64": "float64 data\n",
    "geometry_msgs/msg/Inertia": (
        "float64 m\ngeometry_msgs/Vector3 com\nfloat64 ixx\nfloat64 ixy\nfloat64 ixz\n"
        "float64 iyy\nfloat64 iyz\nfloat64 izz\n"
    ),
    "geometry_msgs/msg/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "sensor_msgs/msg/JointState": (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n"
        "float64[] effort\n"
    ),
    "sensor_msgs/msg/Temperature": (
        "std_msgs/Header header\nfloat64 temperature\nfloat64 variance\n"
    ),
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
def typestore() -> LazyStore:
    """Return the message definitions of ROS 2 Jazzy, ros2_energy_msgs, and a few more.

    The store is made at the first call and shared: take a copy to add types to it.
    """
    from robot_energy.bag.cdr.lazy_store import LazyStore

    return LazyStore(_shipped, _all_known)


@cache
def _all_known() -> Typestore:
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    ours = [f"{ENERGY_PACKAGE}/msg/{path.stem}" for path in sorted(_MSG_FOLDER.glob("*.msg"))]
    definitions: Typesdict = {}
    for name in (*ours, *_TEXTS):
        if name not in store.fielddefs:
            definitions.update(_shipped(name))
    store.register(definitions)
    return store


def _shipped(name: str) -> Typesdict:
    """Return one definition whose text is here, or nothing."""
    package, _, stem = name.partition("/msg/")
    if package == ENERGY_PACKAGE and (_MSG_FOLDER / f"{stem}.msg").is_file():
        return _parsed(name, "ros2msg", definition(stem))
    return _parsed(name, "ros2msg", _TEXTS[name]) if name in _TEXTS else {}


def definition(name: str) -> str:
    path = _MSG_FOLDER / f"{name}.msg"
    if not path.is_file():
        known = ", ".join(sorted(each.stem for each in _MSG_FOLDER.glob("*.msg")))
        raise MessageTypeError(f"{ENERGY_PACKAGE} has no message {name}", f"one of {known}")
    return path.read_text(encoding="utf-8")


def extended(
    base: LazyStore,
    definitions: Mapping[str, tuple[str, str]],
    report: Callable[[str], None] | None = None,
) -> LazyStore:
    """Return a store that has ``definitions`` as well, and prefers them where they differ.

    A bag carries the definitions its messages were written with. They decide how the bytes lie,
    so where one differs from the definition known here, the bag's is right for that bag.

    Args:
        definitions: Per message type its schema encoding (``ros2msg`` or ``ros2idl``) and text.

    Returns:
        ``base`` itself if all are known to be the same without a look at all of Jazzy, else a
        new store.
    """
    from robot_energy.bag.cdr.lazy_store import LazyStore

    own: Typesdict = {}
    nested: Typesdict = {}
    room = MAX_DEFINITIONS
    # Known types first: what else a bag defines must not take their room.
    for msgtype in sorted(definitions, key=lambda name: not base.quick(name)):
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
    if report is not None:
        for name in own.keys() & nested.keys():
            if own[name][1] != nested[name][1]:
                report(f"the bag defines {name} in two ways; its own definition was used")
    new: Typesdict = {
        name: definition
        for name, definition in {**nested, **own}.items()
        if not base.quick(name) or base.fielddefs[name][1] != definition[1]
    }
    every, sizes = ChainMap(dict(new), base.fielddefs), dict[str, int]()
    for name in list(new):
        try:
            check_size(name, every, known=sizes)
        except MessageTypeError as error:
            if report is None or name in base.fielddefs:
                raise
            report(str(error))
            del new[name]
    if not new:
        return base

    def find(name: str) -> Typesdict:
        if name in new or not base.quick(name):
            return {name: new[name]} if name in new else {}
        return {name: base.fielddefs[name]}

    def load() -> Typestore:
        return _with_classes(base, new, report)

    return LazyStore(find, cache(load))


def _with_classes(
    base: Typestore, new: Typesdict, report: Callable[[str], None] | None
) -> Typestore:
    """Return a store of all types, in which ``new`` takes the place of those of ``base``."""
    from rosbags.typesys.store import Typestore

    store = Typestore()
    store.fielddefs.update({k: v for k, v in base.fielddefs.items() if k not in new})
    store.types.update({k: v for k, v in base.types.items() if k not in new})
    for name, definition in new.items():
        try:
            store.register({name: definition})
        except Exception as error:  # it makes Python classes of what the bag says
            if report is None:
                raise _unusable(name, str(error)) from error
            report(str(_unusable(name, str(error))))
    return store


def differs(store: Typestore, definitions: Mapping[str, tuple[str, str]]) -> bool:
    return any(
        name in store.fielddefs and store.fielddefs[name][1] != definition[1]
        for msgtype, (encoding, text) in definitions.items()
        for name, definition in _parsed(msgtype, encoding, text).items()
    )


@lru_cache(maxsize=64)  # the bags of a fleet carry the same ones
def _parsed(msgtype: str, encoding: str, text: str) -> Typesdict:
    """Parse one definition; only names that can be names of messages and fields pass."""
    from rosbags.interfaces import Nodetype
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
        if len({field[0] for field in (*constants, *fields)}) < len(constants) + len(fields):
            raise _unusable(msgtype, "two fields of one name")
        if not fields:  # as ROS generates it: a structure of C holds at least one byte
            fields.append(("structure_needs_at_least_one_member", (Nodetype.BASE, ("uint8", 0))))
    return found


def _unusable(msgtype: str, why: str) -> MessageTypeError:
    return MessageTypeError(
        f"the definition of {shown(msgtype)} stored in the bag cannot be parsed ({shown(why)})",
        "a ROS 2 message definition",
        "check the bag with `ros2 bag info`, or leave that topic out",
    )
