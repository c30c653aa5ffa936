"""Temperatures of motor and gear of each joint and their covariance: one Kalman filter per joint.

The state is the temperature of motor, structure and ambient, the factor on the heat of the losses
and the temperature of the gear. Recordings may show the gears of some joints and not those of
others, whose friction then follows the motor. There the last state is how much warmer the gear was
than its motor when the motor was first read. What recordings do not show is not identified: that
difference begins as 0 with a deviation, and fades as slowly as the slowest gear that is known.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_energy.inputs.temperatures.stuck import WINDOW_NS
from robot_energy.model.joint import JointGear, JointThermal
from robot_energy.model.schema import TemperatureSettings
from robot_energy.physics.motor_heat import GearHeat, MotorHeat
from robot_energy.timeline.blocks import NANOSECOND, PLAUSIBLE_DEGC, Float, Int

WINDOW = WINDOW_NS * NANOSECOND  # s
AMBIENT_STD = 3.0  # K, where the model file gives none
START_STD = 5.0  # K of a motor above the ambient at the first start: it may have run before
HEAT_STD = 0.1  # of the factor on the heat
AMBIENT_DRIFT = 1.0  # K per root hour
HEAT_DRIFT = 0.02  # per root hour
MOTOR_DRIFT = 1.0  # K per root hour: what the network leaves out
SENSOR_STD = 0.7  # K, of one reading in a window
GEAR_START_STD = 1.0  # K of a gear against its motor where the motor is as warm as the air ...
GEAR_START_SHARE = 0.3  # ... and of the motor above the air: one may have worked longer ago
SENSED_DRIFT = 20.0  # K per root hour, of a motor without a network, which its sensor measures
COOLING = 1500.0  # s, in which such a motor cools while nothing comes
LEAST = 1e-3  # K above the air, which no rest takes away
SECONDS_PER_HOUR = 3600.0
MOTOR, STRUCTURE, AMBIENT, HEAT, GEAR = range(5)


class ThermalState:
    """State and covariance of some joints.

    Args:
        thermal: Networks of their motors; None for a motor that its sensor alone measures.
        gears: None for a joint whose friction follows the motor.

    Attributes:
        ambient_degc: Temperature of the air at the start. [degC]
        gear: Of the gears.
        x: Shape (count, 5).
        covariance: Shape (count, 5, 5).
        has_gear: Whose gear the model has, shape (count,).
        networks: Whose motor has a network, shape (count,).
        begun: Whose gear is known, shape (count,): at once by a network, else by the first reading
            of the motor. Where the model has none, whose difference has a deviation.
    """

    def __init__(
        self,
        thermal: list[JointThermal | None],
        gears: list[JointGear | None],
        settings: TemperatureSettings,
    ) -> None:
        self._heat = MotorHeat.of(thermal)
        self._step = self._heat.step(WINDOW)
        self._resting = MotorHeat.of(thermal, COOLING)
        self.has_gear = np.array([entry is not None for entry in gears])
        self.gear = GearHeat.of(gears)
        known = self.gear.time[self.has_gear]
        self._fading = self.gear.time if not len(known) else np.fmin(self.gear.time, known.max())
        self.networks = np.array([entry is not None for entry in thermal])
        self._drift = np.array(
            [
                SENSED_DRIFT if entry is None else MOTOR_DRIFT if entry.std is None else entry.std
                for entry in thermal
            ]
        )
        ambient = settings.ambient_degc
        self.ambient_degc = settings.fallback_degc if ambient is None else ambient.value
        spread = AMBIENT_STD if ambient is None or ambient.std is None else ambient.std
        count = len(thermal)
        self.x: Float = np.tile([self.ambient_degc] * 3 + [1.0, self.ambient_degc], (count, 1))
        # A network was identified with one air for all; without one all is as the thermometer says.
        self._offset = np.where(self.networks, self.gear.offset, 0.0)
        shown = [MOTOR, STRUCTURE, AMBIENT, GEAR]
        self.x[:, shown] += (self.gear.offset - self._offset)[:, None]
        # All: the ambient; motor, structure and gear: what an earlier run has left in them.
        alike = np.array([1.0, 1.0, 1.0, 0.0, 1.0])
        above = np.array([1.0, 1.0, 0.0, 0.0, 1.0])
        start = spread**2 * np.outer(alike, alike) + START_STD**2 * np.outer(above, above)
        start[HEAT, HEAT] = HEAT_STD**2
        self.covariance: Float = np.tile(start, (count, 1, 1))
        self.begun = self.networks & self.has_gear
        self._kept = np.zeros(count, np.bool_)  # whose gear goes on from an earlier state
        self._without = ~self.has_gear & self.has_gear.any()
        self.x[self._without, GEAR] = 0.0
        self.covariance[self._without, GEAR, :] = self.covariance[self._without, :, GEAR] = 0.0

    def go_on(self, x: Float, covariance: Float, begun: NDArray[np.bool_]) -> None:
        """Go on from an earlier state.

        Args:
            x: Temperatures, and the factor of the heat, shape (count, 5). [degC, -]
            covariance: Of them, shape (count, 5, 5). [K^2, K, -]
            begun: Whose gear was known, shape (count,).
        """
        self.x, self.covariance, self.begun, self._kept = x, covariance, begun, begun.copy()

    @property
    def gears(self) -> NDArray[np.bool_]:
        """Whose friction follows the temperature of the gear, shape (count,)."""
        return self.has_gear & self.begun

    @property
    def friction_degc(self) -> Float:
        """What the friction of each joint follows: its gear, else its motor, (count,). [degC]"""
        off = np.where(self._without, self.x[:, GEAR], 0.0)
        return np.where(self.has_gear, self.x[:, GEAR], self.x[:, MOTOR] + off)

    @property
    def others(self) -> NDArray[np.bool_]:
        """Whose gear may be warmer or colder than the motor that friction follows, (count,)."""
        return self.begun & self._without

    def std(self, place: int) -> Float:
        """Return the deviation of a temperature of each joint, shape (count,). [K]"""
        return np.sqrt(np.maximum(self.covariance[:, place, place], 0.0))

    def clip(self) -> None:
        """Keep temperatures plausible."""
        self.x[:, :3] = np.clip(self.x[:, :3], *PLAUSIBLE_DEGC)
        self.x[:, GEAR] = np.clip(self.x[:, GEAR], *PLAUSIBLE_DEGC)

    def work(self, drive: Float, friction: Float) -> None:
        """Move on by one window.

        Args:
            drive: Losses of each drive, shape (count,). [J]
            friction: Friction work of each joint, shape (count,). [J]
        """
        heat = self._heat
        worked = np.stack(
            [drive + heat.share * friction, (1.0 - heat.share) * friction, friction], axis=-1
        )
        idle = np.stack([heat.idle, np.zeros_like(heat.idle)], axis=-1)
        self._advance(*self._window_of(heat, self._step, WINDOW, worked / WINDOW, idle), WINDOW)

    def take_sensed(self, reading: Float, sensed: NDArray[np.bool_]) -> None:
        """Let motors without a network be as warm as their sensors say.

        Args:
            reading: Shape (count,). [degC]
            sensed: Which of them, shape (count,).
        """
        self.x[sensed, MOTOR] = reading[sensed]
        self.covariance[sensed, MOTOR, :] = self.covariance[sensed, :, MOTOR] = 0.0
        self.covariance[sensed, MOTOR, MOTOR] = SENSOR_STD**2

    def begin_gears(self, first: NDArray[np.bool_], before: Float) -> None:
        """Let gears begin at the temperature of their motors, now that it is known.

        After a restart they go on where they were, unless a motor is warmer or colder than the time
        since then has left it: then something else has warmed it.

        Args:
            first: Whose motor has its first reading, shape (count,).
            before: Temperatures of the motors as estimated without it, shape (count,). [degC]
        """
        if not self.has_gear.any():
            return
        started = first & self.has_gear & ~self.begun
        self.begun |= first
        self.x[started, GEAR] = self.x[started, MOTOR]
        self.covariance[started, GEAR, :] = self.covariance[started, MOTOR, :]
        self.covariance[started, :, GEAR] = self.covariance[started, :, MOTOR]
        self.covariance[started, GEAR, GEAR] = self.covariance[started, MOTOR, MOTOR]
        expected = np.where(self._kept, before, self.x[:, AMBIENT] + self._offset)
        off = GEAR_START_SHARE * np.abs(self.x[:, MOTOR] - expected)
        own = (off + np.where(self._kept, 0.0, GEAR_START_STD)) ** 2
        self.covariance[first, GEAR, GEAR] += own[first]

    def cool(self, duration_ns: int) -> None:
        """Move on by a time without samples and without heat.

        How fast gears cool is not well known: ``dT = share (T - T_a) ln((T_0 - T_a) / (T - T_a))``,
        which is most after one time constant and fades with the warmth itself.
        """
        duration = duration_ns * NANOSECOND
        if duration <= 0:
            return
        count = len(self.x)
        none = np.zeros((count, 3))
        heat, followed = self._resting, np.where(self.has_gear, GEAR, MOTOR)
        rows = np.arange(count)
        before = self.x[rows, followed] - self.x[:, AMBIENT] - self._offset
        windows, rest = divmod(duration_ns, WINDOW_NS)
        for length, times in ((WINDOW, int(windows)), (rest * NANOSECOND, int(rest > 0))):
            if times:
                slope, _ = self._window_of(heat, heat.step(length), length, none, none[:, :2])
                slope = np.linalg.matrix_power(slope, times)
                self._advance(slope, np.zeros((count, 5)), length * times)
        if self.has_gear.any():
            left = self.x[rows, followed] - self.x[:, AMBIENT] - self._offset
            first, last = (np.maximum(np.abs(above), LEAST) for above in (before, left))
            off = GEAR_START_SHARE * last * np.log(first / last)
            self.covariance[:, GEAR, GEAR] += off**2

    def _window_of(
        self, heat: MotorHeat, step: tuple[Float, Float], duration: float, worked: Float,
        idle: Float,
    ) -> tuple[Float, Float]:  # fmt: skip
        """What a step does to the state, shape (count, 5, 5), and what it adds, (count, 5)."""
        transition, gain = step
        count = len(self.x)
        slope, added = np.tile(np.eye(5), (count, 1, 1)), np.zeros((count, 5))
        slope[:, :2, :2] = transition
        slope[:, :2, AMBIENT] = 1.0 - transition.sum(axis=-1)
        slope[:, :2, HEAT] = (gain @ worked[:, :2, None])[..., 0]
        added[:, :2] = (gain @ idle[..., None])[..., 0]
        gear = self.gear
        kept = np.exp(-duration / self._fading)
        to_motor = 0.5 * (1.0 - kept) * gear.to_motor
        slope[:, GEAR] = to_motor[:, None] * slope[:, MOTOR]
        slope[:, GEAR, MOTOR] += to_motor
        to_air = np.where(self.has_gear, (1.0 - kept) * (1.0 - gear.to_motor), 0.0)
        slope[:, GEAR, AMBIENT] += to_air
        slope[:, GEAR, GEAR] = kept
        added[:, GEAR] = (1.0 - kept) * gear.per_watt * worked[:, 2] + to_motor * added[:, MOTOR]
        added[:, GEAR] += to_air * self._offset
        return slope, added

    def _advance(self, slope: Float, added: Float, duration: float) -> None:
        self.x = (slope @ self.x[..., None])[..., 0] + added
        covariance = slope @ self.covariance @ slope.swapaxes(-1, -2)
        hours = duration / SECONDS_PER_HOUR
        covariance[:, MOTOR, MOTOR] += self._drift**2 * hours
        covariance[:, AMBIENT, AMBIENT] += AMBIENT_DRIFT**2 * hours
        covariance[:, HEAT, HEAT] += HEAT_DRIFT**2 * hours
        self.covariance = covariance

    def correct(self, place: int | Int, degc: Float, variance: Float) -> None:
        """Correct joints by a temperature.

        Args:
            place: In the state, one or shape (count,).
            degc: Shape (count,). [degC]
            variance: Infinite for a joint that is not corrected, shape (count,). [K^2]
        """
        known = np.isfinite(variance)
        if not known.any():
            return
        rows = np.arange(len(self.x))
        column = self.covariance[rows, :, place]
        total = column[rows, place] + np.where(known, variance, 1.0)
        gain = np.where(known[:, None], column / total[:, None], 0.0)
        self.x += gain * np.where(known, degc - self.x[rows, place], 0.0)[:, None]
        covariance = self.covariance - gain[:, :, None] * column[:, None, :]
        self.covariance = 0.5 * (covariance + covariance.swapaxes(-1, -2))
