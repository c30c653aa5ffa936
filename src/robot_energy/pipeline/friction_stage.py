"""Second stage: motor temperatures -> friction coefficients."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numpy as np

from robot_energy.certainty.friction_certainty import FrictionCertainty
from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.inputs.temperatures.filter import ReadingStatus, TemperatureFilter
from robot_energy.model import RobotModel
from robot_energy.physics.friction import FrictionModel
from robot_energy.timeline.blocks import (
    Float,
    FrictionBlock,
    Int,
    Quality,
    TemperatureBlock,
    mark,
)

REASONS = {
    ReadingStatus.IMPLAUSIBLE: "temperature_implausible",
    ReadingStatus.OLDER: "temperature_older",
    ReadingStatus.STEP: "temperature_step",
}

DOUBTS = (ReadingStatus.STEP, ReadingStatus.IMPLAUSIBLE)
MAX_REFUSED = 0.1  # share of the values that may be refused without a sentence


class _State(NamedTuple):
    """What is known of the temperatures at one stamp."""

    stamp_ns: int
    temperature_degc: Float
    temperature_stamp_ns: Int
    implausible: bool  # the last reading of some motor


class FrictionStage:
    """Keeps the last temperature of every motor and evaluates the friction laws.

    Readings that are not finite, implausible, a step without cause or older than the last
    one of their motor are counted and change nothing.

    Attributes:
        rejections: Values of motors that arrived, that were used and that were not, by reason.
    """

    def __init__(self, model: RobotModel) -> None:
        self._names = model.joint_names
        self._friction = FrictionModel.from_model(model)
        self._certainty = FrictionCertainty(model)
        n_joints = len(model.joints)
        fallback = np.full(n_joints, model.temperature.fallback_degc)
        self._fallback = self._friction.viscous(fallback)
        # The temperature of a gear is judged where it is known, in the power stage.
        self._motors = np.array([joint.gear is None for joint in model.joints])
        self._judge = TemperatureFilter(n_joints)
        self.rejections = RejectionLog()

    @property
    def refused(self) -> str:
        """That more than a tenth of values jumped or were no temperature, others were; or empty."""
        counts = [self.rejections.rejected[REASONS[one]] for one in DOUBTS]
        if not self.rejections.accepted or sum(counts) <= MAX_REFUSED * self.rejections.received:
            return ""
        return (
            f"of {self.rejections.received} values of motor temperatures {counts[0]} jumped and "
            f"{counts[1]} were outside any range, and were refused: two sensors or robots may "
            "share a topic, and which of them was believed is not known"
        )

    def initial(self) -> FrictionBlock:
        """Return the friction before any temperature is known, valid from the start."""
        none = np.full_like(self._fallback, np.nan)
        return self._rows([_State(0, none, np.zeros(len(none), dtype=np.int64), False)])

    def latest(self) -> FrictionBlock:
        """Return the friction as of the newest temperature, one row."""
        return self._rows([self._state()])

    def outside(self) -> dict[str, str]:
        """Return the motors outside the temperatures of their friction law, and by how much."""
        degc = self._judge.temperature_degc
        beyond = self._motors & ~np.isnan(degc) & self._friction.extrapolated(degc)
        laws = self._friction.laws
        return {
            self._names[
                place
            ]: f"{degc[place]:.1f} degC, fitted from {laws[place].lower_degc:g} to "
            f"{laws[place].upper_degc:g} degC"
            for place in np.flatnonzero(beyond).tolist()
        }

    def step(self, block: TemperatureBlock) -> FrictionBlock | None:
        """Return the friction from each temperature onward that changes something, or None."""
        if not len(block):
            return None
        values, stamp = block.motor_temperature_degc, block.stamp_ns
        if self._judge.take_all(stamp, values):
            self.rejections.received += values.size
            self.rejections.accepted += values.size
            states = [
                _State(at, row, np.full(len(row), at, dtype=np.int64), False)
                for at, row in zip(stamp.tolist(), values, strict=True)
            ]
        else:
            states = [
                self._state()
                for at, row in zip(stamp.tolist(), values, strict=True)
                if self._take(int(at), row)
            ]
        return self._rows(states) if states else None

    def _take(self, stamp: int, values: Float) -> bool:
        """Take one reading; each motor's value is received, accepted or rejected."""
        given = int((~np.isnan(values)).sum())
        self.rejections.received += max(given, 1)
        if not given:
            self.rejections.reject("temperature_not_finite")
            return False
        before = self._judge.doubted
        counts = Counter[int](self._judge.take(stamp, values).tolist())
        for verdict, reason in REASONS.items():
            self.rejections.reject(reason, counts[verdict])
        self.rejections.accepted += counts[ReadingStatus.ACCEPTED]
        turned = bool((before != self._judge.doubted).any())
        return turned or bool(counts[ReadingStatus.ACCEPTED])

    def _state(self) -> _State:
        judge = self._judge
        carried = (judge.stamp_ns == 0) & ~np.isnan(judge.temperature_degc)
        return _State(
            judge.newest_ns,
            judge.temperature_degc.copy(),
            np.where(carried, judge.begin_ns, judge.stamp_ns),
            bool(judge.doubted.any()),
        )

    def _rows(self, states: list[_State]) -> FrictionBlock:
        """Evaluate the laws for every state at once."""
        temperature = np.stack([state.temperature_degc for state in states])
        known = ~np.isnan(temperature)
        extrapolated = known & self._motors & self._friction.extrapolated(temperature)
        quality = np.zeros(len(states), dtype=np.uint32)
        mark(quality, np.logical_or.reduce(~known, axis=1), Quality.TEMPERATURE_MISSING)
        mark(quality, np.logical_or.reduce(extrapolated, axis=1), Quality.EXTRAPOLATED)
        mark(
            quality,
            np.array([state.implausible for state in states]),
            Quality.TEMPERATURE_IMPLAUSIBLE,
        )
        std, shared = self._certainty.std(temperature)
        return FrictionBlock(
            stamp_ns=np.array([state.stamp_ns for state in states], dtype=np.int64),
            quality=quality,
            coulomb=np.tile(self._friction.coulomb, (len(states), 1)),
            viscous=np.where(known, self._friction.viscous(temperature), self._fallback),
            viscous_std=std,
            viscous_shared_std=shared,
            viscous_fallback=np.tile(self._fallback, (len(states), 1)),
            viscous_fallback_std=np.tile(self._certainty.fallback_std, (len(states), 1)),
            motor_temperature_degc=temperature,
            temperature_stamp_ns=np.stack([state.temperature_stamp_ns for state in states]),
        )
