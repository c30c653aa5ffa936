"""Mean power of one phase of the cabinet, with how sure it is."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from robot_energy.identify.stats.regression import SCATTER


@dataclass(frozen=True)
class Level:
    """Mean power of one phase.

    Attributes:
        power: Less what the drives take in it. [W]
        std: Standard deviation of the mean, over events, without constant errors. [W]
        readings: Number of readings.
        events: Number of separate phases they come from.
        spread: Greatest difference between events, such as of holding poses. [W]
        moves: By one standard deviation of each constant error, by cause. [W]
    """

    power: float
    std: float
    readings: int
    events: int
    spread: float
    moves: dict[str, float] = field(default_factory=dict[str, float])

    @property
    def parts(self) -> dict[str, float]:
        """Its deviations by cause. [W]"""
        return {SCATTER: self.std, **{cause: abs(move) for cause, move in self.moves.items()}}

    def less(self, other: Level) -> dict[str, float]:
        """Return the deviations of the difference; constant errors are common to both. [W]

        Args:
            other: What is taken off.
        """
        causes = {**self.moves, **other.moves}
        moves = {
            cause: abs(self.moves.get(cause, 0.0) - other.moves.get(cause, 0.0)) for cause in causes
        }
        return {SCATTER: float(np.hypot(self.std, other.std)), **moves}

    def joined(self, other: Level) -> Level:
        """Return the mean of two levels of the same power, weighted by their inverse variances.

        Where they differ by more than their scatter, the deviation is enlarged by the root of
        chi squared, of one degree of freedom (R. T. Birge, The calculation of errors by the
        method of least squares, Phys. Rev. 40, 1932).

        Args:
            other: The other level.
        """
        both, apart = self.std**2 + other.std**2, abs(self.power - other.power)
        own = other.std**2 / both if both > 0.0 else 0.5  # the weight of this one
        rest = 1.0 - own
        std = max(np.sqrt(rest) * other.std, np.sqrt(own * rest) * apart)
        moves = {
            cause: own * self.moves.get(cause, 0.0) + rest * other.moves.get(cause, 0.0)
            for cause in {**self.moves, **other.moves}
        }
        return Level(
            own * self.power + rest * other.power,
            float(std),
            self.readings + other.readings,
            self.events + other.events,
            max(self.spread, other.spread, apart),
            moves,
        )
