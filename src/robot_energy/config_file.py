"""YAML -> plain values, safely: bounded, without tags, aliases and repeated keys.

The whole document is looked through as events, which needs no memory and no recursion, before
anything is made of it. The C parser does the work where PyYAML has it.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import TYPE_CHECKING, Any

import yaml

from robot_energy.errors import ModelFileError, RobotEnergyError

if TYPE_CHECKING:
    _Base = yaml.SafeLoader
else:
    _Base = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

MAX_BYTES = 8 * 1024 * 1024  # an embedded URDF and large maps fit
MAX_NODES = 200_000  # keys and values; a large efficiency map has some thousands
MAX_DEPTH = 50  # a model file has eight
LARGEST_INTEGER = 2**63


class _Loader(_Base):
    """Safe YAML that refuses repeated keys and integers no machine holds."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[str] = set()
        for key, _ in node.value:
            text = str(key.value)
            if text in seen:
                raise ModelFileError(
                    f"the key '{text}' stands twice, again at line {key.start_mark.line + 1}",
                    "each key once",
                )
            seen.add(text)
        return super().construct_mapping(node, deep=deep)

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        if len(node.value) > 4 * LARGEST_INTEGER.bit_length():
            raise ValueError("an integer of too many digits")
        value = super().construct_yaml_int(node)
        if abs(value) > LARGEST_INTEGER:
            raise ValueError("an integer beyond 64 bits")
        return value


_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_yaml_int)


def parse_yaml(text: str, source: str, error: type[RobotEnergyError] = ModelFileError) -> Any:
    """Parse one YAML document.

    Args:
        text: The document.
        source: Its name, for messages.
        error: What to raise.

    Returns:
        Plain Python values.

    Raises:
        RobotEnergyError: The error asked for, if the text is not YAML, is too large or too deep,
            or holds tags, aliases or repeated keys.
    """
    if len(text) > MAX_BYTES:
        raise error(f"{source} has {len(text)} characters", f"at most {MAX_BYTES}")
    try:
        _look_through(text)
        return yaml.load(text, Loader=_Loader)
    except ModelFileError as found:
        raise error(f"{source}: {found.found}", found.expected, found.remedy) from None
    except (yaml.YAMLError, RecursionError, ValueError) as found:
        mark = getattr(found, "problem_mark", None)
        where = f" at line {mark.line + 1}" if mark is not None else ""
        problem = getattr(found, "problem", None) or _told(found)
        raise error(f"{source} is not valid YAML{where}: {problem}") from found


def _told(error: Exception) -> str:
    """What an error without a mark says; only its kind if that is more than a line."""
    text = str(error)
    return text if text and "\n" not in text and len(text) < 80 else type(error).__name__


def _look_through(text: str) -> None:
    """Refuse what would blow up when values are made of it."""
    depth = nodes = 0
    for event in yaml.parse(text, Loader=_Loader):
        if isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
            continue
        if not isinstance(event, yaml.NodeEvent):
            continue
        where = f"at line {event.start_mark.line + 1}" if event.start_mark else "somewhere"
        if isinstance(event, yaml.AliasEvent):
            raise ModelFileError(
                f"a YAML alias (*name) {where}", "plain values", "write the value out"
            )
        tag = getattr(event, "tag", None)
        if tag is not None:
            raise ModelFileError(f"the YAML tag {tag} {where}", "plain values")
        nodes += 1
        depth += isinstance(event, yaml.CollectionStartEvent)
        if depth > MAX_DEPTH:
            raise ModelFileError(f"more than {MAX_DEPTH} levels {where}", "a flatter file")
        if nodes > MAX_NODES:
            raise ModelFileError(f"more than {MAX_NODES} keys and values {where}", "fewer")
