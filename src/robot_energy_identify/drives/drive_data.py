"""What the fits of drives see of recordings: torque, speed, temperature and power of each axis."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.accounting.power_curve import MeterLimits
from robot_energy.certainty.friction_certainty import FrictionCertainty
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import LogFormatError
from robot_energy.physics.drives_and_cabinet import Drive, FanStage
from robot_energy.physics.drivetrain import motor_standstill
from robot_energy.physics.friction import FrictionModel
from robot_energy.physics.hold_torque import HoldTorque
from robot_energy.physics.torque_constant import TorqueConstants
from robot_energy.timeline.blocks import (
    NANOSECOND,
    EffortMeaning,
    Float,
    Int,
    MeterBlock,
    MeterLocation,
    MeterMeaning,
)
from robot_energy_identify.data.recordings import Recording, temperatures_known
from robot_energy_identify.drives.drive_power import MeasuredDrivePower
from robot_energy_identify.drives.losses import loss_columns
from robot_energy_identify.friction.samples import bodies_identified
from robot_energy_identify.stats.cross_validation import contiguous_blocks
from robot_energy_identify.stats.systematic import DEFAULT_LIMITS, SensorLimits

if TYPE_CHECKING:
    from robot_energy_logs.recording import LogBlock, RecordingContents

BLOCK = 5.0  # s: residuals further apart than this are taken as independent
AVERAGED = 0.1  # s: longest time over which both sides of an equation are averaged
WINDOWS = 400  # wanted, where the recordings are too short for that many of 0.1 s
BLOCKS = 20  # wanted, where the recordings are too short for that many of 5 s
MIN_BLOCK = 0.2  # s
APART = 5.0  # s between rows of a log, beyond which another recording begins
BRIDGED = 0.1  # s between two readings of a drive's power, at most
HELD = 1.0  # J in a DC link, below which nothing is held
COOL = 20.0  # degC, where no temperature of a winding is known
ALL = slice(None)
Rows = slice | Int | NDArray[np.bool_]


class DriveData(Described):
    """Samples of all drives, motor side; NaN where something is not known."""

    names: tuple[str, ...]
    stamp_ns: Annotated[Int, "Shape (N,). [ns]"]
    recording: Annotated[Int, "Number of the recording of each sample, rising, shape (N,)."]
    segment: Annotated[Int, "A new one begins after an interruption, shape (N,)."]
    motor_velocity: Annotated[Float, "Shape (N, n). [rad/s]"]
    motor_torque: Annotated[Float, "Shape (N, n). [N m]"]
    motor_temperature_degc: Annotated[Float, "Of the windings, shape (N, n). [degC]"]
    drive_power: Annotated[Float, "Measured electrical input, shape (N, n). [W]"]
    meters: Annotated[
        tuple[MeterBlock | None, ...], "Readings of each recording's power meter, None without one."
    ]
    limits: Annotated[tuple[MeterLimits, ...], "What the user says of the readings of each."]
    braking: Annotated[
        NDArray[np.bool_], "Where the supply does not pass on what the drives draw, shape (N,)."
    ]
    torque_share: Annotated[
        Float,
        "Part of the motor torque that is off by the error of its torque constant, shape (N, "
        "n); the rest comes from bodies that are given. [N m]",
    ]
    sensors: SensorLimits = DEFAULT_LIMITS
    viscous_off: Annotated[
        Float | None,
        "Power by which the viscous friction in use is off at one deviation of its law, shape "
        "(N, n); None where the torque is measured. [W]",
    ] = None
    fan_power: Annotated[
        Float | None, "Of the fan of the model, shape (N,); None without one. [W]"
    ] = None
    constants: Annotated[
        TorqueConstants | None, "Of the motors; None where no torque constant falls."
    ] = None

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def samples_of(self, number: int) -> slice:
        """Return the samples of one recording."""
        return slice(*np.searchsorted(self.recording, (number, number + 1)).tolist())

    @cached_property
    def stretch(self) -> Int:
        """Number of the uninterrupted stretch of each sample, rising, shape (N,)."""
        change = np.diff(self.recording, prepend=0) != 0
        change |= np.diff(self.segment, prepend=self.segment[0]) != 0
        return np.cumsum(change).astype(np.int64)

    @cached_property
    def block(self) -> Int:
        """Contiguous block of each sample, shape (N,)."""
        length = block_length(self._recorded)
        return contiguous_blocks(self.stamp_ns, self.stretch, length)

    @cached_property
    def window(self) -> Int:
        """Shorter ones, over which the fits average both sides of their equations, shape (N,).

        That is against the noise of torque and speed.
        """
        length = max(min(AVERAGED, self._recorded / WINDOWS), 1e-6)
        return contiguous_blocks(self.stamp_ns, self.stretch, length)

    @property
    def _recorded(self) -> float:
        return float(np.diff(self.stamp_ns)[np.diff(self.stretch) == 0].sum()) * NANOSECOND

    @property
    def shaft_power(self) -> Float:
        """Torque times speed (paper B, eq. 4), shape (N, n). [W]"""
        return self.motor_torque * self.motor_velocity

    def loss_columns(self, rows: Rows = ALL, joints: slice | int = ALL) -> Float:
        """Return the columns of the loss model (`losses.loss_columns`)."""
        part = (rows, joints)
        return loss_columns(
            self.motor_velocity[part], self.heating_torque[part], self.motor_temperature_degc[part]
        )

    @cached_property
    def heating_torque(self) -> Float:
        """Torque that the current of the windings says, shape (N, n). [N m]"""
        if self.constants is None:
            return self.motor_torque
        return self.motor_torque / self.constants.left(self.motor_temperature_degc)

    def input_power(self, drive: Drive, joints: slice = ALL) -> Float:
        """Return the electrical power that a model of some drives says, shape (N, joints). [W]"""
        power, _ = drive.input_power(
            self.shaft_power[:, joints],
            self.motor_velocity[:, joints],
            self.motor_torque[:, joints],
            self.motor_temperature_degc[:, joints],
        )
        return power

    @property
    def supplied_power(self) -> Float:
        """Shaft power of all drives, NaN where the supply does not pass it on, shape (N,). [W]"""
        return np.where(self.braking, np.nan, self.shaft_power.sum(axis=1))

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Where torque, speed and measured power of a drive are all known, shape (N, n)."""
        return np.isfinite(self.shaft_power) & np.isfinite(self.drive_power)

    @property
    def period(self) -> float:
        """Median time between samples. [s]"""
        step = np.diff(self.stamp_ns)[np.diff(self.stretch) == 0]
        return float(np.median(step)) * NANOSECOND if len(step) else float("nan")

    @cached_property
    def periods(self) -> Float:
        """Median time between samples of the recording of each, shape (N,). [s]

        Recordings differ: by their rates, and as long ones are thinned.
        """
        found = np.full(len(self), self.period)
        for number in range(self.recordings):
            rows = self.samples_of(number)
            step = np.diff(self.stamp_ns[rows])[np.diff(self.stretch[rows]) == 0]
            if len(step):
                found[rows] = float(np.median(step)) * NANOSECOND
        return found

    @property
    def duration(self) -> Float:
        """Time that each sample stands for, shape (N,). [s]"""
        step = np.diff(self.stamp_ns, append=self.stamp_ns[-1:]) * NANOSECOND
        last = np.append(np.diff(self.stretch) != 0, True)
        return np.where(last, self.periods, step)

    @property
    def recordings(self) -> int:
        """Number of recordings."""
        return len(self.meters)


