"""JSON Schema of the results, made from their dataclasses; and results read back from JSON."""

from __future__ import annotations

import inspect
import json
import re
import types
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum, StrEnum
from pathlib import Path
from typing import Any, Literal, Union, cast, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import BaseModel, TypeAdapter, ValidationError

from robot_energy.errors import ReportError
from robot_energy.model import RobotModel
from robot_energy.results.base import SCHEMA_VERSION, Result
from robot_energy.results.drives import DrivesReport
from robot_energy.results.dynamics import DynamicsReport
from robot_energy.results.excitation import ExcitationReport
from robot_energy.results.identification import (
    CabinetReport,
    FrictionReport,
    FrictionStudyReport,
    IdentificationReport,
)
from robot_energy.results.model import ModelReport
from robot_energy.results.prediction import PredictionsReport
from robot_energy.results.replay import ReplayReport
from robot_energy.shown_text import shown

RESULTS: dict[str, type[Result]] = {
    kind.NAME: kind
    for kind in (
        ReplayReport,
        PredictionsReport,
        FrictionReport,
        FrictionStudyReport,
        CabinetReport,
        DrivesReport,
        DynamicsReport,
        ExcitationReport,
        IdentificationReport,
        ModelReport,
    )
}
READABLE = (ReplayReport, PredictionsReport)  # that a page is made from
MAX_JSON_BYTES = 100_000_000
NAMES: dict[type, dict[str, Any]] = {
    bool: {"type": "boolean"},
    int: {"type": "integer"},
    float: {"type": ["number", "null"]},  # null: not known
    str: {"type": "string"},
    Path: {"type": "string"},
    type(None): {"type": "null"},
}


def schema_of(name: str) -> dict[str, Any]:
    """Return the JSON Schema of one result.

    Args:
        name: Of the result, a key of `RESULTS`.

    Raises:
        ReportError: If there is none of that name.
    """
    if name not in RESULTS:
        raise ReportError(f"there is no result '{shown(name)}'", f"one of {', '.join(RESULTS)}")
    return _document(f"robot-energy {name}, version {SCHEMA_VERSION}", [RESULTS[name]])


def all_schemas() -> dict[str, Any]:
    """Return one JSON Schema that every result fits."""
    return _document(f"results of robot-energy, version {SCHEMA_VERSION}", RESULTS.values())


def _document(title: str, kinds: Iterable[type[Result]]) -> dict[str, Any]:
    definitions: dict[str, Any] = {}
    choices: list[dict[str, Any]] = []
    for kind in kinds:
        header = {
            "result": {"const": kind.NAME},
            "schema_version": {"const": SCHEMA_VERSION},
            "tool_version": {"type": "string"},
        }
        fits = _schema(kind, definitions)
        choices.append({**fits, "properties": header, "required": list(header)})
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": title,
        "oneOf": choices,
        "$defs": dict(sorted(definitions.items())),
    }


def _schema(kind: Any, definitions: dict[str, Any]) -> dict[str, Any]:
    """Schema of an annotation; dataclasses are added to the definitions."""
    if kind in NAMES:
        return NAMES[kind]
    origin, args = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return {"anyOf": [_schema(one, definitions) for one in args]}
    if origin is Literal:
        return {"enum": list(args)}
    if origin is tuple and args[-1] is not Ellipsis:
        parts = [_schema(one, definitions) for one in args]
        return {"type": "array", "prefixItems": parts, "minItems": len(parts), "items": False}
    if origin in (tuple, list, Sequence):
        return {"type": "array", "items": _schema(args[0], definitions)}
    if origin in (dict, Mapping):
        return {"type": "object", "additionalProperties": _schema(args[1], definitions)}
    if origin is np.ndarray:
        return {"type": "array"}
    return _class(cast("type[Any]", kind), definitions) if isinstance(kind, type) else {}


def _class(kind: type[Any], definitions: dict[str, Any]) -> dict[str, Any]:
    if issubclass(kind, Enum):
        return {"enum": [str(e) if issubclass(kind, StrEnum) else e.name.lower() for e in kind]}
    if issubclass(kind, RobotModel):
        return {"type": "string", "description": "model_id"}
    if issubclass(kind, BaseModel):
        return {"type": "object", "description": f"{kind.__name__} of a model file"}
    if not is_dataclass(kind):
        return {}
    if kind.__name__ not in definitions:
        definitions[kind.__name__] = {}  # it may hold itself
        definitions[kind.__name__] = _dataclass(kind, definitions)
    return {"$ref": f"#/$defs/{kind.__name__}"}


def _dataclass(kind: type, definitions: dict[str, Any]) -> dict[str, Any]:
    hints, words = get_type_hints(kind), _documented(kind)
    properties: dict[str, Any] = {}
    for entry in fields(cast("Any", kind)):
        if entry.repr:
            properties[entry.name] = dict(_schema(hints[entry.name], definitions))
            if entry.name in words:
                properties[entry.name]["description"] = words[entry.name]
    text = (inspect.getdoc(kind) or "").partition("\n")[0]
    return {
        "type": "object",
        "description": text,
        "properties": properties,
        "required": list(properties),
    }


def _documented(kind: type) -> dict[str, str]:
    """Text of each attribute in the docstring of a class."""
    _, _, block = (inspect.getdoc(kind) or "").partition("Attributes:\n")
    found = re.findall(r"^    (\w+): (.*(?:\n     .*)*)", block, re.MULTILINE)
    return {name: " ".join(text.split()) for name, text in found}


def read_result(path: str | Path) -> ReplayReport | PredictionsReport:
    """Read a result back from the JSON of a command.

    Args:
        path: The file.

    Returns:
        The same as the command gave.

    Raises:
        ReportError: If it is no such file, or of another version.
    """
    place = f"'{shown(str(path))}'"
    try:
        with Path(path).open("rb") as file:
            content = file.read(MAX_JSON_BYTES + 1)
        data = json.loads(content) if len(content) <= MAX_JSON_BYTES else None
    except (OSError, ValueError, RecursionError) as error:
        raise ReportError(f"{place} cannot be read as JSON", "JSON of replay or predict") from error
    known = {kind.NAME: kind for kind in READABLE}
    given = cast("dict[str, Any]", data) if isinstance(data, dict) else {}
    kind = known.get(str(given.get("result")))
    if kind is None or given.get("schema_version") != SCHEMA_VERSION:
        found = f"result {given.get('result')!r}, schema_version {given.get('schema_version')!r}"
        raise ReportError(
            f"{place} holds {shown(found)}",
            f"result {' or '.join(known)}, schema_version {SCHEMA_VERSION}",
            "write it again with --json",
        )
    try:
        return TypeAdapter(kind).validate_python(given)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise ReportError(
            f"{place}: {shown(where)} is wrong ({first['msg']})", "its schema"
        ) from None
