"""Temperatures that no sensor measures, of motors and gears: from the model's own losses.

One Kalman filter per joint over windows of 10 s of the stamps. Its state is the temperature of
motor, structure and ambient, the factor on the heat of the losses and the temperature of the gear;
with the ambient and the factor the variance of an open loop grows by itself, and what a sensor has
taught stays when it fails. The heat of a window moves the temperature that is used from the next
one on, so nothing depends on how the input is cut.

What a gear begins with is not known: measured torque corrects it, else the power meter. Friction
that errs for another reason, such as wear, must not be taken for a temperature. So only the error
of the start is corrected, which fades; what the figures of the gear leave open is in the deviation
alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_energy.accounting.power_curve import MeterCurve, MeterLimits
from robot_energy.certainty.friction_certainty import FrictionCertainty
from robot_energy.condition.meter_windows import METER_WAIT, MeterWindows
from robot_energy.condition.record import ThermalRecord, filled, flat
from robot_energy.foundation.errors import StateFileError
from robot_energy.inputs.temperatures.stuck import WINDOW_NS
from robot_energy.model import RobotModel
from robot_energy.physics.friction import FrictionModel
from robot_energy.physics.motor_heat import GearHeat, MotorHeat
from robot_energy.timeline.blocks import (
    DOUBTFUL,
    NANOSECOND,
    PLAUSIBLE_DEGC,
    Bits,
    Float,
    Int,
    MeterBlock,
    MeterLocation,
    Phase,
    PowerBlock,
    Quality,
    differences,
    mark,
)

WINDOW = WINDOW_NS * NANOSECOND  # s
AMBIENT_STD = 3.0  # K, where the model file gives none
START_STD = 5.0  # K of a motor above the ambient at the first start: it may have run before
HEAT_STD = 0.1  # of the factor on the heat
AMBIENT_DRIFT = 1.0  # K per root hour
HEAT_DRIFT = 0.02  # per root hour
MOTOR_DRIFT = 1.0  # K per root hour: what the network leaves out
SENSOR_STD = 0.7  # K, of one reading in a window
LAG_STD = 3.0  # K, of motors against the gears whose friction is seen
FRICTION_WINDOWS = 60  # whose friction errs alike: torque constant, Coulomb friction
COULOMB_SHARE = 0.03  # by which Coulomb friction is taken to be off
MAX_ODDITY = 4.0  # standard deviations: beyond it, friction says something else
MIN_WORK = 1.0  # J of friction in a window that says something of it
GEAR_START_STD = 1.0  # K of a gear against its motor where the motor is as warm as the air ...
GEAR_START_SHARE = 0.3  # ... and of the motor above the air: one may have worked longer ago
SENSED_DRIFT = 20.0  # K per root hour, of a motor without a network, which its sensor measures
COOLING = 1500.0  # s, in which such a motor cools while nothing comes
METER_SHARE = 0.02  # of the measured power by which predictions err alike
METER_LEAST = 5.0  # W, at least
METER_WINDOWS = 60  # of 5 s, that err alike
SLOT_NS = 10_000_000  # of each, the first sample is compared with the meter [ns]
SECONDS_PER_HOUR = 3600.0
PLACES = (MeterLocation.GRID, MeterLocation.DC_BUS)
MOTOR, STRUCTURE, AMBIENT, HEAT, GEAR = range(5)


class ThermalObserver:
    """Estimates temperatures of motors and gears.

    A motor is corrected by a reading that has changed, else, where there is none, by the viscous
    friction that the measured torque shows, else by nothing. A reading that stands still corrects
    nothing: it may be stuck long before that is known. A gear is corrected by that friction, else
    by the power meter.

    Args:
        model: The robot's model; motors without ``thermal`` and gears without ``gear`` are not
            estimated.
        on: False for a motion whose temperatures are assumed.
        curve: Turns readings of the meter into pieces; None for the usual limits.

    Attributes:
        degc: Estimated temperature of each motor in this window, shape (n,); NaN where there is
            no network. [degC]
        std: Its standard deviation, shape (n,). [K]
        geared: Joints that have a gear, shape (n,).
        gears: Whose friction follows the temperature of the gear in this window, shape (n,).
        friction_degc: Temperature that the friction follows: that of the gear, else ``degc``,
            shape (n,). [degC]
        friction_std: Its standard deviation, shape (n,). [K]
        stuck: Whose readings are not believed in this window, shape (n,).
        end_ns: End of the newest window that was taken; None before the first. [ns]
    """

    def __init__(self, model: RobotModel, on: bool = True, curve: MeterCurve | None = None) -> None:
        self._model = model
        joints = model.joints
        self._networks = np.array([on and joint.thermal is not None for joint in joints])
        self.geared = np.array([on and joint.gear is not None for joint in joints])
        self._own = self._networks | self.geared
        self.on = bool(self._own.any())
        n_joints = len(joints)
        self.degc = np.full(n_joints, np.nan)
        self.std = np.full(n_joints, np.nan)
        self.friction_degc, self.friction_std = self.degc.copy(), self.std.copy()
        self.gears = np.zeros(n_joints, dtype=np.bool_)
        self.stuck = np.zeros(n_joints, dtype=np.bool_)
        self.end_ns: int | None = None
        if not self.on:
            return
        self._friction = FrictionModel.from_model(model)
        self._certainty = FrictionCertainty(model)
        own = [joint for joint, is_own in zip(joints, self._own, strict=True) if is_own]
        thermal = [joint.thermal for joint in own]
        self._heat = MotorHeat.of(thermal)
        self._step = self._heat.step(WINDOW)
        self._resting = MotorHeat.of(thermal, COOLING)
        self._gear = GearHeat.of([joint.gear for joint in own])
        self._has_gear = np.isfinite(self._gear.time)
        self._drift = np.array(
            [
                SENSED_DRIFT if entry is None else MOTOR_DRIFT if entry.std is None else entry.std
                for entry in thermal
            ]
        )
        settings = model.temperature
        ambient = settings.ambient_degc
        self._ambient = settings.fallback_degc if ambient is None else ambient.value
        spread = AMBIENT_STD if ambient is None or ambient.std is None else ambient.std
        count = len(own)
        self._x = np.tile([self._ambient] * 3 + [1.0, self._ambient], (count, 1))
        # All: the ambient; motor, structure and gear: what an earlier run has left in them.
        alike = np.array([1.0, 1.0, 1.0, 0.0, 1.0])
        above = np.array([1.0, 1.0, 0.0, 0.0, 1.0])
        start = spread**2 * np.outer(alike, alike) + START_STD**2 * np.outer(above, above)
        start[HEAT, HEAT] = HEAT_STD**2
        self._covariance = np.tile(start, (count, 1, 1))
        # A gear is known once its motor is: at once by a network, else by the first reading.
        self._begun = self._networks[self._own].copy()
        self._windows = MeterWindows(len(PLACES) + count, curve or MeterCurve(MeterLimits.max_gap))
        self._slot = -1
        self._used = np.full(count, np.nan)  # reading of the last correction
        self._open: list[PowerBlock] = []  # of the window that has not ended
        self._reading: Float = np.full(n_joints, np.nan)
        self._window: int | None = None
        self._last_ns, self._segment = 0, -1
        self._publish()

    @property
    def learns(self) -> bool:
        """Whether there is a state to keep across restarts."""
        return self.on

    def measure(self, block: MeterBlock) -> None:
        """Take readings of the meter."""
        if self.geared.any():
            self._windows.measure(block)

    def cuts(self, stamp_ns: Int, before_ns: int, rising: bool) -> list[int]:
        """Return where samples must be cut, so that a window's heat counts from there on.

        Args:
            stamp_ns: Shape (N,), N >= 1. [ns]
            rising: Whether no stamp is older than the one before it.
        """
        if rising and before_ns // WINDOW_NS == int(stamp_ns[-1]) // WINDOW_NS:
            return []
        return np.flatnonzero(differences(stamp_ns // WINDOW_NS, before_ns // WINDOW_NS)).tolist()

    def begin(self, stamp_ns: int, stuck: NDArray[np.bool_]) -> None:
        """Let the window before a sample count, if the sample begins another one.

        Args:
            stuck: Whose readings stand still, shape (n,).
        """
        window = stamp_ns // WINDOW_NS
        if window == self._window:
            return
        if self._window is not None and self._open:
            self._end_window(window - self._window)
        elif self.end_ns is not None:  # continued from a record: nobody has worked meanwhile
            self._cool(stamp_ns - self.end_ns)
        self._window = window
        self.stuck = stuck.copy()
        self._publish()

    def estimate(
        self, reading_degc: Float, viscous: Float, std: Float, shared: Float, quality: Bits
    ) -> tuple[Float, Float]:
        """Put estimates where no reading is believed, and let friction follow the gears.

        Arguments and result as in `robot_energy.pipeline.power_stage.Condition.estimate`.
        """
        degc = reading_degc
        if self.stuck.any() or not np.isfinite(degc.sum()):
            estimated = self._networks & (np.isnan(degc) | self.stuck)
            if estimated.any():
                degc = degc.copy()
                marked = np.logical_or.reduce(estimated, axis=1)
                mark(quality, marked, Quality.TEMPERATURE_ESTIMATED)
                of_motors = (self.degc, *self._followed[1:])
                _put((degc, viscous, std, shared), of_motors, estimated)
        if not self.geared.any():
            return degc, degc
        waiting = self.geared & ~self.gears
        if waiting.any():  # the motor is known, not how warm its gear is
            unknown = self._viscous_share * viscous
            unknown[:, ~waiting] = 0.0
            unknown[np.isnan(degc)] = 0.0
            for values in (std, shared):
                np.hypot(values, unknown, out=values)
        friction_degc = degc.copy()
        _put((friction_degc, viscous, std, shared), self._followed, self.gears)
        if self._extrapolated:
            quality |= np.uint32(Quality.EXTRAPOLATED)
        return degc, friction_degc

    def take(self, block: PowerBlock, reading_degc: Float) -> None:
        """Take samples of one window: their heat, and what measured torque says of friction.

        Args:
            reading_degc: At the last of them, NaN where there is none, shape (n,). [degC]
        """
        self._reading = reading_degc
        self._open.append(block)

    def state(self) -> ThermalRecord | None:
        """Return what must be kept across a restart; None before the first window has ended."""
        if not self.on or self.end_ns is None:
            return None
        return ThermalRecord(
            model_id=self._model.model_id,
            end_ns=self.end_ns,
            state=flat(self._x),
            covariance=flat(self._covariance),
        )

    def restore(self, record: ThermalRecord) -> None:
        """Continue from a record."""
        sizes = len(record.state), len(record.covariance)
        fits = sizes == (self._x.size, self._covariance.size)
        if record.model_id != self._model.model_id or not fits:
            raise StateFileError(
                f"temperatures of model {record.model_id}", f"model {self._model.model_id}"
            )
        self._x = filled(record.state, self._x)
        self._covariance = filled(record.covariance, self._covariance)
        self._begun[:] = True
        self.end_ns, self._window = record.end_ns, None
        self._publish()

    @np.errstate(invalid="ignore", over="ignore")
    def _end_window(self, windows: int) -> None:
        """Move on by the window that ended, and by the time without samples after it."""
        stamp = np.concatenate([block.stamp_ns for block in self._open])
        segment = np.concatenate([block.segment for block in self._open])
        elapsed = differences(stamp, self._last_ns) * NANOSECOND
        elapsed[differences(segment, self._segment) != 0] = 0.0
        self._last_ns, self._segment = int(stamp[-1]), int(segment[-1])
        drive, friction = (
            elapsed @ np.nan_to_num(self._columns(name), posinf=0.0, neginf=0.0)
            for name in ("drive_loss", "friction_power")
        )
        heat = self._heat
        worked = np.stack(
            [drive + heat.share * friction, (1.0 - heat.share) * friction, friction], axis=-1
        )
        idle = np.stack([heat.idle, np.zeros_like(heat.idle)], axis=-1)
        self._advance(*self._window_of(heat, self._step, WINDOW, worked / WINDOW, idle), WINDOW)
        reading = np.where(self.stuck, np.nan, self._reading)[self._own]
        new = ~np.isnan(reading) & (reading != self._used)
        first = new & np.isnan(self._used) & self._has_gear
        self._used = np.where(new, reading, self._used)
        networks = self._networks[self._own]
        self._correct(MOTOR, reading, np.where(new & networks, SENSOR_STD**2, np.inf))
        self._take_sensed(reading, ~np.isnan(reading) & ~networks)
        if first.any():
            self._begin_gears(first)
        torque = bool(np.isfinite(self._columns("motor_torque_measured")).any())
        if torque and (np.isnan(reading).any() or self._has_gear.any()):
            self._correct_by_friction(elapsed, np.isnan(reading))
        if self._has_gear.any():
            self._correct_by_meter(torque)
        self._open.clear()
        if windows > 1:
            self._cool((windows - 1) * WINDOW_NS)
        self.end_ns = max(self._last_ns, 0)

    def _take_sensed(self, reading: Float, sensed: NDArray[np.bool_]) -> None:
        """Let motors without a network be as warm as their sensors say."""
        self._x[sensed, MOTOR] = reading[sensed]
        self._covariance[sensed, MOTOR, :] = self._covariance[sensed, :, MOTOR] = 0.0
        self._covariance[sensed, MOTOR, MOTOR] = SENSOR_STD**2

    def _begin_gears(self, first: NDArray[np.bool_]) -> None:
        """Let gears begin at the temperature of their motors, now that it is known."""
        started = first & ~self._begun
        self._begun |= first
        self._x[started, GEAR] = self._x[started, MOTOR]
        self._covariance[started, GEAR, :] = self._covariance[started, MOTOR, :]
        self._covariance[started, :, GEAR] = self._covariance[started, :, MOTOR]
        self._covariance[started, GEAR, GEAR] = self._covariance[started, MOTOR, MOTOR]
        above = np.abs(self._x[:, MOTOR] - self._x[:, AMBIENT])
        own = (GEAR_START_STD + GEAR_START_SHARE * above) ** 2
        self._covariance[first, GEAR, GEAR] += own[first]

    def _cool(self, duration_ns: int) -> None:
        """Move on by a time without samples and without heat."""
        duration = duration_ns * NANOSECOND
        if duration <= 0:
            return
        count = len(self._x)
        none = np.zeros((count, 3))
        heat, before = self._resting, self._x[:, GEAR].copy()
        windows, rest = divmod(duration_ns, WINDOW_NS)
        for length, times in ((WINDOW, int(windows)), (rest * NANOSECOND, int(rest > 0))):
            if times:
                slope, _ = self._window_of(heat, heat.step(length), length, none, none[:, :2])
                slope = np.linalg.matrix_power(slope, times)
                self._advance(slope, np.zeros((count, 5)), length * times)
        change = GEAR_START_SHARE * (self._x[:, GEAR] - before)
        self._covariance[:, GEAR, GEAR] += np.where(self._has_gear, change**2, 0.0)

    def _window_of(
        self, heat: MotorHeat, step: tuple[Float, Float], duration: float, worked: Float,
        idle: Float,
    ) -> tuple[Float, Float]:  # fmt: skip
        """What a step does to the state, shape (count, 5, 5), and what it adds, (count, 5)."""
        transition, gain = step
        count = len(self._x)
        slope, added = np.tile(np.eye(5), (count, 1, 1)), np.zeros((count, 5))
        slope[:, :2, :2] = transition
        slope[:, :2, AMBIENT] = 1.0 - transition.sum(axis=-1)
        slope[:, :2, HEAT] = (gain @ worked[:, :2, None])[..., 0]
        added[:, :2] = (gain @ idle[..., None])[..., 0]
        gear = self._gear
        kept = np.exp(-duration / gear.time)
        to_motor = 0.5 * (1.0 - kept) * gear.to_motor
        slope[:, GEAR] = to_motor[:, None] * slope[:, MOTOR]
        slope[:, GEAR, MOTOR] += to_motor
        slope[:, GEAR, AMBIENT] += (1.0 - kept) * (1.0 - gear.to_motor)
        slope[:, GEAR, GEAR] = kept
        added[:, GEAR] = (1.0 - kept) * gear.per_watt * worked[:, 2] + to_motor * added[:, MOTOR]
        return slope, added

    def _advance(self, slope: Float, added: Float, duration: float) -> None:
        self._x = (slope @ self._x[..., None])[..., 0] + added
        covariance = slope @ self._covariance @ slope.swapaxes(-1, -2)
        hours = duration / SECONDS_PER_HOUR
        covariance[:, MOTOR, MOTOR] += self._drift**2 * hours
        covariance[:, AMBIENT, AMBIENT] += AMBIENT_DRIFT**2 * hours
        covariance[:, HEAT, HEAT] += HEAT_DRIFT**2 * hours
        self._covariance = covariance

    def _correct(self, place: int | Int, degc: Float, variance: Float) -> None:
        """Correct joints by a temperature at a place of the state; infinite variance for none."""
        known = np.isfinite(variance)
        if not known.any():
            return
        rows = np.arange(len(self._x))
        column = self._covariance[rows, :, place]
        total = column[rows, place] + np.where(known, variance, 1.0)
        gain = np.where(known[:, None], column / total[:, None], 0.0)
        self._x += gain * np.where(known, degc - self._x[rows, place], 0.0)[:, None]
        covariance = self._covariance - gain[:, :, None] * column[:, None, :]
        self._covariance = 0.5 * (covariance + covariance.swapaxes(-1, -2))

    def _correct_by_friction(self, elapsed: Float, unread: NDArray[np.bool_]) -> None:
        """Correct gears, and motors without a gear and without a reading, by measured torque."""
        gears = self._has_gear & self._begun
        place = np.where(gears, GEAR, MOTOR)
        used = gears | (unread & ~self._has_gear)
        self._correct(place, *self._by_friction(elapsed, used, place))

    def _correct_by_meter(self, torque: bool) -> None:
        """Correct all gears together by the residual of the power, where no torque determines more.

        The residual of a window is ``sum(d fv/dT (T_g - estimate) integral(w u dt))``; errors of
        the prediction itself are alike for long, so one window counts for little.
        """
        blocks, last = self._open, self._last_ns
        stamp = np.concatenate([block.stamp_ns for block in blocks])
        rows = differences(stamp // SLOT_NS, self._slot).nonzero()[0]
        self._slot = int(stamp[-1] // SLOT_NS)
        if not len(rows):
            return
        segment = np.concatenate([block.segment for block in blocks])
        power = [
            np.concatenate([block.power_at(place) for block in blocks])[rows] for place in PLACES
        ]
        phase = np.concatenate([block.phase for block in blocks])
        squares = (self._columns("motor_velocity") * self._turning())[rows]
        squares[phase[rows] == Phase.GENERATING] = 0.0
        columns = np.column_stack([*power, squares])
        until = (last // WINDOW_NS + 1) * WINDOW_NS - METER_WAIT
        for window in self._windows.step(stamp[rows], segment[rows], columns, until):
            if torque or not self._begun.any():
                continue
            slope = self._slope()[self._own] * (self._has_gear & self._begun)
            slope *= window.energies[len(PLACES) :]
            column = self._covariance[:, :, GEAR]
            place = PLACES.index(self._windows.location)
            residual = window.measured - float(window.energies[place])
            error = max(METER_SHARE * abs(window.measured), METER_LEAST * window.duration)
            prior = float(slope**2 @ column[:, GEAR])
            if not np.isfinite(residual) or residual**2 > MAX_ODDITY**2 * (prior + error**2):
                continue
            gain = column * (slope / (prior + METER_WINDOWS * error**2))[:, None]
            self._x += gain * residual
            self._covariance = self._covariance - gain[:, :, None] * (
                slope[:, None, None] * column[:, None, :]
            )

    def _slope(self) -> Float:
        """Slope of fv at the temperature of the friction, shape (n,). [N m s/(rad K)]"""
        degc = self._whole(self._x[np.arange(len(self._x)), np.where(self._has_gear, GEAR, MOTOR)])
        return 0.5 * (self._friction.viscous(degc + 1.0) - self._friction.viscous(degc - 1.0))

    def _columns(self, name: str) -> Float:
        """An array of the window for the estimated motors; in one order however it was cut."""
        parts = [getattr(block, name)[:, self._own] for block in self._open]
        return np.asfortranarray(np.concatenate(parts))

    def _turning(self) -> Float:
        """What viscous friction is in proportion to, as `_columns`. [rad/s]"""
        speeds = [self._friction.viscous_velocity(block.motor_velocity) for block in self._open]
        return np.asfortranarray(np.concatenate([speed[:, self._own] for speed in speeds]))

    def _by_friction(
        self, elapsed: Float, used: NDArray[np.bool_], place: Int
    ) -> tuple[Float, Float]:
        """Temperature at which friction is what the torque shows, linear around the estimate.

        Measured torque less all but viscous friction is ``fv u``; over the window
        ``fv = sum(u (tau - other)) / sum(u^2)``, with u the speed w, or its power.
        """
        own, measured = self._own, self._columns("motor_torque_measured")
        rows = np.arange(len(self._x))
        now, variance = self._x[rows, place], self._covariance[rows, place, place]
        speed = self._turning()
        rest = measured - self._columns("motor_torque") + self._columns("viscous") * speed
        quality = np.concatenate([block.quality for block in self._open])
        seen = np.isfinite(rest) & (self._columns("friction_power") > 0.0)
        seen &= ((quality & np.uint32(DOUBTFUL)) == 0)[:, None]
        weight = np.where(seen, elapsed[:, None], 0.0)
        squares = (weight * speed**2).sum(axis=0)
        work = np.where(seen, weight * rest * speed, 0.0).sum(axis=0)
        coulomb = (weight * np.abs(speed) * self._columns("coulomb")).sum(axis=0)
        whole = self._whole(now)
        value, slope = self._friction.viscous(whole)[own], self._slope()[own]
        law = np.nan_to_num(self._friction.viscous_std(whole)[own])
        says = used & (value * squares > MIN_WORK) & (slope < 0.0)
        squares, slope = np.where(says, squares, 1.0), np.where(says, slope, -1.0)
        off = (work / squares - value) / slope
        error = np.hypot(law, COULOMB_SHARE * coulomb / squares) / slope
        alone = error**2 + np.where(place == GEAR, 0.0, LAG_STD**2)
        odd = off**2 > MAX_ODDITY**2 * (variance + alone)
        return now + off, np.where(says & ~odd, alone * FRICTION_WINDOWS, np.inf)

    def _whole(self, values: Float) -> Float:
        """Values of the estimated motors at their places; the others at the ambient."""
        whole = np.full(len(self._own), self._ambient)
        whole[self._own] = values
        return whole

    def _publish(self) -> None:
        """Hold the estimate for the window that begins."""
        self._x[:, :3] = np.clip(self._x[:, :3], *PLAUSIBLE_DEGC)
        self._x[:, GEAR] = np.clip(self._x[:, GEAR], *PLAUSIBLE_DEGC)
        std = np.sqrt(np.maximum(self._covariance[:, MOTOR, MOTOR], 0.0))
        motors = self._networks[self._own]
        self.degc[self._networks] = self._x[motors, MOTOR]
        self.std[self._networks] = std[motors]
        gears = self._has_gear & self._begun
        self.gears[self._own] = gears
        left = np.hypot(np.sqrt(np.maximum(self._covariance[:, GEAR, GEAR], 0.0)), self._gear.std)
        self.friction_degc[self._own] = np.where(gears, self._x[:, GEAR], self._x[:, MOTOR])
        self.friction_std[self._own] = np.where(gears, left, std)
        degc = self._whole(self.friction_degc[self._own])
        spread = np.where(self._own, self.friction_std, 0.0)
        viscous = self._friction.viscous(degc)
        colder, warmer = (self._friction.viscous(degc + way * spread) for way in (-1.0, 1.0))
        viscous_spread = 0.5 * np.abs(colder - warmer)  # that comes from ``friction_std``
        self._viscous_share = viscous_spread / np.where(viscous > 0.0, viscous, 1.0)
        self._extrapolated = bool((self._friction.extrapolated(degc) & self.gears).any())
        total, shared = self._certainty.std(self.friction_degc)
        self._followed = (
            self.friction_degc.copy(), viscous,
            np.hypot(total, viscous_spread), np.hypot(shared, viscous_spread),
        )  # fmt: skip


def _put(values: tuple[Float, ...], estimates: tuple[Float, ...], where: NDArray[np.bool_]) -> None:
    """Write estimates, shape (n,) each, into values, shape (N, n) each."""
    for each, of_joints in zip(values, estimates, strict=True):
        np.copyto(each, of_joints, where=where)
