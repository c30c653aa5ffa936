"""Sensors of the rig: encoders, stamps, thermometers, the grid meter.

Each has a random stream of its own, so that switching one effect never changes another.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.timeline.blocks import (
    NANOSECOND,
    Float,
    MeterBlock,
    MeterLocation,
    MeterMeaning,
    TemperatureBlock,
)
from robot_energy_plan.motion import Trajectory
from robot_energy_rig.config import RigConfig, RigJoints, Truth

TURN = 2.0 * np.pi  # rad
JITTER_SPREAD = 3.0  # standard deviations at which the jitter is cut
MAX_JITTER = 0.4  # of the sample period, so that stamps always rise


class Stream(IntEnum):
    """Purposes of random numbers; the order must not change."""

    VELOCITY = 0
    TORQUE = 1
    STAMP = 2
    TEMPERATURE = 3
    METER = 4
    DRIVE = 5
    TEMPERATURE_OFFSET = 6
    TORQUE_CONSTANT = 7


def stream(seed: int, purpose: Stream) -> np.random.Generator:
    return np.random.Generator(
        np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(int(purpose),)))
    )


class LowPass:
    """A first-order low pass over consecutive samples; it starts settled at the first one.

    Args:
        time_constant: [s]
        period: Between samples. [s]
    """

    def __init__(self, time_constant: float, period: float) -> None:
        self._kept = float(np.exp(-period / time_constant)) if time_constant else 0.0
        self._last: Float | None = None

    def step(self, values: Float) -> Float:
        """Return the filtered samples, same shape and unit.

        Args:
            values: Shape (N,) or (N, n). [any unit]
        """
        from scipy.signal import lfilter  # heavy to import, for hard effects only

        if not len(values):
            return values
        last = values[0] if self._last is None else self._last
        start = np.asarray(self._kept * last)[None]
        filtered, _ = lfilter([1 - self._kept], [1, -self._kept], values, axis=0, zi=start)
        self._last = filtered[-1]
        return filtered


class JointSensors:
    """What the controller reports of the joints."""

    def __init__(
        self, config: RigConfig, drivetrain: Drivetrain, seed: int, period_ns: int, device: int
    ) -> None:
        self._config = config
        self._drivetrain = drivetrain
        self._velocity = stream(seed, Stream.VELOCITY)
        self._torque = stream(seed, Stream.TORQUE)
        self._stamp = stream(seed, Stream.STAMP)
        self._drive = stream(seed, Stream.DRIVE)
        n_joints = len(drivetrain.rotor_inertia)
        self._drive.uniform(-1.0, 1.0, n_joints)  # the noise begins behind the gains
        gain = stream(device, Stream.DRIVE).uniform(-1.0, 1.0, n_joints)
        self._drive_gain = 1.0 + gain * config.sensors.drive_power_class
        constant = stream(device, Stream.TORQUE_CONSTANT).standard_normal(n_joints)
        self._torque_gain = 1.0 + constant * config.sensors.torque_constant_error
        self._period_ns = period_ns
        lag = LowPass(config.sensors.velocity_filter, period_ns * NANOSECOND)
        self._velocity_filter = lag if config.velocity_filter else None

    def read(self, truth: Truth, motors: Trajectory, motor_torque: Float) -> RigJoints:
        """Return what is reported of consecutive samples.

        Args:
            motor_torque: From currents and name plates, before noise, shape (N, n). [N m]
        """
        sensors, on = self._config.sensors, self._config
        velocity, torque = motors.joint_velocity, motor_torque * self._torque_gain
        stamp_ns, position, power = truth.stamp_ns, motors.joint_position, truth.drive_power
        chain = self._drivetrain
        if self._velocity_filter:
            velocity = self._velocity_filter.step(velocity)
        if on.velocity_noise:
            noise = self._velocity.standard_normal(velocity.shape)
            noise *= sensors.velocity_noise
            velocity = velocity + chain.joint_velocity_from_motor(noise)
        if on.torque_noise:
            torque = torque + self._torque.standard_normal(torque.shape) * sensors.torque_noise
        if on.drive_power_error:
            noise = self._drive.standard_normal(power.shape)
            power = power * self._drive_gain + noise * sensors.drive_power_noise
        if on.stamp_jitter and (sigma := sensors.stamp_jitter / NANOSECOND):
            bound = min(JITTER_SPREAD * sigma, MAX_JITTER * self._period_ns)
            error = np.clip(sigma * self._stamp.standard_normal(len(stamp_ns)), -bound, bound)
            stamp_ns = stamp_ns + np.rint(error).astype(np.int64)
        if on.encoder:
            step = TURN / sensors.encoder_counts
            counts = np.rint(chain.motor_velocity_from_joint(position) / step)
            position = chain.joint_velocity_from_motor(counts * step)
        return RigJoints(stamp_ns, position, velocity, torque, power)


class TemperatureSensor:
    """Motor thermometers with their own rate."""

    def __init__(
        self, config: RigConfig, seed: int, start_stamp_ns: int, n_joints: int, device: int
    ) -> None:
        self._noisy = config.temperature_sensor
        self._sensors = config.sensors
        self._random = stream(seed, Stream.TEMPERATURE)
        self._start_ns = start_stamp_ns
        self._period_ns = round(1.0 / (config.sensors.temperature_rate * NANOSECOND))
        self._next = 0
        time_constant = config.sensors.temperature_lag / config.thermal_speedup
        lag = LowPass(time_constant, self._period_ns * NANOSECOND)
        self._lag = lag if config.temperature_error else None
        offset = stream(device, Stream.TEMPERATURE_OFFSET).standard_normal(n_joints)
        self._offset = offset * config.sensors.temperature_offset

    def read(
        self, begin_ns: int, end_ns: int, begin_degc: Float, end_degc: Float
    ) -> TemperatureBlock:
        """Return the readings in ``[begin, end)``, possibly none.

        Args:
            begin_ns: Since the start. [ns]
            end_ns: Since the start. [ns]
            begin_degc: Motor temperatures at ``begin``, shape (n,). [degC]
            end_degc: And at ``end``, straight between, shape (n,). [degC]
        """
        last = -(-end_ns // self._period_ns)  # first reading at or after the end
        since = np.arange(self._next, max(last, self._next), dtype=np.int64) * self._period_ns
        self._next += len(since)
        share = ((since - begin_ns) / (end_ns - begin_ns))[:, None]
        degc = begin_degc + share * (end_degc - begin_degc)
        if self._lag:
            degc = self._lag.step(degc) + self._offset
        if self._noisy:
            step = self._sensors.temperature_resolution
            degc = degc + self._sensors.temperature_noise * self._random.standard_normal(degc.shape)
            degc = np.rint(degc / step) * step
        return TemperatureBlock(since + self._start_ns, degc)


class GridMeter:
    """A power meter on the mains supply with its own rate.

    Each sample of the true power stands for half a sample period before and after it.

    Args:
        start_stamp_ns: The first interval begins here. [ns]
        period_ns: Between samples of the true power. [ns]
    """

    def __init__(
        self, config: RigConfig, seed: int, start_stamp_ns: int, period_ns: int, device: int
    ) -> None:
        sensors = config.sensors
        self._random = stream(seed, Stream.METER)
        self._random.uniform(-1.0, 1.0)  # the noise begins behind the gain
        gain = float(stream(device, Stream.METER).uniform(-1.0, 1.0)) * sensors.meter_class
        self.gain = 1.0 + gain if config.meter_error else 1.0
        self._noise = sensors.meter_noise if config.meter_error else 0.0
        self._meaning = sensors.meter_meaning
        filtered = config.meter_filter and self._meaning is not MeterMeaning.CUMULATIVE
        self._filter = LowPass(sensors.meter_filter, period_ns * NANOSECOND) if filtered else None
        self._start_ns = start_stamp_ns
        self._sample_ns = period_ns
        self._period_ns = round(1.0 / (sensors.meter_rate * NANOSECOND))
        self._next = 0
        self._energy = 0.0  # J up to the end of the last block
        self._last = 0.0  # J at the last reading

    def read(self, first: int, grid_power: Float) -> MeterBlock:
        """Return the readings that consecutive samples of the true power complete.

        Args:
            grid_power: Shape (N,). [W]
        """
        if self._filter:
            grid_power = self._filter.step(grid_power)
        samples = first + np.arange(len(grid_power) + 1) - 0.5
        edge = samples * self._sample_ns  # ns since the start
        drawn = np.cumsum(grid_power * (self._sample_ns * NANOSECOND))
        energy = np.concatenate([[0.0], drawn]) + self._energy
        self._energy = float(energy[-1])
        stop = int(edge[-1] // self._period_ns) + 1
        index = np.arange(self._next, max(stop, self._next), dtype=np.int64)
        self._next += len(index)
        since = index * self._period_ns
        counter = np.interp(since, edge, energy)
        before = np.concatenate([[self._last], counter[:-1]])
        if len(index):
            self._last = float(counter[-1])
        row = np.clip(np.searchsorted(edge, since, side="right") - 1, 0, len(grid_power) - 1)
        interval = noted = unknown = np.full(len(since), np.nan)
        power = grid_power[row]
        if self._meaning is MeterMeaning.CUMULATIVE:
            power, noted = unknown, counter * self.gain
        else:
            if self._meaning is MeterMeaning.MEAN_OVER_INTERVAL:
                interval = np.full(len(since), self._period_ns * NANOSECOND)
                power = (counter - before) / interval
            noise = 1.0 + self._noise * self._random.standard_normal(len(since))
            power = power * self.gain * noise
        stamp_ns = since + self._start_ns
        block = MeterBlock(stamp_ns, power, noted, interval, self._meaning, MeterLocation.GRID)
        # At index 0 the first interval only begins.
        return block[index > 0] if self._meaning is not MeterMeaning.INSTANTANEOUS else block
