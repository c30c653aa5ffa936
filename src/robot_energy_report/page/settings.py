"""What the page adds to the monitors' figures: prices, emissions, the length of a shift."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from robot_energy.foundation.config_file import load
from robot_energy.foundation.described import documented
from robot_energy.foundation.errors import PageError
from robot_energy.foundation.units import JOULE_PER_KWH
from robot_energy_history.tariffs import Prices


@documented
class PageSettings(Prices):
    """Settings of the page; all have defaults."""

    shift_hours: Annotated[
        float,
        Field(ge=1.0, le=24.0, allow_inf_nan=False),
        "Length of the longest live history. [h]",
    ] = 8.0


class CostCounter:
    """Cost of an energy register under a tariff.

    With one price, the cost of the whole register. With times of use, that of the energy
    counted since the first register message: when the energy before was used is not known.

    Attributes:
        since_ns: Beginning of the energy that is priced; None before the first. [ns]
        price: In force at the last register; None before the first. [currency/kWh]
    """

    def __init__(self, settings: PageSettings) -> None:
        self._settings = settings
        self._sum = 0.0
        self._last: tuple[int, int, float] | None = None  # start, stamp, energy
        self.since_ns: int | None = None
        self.price: float | None = None

    def add(self, start_ns: int, stamp_ns: int, energy: float) -> None:
        """Take a register.

        Args:
            energy: Its value. [J]
        """
        if self._settings.price_per_kwh is None or not energy >= 0.0:
            return
        if not self._settings.time_of_use:
            self._sum = energy / JOULE_PER_KWH * self._settings.price_per_kwh
            self.since_ns, self.price = start_ns, self._settings.price_per_kwh
            return
        if self._last is None or start_ns != self._last[0] or energy < self._last[2]:
            self._sum, self.since_ns = 0.0, stamp_ns
        else:
            _, before_ns, before = self._last
            price = self._settings.price_at((before_ns + stamp_ns) // 2) or 0.0
            self._sum += (energy - before) / JOULE_PER_KWH * price
        self.price = self._settings.price_at(stamp_ns)
        self._last = (start_ns, stamp_ns, energy)

    @property
    def cost(self) -> float | None:
        """Cost since `since_ns`; None before the first register. [currency]"""
        return None if self.since_ns is None else self._sum


def load_settings(path: str) -> PageSettings:
    """Return the settings of the page."""
    return load(path, PageSettings, PageError, "page settings") if path else PageSettings()
