"""Second stage: motor temperatures -> friction coefficients."""

from __future__ import annotations

from collections import Counter

import numpy as np

from robot_energy.blocks import Float, FrictionBlock, Int, Quality, TemperatureBlock
from robot_energy.friction import FrictionModel
from robot_energy.model_file import RobotModel

PLAUSIBLE_DEGC = (-40.0, 200.0)
BACKWARD_JUMP_NS = 1_000_000_000  # older stamps than this are a new epoch, not late ones


class FrictionStage:
    """Keeps the last temperature of every motor and evaluates the friction laws.

    Readings that are not finite, implausible or older than the last one of their motor
    are counted and change nothing.

    Args:
        model: The robot's model.
    """

    def __init__(self, model: RobotModel) -> None:
        self._friction = FrictionModel.from_model(model)
        n_joints = len(model.joints)
        fallback = np.full(n_joints, model.temperature.fallback_degc)
        self._fallback = self._friction.viscous(fallback)
        self._temperature: Float = np.full(n_joints, np.nan)
        self._stamp: Int = np.zeros(n_joints, dtype=np.int64)
        self._newest = 0
        self.received = 0
        self.accepted = 0
        self.rejected: Counter[str] = Counter()

    def initial(self) -> FrictionBlock:
        """Return the friction before any temperature is known, valid from the start."""
        return self._row(0, Quality.TEMPERATURE_MISSING)

    def step(self, block: TemperatureBlock) -> FrictionBlock | None:
        """Take temperatures and return the friction from each of them onward.

        Args:
            block: Readings, in order of their stamps as far as they arrived in time.

        Returns:
            One row per reading that changed something, or None.
        """
        rows: list[FrictionBlock] = []
        for stamp, values in zip(
            block.stamp_ns.tolist(), block.motor_temperature_degc, strict=True
        ):
            if self._take(int(stamp), values):
                missing = np.isnan(self._temperature).any()
                quality = Quality.TEMPERATURE_MISSING if missing else Quality.OK
                rows.append(self._row(self._newest, quality))
        return FrictionBlock.concatenate(rows) if rows else None

    def _take(self, stamp: int, values: Float) -> bool:
        """Store one reading; each motor's value is received, accepted or rejected."""
        given = ~np.isnan(values)
        self.received += max(int(given.sum()), 1)
        if not given.any():
            self.rejected["temperature_not_finite"] += 1
            return False
        if stamp < self._newest - BACKWARD_JUMP_NS:
            self._stamp[:] = 0
            self._newest = stamp
        plausible = given & (values >= PLAUSIBLE_DEGC[0]) & (values <= PLAUSIBLE_DEGC[1])
        newer = plausible & (stamp >= self._stamp)
        self.rejected["temperature_implausible"] += int((given & ~plausible).sum())
        self.rejected["temperature_older"] += int((plausible & ~newer).sum())
        self.accepted += int(newer.sum())
        self._temperature[newer] = values[newer]
        self._stamp[newer] = stamp
        self._newest = max(self._newest, stamp)
        return bool(newer.any())

    def _row(self, stamp: int, quality: Quality) -> FrictionBlock:
        temperature = self._temperature.copy()
        known = ~np.isnan(temperature)
        viscous = np.where(known, self._friction.viscous(temperature), self._fallback)
        extrapolated = known & self._friction.extrapolated(temperature)
        if extrapolated.any():
            quality |= Quality.EXTRAPOLATED
        return FrictionBlock(
            stamp_ns=np.array([stamp], dtype=np.int64),
            quality=np.array([quality], dtype=np.uint32),
            coulomb=self._friction.coulomb[None, :].copy(),
            viscous=viscous[None, :],
            viscous_fallback=self._fallback[None, :].copy(),
            motor_temperature_degc=temperature[None, :],
            temperature_stamp_ns=self._stamp[None, :].copy(),
        )
