"""What a file has wrong against its schema, in plain words: key path, found, expected."""

from __future__ import annotations

import datetime
import difflib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeVar, cast

from pydantic import BaseModel, ValidationError

from robot_energy.foundation.errors import RobotEnergyError
from robot_energy.foundation.kinds import LIKELY
from robot_energy.foundation.shown_text import shown

MAX_PROBLEMS = 8  # said at once
MAX_KEYS = 20  # of a schema, listed where an unknown key resembles none
MAX_WORD = 60  # characters of a key or value that are shown

# What was expected, by pydantic's type of error; the braces are filled from its context.
EXPECTED = {
    **dict.fromkeys(("bool_parsing", "bool_type"), "true or false"),
    **dict.fromkeys(("float_parsing", "float_type"), "a number"),
    **dict.fromkeys(("int_parsing", "int_type", "int_from_float"), "a whole number"),
    **dict.fromkeys(("list_type", "tuple_type"), "a list"),
    **dict.fromkeys(
        ("datetime_parsing", "datetime_from_date_parsing"),
        "a date with time, such as 2026-01-31T12:00:00Z",
    ),
    "finite_number": "a finite number",
    "greater_than": "a number greater than {gt}",
    "greater_than_equal": "a number greater than or equal to {ge}",
    "less_than": "a number less than {lt}",
    "less_than_equal": "a number less than or equal to {le}",
    "string_type": "text",
    "string_unicode": "text without lone surrogates",
    "string_too_short": "text with a length of at least {min_length}",
    "string_too_long": "text with a length of at most {max_length}",
    "string_pattern_mismatch": "text that matches {pattern}",
    "literal_error": "{expected}",
    "union_tag_invalid": "one of {expected_tags}",
    "unknown_kind": "{wanted}",
    "too_short": "at least {min_length} entries, found {actual_length}",
    "too_long": "at most {max_length} entries",
    "datetime_type": "a date with time",
}
NO_MAPPING = {"dict_type", "mapping_type", "model_type", "model_attributes_type"}

E = TypeVar("E", bound=RobotEnergyError)
Part = str | int


@dataclass(frozen=True)
class _Problem:
    """One thing that is wrong at one place."""

    place: tuple[Part, ...]
    found: str
    expected: str = ""
    remedy: str = ""
    of_union: bool = False  # refused by one of several kinds that the place may hold


def refusal(
    error: ValidationError, model: type[BaseModel], data: object, source: str, kind: type[E]
) -> E:
    """Return pydantic's report as an error that names what is wrong, up to a bound."""
    problems = _joined(_problems(error, model, data))
    if len(problems) == 1:
        only = problems[0]
        return kind(f"{source}: {only.found}", only.expected, only.remedy)
    lines = [
        f"({number}) {problem.found}"
        + (f", expected {problem.expected}" if problem.expected else "")
        + (f" ({problem.remedy})" if problem.remedy else "")
        for number, problem in enumerate(problems[:MAX_PROBLEMS], start=1)
    ]
    more = len(problems) - MAX_PROBLEMS
    lines += [f"and {more} more"] if more > 0 else []
    return kind(f"{source} has {len(problems)} problems: {'; '.join(lines)}")


def described(value: object) -> str:
    """Return what a value of a file is, in a few words."""
    if value is None:
        return "empty"
    if isinstance(value, str):
        return f"'{shown(value, MAX_WORD)}'"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        return "a mapping"
    if isinstance(value, list | tuple):
        return "a list"
    if isinstance(value, int | float | datetime.date):
        return shown(str(value), MAX_WORD)
    return type(value).__name__


def listed(words: Iterable[str]) -> str:
    """Return words as one phrase: ``a, b and c``."""
    *others, last = words
    return f"{', '.join(others)} and {last}" if others else last


def _problems(error: ValidationError, model: type[BaseModel], data: object) -> Iterator[_Problem]:
    for entry in error.errors(include_url=False):
        kind, context = entry["type"], entry.get("ctx", {})
        place, of_union = _place(entry["loc"], data, missing=kind == "missing")
        name = _name(place, data)
        if kind == "missing" and isinstance(place[-1], int):  # of a list of fixed length
            where = place[:-1]
            count = max(len(node.get("prefixItems", ())) for node in _nodes(model, where))
            yield _Problem(where, f"'{_name(where, data)}' is a list", f"{count} entries")
        elif kind == "missing":
            yield _Problem(place, f"key '{name}' is missing")
        elif kind == "extra_forbidden":
            yield _unknown(place, name, model)
        elif kind in ("value_error", "assertion_error"):
            text = str(context.get("error", entry["msg"]))
            yield _Problem(place, f"{name}: {text}" if name else text)
        elif kind == "union_tag_not_found":
            key = context["discriminator"].strip("'")
            yield _Problem(place, f"key '{name}.{key}' is missing")
        elif kind == "union_tag_invalid":
            key = context["discriminator"].strip("'")
            tags = [tag.strip(" '") for tag in context["expected_tags"].split(",")]
            near = difflib.get_close_matches(str(context["tag"])[:MAX_WORD], tags, 1, LIKELY)
            found = f"'{name}.{key}' is '{context['tag']}'"
            remedy = f"write '{near[0]}'" if near else ""
            yield _Problem(place, found, _expected(kind, context, entry), remedy)
        elif kind == "invalid_key":
            yield _Problem(
                place,
                f"'{_name(place[:-1], data)}' has {described(entry['input'])} as a key",
                "a name",
                "write decimals with a point, as in 0.02, if a number was meant",
            )
        else:
            expected = _expected(kind, context, entry)
            if kind in NO_MAPPING:
                _, required = _keys(model, place)
                expected = f"a mapping with {listed(required)}" if required else "a mapping"
            found = f"'{name}' is {described(entry['input'])}"
            yield _Problem(place, found, expected, context.get("remedy", ""), of_union=of_union)