def shaft_torque(recording: Recording) -> Float:
    """Return the torque of the model, at rest the measured one where it is known, (N, n). [N m]"""
    power, model = recording.power, recording.model
    standing = np.abs(power.motor_velocity) <= motor_standstill(model)
    effort = EffortMeaning.NONE if recording.replay is None else recording.replay.effort
    hold = HoldTorque(model, effort)
    return hold.in_winding(power.motor_torque, power.motor_torque_measured, standing)[0]


def winding_torque(recording: Recording, torque: Float) -> Float:
    """Return the torque that the current of the windings says.

    Args:
        torque: At the shaft, shape (N, n). [N m]
    """
    constants = TorqueConstants.of(recording.model)
    if constants is None:
        return torque
    return torque / constants.left(recording.power.motor_temperature_degc)


def drive_data(
    recordings: Sequence[Recording],
    powers: Sequence[MeasuredDrivePower | None],
    measured_torque: bool,
) -> DriveData:
    """Return all axes of recordings; a power is taken between readings that are close enough.

    Args:
        powers: Measured power of the drives of each recording, None without.
        measured_torque: Whether to use the measured torque; else that of the model, rigid
            bodies and friction, but at rest the measured one where it is known.
    """
    names, constants = recordings[0].model.joint_names, TorqueConstants.of(recordings[0].model)
    warm = np.concatenate(temperatures_known(recordings))
    if measured_torque and constants is None:  # which holds whatever the temperature
        warm[:] = True
    sound = np.concatenate([part.sound for part in recordings]) & warm
    stamp = np.concatenate([part.torque.stamp_ns for part in recordings])
    number = np.repeat(np.arange(len(recordings)), [len(part) for part in recordings])
    segment = np.concatenate([part.torque.segment for part in recordings])
    torque = np.concatenate(
        [
            part.power.motor_torque_measured if measured_torque else shaft_torque(part)
            for part in recordings
        ]
    )
    torque[~sound] = np.nan
    electrical = np.concatenate(
        [
            np.full((len(part), len(names)), np.nan)
            if power is None
            else power.at(part.torque.stamp_ns, BRIDGED)
            for part, power in zip(recordings, powers, strict=True)
        ]
    )
    shared = torque
    if not (measured_torque or bodies_identified(recordings[0].model)):
        shared = torque - np.concatenate([part.torque.motor_torque_rigid for part in recordings])
    fans = [
        FanStage(part.model.cabinet).step(part.power.motor_temperature_degc) for part in recordings
    ]
    return DriveData(
        names,
        stamp,
        number,
        segment,
        np.concatenate([part.power.motor_velocity for part in recordings]),
        torque,
        _winding(np.concatenate([part.power.motor_temperature_degc for part in recordings])),
        electrical,
        tuple(part.meter for part in recordings),
        tuple(part.limits for part in recordings),
        np.concatenate([_apart_from_supply(part) for part in recordings]),
        shared,
        recordings[0].sensors,
        None if measured_torque else np.concatenate([_viscous_off(part) for part in recordings]),
        np.concatenate(fans) if isinstance(fans[0], np.ndarray) else None,
        constants,
    )


