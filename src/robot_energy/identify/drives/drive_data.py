"""What the fits of drives see of recordings: torque, speed, temperature and power of each axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from robot_energy.blocks import NANOSECOND, Float, Int, MeterBlock, MeterLocation, MeterMeaning
from robot_energy.errors import LogFormatError
from robot_energy.identify.drive_power import DrivePower
from robot_energy.identify.quality import contiguous_blocks
from robot_energy.identify.recordings import Recording
from robot_energy.logs.recording import Contents, LogBlock

BLOCK = 5.0  # s: residuals further apart than this are taken as independent
AVERAGED = 0.1  # s: longest time over which both sides of an equation are averaged
WINDOWS = 400  # wanted, where the recordings are too short for that many of 0.1 s
BLOCKS = 20  # wanted, where the recordings are too short for that many of 5 s
SHORTEST_BLOCK = 0.2  # s
APART = 5.0  # s between rows of a log, beyond which another recording begins
BRIDGED = 0.1  # s between two readings of a drive's power, at most
HELD = 1.0  # J in a DC link, below which nothing is held
COOL = 20.0  # degC, where no temperature of a winding is known


@dataclass(frozen=True)
class DriveData:
    """Samples of all drives, motor side; NaN where something is not known.

    Attributes:
        names: Of the joints.
        stamp_ns: Shape (N,). [ns]
        recording: Number of the recording of each sample, rising, shape (N,).
        stretch: Number of the uninterrupted stretch of each sample, rising, shape (N,).
        block: Contiguous block of each sample, shape (N,).
        window: Shorter ones, over which the fits average both sides of their equations
            against the noise of torque and speed, shape (N,).
        motor_velocity: Shape (N, n). [rad/s]
        motor_torque: Shape (N, n). [N m]
        motor_temperature_degc: Of the windings, shape (N, n). [degC]
        drive_power: Measured electrical input, shape (N, n). [W]
        meters: Readings of each recording's power meter, None without one.
        braking: Where the supply does not pass on what the drives draw, shape (N,).
    """

    names: tuple[str, ...]
    stamp_ns: Int
    recording: Int
    stretch: Int
    block: Int
    window: Int
    motor_velocity: Float
    motor_torque: Float
    motor_temperature_degc: Float
    drive_power: Float
    meters: tuple[MeterBlock | None, ...]
    braking: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.stamp_ns)

    @property
    def shaft_power(self) -> Float:
        """Torque times speed (paper B, eq. 4), shape (N, n). [W]"""
        return self.motor_torque * self.motor_velocity

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Where torque, speed and measured power of a drive are all known, shape (N, n)."""
        return np.isfinite(self.shaft_power) & np.isfinite(self.drive_power)

    @property
    def period(self) -> float:
        """Median time between samples. [s]"""
        step = np.diff(self.stamp_ns)[np.diff(self.stretch) == 0]
        return float(np.median(step)) * NANOSECOND if len(step) else float("nan")

    @property
    def duration(self) -> Float:
        """Time that each sample stands for, shape (N,). [s]"""
        step = np.diff(self.stamp_ns, append=self.stamp_ns[-1:]) * NANOSECOND
        last = np.append(np.diff(self.stretch) != 0, True)
        return np.where(last, self.period, step)

    @property
    def recordings(self) -> int:
        """Number of recordings."""
        return len(self.meters)


def drive_data(
    recordings: Sequence[Recording],
    powers: Sequence[DrivePower | None],
    measured_torque: bool,
) -> DriveData:
    """Collect all axes from recordings of one robot.

    Args:
        recordings: Run with one model.
        powers: Measured power of the drives of each recording, None without.
        measured_torque: Whether to use the measured torque; else that of the model, rigid
            bodies and friction.

    Returns:
        The samples; a power is taken between two readings where they are close enough.
    """
    names = recordings[0].model.joint_names
    stamp = np.concatenate([part.torque.stamp_ns for part in recordings])
    number = np.repeat(np.arange(len(recordings)), [len(part) for part in recordings])
    segment = np.concatenate([part.torque.segment for part in recordings])
    torque = np.concatenate(
        [
            np.where(
                part.sound[:, None],
                part.torque.motor_torque_measured if measured_torque else part.power.motor_torque,
                np.nan,
            )
            for part in recordings
        ]
    )
    electrical = np.concatenate(
        [
            np.full((len(part), len(names)), np.nan)
            if power is None
            else power.at(part.torque.stamp_ns, BRIDGED)
            for part, power in zip(recordings, powers, strict=True)
        ]
    )
    return _data(
        names,
        stamp,
        number,
        segment,
        np.concatenate([part.power.motor_velocity for part in recordings]),
        torque,
        np.concatenate([part.power.motor_temperature_degc for part in recordings]),
        electrical,
        tuple(part.meter for part in recordings),
        np.concatenate([_apart_from_supply(part) for part in recordings]),
    )


