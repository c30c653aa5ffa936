"""What all results share: their fields are their JSON, and the model behind them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum, StrEnum
from pathlib import Path
from typing import Annotated, Any, ClassVar, cast, get_args

import numpy as np
from pydantic import BaseModel

from robot_energy import __version__
from robot_energy.foundation.described import Described
from robot_energy.foundation.shown import Shown
from robot_energy.model import RobotModel
from robot_energy.model.figure import Tag

SCHEMA_VERSION = 4  # rises when a key goes, is renamed, or changes its meaning
Number = float | None  # None where nothing is known
Texts = tuple[str, ...]


def known(value: float) -> Number:
    """Return a number, or None where it is not finite.

    Args:
        value: Of any quantity. [its own unit]
    """
    return float(value) if math.isfinite(value) else None


class Result(Described, Shown):
    """Base of the results. A number that is not finite becomes None: it is not known."""

    NAME: ClassVar[str] = ""  # of the JSON document; empty for a part of one

    def __init_subclass__(cls, name: str = "") -> None:
        """Give a class the name of its JSON document; empty for a part of one."""
        cls.NAME = name
        super().__init_subclass__()
        if name:  # all figures of a document fill a page
            cls.__repr__ = Result.__repr__

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if isinstance(value, float):
                object.__setattr__(self, entry.name, known(value))

    def __repr__(self) -> str:
        names = ", ".join(entry.name for entry in fields(self) if entry.repr)
        return f"{type(self).__name__}({names})"

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain values: the JSON of the command."""
        header = {"result": self.NAME, "schema_version": SCHEMA_VERSION}
        return {**(header | {"tool_version": __version__} if self.NAME else {}), **json_value(self)}


def json_value(value: Any) -> Any:
    """Return a value as JSON can hold it; None for a number that is not finite.

    Fields of a dataclass that its representation hides (``repr=False``) are data behind it and left
    out. A robot model becomes its identity.
    """
    if is_dataclass(value) and not isinstance(value, type):
        return {e.name: json_value(getattr(value, e.name)) for e in fields(value) if e.repr}
    match value:
        case float():
            return known(value)
        case RobotModel():
            return value.model_id
        case BaseModel():
            return json_value(value.model_dump(mode="json", exclude_none=True))
        case StrEnum() | Path():
            return str(value)
        case Enum():
            return value.name.lower()
        case np.ndarray() | np.generic():
            return json_value(cast("Any", value).tolist())
        case Mapping():
            return {str(key): json_value(item) for key, item in cast("Any", value).items()}
        case list() | tuple():
            return [json_value(item) for item in cast("Any", value)]
        case _:
            return value


TAGS: tuple[str, ...] = get_args(Tag)


class ModelUsed(Result):
    """The model behind a result."""

    model_id: Annotated[str, "Hash of its content."]
    source: Annotated[str, "File, or name of a shipped model."]
    robot: Annotated[str, "Type of the robot."]
    serial: Annotated[str | None, "Serial of the robot; None if the model file states none."]
    drive: Annotated[str, "Drive model."]
    fallback_temperature_degc: Annotated[float, "Taken where no motor temperature is known. [degC]"]
    figures: Annotated[dict[str, int], "Count of its figures by how they are known."]
    change: Annotated[
        str | None, "What was changed about it, such as fixed friction; None for nothing."
    ]
    notes: Annotated[str | None, "Notes of its provenance."]


def count_tags(model: RobotModel) -> dict[str, int]:
    """Return how many figures of a model have each tag, zeros included.

    Every tagged number counts once, a table or map once as a whole, and every group of
    the URDF (kinematics, masses ...) once.
    """
    entries = tagged_entries(model.model_dump(exclude={"urdf"}, exclude_none=True))
    counts = Counter([*model.urdf.tags.values(), *(entry["tag"] for entry in entries)])
    return {tag: counts[tag] for tag in TAGS}


def tagged_entries(value: object) -> Iterator[Mapping[str, Any]]:
    if isinstance(value, Mapping):
        entries = cast("Mapping[str, Any]", value)
        if isinstance(entries.get("tag"), str):
            yield entries
        value = list(entries.values())
    if isinstance(value, list | tuple):
        for entry in cast("Sequence[object]", value):
            yield from tagged_entries(entry)


def model_used(model: RobotModel, change: str | None = None) -> ModelUsed:
    return ModelUsed(
        model_id=model.model_id,
        source=model.source,
        robot=model.robot.type,
        serial=model.robot.serial or None,
        drive=model.drive,
        fallback_temperature_degc=model.temperature.fallback_degc,
        figures=count_tags(model),
        change=change,
        notes=model.provenance.notes or None,
    )
