"""What the fit of friction sees of one axis, taken from recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.errors import LogFormatError, NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.physics.equations import viscous_velocity
from robot_energy.timeline.blocks import NANOSECOND, Float, Int, Rows
from robot_energy_identify.data.recordings import LACKING, Recording
from robot_energy_identify.data.thinned import few
from robot_energy_identify.stats.cross_validation import averaged, contiguous_blocks, rms_of
from robot_energy_identify.stats.regression import Method
from robot_energy_identify.stats.systematic import BODIES, TORQUE

if TYPE_CHECKING:
    from robot_energy_logs.recording import LogBlock

MIN_SAMPLES = 200
SPEED_SHARE = 0.03  # of the greatest speed: below it Stribeck friction reigns
AVERAGED = 0.04  # s: samples this close say the same of friction
BLOCK = 5.0  # s: residuals further apart than this are taken as independent
LOG_BLOCK = 30.0  # s: the same for a slow log of one joint
APART = 5.0  # s between rows of a log, beyond which another run begins
STEADY = 0.03  # of the greatest speed: a change from row to row beyond it is not a steady motion


class FrictionData(Rows):
    """What the fit of one axis sees, motor side. Samples at rest are left out by the fit."""

    name: str
    motor_velocity: Annotated[Float, "Shape (N,). [rad/s]"]
    friction_torque: Annotated[
        Float,
        "Measured minus rigid-body motor torque, shape (N,). [N m], or the unit of a relative "
        "measurement such as ampere.",
    ]
    motor_temperature_degc: Annotated[Float, "At each sample, shape (N,). [degC]"]
    block: Annotated[Int, "Contiguous block of each sample, shape (N,)."]
    run: Annotated[
        Int, "Number of the recording, or of the run inside a log, of each sample, shape (N,)."
    ]
    nuisance: Annotated[
        Float,
        "Further columns whose coefficients are fitted and thrown away, such as what gravity does "
        "to an axis whose bodies are not modelled, shape (N, K).",
    ]
    smooth_velocity: Annotated[
        float, "w0 of the smooth sign ``tanh(w/w0)``; 0 for the plain sign. [rad/s]"
    ] = 0.0
    causes: Annotated[tuple[str, ...], "Of constant errors."] = ()
    changes: Annotated[
        Float | None,
        "Of the friction torque by one standard deviation of each of them, shape (N, causes); None "
        "for none. [N m]",
    ] = None
    thermometer: Annotated[
        float, "Standard deviation of the offset of the motor temperature. [K]"
    ] = 0.0
    stamp_ns: Annotated[Int | None, "Of each sample, shape (N,); None for a log. [ns]"] = None
    method: Method = "irls"
    follows_temperature: Annotated[
        bool,
        "Whether the friction work of minutes that no fit has seen shows that viscous friction "
        "follows the temperature, although the scatter of the samples may hide it.",
    ] = False
    rigid: Annotated[
        Float | None,
        "Rigid motor torque, shape (N,); None where bodies are not modelled. [N m]",
    ] = None
    saturation: Annotated[
        float,
        "Load beyond which friction by load, the first nuisance, rises no further; NaN where it "
        "is none of them. [N m]",
    ] = float("nan")
    exponent: Annotated[float, "Of the speed in viscous friction. [-]"] = 1.0
    exponent_velocity: Annotated[float, "At which it changes nothing. [rad/s]"] = 1.0
    exponent_free: Annotated[
        bool, "Whether the last nuisance is the change of friction by the exponent."
    ] = False
    deviations: Annotated[
        bool, "Whether a fit of it needs them, or only predicts what was held out."
    ] = True

    @property
    def load(self) -> Float | None:
        """Size of the rigid motor torque, shape (N,); None where bodies are not modelled. [N m]"""
        return None if self.rigid is None else np.abs(self.rigid)

    @property
    def sign(self) -> Float:
        """Sign of the velocity, or its smooth form, shape (N,)."""
        if self.smooth_velocity > 0:
            return np.tanh(self.motor_velocity / self.smooth_velocity)
        return np.sign(self.motor_velocity)

    @property
    def turning(self) -> Float:
        """What viscous friction is in proportion to, shape (N,). [rad/s]"""
        if self.exponent == 1.0:
            return self.motor_velocity
        return viscous_velocity(self.motor_velocity, self.exponent, self.exponent_velocity)

    @property
    def loaded(self) -> bool:
        """Whether friction by load is fitted."""
        return not np.isnan(self.saturation)

    def by_load(self, saturation: float) -> FrictionData:
        """Return the samples with friction by load as their first nuisance.

        Args:
            saturation: Load beyond which it rises no further. [N m]
        """
        assert self.load is not None
        column = self.sign * np.minimum(self.load, saturation)
        return replace(
            self, nuisance=np.column_stack([column, self.nuisance]), saturation=saturation
        )

    def by_exponent(self, exponent: float, viscous: Float) -> FrictionData:
        """Return the samples with an exponent, and its change of friction as the last nuisance.

        ``d(fv u)/dq = fv u ln(|w| / wq)`` with ``u = wq sgn(w) (|w| / wq)^q``, so a fit finds how
        far q is off, and the deviations of all figures with q free. wq is the RMS speed, which
        leaves fv what it is without an exponent.

        Args:
            exponent: q. [-]
            viscous: fv at each sample, shape (N,). [N m s/rad]
        """
        velocity = rms_of(self.motor_velocity)
        bent = replace(self, exponent=exponent, exponent_velocity=velocity, exponent_free=True)
        column = viscous * bent.turning * np.log(np.abs(self.motor_velocity) / velocity)
        return replace(bent, nuisance=np.column_stack([self.nuisance, column]))


def friction_data(recordings: Sequence[Recording], joint: int) -> FrictionData:
    """Return one axis of recordings, motor side; the blocks of each are its own.

    Samples are averaged over 0.04 s, both sides of the equation alike, which changes
    nothing in it and makes ten times fewer of them; a span in which the axis stands or
    turns back is left out. Temperatures that hardly any sample has do not count.
    """
    parts: list[FrictionData] = []
    block = 0
    for number, recording in enumerate(recordings):
        part = _of_recording(recording, joint)
        run = np.full(len(part), number)
        parts.append(replace(part, block=part.block + block, run=run))
        block += int(part.block[-1]) + 1 if len(part) else 0
    data = FrictionData.concatenate(parts)
    if np.isfinite(data.motor_temperature_degc).sum() > LACKING * len(data):
        return data
    return replace(data, motor_temperature_degc=np.full(len(data), np.nan))


def _of_recording(recording: Recording, joint: int) -> FrictionData:
    torque, power = recording.torque, recording.power
    speed = torque.motor_velocity[:, joint]
    friction = torque.motor_torque_measured[:, joint] - torque.motor_torque_rigid[:, joint]
    window = contiguous_blocks(torque.stamp_ns, torque.segment, AVERAGED)
    starts = np.flatnonzero(np.diff(window, prepend=-1))
    still = recording.model.joints[joint].standstill_velocity
    turning = np.abs(torque.joint_velocity[:, joint]) > still
    steady = np.abs(averaged(np.sign(speed), window)) == 1.0
    usable = (averaged((turning & recording.sound).astype(np.float64), window) == 1.0) & steady
    block = contiguous_blocks(torque.stamp_ns, torque.segment, BLOCK)[starts]
    sensors = recording.sensors.std
    measured = averaged(torque.motor_torque_measured[:, joint], window)
    rigid = averaged(torque.motor_torque_rigid[:, joint], window)
    # identified bodies have the error of the torque that they come from
    changes = {TORQUE: sensors.torque * (measured - rigid)}
    if not bodies_identified(recording.model):
        changes = {TORQUE: sensors.torque * measured, BODIES: sensors.bodies * rigid}
    smooth = recording.model.joints[joint].friction.smooth_velocity
    return FrictionData(
        recording.model.joint_names[joint],
        np.where(usable, averaged(speed, window), 0.0),
        averaged(friction, window),
        averaged(power.motor_temperature_degc[:, joint], window),
        block,
        np.zeros(len(starts), dtype=np.int64),
        np.empty((len(starts), 0)),
        0.0 if smooth is None else smooth.value,
        tuple(changes),
        np.column_stack([*changes.values()]),
        sensors.thermometer,
        torque.stamp_ns[starts],
        rigid=rigid,
    )


def moving_samples(data: FrictionData) -> FrictionData:
    """Return the samples without rest, slow motion and those with something missing.

    Of many, some that are evenly taken.
    """
    moving = data[moving_rows(data)]
    if len(moving) < MIN_SAMPLES:
        raise NotIdentifiableError(
            f"{data.name} moves in {len(moving)} of {len(data)} samples",
            f"at least {MIN_SAMPLES} in motion",
            "record motions of this joint at several speeds and in both directions",
        )
    return moving[few(len(moving))]


def moving_rows(data: FrictionData) -> NDArray[np.bool_]:
    """Return which samples are in motion and complete, shape (N,)."""
    known = np.isfinite(data.friction_torque) & np.isfinite(data.motor_velocity)
    if not known.any():
        raise NotIdentifiableError(
            f"{data.name} has no measured torque",
            "effort in the joint states",
            "say what it means with --effort",
        )
    warm = np.isfinite(data.motor_temperature_degc)
    if not (known & warm).any():
        warm = known  # without temperatures there is still a constant
    speed = np.abs(data.motor_velocity)
    fastest = float(np.quantile(speed[known], 0.999))
    return known & warm & (speed > SPEED_SHARE * fastest) & (speed > 0)


def bodies_identified(model: RobotModel) -> bool:
    """Whether the bodies of a model come from measured torque."""
    return model.urdf.tags.get("masses") == "derived"


def friction_data_of_log(
    blocks: Sequence[LogBlock], joint_names: Sequence[str], joint: int
) -> FrictionData:
    """Collect one joint from a log of single-joint motions, without a model of its bodies.

    Only rows of steady speed count, in which nothing accelerates. Gravity of the one joint
    that moves is a sine and a cosine of its position, whose sizes are fitted as nuisances;
    that holds while the joints before it stand still. Without positions gravity is noise.

    Returns:
        In the unit of the log's effort, at the joint: relative figures, of use for
        comparing temperatures and laws, not for a model file.
    """
    rows = blocks[0].concatenate(blocks)
    for key, values, column in (
        ("effort", rows.effort, "its torque or current"),
        ("velocity", rows.joint_velocity, "its velocity"),
    ):
        if not np.isfinite(values[:, joint]).any():
            raise LogFormatError(
                f"the log has no {key} of {joint_names[joint]}",
                f"a column of {column}",
                f"name it under joints.{key} in the mapping",
            )
    step = np.diff(rows.stamp_ns, prepend=rows.stamp_ns[0])
    begins = np.abs(step) > APART / NANOSECOND
    if rows.run is not None:
        begins |= np.diff(rows.run, prepend=rows.run[0]) != 0
    run = np.cumsum(begins)
    speed, position = rows.joint_velocity[:, joint], rows.joint_position[:, joint]
    change = np.abs(np.diff(speed))
    limit = STEADY * float(np.nanquantile(np.abs(speed), 0.999))
    steady = np.ones(len(speed), dtype=np.bool_)
    steady[1:] &= change <= limit
    steady[:-1] &= change <= limit
    return FrictionData(
        joint_names[joint],
        np.where(steady, speed, 0.0),
        rows.effort[:, joint],
        rows.motor_temperature_degc[:, joint],
        contiguous_blocks(rows.stamp_ns, run.astype(np.int64), LOG_BLOCK),
        run.astype(np.int64),
        np.stack([np.sin(position), np.cos(position)], axis=1)
        if np.isfinite(position).all()
        else np.empty((len(position), 0)),
    )