def _apart_from_supply(part: Recording) -> NDArray[np.bool_]:
    """Where the supply does not pass on what the drives draw, shape (N,).

    While they brake, and, behind a rectifier, until they have drawn as much again as they
    fed back: a DC link holds some of it and gives that first. How much it holds is not known
    without a capacitor in the model, so all of it is taken.
    """
    power, cabinet = part.power, part.model.cabinet
    apart = (power.brake_power > 0) | (np.abs(power.capacitor_power) > 1.0)
    grid = part.meter is not None and part.meter.location is MeterLocation.GRID
    if not grid or cabinet.capacitor is not None or cabinet.regeneration_efficiency is not None:
        return apart
    held = held_energy(power.bus_power + power.loss_dc, power.stamp_ns, power.segment)
    return apart | (held > HELD)


def held_energy(demand: Float, stamp_ns: Int, segment: Int) -> Float:
    """Return what was fed back to the DC side and not yet drawn again.

    Args:
        demand: Power drawn from the DC side, negative while braking, shape (N,). [W]
        stamp_ns: Shape (N,). [ns]
        segment: A new one starts with nothing, shape (N,).

    Returns:
        Shape (N,), >= 0. [J]
    """
    held = np.zeros(len(demand))
    step = np.diff(stamp_ns, prepend=stamp_ns[:1]) * NANOSECOND
    for number in np.unique(segment):
        rows = np.flatnonzero(segment == number)
        fed = np.nan_to_num(-demand[rows]) * step[rows]
        fed[0] = 0.0
        total = np.cumsum(fed)
        held[rows] = total - np.minimum(np.minimum.accumulate(total), 0.0)
    return held


def drive_data_of_logs(logs: Sequence[tuple[Contents, Sequence[LogBlock]]], unit: str) -> DriveData:
    """Collect all axes from logs, without a model of the robot.

    Args:
        logs: What each log holds, and its rows. A log may hold several recordings, more
            than five seconds apart.
        unit: Of the effort, as the mapping says.

    Returns:
        The samples. "Motor side" is where the log gives torque and speed.

    Raises:
        LogFormatError: If the effort is no torque, speeds are missing, or joints differ.
    """
    contents = logs[0][0]
    if unit != "newton_metre" or not contents.effort or not contents.velocity:
        raise LogFormatError(
            "the log has no speed, or no effort that is a torque",
            "joints.velocity, and joints.effort in newton_metre",
            "with currents, import the log to a bag and use a model with torque constants",
        )
    if any(other.joint_names != contents.joint_names for other, _ in logs):
        raise LogFormatError("the logs have different joints", "logs of one robot")
    parts: list[LogBlock] = []
    for _, blocks in logs:
        rows = LogBlock.concatenate(list(blocks))
        cuts = np.flatnonzero(np.diff(rows.stamp_ns) > APART / NANOSECOND) + 1
        edges = [0, *cuts.tolist(), len(rows)]
        parts += [rows[slice(a, b)] for a, b in pairwise(edges)]
    whole = LogBlock.concatenate(parts)
    number = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    meters: list[MeterBlock | None] = []
    for part in parts:
        given = np.isfinite(part.reading)
        counter = contents.meaning is MeterMeaning.CUMULATIVE
        nothing = np.full(int(given.sum()), np.nan)
        meters.append(
            MeterBlock(
                part.stamp_ns[given],
                nothing if counter else part.reading[given],
                part.reading[given] if counter else nothing,
                np.full(int(given.sum()), contents.interval),
                contents.meaning,
                contents.location,
            )
            if given.any()
            else None
        )
    return _data(
        contents.joint_names,
        whole.stamp_ns,
        number,
        np.zeros(len(whole), dtype=np.int64),
        whole.joint_velocity,
        whole.effort,
        whole.motor_temperature_degc,
        whole.drive_power,
        tuple(meters),
        np.zeros(len(whole), dtype=np.bool_),
    )


def _data(
    names: tuple[str, ...],
    stamp: Int,
    recording: Int,
    segment: Int,
    velocity: Float,
    torque: Float,
    degc: Float,
    power: Float,
    meters: tuple[MeterBlock | None, ...],
    braking: NDArray[np.bool_],
) -> DriveData:
    change = (np.diff(recording, prepend=0) != 0) | (np.diff(segment, prepend=segment[0]) != 0)
    stretch = np.cumsum(change).astype(np.int64)
    inside = np.diff(stretch) == 0
    span = float(np.diff(stamp)[inside].sum()) * NANOSECOND
    length = min(BLOCK, max(SHORTEST_BLOCK, span / BLOCKS))
    return DriveData(
        names,
        stamp,
        recording.astype(np.int64),
        stretch,
        contiguous_blocks(stamp, stretch, length),
        contiguous_blocks(stamp, stretch, max(min(AVERAGED, span / WINDOWS), 1e-6)),
        velocity,
        torque,
        np.where(np.isfinite(degc), degc, COOL),
        power,
        meters,
        braking,
    )


def averaged(values: Float, window: Int) -> Float:
    """Return the mean of every window.

    Args:
        values: Shape (N, K) or (N,).
        window: Number of the window of each row, rising, shape (N,).
    """
    first = np.flatnonzero(np.diff(window, prepend=window[:1] - 1))
    size = np.diff(np.append(first, len(window)))
    total = np.add.reduceat(values, first, axis=0)
    return total / (size if values.ndim == 1 else size[:, None])


def location(data: DriveData) -> MeterLocation | None:
    """Where the meters sit, None if there is none or they differ."""
    places = {meter.location for meter in data.meters if meter is not None}
    return places.pop() if len(places) == 1 else None
