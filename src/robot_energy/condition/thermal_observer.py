"""Temperatures that no sensor measures, of motors and gears: from the model's own losses.

A filter (`robot_energy.condition.thermal_state`) over windows of 10 s of the stamps. With the
ambient and the factor on the heat in its state the variance of an open loop grows by itself, and
what a sensor has taught stays when it fails. The heat of a window moves the temperature that is
used from the next one on, so nothing depends on how the input is cut.

What a gear begins with is not known: measured torque corrects it. Friction that errs for another
reason, such as wear, must not be taken for a temperature. So only the error of the start is
corrected, which fades; what the figures of the gear leave open is in the deviation alone. The power
meter corrects no temperature, as a prediction is compared with it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_energy.certainty.friction_certainty import FrictionCertainty
from robot_energy.condition.record import ThermalRecord, filled, flat
from robot_energy.condition.thermal_state import GEAR, MOTOR, SENSOR_STD, ThermalState
from robot_energy.foundation.errors import StateFileError
from robot_energy.inputs.temperatures.stuck import WINDOW_NS
from robot_energy.model import RobotModel
from robot_energy.physics.friction import FrictionModel
from robot_energy.timeline.blocks import (
    DOUBTFUL,
    NANOSECOND,
    Bits,
    Float,
    Int,
    PowerBlock,
    Quality,
    differences,
    mark,
)

LAG_STD = 3.0  # K, of motors against the gears whose friction is seen
FRICTION_WINDOWS = 60  # with one error of friction: torque constant, Coulomb friction
COULOMB_SHARE = 0.03  # by which Coulomb friction is taken to be off
MAX_ODDITY = 4.0  # standard deviations: beyond it, friction says something else
MIN_WORK = 1.0  # J of friction in a window that says something of it


class ThermalObserver:
    """Estimates temperatures of motors and gears.

    A motor is corrected by a reading that has changed, else, where there is none, by the viscous
    friction that the measured torque shows, else by nothing. A reading that stands still corrects
    nothing: it may be stuck long before that is known. A gear is corrected by that friction.

    Args:
        model: The robot's model; motors without ``thermal`` and gears without ``gear`` are not
            estimated.
        on: False for a motion whose temperatures are assumed.

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

    def __init__(self, model: RobotModel, on: bool = True) -> None:
        self._model = model
        joints = model.joints
        self._networks = np.array([on and joint.thermal is not None for joint in joints])
        self.geared = np.array([on and joint.gear is not None for joint in joints])
        self._own = self._networks | self.geared | self.geared.any()
        self.on = bool(self._own.any())
        n_joints = len(joints)
        self.degc = np.full(n_joints, np.nan)
        self.std = np.full(n_joints, np.nan)
        self.friction_degc, self.friction_std = self.degc.copy(), self.std.copy()
        self.gears, self._follows = np.zeros((2, n_joints), dtype=np.bool_)
        self.stuck = np.zeros(n_joints, dtype=np.bool_)
        self.end_ns: int | None = None
        if not self.on:
            return
        self._friction = FrictionModel.from_model(model)
        self._certainty = FrictionCertainty(model)
        own = [joint for joint, is_own in zip(joints, self._own, strict=True) if is_own]
        self._filter = ThermalState(
            [joint.thermal for joint in own], [joint.gear for joint in own], model.temperature
        )
        self._used = np.full(len(own), np.nan)  # reading of the last correction
        self._open: list[PowerBlock] = []  # of the window that has not ended
        self._reading: Float = np.full(n_joints, np.nan)
        self._window: int | None = None
        self._last_ns, self._segment = 0, -1
        self._publish()

    @property
    def learns(self) -> bool:
        """Whether there is a state to keep across restarts."""
        return self.on

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
            self._filter.cool(stamp_ns - self.end_ns)
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
        if not self._follows.all():  # the motor is known, not how warm its gear is
            unknown = self._unknown_share * viscous
            unknown[:, self._follows] = 0.0
            unknown[np.isnan(degc)] = 0.0
            for values in (std, shared):
                np.hypot(values, unknown, out=values)
        friction_degc = degc.copy()
        _put((friction_degc, viscous, std, shared), self._followed, self._follows)
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
            state=flat(self._filter.x),
            covariance=flat(self._filter.covariance),
            begun=tuple(self._filter.begun.tolist()),
        )

    def restore(self, record: ThermalRecord) -> None:
        """Continue from a record."""
        if record.model_id != self._model.model_id:
            raise StateFileError(
                f"temperatures of model {record.model_id}", f"model {self._model.model_id}"
            )
        state = self._filter
        state.go_on(
            filled(record.state, state.x),
            filled(record.covariance, state.covariance),
            filled(record.begun, state.begun),
        )
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
        state = self._filter
        state.work(drive, friction)
        reading = np.where(self.stuck, np.nan, self._reading)[self._own]
        new = ~np.isnan(reading) & (reading != self._used)
        first = new & np.isnan(self._used)
        self._used = np.where(new, reading, self._used)
        before = state.x[:, MOTOR].copy()
        state.correct(MOTOR, reading, np.where(new & state.networks, SENSOR_STD**2, np.inf))
        state.take_sensed(reading, ~np.isnan(reading) & ~state.networks)
        if first.any():
            state.begin_gears(first, before)
        torque = bool(np.isfinite(self._columns("motor_torque_measured")).any())
        if torque and (np.isnan(reading).any() or state.has_gear.any()):
            self._correct_by_friction(elapsed, np.isnan(reading))
        self._open.clear()
        if windows > 1:
            state.cool((windows - 1) * WINDOW_NS)
        self.end_ns = max(self._last_ns, 0)

    def _correct_by_friction(self, elapsed: Float, unread: NDArray[np.bool_]) -> None:
        """Correct gears, and motors without a gear and without a reading, by measured torque."""
        state = self._filter
        gears = state.gears | (state.others & ~unread)
        place = np.where(gears, GEAR, MOTOR)
        used = gears | (unread & state.networks & ~state.has_gear)
        state.correct(place, *self._by_friction(elapsed, used, place))

    def _columns(self, name: str) -> Float:
        """An array of the window for the estimated motors; in one order however it was cut."""
        parts = [getattr(block, name)[:, self._own] for block in self._open]
        return np.asfortranarray(np.concatenate(parts))

    def _by_friction(
        self, elapsed: Float, used: NDArray[np.bool_], place: Int
    ) -> tuple[Float, Float]:
        """Temperature at which friction is what the torque shows, linear around the estimate.

        Measured torque less all but viscous friction is ``fv u``; over the window
        ``fv = sum(u (tau - other)) / sum(u^2)``, with u the speed w, or its power.
        """
        own, measured = self._own, self._columns("motor_torque_measured")
        state, rows = self._filter, np.arange(len(place))
        now, variance = state.friction_degc, state.covariance[rows, place, place]
        speeds = [self._friction.viscous_velocity(block.motor_velocity) for block in self._open]
        speed = np.asfortranarray(np.concatenate([each[:, own] for each in speeds]))
        rest = measured - self._columns("motor_torque") + self._columns("viscous") * speed
        quality = np.concatenate([block.quality for block in self._open])
        seen = np.isfinite(rest) & (self._columns("friction_power") > 0.0)
        seen &= ((quality & np.uint32(DOUBTFUL)) == 0)[:, None]
        weight = np.where(seen, elapsed[:, None], 0.0)
        squares = (weight * speed**2).sum(axis=0)
        work = np.where(seen, weight * rest * speed, 0.0).sum(axis=0)
        coulomb = (weight * np.abs(speed) * self._columns("coulomb")).sum(axis=0)
        whole = self._whole(now)
        colder, value, warmer = (self._friction.viscous(whole + k)[own] for k in (-1.0, 0.0, 1.0))
        slope = 0.5 * (warmer - colder)
        law = np.nan_to_num(self._friction.viscous_std(whole)[own])
        says = used & (value * squares > MIN_WORK) & (slope < 0.0)
        squares, slope = np.where(says, squares, 1.0), np.where(says, slope, -1.0)
        off = (work / squares - value) / slope
        error = np.hypot(law, COULOMB_SHARE * coulomb / squares) / slope
        alone = error**2 + np.where(state.has_gear, 0.0, LAG_STD**2)
        odd = off**2 > MAX_ODDITY**2 * (variance + alone)
        return state.x[rows, place] + off, np.where(says & ~odd, alone * FRICTION_WINDOWS, np.inf)

    def _spread(self, degc: Float, std: Float) -> Float:
        """Deviation of fv by that of the temperature, shape (n,). [N m s/rad]"""
        colder, warmer = (self._friction.viscous(degc + way * std) for way in (-1.0, 1.0))
        return 0.5 * np.abs(colder - warmer)

    def _whole(self, values: Float) -> Float:
        """Values of the estimated motors at their places; the others at the ambient."""
        whole = np.full(len(self._own), self._filter.ambient_degc)
        whole[self._own] = values
        return whole

    def _publish(self) -> None:
        """Hold the estimate for the window that begins."""
        state = self._filter
        state.clip()
        std = state.std(MOTOR)
        self.degc[self._networks] = state.x[state.networks, MOTOR]
        self.std[self._networks] = std[state.networks]
        self.gears[self._own] = state.gears
        warm = state.networks | ~np.isnan(self._reading[self._own])  # the motor is known
        follows = state.gears | (state.others & warm & (state.x[:, GEAR] != 0.0))
        self._follows[self._own] = follows
        left = np.hypot(state.std(GEAR), np.where(state.has_gear, state.gear.std, std))
        friction_degc = np.where(follows, state.friction_degc, state.x[:, MOTOR])
        self.friction_degc[self._own] = friction_degc
        self.friction_std[self._own] = np.where(follows, left, std)
        degc = self._whole(friction_degc)
        spread, unknown = np.zeros((2, len(self._own)))
        spread[self._own] = self.friction_std[self._own]
        unknown[self._own] = np.where(state.others, state.std(GEAR), self.friction_std[self._own])
        viscous = self._friction.viscous(degc)
        viscous_spread = self._spread(degc, spread)
        whole = np.where(viscous > 0.0, viscous, 1.0)
        self._unknown_share = self._spread(degc, unknown) / whole
        self._extrapolated = bool((self._friction.extrapolated(degc) & self._follows).any())
        total, shared = self._certainty.std(self.friction_degc)
        self._followed = (
            self.friction_degc.copy(), viscous,
            np.hypot(total, viscous_spread), np.hypot(shared, viscous_spread),
        )  # fmt: skip


def _put(values: tuple[Float, ...], estimates: tuple[Float, ...], where: NDArray[np.bool_]) -> None:
    """Write estimates, shape (n,) each, into values, shape (N, n) each."""
    for each, of_joints in zip(values, estimates, strict=True):
        np.copyto(each, of_joints, where=where)
