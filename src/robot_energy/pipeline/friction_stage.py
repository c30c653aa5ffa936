"""Second stage: motor temperatures -> friction coefficients."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numpy as np

from robot_energy.blocks import (
    PLAUSIBLE_DEGC,
    Float,
    FrictionBlock,
    Int,
    Quality,
    TemperatureBlock,
    differences,
    in_any_joint,
    mark,
)
from robot_energy.friction import FrictionModel
from robot_energy.model_file import RobotModel

BACKWARD_JUMP_NS = 1_000_000_000  # older stamps than this are a new epoch, not late ones


class _State(NamedTuple):
    """What is known of the temperatures at one stamp."""

    stamp_ns: int
    temperature_degc: Float
    temperature_stamp_ns: Int
    implausible: bool  # the last reading of some motor


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
        self._implausible = np.zeros(n_joints, dtype=np.bool_)  # the motor's last reading was
        self._newest = 0
        self.received = 0
        self.accepted = 0
        self.rejected: Counter[str] = Counter()

    def initial(self) -> FrictionBlock:
        """Return the friction before any temperature is known, valid from the start."""
        none = np.full_like(self._temperature, np.nan)
        return self._rows([_State(0, none, np.zeros_like(self._stamp), False)])

    def latest(self) -> FrictionBlock:
        """Return the friction as of the newest temperature, one row."""
        return self._rows([self._state()])

    def step(self, block: TemperatureBlock) -> FrictionBlock | None:
        """Take temperatures and return the friction from each of them onward.

        Args:
            block: Readings, in order of their stamps as far as they arrived in time.

        Returns:
            One row per reading that changed something, or None.
        """
        if not len(block):
            return None
        values, stamp = block.motor_temperature_degc, block.stamp_ns
        plausible = (values >= PLAUSIBLE_DEGC[0]) & (values <= PLAUSIBLE_DEGC[1])
        newer = differences(stamp, self._newest) >= 0
        if bool(plausible.all()) and bool(newer.all()) and not self._implausible.any():
            states = self._take_all(stamp, values)
        else:
            states = [
                self._state()
                for at, row in zip(stamp.tolist(), values, strict=True)
                if self._take(int(at), row)
            ]
        return self._rows(states) if states else None

    def _take_all(self, stamp: Int, values: Float) -> list[_State]:
        """Store readings of every motor that are all in order: what `_take` does, at once."""
        self.received += values.size
        self.accepted += values.size
        self._newest = int(stamp[-1])
        self._temperature[:] = values[-1]
        self._stamp[:] = stamp[-1]
        return [
            _State(at, row, np.full_like(self._stamp, at), False)
            for at, row in zip(stamp.tolist(), values, strict=True)
        ]

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
        implausible = np.where(given, ~plausible, self._implausible)
        turned = bool((implausible != self._implausible).any())
        self._implausible = implausible
        return turned or bool(newer.any())

    def _state(self) -> _State:
        implausible = bool(self._implausible.any())
        return _State(self._newest, self._temperature.copy(), self._stamp.copy(), implausible)

    def _rows(self, states: list[_State]) -> FrictionBlock:
        """Evaluate the laws for every state at once."""
        temperature = np.stack([state.temperature_degc for state in states])
        known = ~np.isnan(temperature)
        extrapolated = known & self._friction.extrapolated(temperature)
        quality = np.zeros(len(states), dtype=np.uint32)
        mark(quality, in_any_joint(~known), Quality.TEMPERATURE_MISSING)
        mark(quality, in_any_joint(extrapolated), Quality.EXTRAPOLATED)
        mark(
            quality,
            np.array([state.implausible for state in states]),
            Quality.TEMPERATURE_IMPLAUSIBLE,
        )
        return FrictionBlock(
            stamp_ns=np.array([state.stamp_ns for state in states], dtype=np.int64),
            quality=quality,
            coulomb=np.tile(self._friction.coulomb, (len(states), 1)),
            viscous=np.where(known, self._friction.viscous(temperature), self._fallback),
            viscous_fallback=np.tile(self._fallback, (len(states), 1)),
            motor_temperature_degc=temperature,
            temperature_stamp_ns=np.stack([state.temperature_stamp_ns for state in states]),
        )
