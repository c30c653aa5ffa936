"""Table of the laws of viscous friction over motor temperature, motor side."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from robot_energy.foundation.kinds import Kind, Kinds, Part
from robot_energy.model.figure import AboveZero, LateEntry, ModelEntry, Number, PositiveFigure, Tag

Outside = Literal["hold", "extend", "auto"]
Row = Annotated[list[Number], Field(min_length=3, max_length=3)]
ROUNDING = 1e-6  # of a covariance as it stands in a file


class LawEntry(ModelEntry):
    """Base of the entries: ``law`` names the kind."""

    law: Annotated[Any, "Name of the law; each entry narrows it to its own."]


class ConstantLaw(LawEntry, LateEntry):
    """Viscous friction that does not depend on temperature, or was seen at one alone."""

    LATE = ("fitted_degc",)

    law: Annotated[Literal["constant"], "Name of the law."]
    viscous: Annotated[PositiveFigure, "fv, motor side. [N m s/rad]"]
    fitted_degc: Annotated[
        tuple[Number, Number] | None,
        "Range of temperatures that it holds for, where identification saw one; without it all.",
    ] = None

    @model_validator(mode="after")
    def _check(self) -> ConstantLaw:
        _check_range(self.fitted_degc)
        return self


class ExponentialLaw(LawEntry, LateEntry):
    """fv(T) = a + b exp(-T/c), T in degC, motor side (paper A, section III)."""

    LATE = ("std", "covariance", "outside")

    law: Annotated[Literal["exponential"], "Name of the law."]
    a: Annotated[PositiveFigure, "Hot limit. [N m s/rad]"]
    b: Annotated[PositiveFigure, "Amplitude at 0 degC. [N m s/rad]"]
    c: Annotated[AboveZero, "Temperature scale, > 0. [K]"]
    fitted_degc: Annotated[tuple[Number, Number], "Range of temperatures behind the fit."]
    std: Annotated[
        Annotated[float, Field(ge=0)] | None,
        "Greatest standard deviation of fv(T) in that range, where identification gave one; those "
        "of a, b and c alone do not give it, since they are correlated. [N m s/rad]",
    ] = None
    covariance: Annotated[
        Annotated[list[Row], Field(min_length=3, max_length=3)] | None,
        "Of a, b and c, three rows of three, where identification gave it: so fv(T) has a "
        "standard deviation at every temperature. [N m s/rad] and [K], their products",
    ] = None
    outside: Annotated[
        Outside | None,
        "What holds outside the fitted range: ``hold`` the value at its edge; ``extend`` the "
        "formula; ``auto`` the formula as far as the covariance says that its change from the "
        "edge is larger than the standard deviation of that change, then hold. Without this key "
        "``auto`` where there is a covariance, else ``hold``.",
    ] = None

    @model_validator(mode="after")
    def _check(self) -> ExponentialLaw:
        if self.covariance is not None:
            _check_covariance(self.covariance)
        elif self.outside == "auto":
            raise ValueError(
                "outside is 'auto' but there is no covariance; expected that of a, b and c, as "
                "identify friction writes it, or outside: hold or extend"
            )
        _check_range(self.fitted_degc)
        return self


def _check_range(degc: tuple[float, float] | None) -> None:
    if degc is not None and not degc[0] < degc[1]:
        raise ValueError(f"fitted_degc must rise, found {list(degc)}")


def _check_covariance(rows: list[list[float]]) -> None:
    matrix = np.array(rows)
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    limit = np.outer(scale, scale) * (1.0 + ROUNDING)
    if (np.abs(matrix - matrix.T) > ROUNDING * limit).any() or (np.abs(matrix) > limit).any():
        raise ValueError(
            "covariance is none; expected three symmetric rows, no entry beyond the product of the "
            "two standard deviations"
        )


class TableLaw(LawEntry):
    """fv at identified temperatures, "saved directly" in paper A; monotone between them."""

    law: Annotated[Literal["table"], "Name of the law."]
    motor_temperature_degc: Annotated[
        list[Number], Field(min_length=2), "Strictly rising, at least two. [degC]"
    ]
    viscous: Annotated[
        list[Annotated[Number, Field(ge=0)]],
        Field(min_length=2),
        "Same length, motor side. [N m s/rad]",
    ]
    std: Annotated[
        list[Annotated[float, Field(ge=0)]] | None, "Standard deviations, same length. [N m s/rad]"
    ] = None
    tag: Annotated[Tag, "How the points are known."]
    source: Annotated[str, "Where they come from."] = ""

    @model_validator(mode="after")
    def _check(self) -> TableLaw:
        temperature = self.motor_temperature_degc
        if len(temperature) != len(self.viscous):
            raise ValueError(
                f"{len(temperature)} temperatures but {len(self.viscous)} viscous values"
            )
        if any(a >= b for a, b in pairwise(temperature)):
            raise ValueError("motor_temperature_degc must rise strictly")
        if self.std is not None and len(self.std) != len(self.viscous):
            raise ValueError(f"{len(self.viscous)} viscous values but {len(self.std)} std")
        return self


def _shown(figures: dict[str, Any]) -> str:
    return ", ".join(
        f"{key} {value['value']:.3g}" for key, value in figures.items() if isinstance(value, dict)
    )


@dataclass(frozen=True, kw_only=True)
class FrictionLaw(Kind):
    """One law of viscous friction. Name, label, line, entry and curve are needed.

    Attributes:
        entry: Schema of the ``viscous`` entry of a joint, whose ``law`` is the name.
        follows_temperature: Whether fv depends on the motor temperature.
        beyond_range: Whether its formula has a meaning outside the fitted range: its entry then
            has a key ``outside``.
        curve: Makes a `robot_energy.physics.friction.ViscousLaw` of an entry.
        fit: Fits an entry to samples in motion: samples and source to the entry and the
            regression behind it; None for a law that has no fit.
        merged_fit: Fits an entry to the sums of a fleet, a
            `robot_energy_fleet.merged_laws.MergedSums`: the entry and the regression behind it;
            None for a law that a fleet cannot fit.
    """

    entry: type[LawEntry]
    follows_temperature: bool = True
    beyond_range: bool = False
    curve: Callable[[Any], Any] | None = None
    fit: Callable[[Any, str], Any] | None = None
    merged_fit: Callable[[Any], Any] | None = None
    text: Callable[[dict[str, Any]], str] = _shown


def _exponential_text(law: dict[str, Any]) -> str:
    a, b, c = (law[key]["value"] for key in ("a", "b", "c"))
    return f"{1e3 * a:.3g} + {1e3 * b:.3g} exp(-T/{c:.3g})"


FRICTION_LAWS = Kinds(
    "friction law",
    FrictionLaw(
        name="constant",
        label="constant",
        line="one viscous coefficient at every temperature",
        entry=ConstantLaw,
        curve=Part("robot_energy.physics.friction:constant_law"),
        fit=Part("robot_energy_identify.friction.laws:fit_constant"),
        merged_fit=Part("robot_energy_fleet.merged_laws:fit_constant"),
        follows_temperature=False,
        text=lambda law: (
            f"{1e3 * law['viscous']['value']:.3g}" if law["viscous"]["value"] else "0, at bound"
        ),
    ),
    FrictionLaw(
        name="exponential",
        label="exponential",
        line="`a + b exp(-T/c)` (paper A, section III)",
        entry=ExponentialLaw,
        curve=Part("robot_energy.physics.friction:exponential_law"),
        fit=Part("robot_energy_identify.friction.laws:fit_exponential"),
        merged_fit=Part("robot_energy_fleet.merged_laws:fit_exponential"),
        beyond_range=True,
        text=_exponential_text,
    ),
    FrictionLaw(
        name="table",
        label="table",
        line="monotone interpolation of identified points",
        entry=TableLaw,
        curve=Part("robot_energy.physics.friction:table_law"),
        fit=Part("robot_energy_identify.friction.laws:fit_table"),
        merged_fit=Part("robot_energy_fleet.merged_laws:fit_table"),
        text=lambda law: " ".join(f"{1e3 * value:.3g}" for value in law["viscous"]),
    ),
)

register_friction_law = FRICTION_LAWS.register
"""Add a law of yours: model files may name it from now on."""
