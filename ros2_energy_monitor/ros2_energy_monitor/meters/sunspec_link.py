# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Meters that describe themselves by the SunSpec information models.

At a known address stand the letters "SunS"; behind them a chain of models, each with its number
and length, until the number 0xFFFF. A meter has one of the models 201 to 204 (integers with scale
factors) or 211 to 214 (floats): single phase, split phase, wye, delta.

Source: SunSpec Alliance, Device Information Model Specification, and the models 201 to 204 and
211 to 214 as published in github.com/sunspec/models.
"""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Sequence
from typing import Annotated, ClassVar

from pydantic import Field

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import MeterAnswerError
from robot_energy.foundation.units import ENERGY_UNITS
from ros2_energy_monitor.meters.link import Endpoint
from ros2_energy_monitor.meters.modbus_link import REGISTERS, Address, RegisterLink
from ros2_energy_monitor.meters.profile import MeterProfile, NumberEntry
from ros2_energy_monitor.meters.reading import Exchange, MeterTerm, Quantity

MARK = (0x5375, 0x6E53)  # "SunS"
END = 0xFFFF
MAX_MODELS = 100  # in one chain
NO_INT16 = -0x8000
COUNT = 2**32  # where an acc32 starts again from zero
BROKEN = 1 << 2 | 1 << 7  # of the events: power failure, missing sensor


class _Layout(Described):
    """Where a family of models has its points, counted from the register behind its header."""

    length: int
    power: int
    power_scale: Annotated[int | None, "Its scale factor; None where numbers are floats."]
    energy: int
    energy_scale: Annotated[int | None, "Its scale factor; None where numbers are floats."]
    events: int


INTEGERS = _Layout(105, 16, 20, 44, 52, 103)
FLOATS = _Layout(124, 26, None, 66, None, 122)
MODELS = {201: INTEGERS, 202: INTEGERS, 203: INTEGERS, 204: INTEGERS} | dict.fromkeys(
    range(211, 215), FLOATS
)


class SunSpecProfile(MeterProfile[NumberEntry]):
    """Profile of a meter that describes itself; what it counts follows from its models.

    Attributes:
        bases: Addresses where "SunS" may stand, counted from 0.
        instance: Which meter of a device with several, from 1.
    """

    port: Annotated[int, Field(ge=1, le=65535)] = 502
    unit: Annotated[int, Field(ge=0, le=255)] = 1
    bases: Annotated[tuple[Address, ...], Field(min_length=1, max_length=10)] = (40000, 50000, 0)
    instance: Annotated[int, Field(ge=1, le=50)] = 1

    DESCRIBES_ITSELF: ClassVar[bool] = True


class SunSpecLink(RegisterLink):
    """Finds the meter among the models of a device and reads it, a whole model at once."""

    def __init__(self, profile: SunSpecProfile, endpoint: Endpoint) -> None:
        self._profile = profile
        super().__init__(endpoint, profile.unit, "holding")
        self._found: tuple[int, _Layout] | None = None  # first register behind the header

    def connect(self) -> None:
        """Connect; the models are looked up again with the first reading."""
        self._found = None
        super().connect()

    def read(self) -> Sequence[Exchange]:
        self.bound.begin()
        if self._found is None:
            self._found = self._meter(self._base())
        address, layout = self._found
        requested = time.monotonic()
        data = self.registers(address, layout.length)
        answered = time.monotonic()
        energy, power = terms(data, layout)
        return [
            Exchange(Quantity.ENERGY, (energy,), requested, answered),
            Exchange(Quantity.POWER, (power,), requested, answered),
        ]

    def _base(self) -> int:
        """Address of the first header."""
        for base in self._profile.bases:
            try:
                mark = tuple(self.registers(base, 2))
            except MeterAnswerError:  # no such register: the next address
                continue
            if mark == MARK:
                return base + 2
        raise MeterAnswerError(
            f"{self.where} has no SunSpec mark",
            f"'SunS' at one of {', '.join(map(str, self._profile.bases))}",
            "switch SunSpec on, or name the address in a profile of yours",
        )

    def _meter(self, address: int) -> tuple[int, _Layout]:
        """First register of the meter's model behind its header, and its layout."""
        seen: list[int] = []
        meters = 0
        while len(seen) < MAX_MODELS and address + 2 <= REGISTERS:
            number, length = self.registers(address, 2)
            if number == END:
                break
            seen.append(number)
            layout = MODELS.get(number)
            if layout is not None and length >= layout.length:
                meters += 1
                if meters == self._profile.instance:
                    return address + 2, layout
            address += 2 + length
        raise MeterAnswerError(
            f"{self.where} has the SunSpec models {', '.join(map(str, seen)) or 'none'}",
            f"meter number {self._profile.instance}: 201 to 204 or 211 to 214",
        )


def terms(data: Sequence[int], layout: _Layout) -> tuple[MeterTerm, MeterTerm]:
    """Return energy [J], with its wrap, and power [W] of a model; NaN for no value."""
    broken = bool(_unsigned(data, layout.events) & BROKEN)
    watt_hour = ENERGY_UNITS["Wh"]
    if layout.energy_scale is None or layout.power_scale is None:
        power, energy = _float(data, layout.power), _float(data, layout.energy) * watt_hour
        wraps_at = scale = None
    else:
        count = _unsigned(data, layout.energy)
        scale = _scale(data, layout.energy_scale) * watt_hour
        energy = count * scale if count else math.nan  # zero: not counted, by the specification
        wraps_at = COUNT * scale if math.isfinite(scale) else None
        watt = _signed(data[layout.power])
        power = math.nan if watt == NO_INT16 else watt * _scale(data, layout.power_scale)
    if broken:
        power = energy = math.nan
    return MeterTerm(energy, wraps_at, scale), MeterTerm(power)


def _signed(register: int) -> int:
    return register - 0x10000 if register & 0x8000 else register


def _unsigned(data: Sequence[int], at: int) -> int:
    return data[at] << 16 | data[at + 1]


def _float(data: Sequence[int], at: int) -> float:
    return struct.unpack(">f", struct.pack(">I", _unsigned(data, at)))[0]


def _scale(data: Sequence[int], at: int) -> float:
    """Factor that a scale factor stands for; NaN where it is none. [-]"""
    exponent = _signed(data[at])
    return 10.0**exponent if -10 <= exponent <= 10 else math.nan
