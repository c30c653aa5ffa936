"""What every entry of a model file is made of: tagged figures."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

Tag = Literal["published", "identified", "derived", "assumed"]
LEAST_KNOWN: tuple[Tag, ...] = ("assumed", "derived", "published", "identified")
"""Tags, the least known first."""


def _not_boolean(value: object) -> object:
    if isinstance(value, bool):
        raise ValueError("expected a number, not true/false")
    return value


Number = Annotated[float, BeforeValidator(_not_boolean), Field(allow_inf_nan=False)]


class ModelEntry(BaseModel):
    """Base of all parts: unknown keys are refused, values cannot be changed."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


class Figure(ModelEntry):
    """One number and how it is known."""

    value: Annotated[Number, "In the unit that the owning key documents."]
    tag: Annotated[Tag, "How the value is known."]
    std: Annotated[
        Annotated[float, Field(ge=0)] | None,
        "Standard deviation in the same unit, where identification gave one.",
    ] = None
    source: Annotated[str, "Where it comes from, in words."] = ""


class PositiveFigure(Figure):
    """A figure that must be >= 0."""

    value: Annotated[Number, Field(ge=0)]


def least_known(tags: list[Tag]) -> Tag:
    """Return the tag of the least known of several figures; ``assumed`` of none."""
    for tag in LEAST_KNOWN:
        if tag in tags:
            return tag
    return "assumed"


def tag_of(entry: ModelEntry) -> Tag:
    """Return how the least known figure of an entry is known."""
    values: list[Any] = [getattr(entry, name) for name in type(entry).model_fields]
    own: list[Tag] = [value.tag for value in values if isinstance(value, Figure)]
    tag: Tag | None = getattr(entry, "tag", None)
    return least_known(own if tag is None else [*own, tag])


def without_absent(entries: dict[str, Any], *keys: str) -> dict[str, Any]:
    """Return entries without optional keys that are None.

    Such keys came later than the files that lack them; a file without them keeps its identity.
    """
    return {key: value for key, value in entries.items() if key not in keys or value is not None}
