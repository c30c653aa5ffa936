"""The metadata.yaml of a rosbag2 folder, and which bags this library wrote."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Annotated, Any, cast

from robot_energy.foundation.config_file import MAX_BYTES, parse_yaml
from robot_energy.foundation.errors import BagError
from robot_energy.foundation.files.first_bytes import MCAP
from robot_energy.foundation.files.regular_file import (
    open_regular,
    read_regular_text,
    why_unreadable,
)

LIBRARY = "robot_energy"  # in the header of every MCAP file that `BagWriter` makes
_HEADER = 1  # opcode
_MAX_HEADER_BYTES = 512
_MAX_METADATA_BYTES = 2**20
_METADATA_START = b"rosbag2_bagfile_information:"


def foreign_entries(folder: Path) -> list[str]:
    """Return what in a folder is not of one bag of this library: an MCAP file and metadata."""
    names = sorted(entry.name for entry in folder.iterdir())
    own = [name for name in names if name.endswith(".mcap") and _is_own(folder / name)]
    text = _start(folder / FILE_NAME, _MAX_METADATA_BYTES)
    if len(own) == 1 and text.startswith(_METADATA_START) and os.fsencode(own[0]) in text:
        return [name for name in names if name not in (*own, FILE_NAME)]
    return names


def _is_own(path: Path) -> bool:
    start = _start(path, _MAX_HEADER_BYTES)
    if not start.startswith(MCAP) or start[8:9] != bytes([_HEADER]):
        return False
    _, rest = _text(start[17:])  # profile and library, behind the length of the record
    library, _ = _text(rest)
    return library == LIBRARY.encode()


def _text(data: bytes) -> tuple[bytes, bytes]:
    """A text behind its length, and what follows it."""
    end = 4 + int.from_bytes(data[:4], "little")
    return data[4:end], data[end:]


def _start(path: Path, size: int) -> bytes:
    """The first bytes of a plain file; none of anything else."""
    with suppress(OSError):
        if not path.is_symlink():
            with open_regular(path) as file:
                return file.read(size)
    return b""


FILE_NAME = "metadata.yaml"
ORIGIN_KEY = "origin"
_FOREVER = "\n    sec: 9223372036\n    nsec: 854775807"


@dataclass(frozen=True, slots=True)
class Qos:
    """Quality of service a topic was published with."""

    reliable: bool = True
    latched: Annotated[
        bool, "Whether late subscribers get the last messages (transient local)."
    ] = False
    depth: Annotated[int, "Length of the publisher's queue. [messages]"] = 10


DEFAULT_QOS = Qos()
SENSOR_QOS = Qos(reliable=False, depth=5)
LATCHED_QOS = Qos(latched=True, depth=1)


@dataclass(frozen=True, slots=True)
class TopicEntry:
    """A topic as the metadata lists it."""

    name: str
    msgtype: str
    qos: Qos
    type_hash: str
    message_count: int


@dataclass(frozen=True, slots=True)
class FolderInfo:
    """What is needed from metadata.yaml to read a folder."""

    compression_mode: str
    files: tuple[str, ...]
    origin: str
    message_count: int | None


def qos_yaml(qos: Qos) -> str:
    """Return one offered QoS profile in YAML, version 9 of the metadata."""
    return (
        "- history: keep_last\n"
        f"  depth: {qos.depth}\n"
        f"  reliability: {'reliable' if qos.reliable else 'best_effort'}\n"
        f"  durability: {'transient_local' if qos.latched else 'volatile'}\n"
        f"  deadline:{_FOREVER}\n"
        f"  lifespan:{_FOREVER}\n"
        "  liveliness: automatic\n"
        f"  liveliness_lease_duration:{_FOREVER}\n"
        "  avoid_ros_namespace_conventions: false\n"
    )


def metadata_yaml(
    topics: Sequence[TopicEntry],
    file: str | None,
    start_ns: int,
    duration_ns: int,
    count: int,
    origin: str = "",
) -> str:
    """Return the text of metadata.yaml; without a file, of the copy inside of the bag file."""
    span = (
        f"starting_time:\n  nanoseconds_since_epoch: {start_ns}\n"
        f"duration:\n  nanoseconds: {duration_ns}\n"
        f"message_count: {count}\n"
    )
    lines = ["version: 9\nstorage_identifier: mcap\n", span]
    lines.append("topics_with_message_count:\n" if topics else "topics_with_message_count: []\n")
    for topic in topics:
        lines.append(
            "  - topic_metadata:\n"
            f"      name: {_scalar(topic.name)}\n"
            f"      type: {_scalar(topic.msgtype)}\n"
            "      serialization_format: cdr\n"
            f"      offered_qos_profiles:\n{_indent(qos_yaml(topic.qos), 8)}"
            f"      type_description_hash: {_scalar(topic.type_hash)}\n"
            f"    message_count: {topic.message_count}\n"
        )
    lines.append('compression_format: ""\ncompression_mode: ""\n')
    if file is None:
        lines.append("relative_file_paths: []\nfiles: []\n")
    else:
        entry = _indent(f"path: {_scalar(file)}\n{span}", 4)
        lines.append(f"relative_file_paths:\n  - {_scalar(file)}\nfiles:\n  - {entry.lstrip()}")
    custom = f"\n  {ORIGIN_KEY}: {json.dumps(origin)}" if origin else " ~"
    lines.append(f"custom_data:{custom}\nros_distro: jazzy\n")
    return "rosbag2_bagfile_information:\n" + _indent("".join(lines), 2)


def read_folder_info(folder: Path) -> FolderInfo:
    """Return compression and files, in the order recorded, from metadata.yaml."""
    path = folder / FILE_NAME
    try:
        content: Any = parse_yaml(read_regular_text(path, MAX_BYTES), str(path), BagError)
        info = cast("Mapping[str, Any]", content["rosbag2_bagfile_information"])
        custom = cast("Mapping[str, Any]", info.get("custom_data") or {})
        mode = str(info.get("compression_mode") or "").lower()
        return FolderInfo(
            "" if mode == "none" else mode,
            tuple(PurePath(str(name)).name for name in info["relative_file_paths"]),
            str(custom.get(ORIGIN_KEY) or ""),
            count if isinstance(count := info.get("message_count"), int) else None,
        )
    except BagError:
        raise
    except (OSError, UnicodeDecodeError) as error:
        raise BagError(
            f"{path} cannot be read ({why_unreadable(error)})", "a metadata.yaml of rosbag2"
        ) from error
    except ValueError as error:
        raise BagError(
            f"{path} cannot be read ({str(error).splitlines()[0]})", "a metadata.yaml of rosbag2"
        ) from error
    except (KeyError, TypeError, AttributeError) as error:
        raise BagError(
            f"{path} is not metadata of a bag: {error!r} is missing or misplaced",
            "a metadata.yaml of rosbag2",
        ) from error


def _scalar(text: str) -> str:
    plain = re.fullmatch(r"[A-Za-z/_][\w/.~-]*", text) and text.lower() not in {
        "null", "true", "false", "yes", "no", "on", "off", "y", "n",
    }  # fmt: skip
    return text if plain else json.dumps(text)


def _indent(text: str, by: int) -> str:
    return "".join(f"{' ' * by}{line}\n" for line in text.splitlines())
