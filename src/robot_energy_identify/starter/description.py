"""The URDF of a robot from a file, from xacro, or from a bag that recorded it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import field
from importlib.util import find_spec
from pathlib import Path
from shutil import which
from typing import Annotated, Any

from robot_energy.bag import BagReader
from robot_energy.foundation.config_file import read_text
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import BagError, RobotDescriptionError
from robot_energy.foundation.files.regular_file import xml_encoding
from robot_energy.foundation.shown_text import shown
from robot_energy.inputs.joint_states.decode import JOINT_STATE
from robot_energy.physics.urdf.parse import MAX_URDF_BYTES

TOPIC = "robot_description"
MAX_XACRO_TIME = 60.0  # [s]
MAX_REASON = 600  # characters of what xacro prints
_STRING = "std_msgs/msg/String"


class RobotText(Described):
    """A URDF and where it comes from."""

    xml: str
    origin: Annotated[str, "In words, for comments and messages."]
    path: Annotated[Path | None, "Its file; None if the text must be embedded."] = None
    joint_names: Annotated[
        tuple[str, ...], "Joints that a bag has joint states of; empty if unknown."
    ] = field(default=())


def read_description(source: str | Path, arguments: Sequence[str] = ()) -> RobotText:
    """Return the text of a URDF, not checked yet: of a file, expanded from xacro, or in a bag."""
    path = Path(source)
    if path.is_dir() or path.suffix in (".mcap", ".db3", ".zstd"):
        return _from_bag(path)
    text = read_text(
        path,
        RobotDescriptionError,
        "robot description",
        max_bytes=MAX_URDF_BYTES,
        expected="a URDF, a xacro file or a bag",
        encoding_of=xml_encoding,
    )
    if path.suffix == ".xacro" or "<xacro:" in text:
        xml = _expanded(path, arguments)
        if "<xacro:macro" in text and "<link" not in xml:
            raise RobotDescriptionError(
                f"{path} has no links: it only defines macros",
                "a xacro file that makes a robot",
                "name the file that includes this one and calls its macros; it often ends in "
                ".urdf.xacro",
            )
        return RobotText(xml, f"xacro file {path.name}")
    if arguments:
        raise RobotDescriptionError(
            f"{path} is not a xacro file, but xacro arguments are given: {' '.join(arguments)}",
            "a xacro file, or no arguments",
        )
    return RobotText(text, f"URDF {path.name}", path)


def _expanded(path: Path, arguments: Sequence[str]) -> str:
    """Run xacro, which resolves packages and evaluates expressions as the robot's driver does."""
    wrong = [word for word in arguments if ":=" not in word]
    if wrong:
        raise RobotDescriptionError(
            f"'{wrong[0]}' is not an argument of xacro", "name:=value, such as ur_type:=ur5e"
        )
    program = which("xacro")
    if program is None and find_spec("xacro") is None:
        raise RobotDescriptionError(
            f"{path} is a xacro file, and xacro is not installed",
            "a URDF, or xacro on this machine",
            "install it (pip install xacro, or apt install ros-jazzy-xacro), or expand the file "
            "where it is installed: xacro FILE > robot.urdf",
        )
    # In an environment that is not on the path there is the module alone, which `-m` cannot run.
    command = [program] if program else [sys.executable, "-c", "import xacro; xacro.main()"]
    try:
        # The user's own file, named on the command line; xacro evaluates its expressions.
        done = subprocess.run(
            [*command, str(path), *arguments],
            capture_output=True,
            timeout=MAX_XACRO_TIME,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise RobotDescriptionError(
            f"xacro did not finish with {path} ({error})", "a xacro file that expands"
        ) from error
    text, said = done.stdout.decode("utf-8", "replace"), done.stderr.decode("utf-8", "replace")
    if done.returncode or not text.strip():
        raise RobotDescriptionError(
            f"xacro cannot expand {path}: {_reason(said)}",
            "a xacro file whose packages and arguments are known",
            "source the workspace of the robot's description, and pass its arguments as "
            "name:=value after the file",
        )
    return text


def _reason(said: str) -> str:
    """Return what xacro prints of an error, its reason first, without warnings, in a line."""
    lines = [line.strip() for line in said.splitlines()]
    kept = [line for line in lines if line and not line.startswith("warning:")]
    if "Traceback (most recent call last):" in kept:
        kept = kept[-1:]
    text = "; ".join(line.removeprefix("error:").strip() for line in kept)
    return shown(text, MAX_REASON) or "it printed nothing"


def _from_bag(path: Path) -> RobotText:
    bag = BagReader(path)
    topics = [
        name
        for name, info in bag.topics.items()
        if info.msgtype == _STRING and name.split("/")[-1] == TOPIC
    ]
    if len(topics) != 1:
        found = f"topics {', '.join(topics)}" if topics else f"no topic {TOPIC}"
        raise BagError(
            f"{path} has {found} of type {_STRING}",
            "one recorded robot description",
            "give the URDF or xacro file of the robot instead",
        )
    names: dict[str, None] = {}  # in the first joint states of each topic
    for topic, info in bag.topics.items():
        if info.msgtype == JOINT_STATE and info.encoding == "cdr" and info.message_count != 0:
            names.update(dict.fromkeys(str(name) for name in _first(bag, topic).name))
    xml = str(_first(bag, topics[0]).data)
    return RobotText(xml, f"{topics[0]} of {path.name}", None, tuple(names))


def _first(bag: BagReader, topic: str) -> Any:
    for part in bag.parts([topic]):
        batch = part[topic]
        try:
            return bag.typestore.deserialize_cdr(batch.row(0), batch.msgtype)
        except Exception as error:
            raise BagError(
                f"the first message of {topic} in {bag.path} cannot be decoded "
                f"({type(error).__name__})",
                f"a {batch.msgtype}",
            ) from error
    raise BagError(f"{topic} of {bag.path} holds no message", "one message at least")
