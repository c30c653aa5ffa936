"""Third stage: torque and friction -> power at the shafts, the bus and the grid."""

from __future__ import annotations

import numpy as np

from robot_energy.accounting.power_curve import MeterCurve
from robot_energy.certainty.deviation import (
    CABINET_DEVIATIONS,
    JOINT_DEVIATIONS,
    PowerDeviation,
)
from robot_energy.certainty.friction_certainty import FrictionCertainty
from robot_energy.condition.learner import ConditionLearner, Learning
from robot_energy.condition.thermal_observer import ThermalObserver
from robot_energy.inputs.temperatures.stuck import StuckTemperatureDetector
from robot_energy.model import RobotModel
from robot_energy.physics.equations import Balance
from robot_energy.physics.friction import FrictionModel
from robot_energy.pipeline.friction_stage import FrictionStage
from robot_energy.pipeline.friction_timeline import FallbackUse, FrictionTimeline
from robot_energy.pipeline.settings import Settings
from robot_energy.pipeline.supply import OF_CABINET, SupplyStage
from robot_energy.timeline.blocks import (
    NANOSECOND,
    Bits,
    Float,
    FrictionBlock,
    Int,
    MeterBlock,
    PowerBlock,
    Quality,
    TorqueBlock,
    differences,
    mark,
)
from robot_energy.timeline.hold import HeldRows

NEVER = 1e9  # s, some thirty years
HELD_NS = 10_000_000  # of each, deviations are computed at the first sample [ns]
NO_SLOT = -1  # before the first sample


