"""What every entry of a model file is made of: tagged figures."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    model_serializer,
)

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


class LateEntry(ModelEntry):
    """Base of parts with keys that came later: a model without them keeps its identity."""

    LATE: ClassVar[tuple[str, ...]]

    @model_serializer(mode="wrap")
    def _dump(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        values: dict[str, Any] = dump(self)
        return {key: v for key, v in values.items() if key not in self.LATE or v is not None}


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


def _above_zero(figure: PositiveFigure) -> PositiveFigure:
    if not figure.value > 0.0:
        raise ValueError(f"must be > 0, found {figure.value}")
    return figure


AboveZero = Annotated[PositiveFigure, AfterValidator(_above_zero)]


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
