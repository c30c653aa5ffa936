"""What every entry of a model file is made of: tagged figures."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

Tag = Literal["published", "identified", "derived", "assumed"]


def _not_boolean(value: object) -> object:
    if isinstance(value, bool):
        raise ValueError("expected a number, not true/false")
    return value


Number = Annotated[float, BeforeValidator(_not_boolean), Field(allow_inf_nan=False)]


class ModelEntry(BaseModel):
    """Base of all parts: unknown keys are refused, values cannot be changed."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Figure(ModelEntry):
    """One number and how it is known.

    Attributes:
        value: In the unit that the owning key documents.
        tag: How the value is known.
        std: Standard deviation in the same unit, where identification gave one.
        source: Where it comes from, in words.
    """

    value: Number
    tag: Tag
    std: Annotated[float, Field(ge=0)] | None = None
    source: str = ""


class PositiveFigure(Figure):
    """A figure that must be >= 0."""

    value: Annotated[Number, Field(ge=0)]


def without_absent(entries: dict[str, Any], key: str) -> dict[str, Any]:
    """Leave out an optional key that is None.

    Such a key came later than the files that lack it; a file without it keeps its identity.

    Args:
        entries: A dumped entry of a model file.
        key: The optional key.

    Returns:
        The entries, without the key if it is None.
    """
    return {name: value for name, value in entries.items() if name != key or value is not None}