class PowerStage:
    """Joins torque with the friction valid at its stamp and follows the power chain.

    Torque waits until the stamps have passed it by ``temperature_wait``, so that a temperature
    which arrives a little late still counts from its own stamp. The result therefore
    does not depend on the order in which topics were delivered.

    Attributes:
        watch: Which temperatures are stuck; they are flagged, and stay in use where ``thermal``
            has no estimate, as the motor is at least as warm.
        fallback_use: How many samples had to do without a temperature, and why.
    """

    def __init__(self, model: RobotModel, settings: Settings | None = None) -> None:
        settings = settings or Settings()
        self._settings = settings
        self._friction = FrictionModel.from_model(model)
        self._supply = SupplyStage(model, settings)
        self._hold = self._supply.hold
        self._deviation = PowerDeviation(model)
        self.watch = StuckTemperatureDetector(model)
        self._assumed = settings.temperature_assumed
        stale_after = NEVER if self._assumed else min(model.temperature.stale_after, NEVER)
        self._stale_ns = round(stale_after / NANOSECOND)
        self._wait_ns = round(settings.temperature_wait / NANOSECOND)
        self._timeline = FrictionTimeline(FrictionStage(model).initial())
        self._last_ns: int | None = None  # newest torque that was released
        columns = len(CABINET_DEVIATIONS) + len(JOINT_DEVIATIONS) * len(model.joints)
        self._held: Float = np.zeros((1, columns))  # deviations that hold
        self._slot, self._finite = NO_SLOT, True  # of the newest sample
        self._waiting: TorqueBlock | None = None
        self.fallback_use = FallbackUse(model.temperature.fallback_degc)
        limits = (settings.meter_max_gap, settings.meter_max_power, settings.meter_wraps_at)
        self.thermal = ThermalObserver(model, not self._assumed, MeterCurve(*limits))
        self._certainty = FrictionCertainty(model)
        self._estimated: tuple[int, tuple[Float, ...]] | None = None  # and the window it is for
        self.condition = ConditionLearner(
            model,
            Learning.OFF if self._assumed else settings.learning,
            MeterCurve(*limits),
        )

    def friction(self, block: FrictionBlock) -> None:
        """Take friction coefficients, each row valid from its stamp onward.

        Rows of stamp zero, what holds before any temperature, are known here already; a
        restarted friction monitor repeats them, which must not undo what came later.
        """
        self._timeline.add(block)

    def measure(self, block: MeterBlock) -> None:
        """Take readings of the meter, to learn from."""
        self.condition.measure(block)
        self.thermal.measure(block)

    @property
    def friction_rows(self) -> int:
        """Rows of friction that are kept for later torques."""
        return self._timeline.rows

    def step(self, block: TorqueBlock) -> PowerBlock | None:
        """Return the power at torques that have settled; None while every sample still waits."""
        block = block.motor_side()
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
        self.condition.restart()

    def flush(self) -> PowerBlock | None:
        """Return the power at what still waits, as at the end of a bag."""
        block, self._waiting = self._waiting, None
        power = self._release(block) if block is not None else None
        self.condition.flush()
        return power

    def _release(self, block: TorqueBlock) -> PowerBlock:
        """Compute the power, epoch by epoch."""
        stamp = block.stamp_ns
        before = int(stamp[0]) if self._last_ns is None else self._last_ns
        self._last_ns = int(stamp[-1])
        jumps = (differences(stamp, before) < 0).nonzero()[0].tolist()
        windows = self.thermal.cuts(stamp, before, not jumps)
        cuts = sorted({*jumps, *windows, *self.condition.cuts(stamp, before)})
        parts: list[PowerBlock] = []
        for start, stop in zip([0, *cuts], [*cuts, len(block)], strict=True):
            if stop > start:
                self.condition.begin(int(stamp[start]))
                self.thermal.begin(int(stamp[start]), self.watch.stuck)
                parts.append(self._power(block[slice(start, stop)] if cuts else block))
                self.condition.step(parts[-1])
            if stop in jumps:
                self._slot = NO_SLOT
                self._timeline.jump_back(int(stamp[stop]))
        return PowerBlock.concatenate(parts)

    @np.errstate(invalid="ignore", over="ignore")  # bad samples become NaN, nothing else
    def _power(self, block: TorqueBlock) -> PowerBlock:
        quality = block.quality.copy()
        speed, rigid = block.motor_velocity, block.motor_torque_rigid
        coulomb, viscous, *deviations, degc, measured_degc = self._coefficients(
            block.stamp_ns, quality
        )
        friction_degc = degc
        if self.thermal.geared.any():
            friction_degc = self._follow_gears(degc, quality, viscous, *deviations)
        standing = self._supply.standing(speed)
        friction = self._friction.torque(speed, rigid, coulomb, viscous, standing)
        learned = self.condition.multiplier(speed, friction_degc)
        if learned is not None:
            coulomb, viscous, friction = coulomb * learned, viscous * learned, friction * learned
        torque = rigid + friction
        direction = self._hold.follow(speed)
        wound, held_std = torque, None
        if standing.any():
            torque = np.where(standing, self._hold.torque(rigid, direction), torque)
            wound, held_std = self._hold.in_winding(torque, block.motor_torque_measured, standing)
        rigid_power, friction_power = rigid * speed, friction * speed
        shaft, winding = rigid_power + friction_power, self._supply.winding(degc)
        drawn = self._supply.drawn(shaft, speed, wound, winding, quality)
        drive_loss = drawn - shaft
        stuck = self.watch.step(
            block.stamp_ns,
            block.segment,
            np.where(standing, 0.0, friction_power + drive_loss),
            measured_degc,
        )
        if stuck is not None and not self._assumed:
            mark(quality, stuck, Quality.TEMPERATURE_STUCK)
        cabinet = self._supply.cabinet
        cabinet.offset_dc, cabinet.offset_grid = self.condition.offsets
        if self.condition.in_use:
            quality |= np.uint32(Quality.LEARNED)
        bus, balance, phase = self._supply.balance(block, drawn, standing, quality)
        turning = np.where(standing, 0.0, speed)
        of_motors = (turning, wound, rigid_power, friction_power, drive_loss, viscous, *deviations)
        held = np.zeros_like(torque)
        if held_std is not None and self._settings.deviations:
            held = self._hold.loss_std(self._supply.drive, wound, held_std, winding)
        deviation = self._deviations(block, (*of_motors, held), balance)
        power = PowerBlock(
            stamp_ns=block.stamp_ns,
            segment=block.segment,
            quality=quality,
            phase=phase,
            motor_velocity=speed,
            motor_torque=torque,
            motor_torque_measured=block.motor_torque_measured,
            shaft_power_measured=block.motor_torque_measured * speed,
            rigid_power=rigid_power,
            friction_power=friction_power,
            drive_loss=drive_loss,
            coulomb=coulomb,
            viscous=viscous,
            motor_temperature_degc=degc,
            payload_mass=block.payload_mass,
            bus_power=bus,
            deviation=deviation,
            **{name: getattr(balance, name) for name in OF_CABINET},
        )
        self.thermal.take(power, measured_degc[-1])
        return power

    def _deviations(
        self, block: TorqueBlock, of_motors: tuple[Float, ...], balance: Balance
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
                *(each[rows] for each in of_motors),
                payload_mass=block.payload_mass[rows],
                balance=balance.at(rows),
                stamp_ns=block.stamp_ns[rows],
            )
            if not begins[0]:
                held = np.concatenate([self._held, held])
            self._held = held[-1:]
        else:
            held = self._held
        return HeldRows(held, np.cumsum(begins) - int(begins[0]), begins)

    def _coefficients(self, stamp_ns: Int, quality: Bits) -> tuple[Float, ...]:
        """Friction valid at each stamp: Coulomb, viscous, its deviations, temperature, reading.

        The reading is NaN where missing or stale; the temperature is the reading, or an
        estimate.
        """
        line, row = self._timeline.at(stamp_ns)
        seen = line.temperature_stamp_ns
        coulomb, viscous, std, shared, temperature = (
            values.T.take(row, axis=1).T
            for values in (
                line.coulomb,
                line.viscous,
                line.viscous_std,
                line.viscous_shared_std,
                line.motor_temperature_degc,
            )
        )
        quality |= line.quality[row]
        deadline = np.where(seen > 0, seen + self._stale_ns, np.iinfo(np.int64).max)
        if (stamp_ns > deadline.min(axis=1)[row]).any():
            stale = stamp_ns[:, None] > deadline[row]
            viscous = np.where(stale, line.viscous_fallback[row], viscous)
            std = np.where(stale, line.viscous_fallback_std[row], std)
            shared = np.where(stale, np.minimum(self._certainty.fallback_shared_std, std), shared)
            temperature = np.where(stale, np.nan, temperature)
            mark(quality, np.logical_or.reduce(stale, axis=1), Quality.TEMPERATURE_STALE)
        reading, thermal = temperature, self.thermal
        lacks = thermal.on and bool(thermal.stuck.any() or not np.isfinite(reading.sum()))
        if lacks and (estimated := thermal.estimated(reading)).any():
            temperature = reading.copy()
            found = (temperature, viscous, std, shared)  # own copies of the rows
            values_of = (thermal.degc, *self._estimate()[1:])
            if whole := bool(estimated.all()):
                quality |= np.uint32(Quality.TEMPERATURE_ESTIMATED)
            else:
                marked = np.logical_or.reduce(estimated, axis=1)
                mark(quality, marked, Quality.TEMPERATURE_ESTIMATED)
            for values, of_motors in zip(found, values_of, strict=True):
                np.copyto(values, of_motors, where=True if whole else estimated)
        self.fallback_use.note(stamp_ns, temperature, seen[row[-1]], self._timeline)
        return coulomb, viscous, std, shared, temperature, reading

    def _follow_gears(
        self, degc: Float, quality: Bits, viscous: Float, std: Float, shared: Float
    ) -> Float:
        """Let friction follow the gears; return the temperature it follows, shape (N, n). [degC]

        Args:
            degc: Motor temperatures, shape (N, n). [degC]
            viscous: Of the motor temperatures, its deviation, and the part of it that errs alike at
                all joints; own copies, changed in place, shape (N, n).
        """
        gears = self.thermal.gears
        waiting = self.thermal.geared & ~gears
        if waiting.any():  # the motor is known, not how warm its gear is
            unknown = self.thermal.viscous_share * viscous
            unknown[:, ~waiting] = 0.0
            unknown[np.isnan(degc)] = 0.0
            for values in (std, shared):
                np.hypot(values, unknown, out=values)
        followed = degc.copy()
        found = (followed, viscous, std, shared)
        for values, of_joints in zip(found, self._estimate(), strict=True):
            np.copyto(values, of_joints, where=gears)
        if self.thermal.extrapolated:
            quality |= np.uint32(Quality.EXTRAPOLATED)
        return followed

    def _estimate(self) -> tuple[Float, ...]:
        """Estimated temperature of the friction: viscous, its deviations; shape (n,) each."""
        thermal = self.thermal
        if self._estimated is None or self._estimated[0] != thermal.windows:
            degc = thermal.friction_degc
            total, shared = self._certainty.std(degc)
            spread = thermal.viscous_spread
            values = (
                degc.copy(), thermal.viscous, np.hypot(total, spread), np.hypot(shared, spread),
            )  # fmt: skip
            self._estimated = (thermal.windows, values)
        return self._estimated[1]
