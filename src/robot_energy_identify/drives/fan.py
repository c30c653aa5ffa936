"""A fan of the cabinet, by what the meter shows at rest of the temperature of the warmest motor.

Where it starts and stops is tried; its power is fitted together with constant and losses
(`likely_losses`). It is taken if its power is surely above 0 and the readings, above all those at
rest, are explained better by it than by the same number of readings at one level.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model.figure import Figure
from robot_energy.model.schema import CabinetFan
from robot_energy.physics.cabinet import UNSEEN, FanSwitch
from robot_energy.timeline.blocks import Float
from robot_energy_identify.bounds import identified
from robot_energy_identify.drives.likely_losses import (
    deviation_of_readings,
    huber_weight,
    quiet_readings,
)
from robot_energy_identify.drives.total_power import TotalFit, fit_structure, predict
from robot_energy_identify.drives.total_sums import Sums
from robot_energy_identify.stats.cross_validation import GAIN

STEPS = 30  # temperatures that are tried as the start
HYSTERESES = (0.0, 4.0, 8.0)  # between start and stop that are tried [K]
SURE = 3.0  # standard deviations of the power
MIN_QUIET = 10  # readings at rest with the fan running, and as many without
ROOT12 = 12.0**0.5


@dataclass(frozen=True)
class FoundFan:
    """Between which temperatures of the warmest motor a fan starts and stops.

    Attributes:
        on_degc: Middle of the two temperatures between which it starts. [degC]
        on_std: By their distance. [K]
        hysteresis: Between start and stop. [K]
    """

    on_degc: float
    on_std: float
    hysteresis: float

    def share(self, data: Sums) -> Float:
        """Return the share that runs at each reading, shape (K,). [-]

        Args:
            data: Pieces between readings.
        """
        entry = self.entry(0.0, 0.0, "")
        found = np.full(len(data), UNSEEN)
        for number in np.unique(data.recording):
            rows = np.flatnonzero(data.recording == number)
            found[rows] = FanSwitch(entry).step(len(rows), data.warmest_degc[rows, None])
        return found

    def entry(self, power: float, std: float, source: str) -> CabinetFan:
        """Return the entry of a model file.

        Args:
            power: While it runs, and its deviation. [W]
            std: Its deviation. [W]
            source: Where the data come from.
        """
        on, off = (
            Figure(value=degc, tag="identified", std=self.on_std, source=source)
            for degc in (self.on_degc, self.on_degc - self.hysteresis)
        )
        return CabinetFan(power=identified(power, std, source), on_degc=on, off_degc=off)


def with_fan(data: Sums) -> tuple[Sums, FoundFan | None]:
    """Return the readings with the share of a fan that runs, and the fan; None without one.

    Args:
        data: Pieces between readings.
    """
    try:
        without = fit_structure(data, "axis")
    except NotIdentifiableError:
        return data, None
    rest = data.measured - predict(data, without)
    deviation, quiet = deviation_of_readings(data, rest), quiet_readings(data)

    def cost(rest: Float) -> float:
        score = rest / deviation
        weight = huber_weight(score)
        return float((weight * (2.0 - weight) * score**2).sum())  # Huber's function, twice

    tried: list[tuple[float, Sums, FoundFan, TotalFit]] = []
    tested: set[bytes] = set()
    for fan in _candidates(data.warmest_degc):
        share = fan.share(data)
        if share.tobytes() in tested:
            continue
        tested.add(share.tobytes())
        if min((share[quiet] == 1.0).sum(), (share[quiet] == 0.0).sum()) < MIN_QUIET:
            continue
        switched = replace(data, fan=share)
        fit = fit_structure(switched, "axis")
        tried.append((cost(data.measured - predict(switched, fit)), switched, fan, fit))
    if not tried:
        return data, None
    least = min(one[0] for one in tried)
    # of those that explain the readings alike, the one in the widest gap between temperatures
    alike = [one for one in tried if GAIN * one[0] <= least]
    found, switched, fan, fit = min(alike, key=lambda one: (-one[2].on_std, one[0]))
    if found > GAIN * cost(rest) or fit.fan < SURE * fit.fan_std:
        return data, None
    return switched, fan


def _candidates(warmest_degc: Float) -> Iterator[FoundFan]:
    """Starts between the temperatures that were seen, each with several stops."""
    seen = np.unique(np.round(warmest_degc))
    low, high = seen[:-1], seen[1:]
    every = max(1, -(-len(low) // STEPS))
    for below, above in zip(low[::every].tolist(), high[::every].tolist(), strict=True):
        for hysteresis in HYSTERESES:
            yield FoundFan(0.5 * (below + above), (above - below) / ROOT12, hysteresis)
