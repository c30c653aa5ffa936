"""What is kept of learned figures across restarts: plain values with units in their names."""

from __future__ import annotations

from typing import Annotated, Any, Self, cast

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from robot_energy.foundation.errors import StateFileError
from robot_energy.foundation.units import MAX_COUNTER
from robot_energy.timeline.blocks import Float
from robot_energy.timeline.stamps import MAX_STAMP_NS, MIN_STAMP_NS

FORMAT_VERSION = 3
THERMAL_VERSION = 4  # of `ThermalRecord`

Number = Annotated[float, Field(allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0, le=MAX_COUNTER)]
Stamp = Annotated[int, Field(ge=MIN_STAMP_NS, le=MAX_STAMP_NS)]
Numbers = tuple[Number, ...]
STRICT = ConfigDict(extra="forbid", strict=True, revalidate_instances="always")  # of what is kept


class ConditionPart(BaseModel):
    """Base of the records: frozen, strict, no unknown keys."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, defer_build=True, populate_by_name=True
    )

    @classmethod
    def of(cls, source: object) -> Self:
        """Return what the attributes of an object hold, arrays flattened in their own order."""
        values: dict[str, Any] = {name: getattr(source, name) for name in cls.model_fields}
        arrays = {n: flat(cast("Float", v)) for n, v in values.items() if isinstance(v, np.ndarray)}
        return cls(**values | arrays)

    def put_into(self, target: object) -> None:
        """Set the attributes of an object, arrays in the shapes that they have there."""
        for name in type(self).model_fields:
            value, old = getattr(self, name), getattr(target, name)
            array = isinstance(old, np.ndarray)
            setattr(target, name, filled(value, cast("Float", old)) if array else value)

    def to_json(self) -> bytes:
        """Return the record as JSON text."""
        return self.model_dump_json(by_alias=True).encode()

    @classmethod
    def from_json(cls, content: bytes) -> Self:
        """Return a record of JSON text."""
        try:
            return cls.model_validate_json(content)
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(str(part) for part in first["loc"])
            raise StateFileError(
                f"learned figures that cannot be used: {where}: {first['msg']}",
                "what this release has written",
            ) from error


class FrictionRecord(ConditionPart):
    """What `FrictionLearner` has summed up."""

    sums: Numbers
    newest: Numbers
    parts: tuple[Count, ...]
    refused: tuple[Count, ...]


class MeterRecord(ConditionPart):
    """What `MeterFit` has summed up."""

    information: Numbers
    target: Numbers
    power: Annotated[Number, Field(alias="power_watt")]
    scale: Number
    time: Annotated[Number, Field(alias="time_second")]
    windows: Count
    refused: Count


class ContrastEntry(ConditionPart):
    """The sums of one `robot_energy.condition.baseline.Contrasts`, flattened; empty without any."""

    information: Numbers
    target: Numbers
    square: Number
    count: Count
    levels: Numbers = ()


def flat(values: Float) -> Numbers:
    """Return the numbers of an array, in their order.

    Args:
        values: Any shape. [-]
    """
    return tuple(values.reshape(-1).tolist())


def filled(values: Numbers | tuple[int, ...], like: np.ndarray) -> np.ndarray:
    """Return plain numbers as an array.

    Args:
        like: An array of the shape and type wanted.
    """
    if len(values) != like.size:
        raise StateFileError(
            f"a kept state with {len(values)} numbers in one array", f"{like.size}"
        )
    return np.array(values, dtype=like.dtype).reshape(like.shape)


class ThermalRecord(ConditionPart):
    """Estimated motor temperatures of one robot with one model file."""

    model_id: str
    end_ns: Annotated[Stamp, "End of the newest window that was taken. [ns]"]
    state: Annotated[
        Numbers,
        "Of every motor, flattened: motor, structure and ambient [degC], factor on the heat, "
        "gear [degC].",
    ]
    covariance: Numbers
    begun: Annotated[
        tuple[bool, ...], "Of every motor, whether the temperature of its gear is known."
    ]
