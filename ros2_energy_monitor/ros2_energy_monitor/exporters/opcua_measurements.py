# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The variables of the OPC UA server: what each is, and what a message says of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from robot_energy.foundation.units import ENERGY_UNITS
from robot_energy.timeline.blocks import MeterLocation
from ros2_energy_monitor.exporters.exporter import Newest
from ros2_energy_monitor.exporters.values import Topic, stamp_of

WATT, WATT_HOUR = (5723220, "W", "watt"), (5720146, "W·h", "watt hour")


@dataclass(frozen=True)
class Measurement:
    """One variable.

    Attributes:
        size: One of its unit, in that of the field. [-]
        double: Whether it is a Double; a Float otherwise.
        number: MeasurementID; None where no public text states one.
        load: Name of the load outside of the cabinet that it is of; empty for the robot.
    """

    origin: str
    name: str
    topic: Topic
    field: str
    size: float
    double: bool
    unit: tuple[int, str, str]
    number: int | None = None
    load: str = ""

    def value(self, message: Any) -> float:
        """Return the value in a message; NaN where the load is not in it."""
        owner = message
        if self.load:
            owner = next((one for one in message.auxiliary if one.name == self.load), None)
        return math.nan if owner is None else getattr(owner, self.field) / self.size


def _of(origin: str, power: str, energy: str) -> tuple[Measurement, ...]:
    size = ENERGY_UNITS["Wh"]
    low, high = "AcActiveEnergyTotalImportLp", "AcActiveEnergyTotalImportHp"
    return (
        Measurement(origin, "AcActivePowerTotal", Topic.POWER, power, 1.0, False, WATT, 1412),
        Measurement(origin, low, Topic.REGISTERS, energy, size, False, WATT_HOUR, 1001),
        Measurement(origin, high, Topic.REGISTERS, energy, size, True, WATT_HOUR),
    )


def _band(
    name: str, topic: Topic, field: str, size: float, unit: tuple[int, str, str]
) -> Measurement:
    """Part of a 90 % band; the standard has none."""
    return Measurement(PREDICTED, name, topic, field, size, True, unit)


PREDICTED, MEASURED, LOAD = "predicted", "measured", "load"
OBJECTS = {
    PREDICTED: ("PredictedEnergy", "computed by a model from joint states and temperatures"),
    MEASURED: ("MeasuredEnergy", "read from a meter at the mains supply of the cabinet"),
}
MEASUREMENTS = (
    *_of(PREDICTED, "predicted_grid_power", "predicted_import_energy"),
    _band("ActivePowerBandLower", Topic.POWER, "predicted_power_lower", 1.0, WATT),
    _band("ActivePowerBandUpper", Topic.POWER, "predicted_power_upper", 1.0, WATT),
    _band(
        "ActiveEnergyBandHalfWidth",
        Topic.REGISTERS,
        "predicted_energy_band",
        ENERGY_UNITS["Wh"],
        WATT_HOUR,
    ),
    *_of(MEASURED, "measured_power", "measured_energy"),
)


def load_measurements(name: str) -> tuple[Measurement, ...]:
    """Return the measurements of a load outside of the cabinet."""
    energy = ENERGY_UNITS["Wh"]
    return (
        Measurement(
            LOAD, "AcActivePowerTotal", Topic.POWER, "power", 1.0, False, WATT, 1412, name
        ),
        Measurement(
            LOAD, "AcActiveEnergyTotalImportHp", Topic.REGISTERS, "energy", energy, True,
            WATT_HOUR, None, name,
        ),
    )  # fmt: skip


def data_value(one: Measurement, newest: Newest, now: float) -> tuple[float, str, float]:
    """Return value, status and source time [s] of a measurement.

    Args:
        now: Steady time. [s]
    """
    message = newest.message(one.topic)
    if message is None:
        return math.nan, "BadWaitingForInitialData", 0.0
    stamp = stamp_of(message.header.stamp)
    if not newest.is_current(one.topic, now):
        return math.nan, "BadNoCommunication", stamp
    value = one.value(message)
    power = newest.message(Topic.POWER)
    if one.origin is MEASURED and (power is None or power.meter_location != MeterLocation.GRID):
        return math.nan, "BadNotConnected", stamp
    if not math.isfinite(value):
        return math.nan, "BadNotConnected" if one.origin is MEASURED else "BadNoData", stamp
    doubtful = one.origin is PREDICTED and power is not None and power.quality != 0
    return value, "UncertainSubNormal" if doubtful else "Good", stamp
