"""Configuration files: YAML -> plain values -> a validated model, or one sentence why not.

Bounded, without tags, aliases and repeated keys: the whole document is looked through as
events, which needs no memory and no recursion, before anything is made of it. The C parser does
the work where PyYAML has it.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import yaml

from robot_energy.foundation.errors import ModelFileError, RobotEnergyError
from robot_energy.foundation.files.regular_file import DECLARE, read_regular_text, why_unreadable

if TYPE_CHECKING:
    from pydantic import BaseModel

    _Base = yaml.SafeLoader
else:
    _Base = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

MAX_BYTES = 8 * 1024 * 1024  # an embedded URDF and large maps fit
MAX_NODES = 200_000  # keys and values; a large efficiency map has some thousands
MAX_DEPTH = 50  # a model file has eight
MAX_INTEGER = 2**64 - 1  # unsigned registers of 64 bits reach it

M = TypeVar("M", bound="BaseModel")


class _Loader(_Base):
    """Safe YAML that refuses repeated keys and integers no machine holds."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[str] = set()
        for key, _ in node.value:
            text = str(key.value)
            if text in seen:
                raise ModelFileError(
                    f"the key '{text}' is given twice, the second time at line "
                    f"{key.start_mark.line + 1}",
                    "each key once",
                )
            seen.add(text)
        return super().construct_mapping(node, deep=deep)

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        if len(node.value) > 4 * MAX_INTEGER.bit_length():
            raise ValueError("an integer of too many digits")
        value = super().construct_yaml_int(node)
        if abs(value) > MAX_INTEGER:
            raise ValueError("an integer beyond 64 bits")
        return value


_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_yaml_int)


def load(
    path: str | Path,
    model: type[M],
    error: type[RobotEnergyError],
    what: str = "configuration file",
    remedy: str = "",
) -> M:
    text = read_text(path, error, what, remedy=remedy)
    return validated(parse_yaml(text, str(path), error), model, str(path), error)


def read_text(
    path: str | Path,
    error: type[RobotEnergyError],
    what: str,
    max_bytes: int = MAX_BYTES,
    expected: str = "a YAML file",
    remedy: str = "",
    encoding_of: Callable[[bytes], str] | None = None,
) -> str:
    """Return the text of a regular file, UTF-8 by default; pipes and devices are refused."""
    try:
        return read_regular_text(path, max_bytes, encoding_of)
    except (OSError, UnicodeDecodeError) as found:
        why = why_unreadable(found)
        if encoding_of is not None and isinstance(found, UnicodeDecodeError):
            remedy = DECLARE
        raise error(f"the {what} '{path}' cannot be read ({why})", expected, remedy) from found


def validated(
    data: object, model: type[M], source: str, error: type[RobotEnergyError] = ModelFileError
) -> M:
    # 10 MB of schemas, which a reader of plain YAML or of bags does not need.
    from pydantic import ValidationError

    from robot_energy.foundation.schema_errors import described, listed, refusal

    if not isinstance(data, dict):
        fields = model.model_fields
        keys = [name for name, field in fields.items() if field.is_required()] or list(fields)
        raise error(f"{source} is {described(data)}", f"a mapping with {listed(keys)}")
    try:
        return model.model_validate(data)
    except ValidationError as report:
        raise refusal(report, model, cast("object", data), source, error) from report


def parse_yaml(text: str, source: str, error: type[RobotEnergyError] = ModelFileError) -> Any:
    if len(text) > MAX_BYTES:
        raise error(f"{source} has {len(text)} characters", f"at most {MAX_BYTES}")
    try:
        _look_through(text)
        return yaml.load(text, Loader=_Loader)
    except ModelFileError as found:
        raise error(f"{source}: {found.found}", found.expected, found.remedy) from None
    except (yaml.YAMLError, RecursionError, ValueError) as found:
        mark, said = getattr(found, "problem_mark", None), str(found)
        where = f" at line {mark.line + 1}" if mark is not None else ""
        short = said and "\n" not in said and len(said) < 80  # else only its kind
        problem = getattr(found, "problem", None) or (said if short else type(found).__name__)
        raise error(f"{source} is not valid YAML{where}: {problem}") from found


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