def _expected(kind: str, context: Mapping[str, Any], entry: Any) -> str:
    if kind in EXPECTED:
        return EXPECTED[kind].format_map(context)
    text = str(entry["msg"]).removeprefix("Input should be ")
    return text[:1].lower() + text[1:]


def _unknown(place: tuple[Part, ...], name: str, model: type[BaseModel]) -> _Problem:
    """An unknown key, with the right spelling if one is near."""
    known, _ = _keys(model, place[:-1])
    near = difflib.get_close_matches(str(place[-1])[:MAX_WORD], known, n=1, cutoff=LIKELY)
    expected = f"'{near[0]}'" if near else "a key of the schema"
    if known and not near:
        rest = ", ..." if len(known) > MAX_KEYS else ""
        expected = f"one of {', '.join(known[:MAX_KEYS])}{rest}"
    return _Problem(place, f"key '{name}' is unknown", expected)


def _joined(problems: Iterable[_Problem]) -> list[_Problem]:
    """One entry per place: kinds that a place may hold are joined, misspellings are said once."""
    by_place: dict[tuple[Part, ...], list[_Problem]] = {}
    for problem in problems:
        by_place.setdefault(problem.place, []).append(problem)
    misspelt = {
        (*place[:-1], first.expected.strip("'"))
        for place, (first, *_) in by_place.items()
        if first.found.endswith("is unknown")
    }
    inner = {place[:length] for place in by_place for length in range(len(place))}
    result: list[_Problem] = []
    for place, (first, *others) in by_place.items():
        if place in misspelt and first.found.endswith("is missing"):
            continue
        if place in inner and first.of_union:
            continue  # what is wrong inside says more
        expected = dict.fromkeys(one.expected for one in (first, *others) if one.expected)
        result.append(_Problem(place, first.found, " or ".join(expected), first.remedy))
    return result


def _place(loc: Sequence[Part], data: object, *, missing: bool) -> tuple[tuple[Part, ...], bool]:
    """Keys and indexes down to the place, without pydantic's names for kinds of a union."""
    parts: list[Part] = []
    value = data
    for position, part in enumerate(loc):
        if isinstance(value, Mapping) and part in value:
            value = cast("Mapping[Part, object]", value)[part]
        elif isinstance(value, list | tuple) and isinstance(part, int) and part < len(value):  # pyright: ignore[reportUnknownArgumentType]
            value = cast("Sequence[object]", value)[part]
        elif not (missing and position == len(loc) - 1):
            continue
        parts.append(part)
    return tuple(parts), len(parts) < len(loc)


def _name(place: Sequence[Part], data: object) -> str:
    """Dotted path; an entry of a list that has a name, such as a joint, is called by it."""
    words: list[str] = []
    value = data
    for part in place:
        try:
            value = cast("Any", value)[part]
        except (KeyError, IndexError, TypeError):
            value = None
        named = isinstance(part, int) and isinstance(value, Mapping)
        name = cast("Mapping[str, object]", value).get("name") if named else None
        words.append(shown(name if isinstance(name, str) and name else str(part), MAX_WORD))
    return ".".join(words)


def _keys(model: type[BaseModel], place: Sequence[Part]) -> tuple[list[str], list[str]]:
    """All keys of the schema at a place, and those that it needs there."""
    objects = [node for node in _nodes(model, place) if "properties" in node]
    known = dict.fromkeys(key for node in objects for key in node["properties"])
    return list(known), [key for key in known if all(key in n.get("required", ()) for n in objects)]


def _nodes(model: type[BaseModel], place: Sequence[Part]) -> list[dict[str, Any]]:
    """All that may stand at a place, as the schema has it."""
    schema = _schema(model)
    nodes = list(_resolved(schema, schema))
    for part in place:
        nodes = [
            end for node in nodes for one in _step(node, part) for end in _resolved(one, schema)
        ]
    return nodes


@lru_cache(maxsize=8)
def _schema(model: type[BaseModel]) -> dict[str, Any]:
    return model.model_json_schema()


def forget_schemas() -> None:
    """Build schemas again, after one of them has changed."""
    _schema.cache_clear()


def _step(node: dict[str, Any], part: Part) -> Iterator[dict[str, Any]]:
    first, rest = node.get("prefixItems", []), node.get("items")
    if isinstance(part, int) and part < len(first):
        yield first[part]
    elif isinstance(part, int) and isinstance(rest, dict):
        yield cast("dict[str, Any]", rest)
    elif part in node.get("properties", {}):
        yield node["properties"][part]


def _resolved(node: dict[str, Any], schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """All that a node of the schema may be."""
    if "$ref" in node:
        yield from _resolved(schema["$defs"][node["$ref"].rpartition("/")[2]], schema)
        return
    kinds = [*node.get("anyOf", []), *node.get("oneOf", [])]
    for kind in kinds:
        yield from _resolved(kind, schema)
    if not kinds:
        yield node
