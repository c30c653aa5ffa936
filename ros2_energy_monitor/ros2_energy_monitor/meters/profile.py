# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Device profiles: what a meter is, in one YAML file.

Energy is what a monitor should compare with; power is a view.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Annotated, ClassVar, Generic, Literal, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, model_validator

from robot_energy.foundation.units import ENERGY_UNITS, POWER_UNITS
from ros2_energy_monitor.meters.reading import Quantity

FOLDER = Path(str(resources.files("ros2_energy_monitor") / "meters" / "profiles"))
UNITS = {**POWER_UNITS, **ENERGY_UNITS}
MAX_TERMS = 16  # numbers that add up to one quantity
MAX_PERIOD = 3600.0  # [s]

Text = Annotated[str, Field(min_length=1, max_length=2000)]
Seconds = Annotated[float, Field(ge=0, le=MAX_PERIOD, allow_inf_nan=False)]


class ProfileEntry(BaseModel):
    """Base of what stands in a profile: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class NumberEntry(ProfileEntry):
    """One number of a meter; several add up, such as tariffs or phases.

    Attributes:
        scale: Factor on the number as read. [-]
        wraps_at: Value, in `unit`, at which a counter starts again from zero.
    """

    unit: str
    scale: Annotated[float, Field(allow_inf_nan=False)] = 1.0
    wraps_at: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.unit not in UNITS:
            raise ValueError(f"unit is '{self.unit}'; expected one of {', '.join(UNITS)}")
        if self.scale == 0:
            raise ValueError("scale is 0; expected another factor")
        return self

    @property
    def factor(self) -> float:
        """What one of the number as read is. [W or J]"""
        return self.scale * UNITS[self.unit]

    @property
    def wraps_at_joule(self) -> float | None:
        """Where the counter starts again; None if it never does. [J]"""
        return None if self.wraps_at is None else self.wraps_at * UNITS[self.unit]


N = TypeVar("N", bound=NumberEntry)


class MeterProfile(ProfileEntry, Generic[N]):
    """What every profile holds; each kind of link adds its own keys.

    Attributes:
        tried: On what the profile was tried, and on what not.
        link: Name of the kind of link that reads the meter.
        period: Time from one request to the next, where the user names none; for a meter that
            sends by itself, the usual time between two messages. [s]
        window: Time over which the meter averages its power; 0 for an instantaneous one. [s]
        lag: Age of a number at the moment of the exchange. [s]
        energy: Numbers that add up to the imported energy; empty if the meter counts none.
        power: Numbers that add up to the active power; empty if the meter gives none.
        DESCRIBES_ITSELF: Whether the meter itself says where its numbers are.
    """

    schema_version: Literal[1]
    label: Text
    sources: Annotated[tuple[Text, ...], Field(min_length=1)]
    tried: Text
    link: Text
    port: Annotated[int, Field(ge=1, le=65535)]
    period: Annotated[Seconds, Field(gt=0)]
    window: Seconds = 0.0
    lag: Seconds = 0.0
    energy: Annotated[tuple[N, ...], Field(max_length=MAX_TERMS)] = ()
    power: Annotated[tuple[N, ...], Field(max_length=MAX_TERMS)] = ()

    DESCRIBES_ITSELF: ClassVar[bool] = False

    @model_validator(mode="after")
    def _check_numbers(self) -> Self:
        if self.DESCRIBES_ITSELF == bool(self.energy or self.power):
            raise ValueError(
                "energy or power is given; expected neither, as the meter describes itself"
                if self.DESCRIBES_ITSELF
                else "neither energy nor power is given; expected at least one"
            )
        for name, units in (("energy", ENERGY_UNITS), ("power", POWER_UNITS)):
            numbers: Sequence[NumberEntry] = getattr(self, name)
            wrong = [number.unit for number in numbers if number.unit not in units]
            if wrong:
                raise ValueError(
                    f"{name} has the unit '{wrong[0]}'; expected one of {', '.join(units)}"
                )
        if any(number.wraps_at is not None for number in self.power):
            raise ValueError("power has a wraps_at; expected one for energy only")
        return self

    @property
    def quantities(self) -> dict[Quantity, tuple[N, ...]]:
        """The numbers of each quantity that the meter gives, energy first."""
        every = {Quantity.ENERGY: self.energy, Quantity.POWER: self.power}
        return {quantity: numbers for quantity, numbers in every.items() if numbers}

    @property
    def hides_password(self) -> bool:
        """Whether a password is unreadable on the network even without TLS."""
        return False

    @property
    def counts_energy(self) -> bool:
        return self.DESCRIBES_ITSELF or bool(self.energy)
