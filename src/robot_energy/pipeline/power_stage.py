"""Third stage: torque and friction -> power at the shafts, the bus and the grid."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from operator import itemgetter
from typing import Annotated, Protocol

import numpy as np
from numpy.typing import NDArray

from robot_energy.certainty.deviation import (
    CABINET_DEVIATIONS,
    JOINT_DEVIATIONS,
    PowerDeviation,
)
from robot_energy.certainty.friction_certainty import FrictionCertainty
from robot_energy.foundation.described import Described
from robot_energy.inputs.temperatures.stuck import WINDOW_NS, StuckTemperatureDetector
from robot_energy.model import RobotModel
from robot_energy.physics.drives_and_cabinet import CabinetStage, FanStage, drive_from_model
from robot_energy.physics.drivetrain import motor_standstill
from robot_energy.physics.equations import Balance
from robot_energy.physics.friction import FrictionModel
from robot_energy.physics.hold_torque import HoldTorque
from robot_energy.physics.torque_constant import TorqueConstants
from robot_energy.pipeline.friction_stage import FrictionStage
from robot_energy.pipeline.friction_timeline import FallbackUse, FrictionTimeline
from robot_energy.pipeline.settings import Settings
from robot_energy.timeline.blocks import (
    NANOSECOND,
    Bits,
    EffortMeaning,
    Float,
    HeldRows,
    Int,
    MeterBlock,
    Phase,
    PowerBlock,
    Quality,
    TorqueBlock,
    differences,
    mark,
    sum_over_joints,
    taken,
)

MAX_POWER = 1e6  # no robot draws a megawatt: the joint states are wrong [W]
NEVER = 1e9  # s, some thirty years
HELD_NS = 10_000_000  # of each, deviations are computed at the first sample [ns]
NO_SLOT = -1  # before the first sample


class _Supplied(Described):
    """What drives and cabinet make of the power at the shafts."""

    drive_loss: Annotated[Float, "Drive input minus shaft power, shape (N, n). [W]"]
    bus_power: Annotated[Float, "Of all drives, shape (N,). [W]"]
    phase: Annotated[NDArray[np.uint8], "Shape (N,)."]
    fan_powers: Annotated[Float | None, "As of `FanStage`, shape (2, N). [W]"]
    balance: Balance


class SupplyStage:
    """Drives and cabinet of a robot.

    Attributes:
        fan: Of the cabinet; None without one.
        standstill: Speeds below which motors stand, shape (n,). [rad/s]
        fallback_degc: Of windings whose temperature is not known. [degC]
    """

    def __init__(self, model: RobotModel, settings: Settings) -> None:
        self.drive = drive_from_model(model)
        self.cabinet = CabinetStage(model.cabinet)
        assumed = settings.temperature_assumed
        self.fan = None if model.cabinet.fan is None else FanStage(model.cabinet, assumed)
        self.hold = HoldTorque(model, settings.effort)
        self.standstill = motor_standstill(model)
        self.fallback_degc = model.temperature.fallback_degc

    def step(
        self, block: TorqueBlock | PowerBlock, shaft: Float, wound: Float, degc: Float,
        winding: Float, standing: NDArray[np.bool_], quality: Bits,
    ) -> _Supplied:  # fmt: skip
        """Return what is drawn by samples in time order, behind those before.

        Args:
            shaft: Shaft power, shape (N, n). [W]
            wound: Torque in the windings, shape (N, n). [N m]
            degc: Temperature of the motors, NaN where unknown, shape (N, n). [degC]
            winding: That of the windings, shape (N, n). [degC]
            standing: Where motors stand, shape (N, n).
            quality: Marked in place where a drive is outside its map, and where the power is not
                finite, shape (N,).
        """
        drawn, extrapolated = self.drive.input_power(shaft, block.motor_velocity, wound, winding)
        if extrapolated is not None:
            mark(quality, np.logical_or.reduce(extrapolated, axis=1), Quality.DRIVE_EXTRAPOLATED)
        bus = sum_over_joints(drawn)
        bus[np.abs(bus) > MAX_POWER] = np.nan
        fan, powers = 0.0, None
        if self.fan is not None:
            fan, powers = self.fan.step(degc), self.fan.powers
        balance = self.cabinet.step(block.stamp_ns, block.segment, bus, fan)
        phase = np.full(len(bus), Phase.MOTION, dtype=np.uint8)
        phase[standing.all(axis=1)] = Phase.HOLD
        phase[bus + balance.loss_dc < 0] = Phase.GENERATING
        finite = np.isfinite(balance.grid_power)
        if not finite.all():
            mark(quality, ~finite, Quality.NOT_FINITE)
            phase[~finite] = Phase.UNKNOWN
        return _Supplied(drawn - shaft, bus, phase, powers, balance)

    @np.errstate(invalid="ignore", over="ignore")
    def again(self, power: PowerBlock) -> PowerBlock:
        """Return power, in time order, as these drives and this cabinet make it of its torques."""
        degc = power.motor_temperature_degc
        standing = np.abs(power.motor_velocity) <= self.standstill
        quality = power.quality & ~np.uint32(Quality.DRIVE_EXTRAPOLATED | Quality.NOT_FINITE)
        wound, _ = self.hold.in_winding(power.motor_torque, power.motor_torque_measured, standing)
        winding = np.where(np.isnan(degc), self.fallback_degc, degc)
        found = self.step(power, power.shaft_power, wound, degc, winding, standing, quality)
        return replace(
            power,
            quality=quality,
            phase=found.phase,
            drive_loss=found.drive_loss,
            bus_power=found.bus_power,
            **vars(found.balance),
        )


class Condition(Protocol):
    """What is learned of one robot while it runs, and how it counts in its power.

    Samples are cut at `cuts`; for each part in the order of time come `estimate`,
    `learned`, where figures are in use, and `step`. So what a part has taught counts from the next
    one on.

    Attributes:
        in_use: Whether the part follows learned figures, and not those of the model file alone.
        fan_odds: That the fan of the cabinet runs, by the meter alone; 1 where it does not say. [-]
    """

    in_use: bool
    fan_odds: float

    def measure(self, block: MeterBlock) -> None:
        """Take readings of the meter."""
        ...

    def cuts(self, stamp_ns: Int, before_ns: int, rising: bool) -> list[int]:
        """Return before which samples to cut, in any order.

        Args:
            stamp_ns: Shape (N,), N >= 1. [ns]
            before_ns: Stamp before the first. [ns]
            rising: Whether no stamp is older than the one before it.
        """
        ...

    def estimate(
        self, begin_ns: int, stuck: NDArray[np.bool_], reading_degc: Float, viscous: Float,
        std: Float, shared: Float, quality: Bits,
    ) -> tuple[Float, Float]:  # fmt: skip
        """Return temperatures of the motors of a part, and those that friction follows. [degC]

        Args:
            begin_ns: First stamp of the part, which begins with it. [ns]
            stuck: Whose temperature readings stand still, shape (n,).
            reading_degc: NaN where there is none, shape (N, n), not to be written to. [degC]
            viscous: At these readings, changed in place as the next two, shape (N, n). [N m s/rad]
            std: Its deviation, shape (N, n). [N m s/rad]
            shared: Part of it with the same error at all joints, shape (N, n). [N m s/rad]
            quality: Marked in place, shape (N,).
        """
        ...

    def learned(
        self, motor_velocity: Float, motor_temperature_degc: Float
    ) -> tuple[Float | float, float, float]:
        """Return the learned figures that are in use.

        Args:
            motor_velocity: Shape (N, n). [rad/s]
            motor_temperature_degc: That friction follows, shape (N, n). [degC]

        Returns:
            Factor on friction, shape (N, n) or one for all [-]; what is added to the constant
            losses of the DC side and of the grid side [W].
        """
        ...

    def step(self, block: PowerBlock, reading_degc: Float) -> None:
        """Take the power of the part.

        Args:
            reading_degc: Temperatures read at its end, NaN where there are none, (n,). [degC]
        """
        ...

    def restart(self) -> None:
        """Drop what waits, as after an error."""
        ...

    def flush(self) -> None:
        """Learn from what waits, as at the end of a bag."""
        ...


class PowerStage:
    """Joins torque with the friction valid at its stamp and follows the power chain.

    Torque waits until the stamps have passed it by ``temperature_wait``, so that a temperature
    which arrives a little late still counts from its own stamp. The result therefore
    does not depend on the order in which topics were delivered.

    Attributes:
        timeline: Takes friction coefficients, each row valid from its stamp onward.
        watch: Which temperatures are stuck; they are flagged, and stay in use where ``condition``
            has no estimate, as the motor is at least as warm.
        fallback_use: How many samples had to do without a temperature, and why.
    """

    def __init__(self, model: RobotModel, settings: Settings, condition: Condition) -> None:
        self._settings = settings
        self._friction = FrictionModel.from_model(model)
        self._supply = SupplyStage(model, settings)
        self._hold = self._supply.hold
        # The power node does not know the meaning of an effort: then it is that of a motor.
        by_current = settings.effort is not EffortMeaning.JOINT_TORQUE
        self._constants = TorqueConstants.of(model) if by_current else None
        self._deviation = PowerDeviation(model)
        self.watch = StuckTemperatureDetector(model)
        self._unwatched: list[tuple[Int, Int, Float, Float]] = []  # since `watch` was asked
        self._assumed = settings.temperature_assumed
        stale_after = NEVER if self._assumed else min(model.temperature.stale_after, NEVER)
        self._stale_ns = round(stale_after / NANOSECOND)
        self._wait_ns = round(settings.temperature_wait / NANOSECOND)
        self.timeline = FrictionTimeline(FrictionStage(model).initial())
        self._last_ns: int | None = None  # newest torque that was released
        columns = len(CABINET_DEVIATIONS) + len(JOINT_DEVIATIONS) * len(model.joints)
        self._held: Float = np.zeros((1, columns))  # deviations that hold
        self._slot, self._finite = NO_SLOT, True  # of the newest sample
        self._waiting: TorqueBlock | None = None
        self.fallback_use = FallbackUse(model.temperature.fallback_degc)
        self._fallback_shared_std = FrictionCertainty(model).fallback_shared_std
        self._condition = condition

    def step(self, block: TorqueBlock) -> PowerBlock | None:
        """Return the power at torques that have settled; None while every sample still waits."""
        if self._waiting is not None:
            block = TorqueBlock.concatenate([self._waiting, block])
        stamp = block.stamp_ns
        backward = stamp[1:] < stamp[:-1]
        epoch = int(backward.nonzero()[0][-1]) + 1 if backward.any() else 0
        until = int(stamp[-1]) - self._wait_ns
        ready = epoch + int(np.searchsorted(stamp[epoch:], until, side="right"))
        if ready == len(block):
            self._waiting = None
            return self._release(block)
        self._waiting = block[slice(ready, None)] if ready else block
        return self._release(block[slice(0, ready)]) if ready else None

    def restart(self) -> None:
        """Drop what waits, as after an error."""
        self._waiting = None
        self._condition.restart()

    def flush(self) -> PowerBlock | None:
        """Return the power at what still waits, as at the end of a bag."""
        block, self._waiting = self._waiting, None
        power = self._release(block) if block is not None else None
        self._condition.flush()
        return power

    def _release(self, block: TorqueBlock) -> PowerBlock:
        """Compute the power, epoch by epoch."""
        stamp = block.stamp_ns
        before = int(stamp[0]) if self._last_ns is None else self._last_ns
        self._last_ns = int(stamp[-1])
        jumps = (differences(stamp, before) < 0).nonzero()[0].tolist()
        cuts = sorted({*jumps, *self._condition.cuts(stamp, before, not jumps)})
        parts: list[PowerBlock] = []
        for start, stop in zip([0, *cuts], [*cuts, len(block)], strict=True):
            if stop > start:
                parts.append(self._power(block[slice(start, stop)] if cuts else block))
            if stop in jumps:
                self._slot = NO_SLOT
                self.timeline.jump_back(int(stamp[stop]))
        return PowerBlock.concatenate(parts)

    @np.errstate(invalid="ignore", over="ignore")  # bad samples become NaN, nothing else
    def _power(self, block: TorqueBlock) -> PowerBlock:
        quality = block.quality.copy()
        speed, rigid = block.motor_velocity, block.motor_torque_rigid
        coulomb, viscous, *deviations, measured_degc, degc, friction_degc = self._coefficients(
            block.stamp_ns, quality
        )
        standing = np.abs(speed) <= self._supply.standstill
        friction = self._friction.torque(
            speed, coulomb, viscous, motor_torque_rigid=rigid, standing=standing
        )
        cabinet = self._supply.cabinet
        cabinet.offset_dc = cabinet.offset_grid = 0.0
        if self._condition.in_use:
            learned = self._condition.learned(speed, friction_degc)
            factor, cabinet.offset_dc, cabinet.offset_grid = learned
            coulomb, viscous, friction = coulomb * factor, viscous * factor, friction * factor
            quality |= np.uint32(Quality.LEARNED)
        torque = rigid + friction
        last = self._hold.last_motion
        direction = last.follow(block.stamp_ns, speed) if self._hold.kept else last.direction
        wound, held_std, measured = torque, None, block.motor_torque_measured
        if self._constants is not None:
            measured = measured * self._constants.left(degc)
        if standing.any():
            torque = np.where(standing, self._hold.torque(rigid, direction), torque)
            wound, held_std = self._hold.in_winding(torque, measured, standing)
        rigid_power, friction_power = rigid * speed, friction * speed
        shaft = rigid_power + friction_power
        winding = np.where(np.isnan(degc), self._supply.fallback_degc, degc)
        if self._supply.fan is not None:
            self._supply.fan.odds = self._condition.fan_odds
        supplied = self._supply.step(block, shaft, wound, degc, winding, standing, quality)
        drive_loss, balance = supplied.drive_loss, supplied.balance
        if not self._assumed:
            loss = np.where(standing, 0.0, friction_power + drive_loss)
            self._unwatched.append((block.stamp_ns, block.segment, loss, measured_degc))
            ends = int(block.stamp_ns[0]) // WINDOW_NS, int(block.stamp_ns[-1]) // WINDOW_NS
            if ends != (self.watch.window,) * 2 or self.watch.stuck.any():
                waiting, self._unwatched = zip(*self._unwatched, strict=True), []
                stuck = self.watch.step(*map(np.concatenate, waiting))
                if stuck is not None:
                    mark(quality, stuck[-len(block) :], Quality.TEMPERATURE_STUCK)
        turning = np.where(standing, 0.0, speed)
        of_motors = (turning, wound, rigid_power, friction_power, drive_loss, viscous, *deviations)
        held = np.zeros_like(torque)
        if held_std is not None and self._settings.deviations:
            held = self._hold.loss_std(self._supply.drive, wound, held_std, winding)
        deviation = self._deviations(block, (*of_motors, held), supplied.fan_powers, balance)
        power = PowerBlock(
            stamp_ns=block.stamp_ns,
            segment=block.segment,
            quality=quality,
            phase=supplied.phase,
            motor_velocity=speed,
            motor_torque=torque,
            motor_torque_measured=measured,
            shaft_power_measured=measured * speed,
            rigid_power=rigid_power,
            friction_power=friction_power,
            drive_loss=drive_loss,
            coulomb=coulomb,
            viscous=viscous,
            motor_temperature_degc=degc,
            payload_mass=block.payload_mass,
            bus_power=supplied.bus_power,
            deviation=deviation,
            **vars(balance),
        )
        self._condition.step(power, measured_degc[-1])
        return power

    def _deviations(
        self,
        block: TorqueBlock,
        of_motors: tuple[Float, ...],
        fan_powers: Float | None,
        balance: Balance,
    ) -> HeldRows:
        """Deviations of the power from the first finite sample of each 10 ms on, or after NaN."""
        if not self._settings.deviations:
            return HeldRows(self._held, np.zeros(len(block), np.int64), np.zeros(len(block), bool))
        slot, finite = block.stamp_ns // HELD_NS, np.isfinite(balance.grid_power)
        begins = differences(slot, self._slot) != 0
        if not (self._finite and finite.all()):
            begins[0] |= not self._finite
            begins[1:] |= ~finite[:-1]
            begins &= finite
        self._slot, self._finite = int(slot[-1]), bool(finite[-1])
        rows = begins.nonzero()[0]
        if len(rows):
            held = self._deviation.columns(
                *map(itemgetter(rows), of_motors),
                fan_powers=None if fan_powers is None else fan_powers[:, rows],
                payload_mass=block.payload_mass[rows],
                balance=Balance(*map(itemgetter(rows), vars(balance).values())),
                stamp_ns=block.stamp_ns[rows],
            )
            if not begins[0]:
                held = np.concatenate([self._held, held])
            self._held = held[-1:]
        else:
            held = self._held
        return HeldRows(held, np.cumsum(begins) - int(begins[0]), begins)

    def _coefficients(self, stamp_ns: Int, quality: Bits) -> tuple[Float, ...]:
        """Friction valid at each stamp: Coulomb, viscous, its deviations; and temperatures.

        These are the readings, NaN where missing or stale; the same or estimates; and what
        friction follows.
        """
        line, row = self.timeline.at(stamp_ns)
        seen = line.temperature_stamp_ns
        coulomb, viscous, std, shared, reading = map(
            partial(taken, rows=row),
            (
                line.coulomb,
                line.viscous,
                line.viscous_std,
                line.viscous_shared_std,
                line.motor_temperature_degc,
            ),
        )
        quality |= line.quality[row]
        deadline = np.where(seen > 0, seen + self._stale_ns, np.iinfo(np.int64).max)
        if (stamp_ns > deadline.min(axis=1)[row]).any():
            stale = stamp_ns[:, None] > deadline[row]
            viscous = np.where(stale, line.viscous_fallback[row], viscous)
            std = np.where(stale, line.viscous_fallback_std[row], std)
            shared = np.where(stale, np.minimum(self._fallback_shared_std, std), shared)
            reading = np.where(stale, np.nan, reading)
            mark(quality, np.logical_or.reduce(stale, axis=1), Quality.TEMPERATURE_STALE)
        degc, friction_degc = self._condition.estimate(
            int(stamp_ns[0]), self.watch.stuck, reading, viscous, std, shared, quality
        )
        self.fallback_use.samples += len(stamp_ns)
        if not np.isfinite(degc.sum()):
            self.fallback_use.note(stamp_ns, degc, seen[row[-1]], self.timeline)
        return coulomb, viscous, std, shared, reading, degc, friction_degc
