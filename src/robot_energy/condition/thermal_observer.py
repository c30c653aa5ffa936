"""Temperature of motors that no sensor tells: from the model's own losses, with its variance.

One Kalman filter per motor over windows of 10 s of the stamps. Its state is the temperature of
motor, structure and ambient and the factor on the heat of the losses; with the last two the
variance of an open loop grows by itself, and what a sensor has taught stays when it fails.
The heat of a window moves the temperature that is used from the next one on, so nothing
depends on how the input is cut.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_energy.blocks import (
    DOUBTFUL,
    NANOSECOND,
    PLAUSIBLE_DEGC,
    Float,
    Int,
    PowerBlock,
    differences,
)
from robot_energy.condition.record import ThermalRecord, filled, flat
from robot_energy.errors import StateFileError
from robot_energy.inputs.temperatures.stuck import WINDOW_NS
from robot_energy.model import RobotModel
from robot_energy.physics.friction import FrictionModel
from robot_energy.physics.motor_heat import MotorHeat

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
SECONDS_PER_HOUR = 3600.0


class ThermalObserver:
    """Estimates motor temperatures.

    Corrected by a reading that has changed, else, where there is none, by the viscous friction
    that the measured torque shows, else by nothing. A reading that stands still corrects
    nothing: it may be stuck long before that is known.

    Args:
        model: The robot's model; joints without ``thermal`` are not estimated.
        on: False for a motion whose temperatures are assumed.

    Attributes:
        on: Whether any joint is estimated.
        degc: Estimated temperature of each motor in this window, shape (n,); NaN where there is
            no network. [degC]
        std: Its standard deviation, shape (n,). [K]
        viscous: fv at that temperature, motor side, shape (n,). [N m s/rad]
        viscous_spread: Part of its standard deviation that comes from ``std``, shape (n,).
            [N m s/rad]
        stuck: Whose readings are not believed in this window, shape (n,).
        end_ns: End of the newest window that was taken; None before the first. [ns]
        windows: How often the estimate has moved on.
    """

    def __init__(self, model: RobotModel, on: bool = True) -> None:
        self._model = model
        entries = [joint.thermal for joint in model.joints]
        self._own = np.array([on and entry is not None for entry in entries])
        self.on = bool(self._own.any())
        n_joints = len(entries)
        self.degc = np.full(n_joints, np.nan)
        self.std = np.full(n_joints, np.nan)
        self.viscous, self.viscous_spread = self.degc.copy(), self.std.copy()
        self.stuck = np.zeros(n_joints, dtype=np.bool_)
        self.end_ns: int | None = None
        self.windows = 0
        if not self.on:
            return
        self._friction = FrictionModel.from_model(model)
        self._heat = MotorHeat.of([entry for entry in entries if entry is not None])
        self._step = self._heat.step(WINDOW)
        errors = [entry.std for entry in entries if entry is not None]
        self._drift = np.array([MOTOR_DRIFT if error is None else error for error in errors])
        settings = model.temperature
        ambient = settings.ambient_degc
        self._ambient = settings.fallback_degc if ambient is None else ambient.value
        spread = AMBIENT_STD if ambient is None or ambient.std is None else ambient.std
        count = len(errors)
        self._x = np.tile([self._ambient, self._ambient, self._ambient, 1.0], (count, 1))
        # Motor and structure: the ambient, and what an earlier run has left in both.
        alike = np.array([1.0, 1.0, 1.0, 0.0])
        above = np.array([1.0, 1.0, 0.0, 0.0])
        start = spread**2 * np.outer(alike, alike) + START_STD**2 * np.outer(above, above)
        start[3, 3] = HEAT_STD**2
        self._covariance = np.tile(start, (count, 1, 1))
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

    def cuts(self, stamp_ns: Int, before_ns: int, rising: bool) -> list[int]:
        """Return where samples must be cut, so that a window's heat counts from there on.

        Args:
            stamp_ns: Shape (N,), N >= 1. [ns]
            before_ns: Stamp before the first. [ns]
            rising: Whether no stamp is older than the one before it.
        """
        if not self.on or (rising and before_ns // WINDOW_NS == int(stamp_ns[-1]) // WINDOW_NS):
            return []
        return np.flatnonzero(differences(stamp_ns // WINDOW_NS, before_ns // WINDOW_NS)).tolist()

    def begin(self, stamp_ns: int, stuck: NDArray[np.bool_]) -> None:
        """Let the window before a sample count, if the sample begins another one.

        Args:
            stamp_ns: Of the sample. [ns]
            stuck: Whose readings stand still, shape (n,).
        """
        if not self.on:
            return
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

    def estimated(self, measured_degc: Float) -> NDArray[np.bool_]:
        """Return where the estimate is used instead of a reading, shape of the argument.

        Args:
            measured_degc: Readings, NaN where there is none, shape (n,) or (N, n). [degC]
        """
        return self._own & (np.isnan(measured_degc) | self.stuck)

    def take(self, block: PowerBlock, reading_degc: Float) -> None:
        """Take samples of one window: their heat, and what measured torque says of friction.

        Args:
            block: The samples.
            reading_degc: At the last of them, NaN where there is none, shape (n,). [degC]
        """
        if not self.on:
            return
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
        """Continue from a record.

        Args:
            record: Of the same model file.

        Raises:
            StateFileError: If it is of another model, or does not fit its joints.
        """
        sizes = len(record.state), len(record.covariance)
        fits = sizes == (self._x.size, self._covariance.size)
        if record.model_id != self._model.model_id or not fits:
            raise StateFileError(
                f"motor temperatures of model {record.model_id}", f"model {self._model.model_id}"
            )
        self._x = filled(record.state, self._x)
        self._covariance = filled(record.covariance, self._covariance)
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
        worked = np.stack([drive + heat.share * friction, (1.0 - heat.share) * friction], axis=-1)
        idle = np.stack([heat.idle, np.zeros_like(heat.idle)], axis=-1)
        self._advance(self._step, WINDOW, worked / WINDOW, idle)
        reading = np.where(self.stuck, np.nan, self._reading)[self._own]
        new = ~np.isnan(reading) & (reading != self._used)
        self._used = np.where(new, reading, self._used)
        self._correct(reading, np.where(new, SENSOR_STD**2, np.inf))
        if np.isnan(reading).any():
            self._correct(*self._by_friction(elapsed, np.isnan(reading)))
        self._open.clear()
        if windows > 1:
            self._cool((windows - 1) * WINDOW_NS)
        self.end_ns = max(self._last_ns, 0)

    def _cool(self, duration_ns: int) -> None:
        """Move on by a time without samples and without heat."""
        duration = duration_ns * NANOSECOND
        if duration > 0:
            none = np.zeros((len(self._x), 2))
            self._advance(self._heat.step(duration), duration, none, none)

    def _advance(
        self, step: tuple[Float, Float], duration: float, worked: Float, idle: Float
    ) -> None:
        transition, gain = step
        rise = (gain @ worked[..., None])[..., 0]
        count = len(self._x)
        slope = np.tile(np.eye(4), (count, 1, 1))
        slope[:, :2, :2] = transition
        slope[:, :2, 2] = 1.0 - transition.sum(axis=-1)
        slope[:, :2, 3] = rise
        self._x = (slope @ self._x[..., None])[..., 0]
        self._x[:, :2] += (gain @ idle[..., None])[..., 0]
        covariance = slope @ self._covariance @ slope.swapaxes(-1, -2)
        hours = duration / SECONDS_PER_HOUR
        covariance[:, 0, 0] += self._drift**2 * hours
        covariance[:, 2, 2] += AMBIENT_DRIFT**2 * hours
        covariance[:, 3, 3] += HEAT_DRIFT**2 * hours
        self._covariance = covariance

    def _correct(self, degc: Float, variance: Float) -> None:
        """Correct motors by a temperature; infinite variance for none."""
        known = np.isfinite(variance)
        if not known.any():
            return
        column = self._covariance[:, :, 0]
        total = column[:, 0] + np.where(known, variance, 1.0)
        gain = np.where(known[:, None], column / total[:, None], 0.0)
        self._x += gain * np.where(known, degc - self._x[:, 0], 0.0)[:, None]
        covariance = self._covariance - gain[:, :, None] * column[:, None, :]
        self._covariance = 0.5 * (covariance + covariance.swapaxes(-1, -2))

    def _columns(self, name: str) -> Float:
        """An array of the window for the estimated motors; in one order however it was cut."""
        parts = [getattr(block, name)[:, self._own] for block in self._open]
        return np.asfortranarray(np.concatenate(parts))

    def _by_friction(self, elapsed: Float, unknown: NDArray[np.bool_]) -> tuple[Float, Float]:
        """Temperature at which friction is what the torque shows, linear around the estimate.

        Measured torque less all but viscous friction is ``fv w``; over the window
        ``fv = sum(w (tau - other)) / sum(w^2)``.
        """
        own, measured = self._own, self._columns("motor_torque_measured")
        if np.isnan(measured).all():
            return self._x[:, 0], np.full(len(self._x), np.inf)
        speed = self._columns("motor_velocity")
        rest = measured - self._columns("motor_torque") + self._columns("viscous") * speed
        quality = np.concatenate([block.quality for block in self._open])
        seen = np.isfinite(rest) & (self._columns("friction_power") > 0.0)
        seen &= ((quality & np.uint32(DOUBTFUL)) == 0)[:, None]
        weight = np.where(seen, elapsed[:, None], 0.0)
        squares = (weight * speed**2).sum(axis=0)
        work = np.where(seen, weight * rest * speed, 0.0).sum(axis=0)
        coulomb = (weight * np.abs(speed) * self._columns("coulomb")).sum(axis=0)
        whole = self._whole(self._x[:, 0])
        value = self._friction.viscous(whole)[own]
        slope = (self._friction.viscous(whole + 1.0) - self._friction.viscous(whole - 1.0))[own]
        law = np.nan_to_num(self._friction.viscous_std(whole)[own])
        says = unknown & (value * squares > MIN_WORK) & (slope < 0.0)
        squares, slope = np.where(says, squares, 1.0), np.where(says, 0.5 * slope, -1.0)
        off = (work / squares - value) / slope
        error = np.hypot(law, COULOMB_SHARE * coulomb / squares) / slope
        alone = error**2 + LAG_STD**2
        odd = off**2 > MAX_ODDITY**2 * (self._covariance[:, 0, 0] + alone)
        return self._x[:, 0] + off, np.where(says & ~odd, alone * FRICTION_WINDOWS, np.inf)

    def _whole(self, values: Float) -> Float:
        """Values of the estimated motors at their places; the others at the ambient."""
        whole = np.full(len(self._own), self._ambient)
        whole[self._own] = values
        return whole

    def _publish(self) -> None:
        """Hold the estimate for the window that begins."""
        self.windows += 1
        std = np.sqrt(self._covariance[:, 0, 0])
        self._x[:, :3] = np.clip(self._x[:, :3], *PLAUSIBLE_DEGC)
        self.degc[self._own], self.std[self._own] = self._x[:, 0], std
        degc, spread = self._whole(self._x[:, 0]), np.where(self._own, self.std, 0.0)
        self.viscous = self._friction.viscous(degc)
        colder, warmer = (self._friction.viscous(degc + way * spread) for way in (-1.0, 1.0))
        self.viscous_spread = 0.5 * np.abs(colder - warmer)