def _viscous_off(part: Recording) -> Float:
    """Power of one deviation of viscous friction, that of one joint for itself, shape (N, n). [W]

    Where friction follows a gear, it has the share of the friction that it has at the motor.
    """
    certainty, friction = FrictionCertainty(part.model), FrictionModel.from_model(part.model)
    speed = part.power.motor_velocity
    degc = part.power.motor_temperature_degc
    known = np.where(np.isnan(degc), part.model.temperature.fallback_degc, degc)
    std, together = certainty.std(known)
    viscous = friction.viscous(known)
    share = np.sqrt(np.maximum(std**2 - together**2, 0.0)) / np.where(viscous > 0, viscous, 1.0)
    return share * part.power.viscous * friction.viscous_velocity(speed) * speed


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
    """Return what was fed back to the DC side and not yet drawn again, shape (N,), >= 0. [J]

    Args:
        demand: Power drawn from the DC side, negative while braking, shape (N,). [W]
        stamp_ns: Shape (N,). [ns]
        segment: A new one starts with nothing, shape (N,).
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


def drive_data_of_logs(
    logs: Sequence[tuple[RecordingContents, Sequence[LogBlock]]], unit: str
) -> DriveData:
    """Return all axes of logs without a model; motor side is where they give torque and speed.

    Args:
        logs: What each log holds, and its rows. A log may hold several recordings, more
            than five seconds apart.
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
        rows = blocks[0].concatenate(blocks)
        cuts = np.flatnonzero(np.diff(rows.stamp_ns) > APART / NANOSECOND) + 1
        edges = [0, *cuts.tolist(), len(rows)]
        parts += [rows[slice(a, b)] for a, b in pairwise(edges)]
    whole = parts[0].concatenate(parts)
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
    return DriveData(
        contents.joint_names,
        whole.stamp_ns,
        number,
        np.zeros(len(whole), dtype=np.int64),
        whole.joint_velocity,
        whole.effort,
        _winding(whole.motor_temperature_degc),
        whole.drive_power,
        tuple(meters),
        (MeterLimits(),) * len(meters),
        np.zeros(len(whole), dtype=np.bool_),
        whole.effort,
    )


def block_length(recorded: float) -> float:
    """Return how long blocks are that count as independent. [s]

    Args:
        recorded: Recorded time. [s]
    """
    return min(BLOCK, max(MIN_BLOCK, recorded / BLOCKS))


def _winding(degc: Float) -> Float:
    return np.where(np.isfinite(degc), degc, COOL)


def location(data: DriveData) -> MeterLocation | None:
    """Return where the meters sit, None if there is none or they differ."""
    places = {meter.location for meter in data.meters if meter is not None}
    return places.pop() if len(places) == 1 else None
